"""Reads a configuration, and states each error in it in one sentence."""

import difflib
import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from wearscope import limits
from wearscope.config.sections import PATTERNS
from wearscope.config.study import StudyConfig
from wearscope.errors import InputError

#: Settings that earlier releases had, and that archived configurations may still hold.
RETIRED = (
    "attribution_board",
    *(
        f"closed_loop.policy.{name}"
        for name in (
            "agreeing alike away beyond_chance beyond_doubt cancels family_level fewest_blocks informing "
            "large_share material_alone material_apart material_share material_torque material_whole "
            "most_terms set_level slow standard_share told_apart unexpected unknown_share zero_level"
        ).split()
    ),
)


def drop_retired(mapping: Mapping[str, Any], section: str = "") -> dict[str, Any]:
    """Return an archived configuration without the settings that only earlier releases had."""
    return {
        name: drop_retired(value, f"{section}{name}.") if isinstance(value, Mapping) else value
        for name, value in mapping.items()
        if f"{section}{name}" not in RETIRED
    }


def load_config(mapping: Mapping[str, Any]) -> StudyConfig:
    """Validate a configuration and fill in its defaults.

    Parameters
    ----------
    mapping : mapping
        Content of the YAML file. Numbers may be text, as YAML reads ``1e-3`` as text.

    Raises
    ------
    InputError
        Where a field is wrong. The sentence names the first such field, the error and a valid value.
    """
    try:
        study = StudyConfig.model_validate(dict(mapping))
        if told := next(list_excesses(study.model_dump()), ""):
            raise InputError(told)
        return study
    except ValidationError as error:
        raise InputError(_explain(error)) from error


def list_breaches(mapping: Mapping[str, Any]) -> list[str]:
    """Return a sentence for each error in a configuration; unknown settings come first."""
    if told := list(list_excesses(mapping)):
        return told
    try:
        return list(list_excesses(StudyConfig.model_validate(dict(mapping)).model_dump()))
    except ValidationError as error:
        return [_explain_one(one, "") for one in _order(error)]


def list_excesses(value: Any, path: str = "") -> Iterator[str]:
    """Yield a sentence for each list, text or number of a configuration that exceeds `wearscope.limits`."""
    inner: Iterable[tuple[Any, Any]] = ()
    if isinstance(value, Mapping):
        inner = value.items()
    elif isinstance(value, list | tuple):
        inner = enumerate(value)
    if isinstance(value, Mapping | list | tuple) and len(value) > limits.LIST:
        yield f"config: {path}: has {len(value)} entries, more than {limits.LIST}; give fewer."
    elif isinstance(value, str) and len(value) > limits.TEXT:
        yield f"config: {path}: has {len(value)} characters, more than {limits.TEXT}; shorten it."
    elif isinstance(value, int) and abs(value) > limits.COUNT:
        told = f"{value:.6g}" if abs(value) < limits.NUMBER else f"a number of {value.bit_length()} bits"
        yield f"config: {path}: {told} is larger than {limits.COUNT:g}; give a smaller number."
    elif isinstance(value, float) and abs(value) > limits.NUMBER:
        yield f"config: {path}: {value:.6g} is larger than {limits.NUMBER:g}; give a smaller number."
    else:
        for key, one in inner:
            yield from list_excesses(one, f"{path}.{key}" if path else str(key))


def _explain(error: ValidationError) -> str:
    """Describe the first error, and the number of the others, in one sentence."""
    more = error.error_count() - 1
    return _explain_one(_order(error)[0], f" ({more} more like this)" if more else "")


def _order(error: ValidationError) -> list[Any]:
    """Return the errors with unknown settings first: a missing setting is often a misspelt one."""
    return sorted(error.errors(), key=lambda one: one["type"] != "extra_forbidden")


def _explain_one(breach: Any, tail: str) -> str:
    """Describe an error of pydantic in one sentence that begins with the setting's path."""
    path = ".".join(str(part) for part in breach["loc"] if part != "[key]")
    if breach["type"] == "extra_forbidden":
        known = _known_keys(breach["loc"][:-1])
        close = difflib.get_close_matches(str(breach["loc"][-1]), known, n=1)
        remedy = f"did you mean {close[0]}?" if close else f"known here: {', '.join(known)}."
        return f"config: {path} is no known setting{tail}; {remedy}"
    if breach["type"] == "missing":
        return f"config: {path} is missing{tail}; add it."
    if breach["type"] == "string_pattern_mismatch":
        form = PATTERNS[breach["ctx"]["pattern"]]
        return f"config: {path}: such a name {form}, not {breach['input']!r}{tail}."
    message = breach["msg"].removeprefix("Value error, ")
    where = f"{path}: " if path else ""
    given = "" if breach["type"] == "value_error" else f", not {breach['input']!r}"
    return f"config: {where}{message[0].lower() if where else message[0]}{message[1:]}{given}{tail}."


def _known_keys(path: tuple[int | str, ...]) -> list[str]:
    """Return the keys that the section at `path` has."""
    section: Any = StudyConfig
    for part in path:
        if isinstance(section, type) and issubclass(section, BaseModel):
            section = section.model_fields[str(part)].annotation
        else:  # the name of an entry of a mapping
            section = get_args(section)[1]
    return sorted(section.model_fields)


def make_schema() -> str:
    """Return the JSON Schema of the configuration as text, which is the file `config/schema.json`."""
    return json.dumps(StudyConfig.model_json_schema(), indent=2) + "\n"
