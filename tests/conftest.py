"""What holds for all tests."""

import signal

# Started in the background by a shell, all this and what it starts would not hear of Ctrl-C.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
