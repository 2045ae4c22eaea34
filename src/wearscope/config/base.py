"""What every section of the configuration is, and the kinds of value that several have."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Model = Literal["main", "full", "simplified"]
AskedModel = Literal["main", "full", "simplified", "chosen"]
SurrogateKind = Literal["quadratic", "polynomial_chaos", "gaussian_process", "bent_gaussian_process"]
CellKey = Literal["robot", "cycle", "axis", "fda"]
_FACTOR_NAME, _NAME = r"^[A-Za-z][A-Za-z0-9_]*$", r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"
#: What the patterns of names ask for, in words.
PATTERNS = {
    _FACTOR_NAME: "starts with a letter from A to Z and holds only letters, digits and '_'",
    _NAME: "starts with a letter from A to Z or a digit and holds only letters, digits, '_', '-' and '.'",
}
#: Columns of the study's tables, which no factor can be called.
KEYS = ("set", "point", "robot", "cycle", "axis", "fda", "factor", "y", "status")
#: Folders below ``results/`` that hold something else than a study.
TAKEN = ("archive", "closed_loop", "detection", "export", "tracking")
FactorName = Annotated[str, Field(pattern=_FACTOR_NAME, max_length=100)]
Name = Annotated[str, Field(pattern=_NAME, max_length=100)]
Share = Annotated[float, Field(ge=0, le=1)]
Probability = Annotated[float, Field(gt=0, lt=1)]


class Section(BaseModel):
    """A part of the configuration: unknown keys are refused, defaults are filled in."""

    model_config = ConfigDict(extra="forbid", use_attribute_docstrings=True, allow_inf_nan=False)
