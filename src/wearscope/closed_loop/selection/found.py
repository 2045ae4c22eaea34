"""A term that the search named."""

from collections.abc import Iterable
from dataclasses import dataclass

from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import Evidence
from wearscope.effects.base import Effect


@dataclass(frozen=True, eq=False)
class Found:
    """A term that was named, with the evidence on it beside all others."""

    chosen: Chosen
    evidence: Evidence

    @property
    def effect(self) -> Effect:
        """Its effect."""
        return self.chosen.candidate.effect

    @property
    def joint(self) -> int:
        """Its joint."""
        return self.chosen.candidate.joint


def count_parameters(found: Iterable[Found]) -> int:
    """Parameters of terms together."""
    return sum(f.evidence.complexity for f in found)
