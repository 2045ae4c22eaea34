"""Reads ``verdict.json`` to compare and list loops, also a file from someone else; files next to it."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, Strict, ValidationError

from wearscope import limits
from wearscope.errors import InputError, explain_breach
from wearscope.storage.files import check_shown, read_json

#: Neither text nor a truth value is read as a number.
_Number = Annotated[float | None, Strict()]
_Name = Annotated[str, Field(max_length=limits.TEXT)]


class _Open(BaseModel):
    model_config = ConfigDict(extra="allow")


class _Joint(_Open):
    rms_before: _Number = None
    rms_after: _Number = None
    unit: _Name = ""


class _Parameter(_Open):
    ci95: tuple[_Number, _Number] = (None, None)


class _Named(_Open):
    joint: _Name
    effect: _Name
    parameters: dict[str, _Parameter] = {}


class _Verdict(_Open):
    joints: Annotated[dict[_Name, _Joint], Field(max_length=limits.JOINTS)]
    verdict: Annotated[list[_Named], Field(max_length=limits.ENTRIES)]
    estimates: Annotated[list[_Named], Field(max_length=limits.ENTRIES)] = []


def read_verdict(path: str | Path) -> dict[str, Any]:
    """Content of a ``verdict.json``.

    Raises
    ------
    InputError
        Where it cannot be read, or its joints and named effects are not as a loop writes them.
    """
    check_shown(path)
    return check_verdict(read_json(path), str(path))


def check_verdict(content: Any, where: str) -> dict[str, Any]:
    """Content of a ``verdict.json`` that was read; `where` is what the sentence calls it.

    Raises
    ------
    InputError
    """
    try:
        _Verdict.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{where}: is no verdict ({explain_breach(error)}); make it again.") from None
    return dict(content)


def drawn_path(stage: str, number: int) -> str:
    """Path of a drawn model in the folder of its loop; `stage` is before or after, `number` from 1."""
    return f"drawn/{stage}-{number:02d}.yaml"
