"""Reads dataclasses from YAML with pydrake's typed reader; errors say how to correct the file."""

import dataclasses as dc
import difflib
import reprlib
import typing
from pathlib import Path

import yaml
from pydrake.common.yaml import yaml_dump_typed, yaml_load, yaml_load_typed

from proxops.diagrams.scenario.plain_yaml import TAG, needs_quotes, read_yaml, write_yaml
from proxops.systems.common import InputError, decoded


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
        return yaml_load_typed(schema=schema, data=write_yaml(tree), defaults=schema())
    except InputError:
        raise
    except (
        yaml.YAMLError, RuntimeError, ValueError, TypeError, AssertionError, OverflowError
    ) as error:  # fmt: skip
        raise InputError(f"{source}: {error}") from error


def dump_typed(config: typing.Any) -> str:
    """Gives a dataclass as YAML; `parse_mapping` and `load_typed` make an equal one from it."""
    text = yaml_dump_typed(config, schema=type(config))
    assert text is not None  # pydrake returns None only if it writes to a file.
    if any(map(needs_quotes, _texts(dc.asdict(config)))):
        # pydrake writes them for YAML 1.1, in which a text such as 1e3 needs no quotes.
        return write_yaml(yaml_load(data=text, private=True))
    return text


def _texts(value: typing.Any) -> typing.Iterator[str]:
    """Yields all texts in nested dicts and lists."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _texts(each)


def is_yaml_path(text: str | Path) -> bool:
    """Tells whether a text that may be a name or a path is the path of a YAML file."""
    return str(text).endswith((".yaml", ".yml"))


def read_mapping(path: Path) -> dict[str, typing.Any]:
    """Reads the mapping at the root of a YAML file; tags are kept under the key `_tag`.

    Raises:
      InputError: the file cannot be read, is not YAML, is empty, or does not hold a mapping.
    """
    try:
        text = decoded(path.read_bytes())
    except IsADirectoryError as error:
        raise InputError(f"{path} is a directory; give a YAML file") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error
    if "\0" in text:
        raise InputError(f"{path} is not a text file; give a YAML file")
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


def _check_tree(schema: type, tree: dict[str, typing.Any], source: str, key: str = "") -> None:
    """Raises `InputError` for the first unknown key, wrong tag or value of the wrong type.

    It removes tags from fields that have only one type, because pydrake accepts tags only where a
    field has several.
    """
    where = f"{source}: {key}" if key else source
    fields = {field.name: field.type for field in dc.fields(schema)}
    for name, value in tree.items():
        if name == TAG:
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
                value[TAG] = f"!{chosen.__name__}"
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
    tag = tree.get(TAG, names[0])
    if tag not in names and f"{tag}Config" in names:
        tag = tree[TAG] = f"{tag}Config"
    if tag not in names:
        raise InputError(f"{where} cannot be {tag}; choose from {', '.join(map(_tag, options))}")
    if len(options) == 1:
        tree.pop(TAG, None)
    return options[names.index(tag)]


def fits(value: typing.Any, schema: typing.Any) -> bool:
    """Tells whether a YAML value fits the type `schema`; pydrake judges types not named here."""
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
