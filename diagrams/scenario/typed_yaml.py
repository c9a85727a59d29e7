"""Reads dataclasses from YAML with pydrake's typed reader; errors say how to correct the file."""

import dataclasses as dc
import difflib
import reprlib
import typing
from pathlib import Path

import yaml
from pydrake.common.yaml import yaml_dump, yaml_load, yaml_load_typed

from proxops.systems.common import InputError

# The one in C is ten times as fast, where PyYAML has it.
_Loader: type = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def load_typed(schema: type, tree: dict[str, typing.Any], source: str) -> typing.Any:
    """Makes an instance of the dataclass `schema` from nested dicts.

    Args:
      schema: a dataclass whose fields all have defaults.
      tree: keys and values that differ from the defaults.
      source: the origin of the tree, such as a file name; error messages begin with it.

    Raises:
      InputError: a key is unknown, or a value has the wrong type.
    """
    try:
        _check_tree(schema, tree, source)
        return yaml_load_typed(schema=schema, data=yaml_dump(tree), defaults=schema())
    except InputError:
        raise
    except (
        yaml.YAMLError, RuntimeError, ValueError, TypeError, AssertionError, OverflowError
    ) as error:  # fmt: skip
        raise InputError(f"{source}: {error}") from error


def is_yaml_path(text: str | Path) -> bool:
    """Tells whether a text that may be a name or a path is the path of a YAML file."""
    return str(text).endswith((".yaml", ".yml"))


def read_mapping(path: Path) -> dict[str, typing.Any]:
    """Reads the mapping at the root of a YAML file; tags are kept under the key `_tag`.

    Raises:
      InputError: the file cannot be read, is not YAML, is empty, or does not hold a mapping.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except IsADirectoryError as error:
        raise InputError(f"{path} is a directory; give a YAML file") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file: {error}") from error
    return parse_mapping(text, str(path))


def parse_mapping(text: str, source: str) -> dict[str, typing.Any]:
    """Reads the mapping at the root of a YAML text; tags are kept under the key `_tag`.

    Raises:
      InputError: the text is not YAML, is empty, or does not hold a mapping; the message begins
        with `source`.
    """
    tree = read_yaml(text, source) if text.strip() else None
    if tree is None:
        raise InputError(f"{source} is empty; it needs at least one `key: value` line")
    if not isinstance(tree, dict):
        raise InputError(f"{source} holds a {type(tree).__name__}, not `key: value` lines")
    return tree


def read_yaml(text: str, source: str) -> typing.Any:
    """Reads the plain values in a YAML text; its tags create no objects.

    Raises:
      InputError: the text is not YAML, or it has aliases: a few lines with aliases can stand for
        more values than fit into memory.
    """
    try:
        # Most texts need not be read twice.
        if "*" in text and any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text)):
            raise InputError(
                f"{source} is not YAML that proxops reads: it has an alias, *name; write the values"
            )
        _refuse_twice(text, source)
        found = yaml_load(data=text, private=True)
        _check_keys(found, source)
        return found
    except InputError:
        raise
    except yaml.constructor.ConstructorError as error:
        mark = f" in line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise InputError(
            f"{source} is not YAML{mark}: {error.problem} (a tag such as !TrueState needs a "
            "mapping after it, which may be empty: !TrueState {})"
        ) from error
    except RecursionError as error:
        raise InputError(
            f"{source} is not YAML that proxops reads: it is nested too deeply"
        ) from error
    except Exception as error:  # Impossible values make the reader raise errors of many types.
        raise InputError(f"{source} is not YAML: {' '.join(str(error).split())}") from error


def _check_keys(found: typing.Any, source: str) -> None:
    """Raises `InputError` if a key is no text, such as a number."""
    if isinstance(found, dict):
        for key, value in found.items():
            if not isinstance(key, str):
                raise InputError(
                    f"{source} is not YAML that proxops reads: the key {key} is no text"
                )
            _check_keys(value, source)
    elif isinstance(found, list):
        for value in found:
            _check_keys(value, source)


def _refuse_twice(text: str, source: str) -> None:
    """Raises `InputError` if a mapping has a key twice: the reader would keep the last alone."""
    # The collections that are open: of a mapping its keys so far, and whether a key comes next.
    levels: list[tuple[set[str], bool] | None] = []
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.NodeEvent) and levels and levels[-1] is not None:
            keys, at_key = levels[-1]
            levels[-1] = keys, not at_key
            if at_key and isinstance(event, yaml.ScalarEvent):
                if event.value in keys:
                    raise InputError(
                        f"{source} has the key {event.value!r} twice, again in line "
                        f"{event.start_mark.line + 1}: write it once"
                    )
                keys.add(event.value)
        if isinstance(event, yaml.MappingStartEvent):
            levels.append((set(), True))
        elif isinstance(event, yaml.SequenceStartEvent):
            levels.append(None)
        elif isinstance(event, yaml.CollectionEndEvent):
            levels.pop()


def _check_tree(schema: type, tree: dict[str, typing.Any], source: str, key: str = "") -> None:
    """Raises `InputError` for the first unknown key, wrong tag or value of the wrong type.

    It removes tags from fields that have only one type, because pydrake accepts tags only where a
    field has several.
    """
    where = f"{source}: {key}" if key else source
    fields = {field.name: field.type for field in dc.fields(schema)}
    for name, value in tree.items():
        if name == "_tag":
            continue
        if not fields:
            raise InputError(f"{where}: {schema.__name__} has no keys, got {str(name)!r}")
        if name not in fields:
            near = difflib.get_close_matches(str(name), fields, n=1, cutoff=0.0)[0]
            raise InputError(
                f"{where}: there is no key {name!r} in {schema.__name__}; the nearest is {near!r}"
            )
        options: list[typing.Any] = list(typing.get_args(fields[name]) or (fields[name],))
        if typing.get_origin(fields[name]) is list:
            options = [fields[name]]
        nested: list[typing.Any] = [option for option in options if dc.is_dataclass(option)]
        path = f"{key}.{name}" if key else name
        if nested and isinstance(value, dict):
            chosen = _choose(nested, value, f"{source}: {path}")
            _check_tree(chosen, value, source, path)
            if str in options:  # pydrake takes a mapping without a tag for a text.
                value["_tag"] = f"!{chosen.__name__}"
        elif not any(fits(value, option) for option in options):
            wanted = "`key: value` lines" if nested else " or ".join(map(in_words, options))
            wanted = f"a text or {wanted}" if nested and str in options else wanted
            if len(nested) > 1:
                wanted += f", or one of {', '.join(f'{_tag(option)} {{}}' for option in nested)}"
            raise InputError(f"{source}: {path} needs {wanted}, got {reprlib.repr(value)}")


def _tag(option: type) -> str:
    """The tag of a dataclass as the documentation writes it."""
    return "!" + option.__name__.removesuffix("Config")


def _choose(options: list[type], tree: dict[str, typing.Any], where: str) -> type:
    """Gives the dataclass that the mapping's tag names; without a tag it gives the first.

    A tag may leave out the `Config` at the end of the class's name.
    """
    names = ["!" + option.__name__ for option in options]
    tag = tree.get("_tag", names[0])
    if tag not in names and f"{tag}Config" in names:
        tag = tree["_tag"] = f"{tag}Config"
    if tag not in names:
        raise InputError(f"{where} cannot be {tag}; choose from {', '.join(map(_tag, options))}")
    if len(options) == 1:
        tree.pop("_tag", None)
    return options[names.index(tag)]


def fits(value: typing.Any, schema: typing.Any) -> bool:
    """Tells whether a YAML value fits the type `schema`; pydrake judges types not named here."""
    if schema is float and isinstance(value, str):  # YAML 1.1 reads 1e3 as text.
        try:
            float(value)
        except ValueError:
            return False
        return True
    if typing.get_origin(schema) is list:
        (item,) = typing.get_args(schema)
        return isinstance(value, list) and all(fits(element, item) for element in value)
    if schema is bool:
        return isinstance(value, bool)
    if schema is float:
        return is_number(value)
    kinds = {int: int, str: str, type(None): type(None)}
    if schema in kinds:
        return isinstance(value, kinds[schema]) and not isinstance(value, bool)
    return not dc.is_dataclass(schema)


def is_number(value: typing.Any) -> typing.TypeGuard[int | float]:
    """Tells whether a value is a number; a truth value is none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def in_words(schema: typing.Any) -> str:
    """What a value of a type is called in messages."""
    words = {
        bool: "true or false",
        float: "a number",
        int: "a whole number",
        str: "a text",
        type(None): "null",
    }
    if typing.get_origin(schema) is list:
        return "a list, each " + in_words(typing.get_args(schema)[0])
    return words.get(schema, str(schema))
