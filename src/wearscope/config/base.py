"""What every section of the configuration is, and the kinds of value that several have."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Model = Literal["main", "full", "simplified"]
AskedModel = Literal["main", "full", "simplified", "chosen"]
SurrogateKind = Literal["quadratic", "polynomial_chaos", "gaussian_process", "bent_gaussian_process"]
CellKey = Literal["robot", "cycle", "axis", "fda"]
FactorName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]
Share = Annotated[float, Field(ge=0, le=1)]
Probability = Annotated[float, Field(gt=0, lt=1)]


class Section(BaseModel):
    """A part of the configuration: unknown keys are refused, defaults are filled in."""

    model_config = ConfigDict(extra="forbid", use_attribute_docstrings=True, allow_inf_nan=False)
