"""Reads YAML as plain values, by the core schema of YAML 1.2, and writes it for older readers, too.

In YAML 1.2, 010 is ten, and 1e3 is a number. In YAML 1.1 the first is eight and the second a text,
1_000 and 5:23 (5 * 60 + 23) are numbers, yes and off are truth values, and 2020-01-01 is a date.
"""

import re
import typing
from collections.abc import Callable

import yaml
from yaml.composer import Composer
from yaml.constructor import ConstructorError, SafeConstructor

from proxops.systems.common import InputError

TAG = "_tag"
"""The key under which the tag of a mapping is kept."""

_CORE = "tag:yaml.org,2002:"
# The parser in C is ten times as fast, where PyYAML has it. Its composer is not used: a deeply
# nested text overflows its stack.
_BASES: typing.Any = (Composer, yaml.CSafeLoader) if yaml.__with_libyaml__ else (yaml.SafeLoader,)


class _Reader(*_BASES):
    """Makes dicts, lists, texts, numbers, truth values and None."""

    yaml_implicit_resolvers: typing.ClassVar[dict] = {}
    yaml_constructors: typing.ClassVar[dict] = {}
    yaml_multi_constructors: typing.ClassVar[dict] = {}

    def __init__(self, text: str):
        _BASES[-1].__init__(self, text)
        self.anchors = {}

    def compose_node(self, parent: typing.Any, index: typing.Any) -> typing.Any:
        """Refuses aliases: with them a few lines can stand for more values than fit into memory."""
        if self.check_event(yaml.AliasEvent):
            raise _refusal("it has an alias, *name; write the values", self.peek_event())
        return super().compose_node(parent, index)

    def construct_mapping(self, node: typing.Any, deep: bool = False) -> dict[str, typing.Any]:
        """Refuses keys that are no texts, and keys that are there twice."""
        found: dict[str, typing.Any] = {}
        for key_node, value_node in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise _refusal(f"the key {key} is no text", key_node)
            if key in found:
                raise _refusal(f"it has the key {key!r} twice: write it once", key_node)
            found[key] = self.construct_object(value_node, deep)
        return found

    def construct_tagged(self, tag: str, node: typing.Any) -> dict[str, typing.Any]:
        """Makes the dict of a mapping with a tag that is not of the core schema."""
        if not isinstance(node, yaml.MappingNode):
            raise _refusal(
                f"the tag {tag} needs a mapping after it, which may be empty: {tag} {{}}; or write "
                f"{tag.removeprefix('!')} alone",
                node,
            )
        return self.construct_mapping(node, deep=True) | {TAG: tag}


def _refusal(problem: str, at: typing.Any) -> ConstructorError:
    return ConstructorError(None, None, problem, at.start_mark)


def _whole(text: str) -> int:
    return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))


def _real(text: str) -> float:
    return float(re.sub(r"\.(?=inf|nan)", "", text.lower()))


# A whole number of this many digits, hexadecimal ones included, is still a float.
_LONGEST = 200
_FINITE = r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?"
_SCALARS: dict[str, tuple[str, Callable[[str], typing.Any]]] = {
    "null": (r"null|Null|NULL|~|", lambda _: None),
    "bool": (r"true|True|TRUE|false|False|FALSE", lambda text: text.lower() == "true"),
    "int": (r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", _whole),
    "float": (rf"{_FINITE}|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", _real),
}
_PATTERNS = {name: re.compile(rf"(?:{pattern})\Z") for name, (pattern, _) in _SCALARS.items()}


def _add_scalar(name: str, read: Callable[[str], typing.Any]) -> None:
    def construct(reader: typing.Any, node: typing.Any) -> typing.Any:
        text = reader.construct_scalar(node)
        if not _PATTERNS[name].match(text):
            raise _refusal(f"{text!r} has the tag !!{name}, which it is not", node)
        if len(text) > _LONGEST:
            raise _refusal(f"a number has {len(text)} digits", node)
        return read(text)

    _Reader.add_constructor(_CORE + name, construct)
    _Reader.add_implicit_resolver(_CORE + name, _PATTERNS[name], None)


for _name, (_, _read) in _SCALARS.items():
    _add_scalar(_name, _read)
_Reader.add_constructor(f"{_CORE}str", SafeConstructor.construct_yaml_str)
_Reader.add_constructor(f"{_CORE}seq", SafeConstructor.construct_yaml_seq)
_Reader.add_constructor(f"{_CORE}map", SafeConstructor.construct_yaml_map)
_Reader.add_multi_constructor("", _Reader.construct_tagged)


def read_yaml(text: str, source: str) -> typing.Any:
    """Reads the plain values in a YAML text; its tags create no objects.

    Raises:
      InputError: the text is not YAML, or it has aliases, a key that is no text, or a key twice.
        The message begins with `source`.
    """
    complaint = f"{source} is not YAML that proxops reads"
    try:
        return yaml.load(text, Loader=_Reader)
    except yaml.MarkedYAMLError as error:
        parts = [(error.context, error.context_mark), (error.problem, error.problem_mark)]
        found = [
            words if at is None else f"line {at.line + 1}: {words}" for words, at in parts if words
        ]
        raise InputError(f"{complaint}: {'; '.join(found)}") from error
    except RecursionError as error:
        raise InputError(f"{complaint}: it is nested too deeply") from error
    except (yaml.YAMLError, ValueError) as error:  # Control characters; numbers of many digits.
        raise InputError(f"{complaint}: {' '.join(str(error).split())}") from error


class _Writer(yaml.SafeDumper):
    """Puts a text in quotes if YAML 1.1 or YAML 1.2 would take it for something else."""

    def ignore_aliases(self, data: typing.Any) -> bool:
        """Writes a list that is there twice twice."""
        return True


def _represent_dict(writer: typing.Any, data: dict[str, typing.Any]) -> typing.Any:
    untagged = {key: value for key, value in data.items() if key != TAG}
    return writer.represent_mapping(data.get(TAG, f"{_CORE}map"), untagged)


_Writer.add_representer(dict, _represent_dict)
for _name, _pattern in _PATTERNS.items():
    _Writer.add_implicit_resolver(_CORE + _name, _pattern, None)


def write_yaml(tree: typing.Any) -> str:
    """Writes plain values so that readers of YAML 1.1 and of YAML 1.2 find the same.

    Raises:
      yaml.YAMLError: a value is none that `read_yaml` gives.
    """
    return yaml.dump(tree, Dumper=_Writer, default_flow_style=None, sort_keys=False)


def needs_quotes(text: str) -> bool:
    """Tells whether YAML 1.2 takes a text for a number, a truth value or null."""
    return any(pattern.match(text) for pattern in _PATTERNS.values())
