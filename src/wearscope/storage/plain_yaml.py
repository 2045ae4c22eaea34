"""The only reader of YAML: it takes plain values of bounded size, and refuses a key that is given twice."""

import re
from datetime import date
from typing import Any

import yaml

from wearscope import limits
from wearscope.errors import InputError, explain_yaml, tell_error

#: Allowed tags; any other would create more than a text, number, list or mapping.
_TAGS = {f"tag:yaml.org,2002:{name}" for name in ("str", "int", "float", "bool", "null", "map", "seq")}
#: Errors that PyYAML's constructors raise for a malformed value.
_NO_VALUE = (ValueError, TypeError, KeyError, AttributeError, IndexError, OverflowError, RecursionError)
_NUMBER = re.compile(
    r"[-+]?(0b[01_]+|0x[0-9a-fA-F_]+|[0-9][0-9_:]*(\.[0-9_]*)?([eE][-+]?[0-9]+)?|\.[0-9_]+([eE][-+][0-9]+)?)"
)
_Fast: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_Fast):
    """YAML loader that refuses a key given twice in a mapping; PyYAML would silently keep the last value."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> Any:
        keys: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in keys:
                    raise _refuse(f"'{key.value[:80]}' stands twice, keep one of them", key.start_mark)
                keys.add((key.tag, key.value))
        return super().construct_mapping(node, deep)


def take_label(value: Any) -> Any:
    """Return a name or label as text, since YAML reads one such as 2024-05-01 as a date."""
    return value.isoformat() if isinstance(value, date) else value


def load_plain_yaml(text: str) -> Any:
    """Return the content of a YAML text.

    Raises
    ------
    yaml.YAMLError
        If the text is no YAML or exceeds `wearscope.limits`, a key is given twice, an alias has no anchor, or
        a tag asks for more than plain values.
    """
    _check_bounds(text)
    try:
        return yaml.load(text, _Loader)
    except _NO_VALUE as error:
        raise yaml.YAMLError(f"a value in it is none of its kind ({tell_error(error)})") from None


def read_mapping(content: str | bytes, where: str, remedy: str = "correct it") -> dict[str, Any]:
    """Return the content of a YAML text that holds a mapping.

    Parameters
    ----------
    content : str or bytes
    where : str
        Name of the text in messages, such as its file.
    remedy : str
        What the user can do, for messages.

    Raises
    ------
    InputError
        If the content is not UTF-8, no YAML (see `load_plain_yaml`), or no mapping.
    """
    try:
        fields = load_plain_yaml(content if isinstance(content, str) else content.decode())
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{where}: is not readable YAML ({explain_yaml(error)}); {remedy}.") from None
    if not isinstance(fields, dict):
        raise InputError(f"{where}: holds no mapping of fields, as 'name: value'; {remedy}.")
    return fields


def _check_bounds(text: str) -> None:
    """Refuse a YAML text with too many values or levels before any is created; an alias counts as a copy."""
    if len(text) > limits.YAML_BYTES:
        raise yaml.YAMLError(f"it holds more than {limits.YAML_BYTES} characters")
    count = 0
    copies: dict[str, tuple[int, int]] = {}  # by anchor: number of values and of levels
    opened: list[list[Any]] = [[None, 0, 0]]  # each open collection: anchor, values before it, levels in it
    for event in yaml.parse(text, _Fast):
        values, levels = 1, 0
        if isinstance(event, yaml.CollectionEndEvent):
            anchor, before, levels = opened.pop()
            values, levels = 0, levels + 1
            copies[anchor] = count - before, levels
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in copies:
                raise _refuse(f"alias '{event.anchor[:40]}' is of nothing before it", event.start_mark)
            values, levels = copies[event.anchor]
        elif isinstance(event, yaml.NodeEvent):
            _check_event(event)
        else:
            continue
        count += values
        opened[-1][2] = max(opened[-1][2], levels)
        if isinstance(event, yaml.CollectionStartEvent):
            opened.append([event.anchor, count - 1, 0])
        elif isinstance(event, yaml.ScalarEvent) and event.anchor:
            copies[event.anchor] = 1, 0
        if len(opened) + levels > limits.YAML_DEPTH:
            raise _refuse(f"nested too deeply, more than {limits.YAML_DEPTH} levels", event.start_mark)
        if count > limits.YAML_VALUES:
            raise _refuse(f"more than {limits.YAML_VALUES} values with its aliases", event.start_mark)


def _check_event(event: Any) -> None:
    """Refuse a tag that is not in `_TAGS`, and a number with too many characters."""
    if event.tag not in (None, "!") and event.tag not in _TAGS:
        told = f"a tag '{event.tag[:40]}', which asks for more than plain values"
        raise _refuse(told, event.start_mark)
    if isinstance(event, yaml.ScalarEvent) and len(event.value) > limits.NUMBER_LENGTH:
        plain = event.implicit[0] if event.tag is None else event.tag != "tag:yaml.org,2002:str"
        if plain and _NUMBER.fullmatch(event.value):
            raise _refuse(f"a number of more than {limits.NUMBER_LENGTH} characters", event.start_mark)


def _refuse(told: str, mark: Any) -> yaml.YAMLError:
    """Return the error with a message and a position in the text."""
    return yaml.MarkedYAMLError(None, None, told, mark)
