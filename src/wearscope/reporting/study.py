"""Tables and settings of a finished study, from which its report is made."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from wearscope.evaluation.conclusion import Conclusion
from wearscope.evaluation.reevaluation import Reevaluation
from wearscope.evaluation.scope import choose_method
from wearscope.reporting.labels import detector_name, join_words

if TYPE_CHECKING:
    from wearscope.designs.factors import Factor


@dataclass(frozen=True, kw_only=True)
class Study:
    """Tables and settings of a finished study.

    Tables are as the stages write them, and None or empty where the study did not ask for one. `snr` is from
    the surrogate that answers, `paper_snr` from the paper's model (3). `loops` holds ``verdict.json`` by data
    set; the demonstration is called ``twin``, and `planted` is the truth that was planted in it. `figures`
    holds files by name, `sources` the origin of each robot's numbers by robot. `conclusions` has the one
    on all robots together first, then one for each where there are several. `units` are those of the
    detectors' test quantities.
    """

    config: Mapping[str, Any]
    factors: Sequence["Factor"]
    surrogates: pd.DataFrame
    validation: pd.DataFrame
    sensitivity: pd.DataFrame
    snr: pd.DataFrame
    ranking: pd.DataFrame
    scope: pd.DataFrame
    failures: pd.DataFrame
    checks: pd.DataFrame
    failed_simulations: pd.DataFrame = field(
        default_factory=lambda: pd.DataFrame(columns=["robot", "cycle", "set", "point", "reason"])
    )
    audit: pd.DataFrame | None = None
    audit_verdicts: pd.DataFrame | None = None
    audit_answers: pd.DataFrame | None = None
    chosen: pd.DataFrame | None = None
    screening: pd.DataFrame | None = None
    direct: pd.DataFrame | None = None
    mismatch: pd.DataFrame | None = None
    paper_snr: pd.DataFrame | None = None
    reevaluation: Reevaluation | None = None
    loops: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    planted: Mapping[str, Any] | None = None
    figures: Mapping[str, Path] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    sources: Mapping[str, Sequence[str]] = field(default_factory=dict)
    conclusions: Sequence[Conclusion] = ()
    thresholds: pd.DataFrame | None = None
    rankings: pd.DataFrame | None = None
    responses: pd.DataFrame | None = None
    simulated: pd.DataFrame | None = None
    detection: pd.DataFrame | None = None
    friction: pd.DataFrame | None = None
    units: Mapping[str, str] = field(default_factory=dict)

    def factor(self, name: str) -> "Factor":
        """Factor by name."""
        return next(one for one in self.factors if one.name == name)

    def factors_of(self, kind: str) -> list[str]:
        """Names of the nuisance factors of a kind."""
        return [one.name for one in self.factors if one.kind == kind and one.role == "nuisance"]

    def detector_of(self, module: str) -> str | None:
        """Configured name of the first detector that uses a module, None where the study has none."""
        return next((n for n, one in self.config["detectors"].items() if one["use"] == module), None)

    def detector_name(self, code: str) -> str:
        """A detector by what it does and its letter."""
        return detector_name(code, self.config["detectors"][code]["use"])

    def detector_names(self) -> dict[str, str]:
        """Names of the detectors that have an SNR, by letter in order."""
        return {code: self.detector_name(code) for code in sorted(self.snr["fda"].unique())}

    def join_detectors(self, codes: Iterable[str], last: str = "and") -> str:
        """Names of detectors as words of a sentence."""
        return join_words([self.detector_name(code) for code in codes], last)

    def recommended(self) -> str:
        """The detector to use on all robots; empty where there is none."""
        return self.conclusions[0].detector if self.conclusions else ""

    def upper(self) -> list[str]:
        """Detectors that are given the simulator's friction law, and so are upper bounds."""
        return self.conclusions[0].upper if self.conclusions else []

    def withheld(self) -> list[str]:
        """Detectors whose answers to Q-2 and Q-3 are withheld, as the audit contradicts them."""
        table = self.audit_answers
        return [] if table is None else sorted(table.loc[table["answer"] == "withheld", "fda"])

    def exact_scope(self, factor: str) -> pd.DataFrame:
        """Scope rows of one factor by one method, the exact one where it is there."""
        return choose_method(self.scope[self.scope["factor"] == factor])
