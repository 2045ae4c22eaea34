"""The numbers that decide about names and about what is left: all of them, each with its unit and its reason.

The documentation lists them from here: ``docs/closed-loop-reference.md``.
"""

from pydantic import BaseModel, ConfigDict, Field


class Policy(BaseModel):
    """Numbers of the score and of the test of what is left; written to ``verdict.json`` with the version."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    form_error: float = Field(0.01, ge=0, lt=1)
    """Share of the loss (variance) that a joint's standard model leaves, below which models are hardly told
    apart: no machine follows a form exactly, and what is small next to a large term is its form."""

    most_rows: float = Field(250.0, gt=1)
    """Most independent rows that speak for or against a term: with more, each form that is slightly wrong
    would be told from each other one (a coarsened likelihood; Miller and Dunson 2019, JASA 114)."""

    name_odds: float = Field(3.0, ge=0)
    """Prior odds against one more name, or an offset, in nats: 20 to 1. Names whose odds are within it of the
    best one's are equivalent."""

    unknown_odds: float = Field(4.0, ge=0)
    """Further odds against structure without a name, in nats: 55 to 1. Twice these over the number of
    recordings speak against what goes with time or temperature, which a drift does too, and by its constant
    share against every other term, since a drift has a level. In a single recording twice these speak against
    what another joint drives: joints start and stop together."""

    structure_share: float = Field(0.2, gt=0, lt=1)
    """Least share of the variance left at a joint for structure without a name to be added, and for the joint
    to be `unexplained`: less is a tenth of the RMS error."""

    unknown_level: float = Field(0.001, gt=0, lt=1)
    """p-value at which what is left depends on the motion, over all signals tried."""

    flips: int = Field(999, ge=99)
    """Surrogates of what is left; the least p-value is one over them."""

    seed: int = Field(20260, ge=0)
    """Of the surrogates."""
