"""The outcome of a search: named terms, the models before and after, and what is left at each joint."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import pandas as pd

from wearscope.closed_loop.diagnostics.error_change import ErrorChange
from wearscope.closed_loop.diagnostics.structure import JointState
from wearscope.closed_loop.inference.answer import Answer
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.inference.status import Marked
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.correction import make_corrected_model
from wearscope.closed_loop.model.estimation import Estimate, estimate
from wearscope.closed_loop.model.events import Event
from wearscope.closed_loop.model.prediction import Predicted, predict_runs
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.robots.model import RobotModel


@dataclass(frozen=True)
class Attribution:
    """A named term with its status, equivalents and evidence.

    Attributes
    ----------
    term : ModelTerm
    share : float
        Of its joint's held-out loss that it removes.
    probability : float
        Of its name, among all that were tried in its place and none.
    equivalent : list of str
        Other names in its confidence set.
    marked : Marked
        What the test runs say.
    withdrawn : str
        Why the corrected model does not have it; empty where it does.
    """

    term: ModelTerm
    share: float
    probability: float
    equivalent: list[str]
    marked: Marked
    withdrawn: str

    @property
    def kept(self) -> bool:
        """Whether the corrected model has it."""
        return not self.withdrawn


@dataclass(frozen=True)
class Outcome:
    """What a search and the test runs say of a data set.

    Attributes
    ----------
    prepared : Prepared
    policy : Policy
        Numbers of the score.
    attributions : list of Attribution
    before, proposed, after : Regression
        The declared model refitted; the same with all named terms, which come last; the same with those that
        make no joint's error on the test runs larger (`withdraw_worse`).
    states : list of JointState
        What is left at each joint.
    error_changes : list of ErrorChange
        What became of each joint's error.
    notes : list of str
        On parameters beyond what is possible, and on inertias that are no name.
    problem : Problem
    limits : list of dict of str to float
        By joint, below which share of its torque (RMS) each effect gets no name.
    answer : Answer
        The search's.
    events : list of dict
        Short events, as ``verdict.json`` has them, whose rows are left out.
    late : sequence of Attribution
        Delays by which channels were moved.
    contradictory : list of str
        Training runs that contradict the others.
    """

    prepared: Prepared
    policy: Policy
    attributions: list[Attribution]
    before: Regression
    proposed: Regression
    after: Regression
    states: list[JointState]
    error_changes: list[ErrorChange]
    notes: list[str]
    problem: Problem = field(repr=False)
    limits: list[dict[str, float]]
    answer: Answer = field(repr=False)
    events: list[Event] = field(default_factory=list)
    late: Sequence[Attribution] = ()
    contradictory: list[str] = field(default_factory=list)

    @property
    def candidates(self) -> pd.DataFrame:
        """Every candidate conditional on the first and on the last model."""
        return self.answer.candidates

    @cached_property
    def predicted(self) -> list[Predicted]:
        """Torque of both models along every run."""
        return predict_runs(self.prepared, self.before, self.after)

    @cached_property
    def estimates(self) -> dict[str, list[Estimate]]:
        """Parameters with intervals of the models ``before``, ``proposed`` and ``after``."""
        return {stage: estimate(getattr(self, stage)) for stage in ("before", "proposed", "after")}

    @cached_property
    def models(self) -> dict[str, RobotModel]:
        """Models ``before`` and ``after`` as the simulator loads them."""
        regressions = {"before": self.before, "after": self.after}
        return {
            stage: make_corrected_model(self.prepared, model, self.estimates[stage], stage)
            for stage, model in regressions.items()
        }
