"""The one exception that says the user's input, not the program, is at fault."""


class InputError(ValueError):
    """Bad input: the message says what is wrong, where, and what to do about it.

    The command line prints the message alone and exits with code 2.
    """
