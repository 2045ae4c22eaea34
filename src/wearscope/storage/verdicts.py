"""Reads and checks the ``verdict.json`` of a closed loop, also one from an unknown source."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, Strict, ValidationError

from wearscope import limits
from wearscope.errors import InputError, explain_breach
from wearscope.storage.files import check_shown, read_json

#: A number or null; strict, so that pydantic does not convert a text or a boolean to a number.
_Number = Annotated[float | None, Strict()]
_Name = Annotated[str, Field(max_length=limits.TEXT)]


class _Open(BaseModel):
    """Part of a verdict; its unknown fields are accepted."""

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
    """Read a ``verdict.json``.

    Raises
    ------
    InputError
        If it cannot be read, or its joints and effects are not in the form that a closed loop writes.
    """
    check_shown(path)
    return check_verdict(read_json(path), str(path))


def check_verdict(content: Any, where: str) -> dict[str, Any]:
    """Check the parsed content of a ``verdict.json`` and return it; `where` is its name in the message.

    Raises
    ------
    InputError
        If its joints and effects are not in the form that a closed loop writes.
    """
    try:
        _Verdict.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{where}: is no verdict ({explain_breach(error)}); make it again.") from None
    return dict(content)


def drawn_path(stage: str, number: int) -> str:
    """Return the path, in a closed loop's folder, of a model drawn from the uncertainty of its estimate.

    `stage` is "before" or "after" the correction; `number` counts from 1.
    """
    return f"drawn/{stage}-{number:02d}.yaml"
