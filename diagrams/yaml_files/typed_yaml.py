"""Dataclasses from YAML and back; errors say how to correct the file."""

import dataclasses as dc
import difflib
import reprlib
import types
import typing
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed, yaml_load

from proxops.diagrams.yaml_files.plain_yaml import TAG, needs_quotes, read_yaml, write_yaml
from proxops.systems.common import InputError, decoded

Made = typing.TypeVar("Made")


def load_typed(
    schema: type[Made], tree: typing.Mapping[str, typing.Any], source: str, key: str = ""
) -> Made:
    """Makes an instance of the dataclass `schema` from nested dicts.

    Args:
      schema: a dataclass whose fields all have defaults.
      tree: keys and values that differ from the defaults. Of a field that takes several
        dataclasses, the key `_tag` names one; it may leave out the `Config` at the name's end.
      source: the origin of the tree, such as a file name; error messages begin with it.
      key: the dotted key of the tree in its source.

    Raises:
      InputError: a key is unknown, or a value has the wrong type.
    """
    made = schema()
    fields = {field.name: field.type for field in dc.fields(typing.cast(typing.Any, schema))}
    for name, value in tree.items():
        if name == TAG:
            continue
        where = f"{source}: {key}" if key else source
        if not fields:
            raise InputError(f"{where}: {schema.__name__} has no keys, got {str(name)!r}")
        if name not in fields:
            near = _nearest(str(name), schema)
            raise InputError(
                f"{where}: there is no key {name!r} in {schema.__name__}; the nearest is {near!r}"
            )
        path = f"{key}.{name}" if key else name
        setattr(made, name, _typed(value, fields[name], source, path))
    return made


def leaves(schema: type, prefix: str = "") -> typing.Iterator[tuple[str, dc.Field]]:
    """Yields the dotted keys and the fields of the values of a dataclass and of those in it.

    Of several dataclasses that a section may be, it takes the first.
    """
    for field in dc.fields(typing.cast(typing.Any, schema)):
        if sections := [*sections_of(field.type).values()]:
            yield from leaves(sections[0], f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, field


def _nearest(name: str, schema: type) -> str:
    """The dotted key whose last part is most like a name; of those alike the shortest."""
    keys = [field.name for field in dc.fields(typing.cast(typing.Any, schema))]
    keys += [key for key, _ in leaves(schema)]
    by_name = {key.rpartition(".")[2]: key for key in sorted(keys, key=lambda key: -key.count("."))}
    return by_name[difflib.get_close_matches(name, by_name, n=1, cutoff=0.0)[0]]


def tree_of(config: typing.Any) -> dict[str, typing.Any]:
    """Gives a dataclass as nested dicts, from which `load_typed` makes an equal one."""
    found: dict[str, typing.Any] = {}
    for field in dc.fields(config):
        value = getattr(config, field.name)
        if dc.is_dataclass(value):
            found[field.name] = tree_of(value) | {TAG: f"!{type(value).__name__}"}
        else:
            found[field.name] = [*value] if isinstance(value, list) else value
    return found


def dump_typed(config: typing.Any, defaults: typing.Any = None) -> str:
    """Gives a dataclass as YAML; `parse_mapping` and `load_typed` make an equal one from it.

    What is as in `defaults`, of the same type, is left out.
    """
    text = yaml_dump_typed(config, schema=type(config), defaults=defaults)
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


def file_of(name_or_path: str | Path, shipped: typing.Mapping[str, Path], key: str) -> Path:
    """Gives the file that ships under a name, or the path of a YAML file as it is.

    Args:
      name_or_path: the name or the path.
      shipped: the files that ship, by their names.
      key: what the message begins with.

    Raises:
      InputError: it is no path of a YAML file, and nothing ships under this name.
    """
    if is_yaml_path(name_or_path):
        return Path(name_or_path)
    name = str(name_or_path)
    if name not in shipped:
        raise InputError(
            f"{key}: {name!r} does not ship with proxops ({', '.join(shipped)} do); for your own, "
            "give the path of its .yaml file"
        )
    return shipped[name]


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


def _typed(value: typing.Any, schema: typing.Any, source: str, path: str) -> typing.Any:
    """A value as a field's type takes it.

    Raises:
      InputError: it has another type, or a tag that the field does not take.
    """
    if typing.get_origin(schema) is list and dc.is_dataclass(item := typing.get_args(schema)[0]):
        if not (isinstance(value, list) and all(isinstance(each, dict) for each in value)):
            raise InputError(f"{source}: {path} needs a list of `key: value` lines, got {value!r}")
        schema = typing.cast(type, item)
        return [load_typed(schema, each, source, f"{path}[{k}]") for k, each in enumerate(value)]
    options, sections = _options(schema), sections_of(schema)
    if sections and isinstance(value, dict):
        tag = str(value.get(TAG, f"!{next(iter(sections))}"))
        chosen = sections.get(tag.removeprefix("!").removesuffix("Config"))
        if chosen is None:
            tags = ", ".join(f"!{each}" for each in sections)
            raise InputError(f"{source}: {path} cannot be {tag}; choose from {tags}")
        return load_typed(chosen, value, source, path)
    if isinstance(value, str) and str not in options and value in sections:
        return sections[value]()  # A tag alone, as in --set navigation=TrueState.
    for option in options:
        if not fits(value, option):
            continue
        if option not in (float, list[float]):
            return [*value] if isinstance(value, list) else value
        try:
            return [*map(float, value)] if isinstance(value, list) else float(value)
        except OverflowError as error:
            raise InputError(f"{source}: {path} is a whole number beyond all floats") from error
    wanted = "`key: value` lines" if sections else in_words(schema)
    wanted = f"a text or {wanted}" if sections and str in options else wanted
    if len(sections) > 1:
        wanted += f", or one of {', '.join(sections)}"
    raise InputError(f"{source}: {path} needs {wanted}, got {reprlib.repr(value)}")


def sections_of(schema: typing.Any) -> dict[str, type]:
    """Gives the dataclasses of which a field of a type may hold one, by their tags without `!`."""
    return {
        each.__name__.removesuffix("Config"): each
        for each in _options(schema)
        if isinstance(each, type) and dc.is_dataclass(each)
    }


def _options(schema: typing.Any) -> tuple[typing.Any, ...]:
    """The types of a union; of another type, it alone."""
    return typing.get_args(schema) if isinstance(schema, types.UnionType) else (schema,)


def fits(value: typing.Any, schema: typing.Any) -> bool:
    """Tells whether a YAML value fits the type `schema`, which is no dataclass."""
    if typing.get_origin(schema) is list:
        (item,) = typing.get_args(schema)
        return isinstance(value, list) and all(fits(element, item) for element in value)
    if schema is float:
        return is_number(value)
    return isinstance(value, schema) and (schema is bool or not isinstance(value, bool))


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
    if isinstance(schema, types.UnionType):
        return " or ".join(map(in_words, typing.get_args(schema)))
    if typing.get_origin(schema) is list:
        return "a list, each " + in_words(typing.get_args(schema)[0])
    return words.get(schema, str(schema))
