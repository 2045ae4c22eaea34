"""The outcome of a search: named terms, the models before and after, and what they predict."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import pandas as pd

from wearscope.closed_loop.diagnostics.contradictions import Contradiction
from wearscope.closed_loop.diagnostics.error_change import (
    ErrorChange,
    measure_error_change,
    withhold_judgement,
)
from wearscope.closed_loop.diagnostics.loads import tell_loads, tell_masses, tell_other_loads
from wearscope.closed_loop.diagnostics.structure import JointState, judge_joints
from wearscope.closed_loop.inference.answer import Answer, Left
from wearscope.closed_loop.inference.detection_limits import tell_limits
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.inference.status import Marked
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.correction import make_corrected_model
from wearscope.closed_loop.model.estimation import Estimate, estimate
from wearscope.closed_loop.model.events import Event
from wearscope.closed_loop.model.possible import Impossible
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
        Share of its joint's held-out loss that it removes.
    probability : float
        Probability of its name against all others that were tried in its place, and against none.
    equivalent : list of str
        Other names in its confidence set.
    marked : Marked
        Its status by the test runs.
    withdrawn : str
        Why the corrected model lacks it; empty where it has it.
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
    """Result of the search and of the test runs for a data set.

    Attributes
    ----------
    prepared : Prepared
    policy : Policy
        Numbers of the score.
    attributions : list of Attribution
    before, proposed, after : Regression
        The declared model refitted; the same with all named terms, which come last; the same with those that
        make no joint's error on the test runs larger (`withdraw_worse`).
    problem : Problem
    answer : Answer
        Answer of the search.
    contradictions : dict of int to Contradiction
        By joint, training runs that contradict the others.
    impossible : list of Impossible
        Parameters beyond what is possible, which are held at the limit.
    helped : list of ModelTerm
        Inertias added at joints whose error a named body alone makes larger; they are no names.
    events : list of dict
        Short events, as ``verdict.json`` has them, whose rows are left out.
    late : sequence of Attribution
        Delays by which channels were moved.
    """

    prepared: Prepared
    policy: Policy
    attributions: list[Attribution]
    before: Regression
    proposed: Regression
    after: Regression
    problem: Problem = field(repr=False)
    answer: Answer = field(repr=False)
    contradictions: dict[int, Contradiction]
    impossible: list[Impossible]
    helped: list[ModelTerm]
    events: list[Event] = field(default_factory=list)
    late: Sequence[Attribution] = ()

    @property
    def candidates(self) -> pd.DataFrame:
        """Table of every candidate, as scored next to the first and next to the last model."""
        return self.answer.candidates

    @cached_property
    def predicted(self) -> list[Predicted]:
        """Torque of both models along every run."""
        return predict_runs(self.prepared, self.before, self.after)

    @cached_property
    def error_changes(self) -> list[ErrorChange]:
        """Change of each joint's error on the test runs."""
        return measure_error_change(self.prepared, self.predicted)

    @cached_property
    def states(self) -> list[JointState]:
        """State of each joint, by what the corrected model leaves there."""
        here = [a.term for a in self.attributions if a.kept]
        gone = [(a.term, a.share, a.withdrawn) for a in self.attributions if not a.kept]
        left = self.answer.left | {
            j: Left(
                one.share, [], f"training runs contradict each other: {', '.join(one.files)} and the others"
            )
            for j, one in self.contradictions.items()
        }
        states = judge_joints(self.prepared, self.after, here, left, self.policy, gone)
        states = withhold_judgement(self.prepared, states, self.error_changes)
        suspected = self.answer.suspected
        return [s if s.reason else replace(s, reason=suspected.get(s.joint, "")) for s in states]

    @cached_property
    def far_links(self) -> tuple[list[str], str]:
        """Joints whose links were refitted far from the URDF, and a sentence; both empty without any."""
        return tell_masses(self.after, self.policy.most_rows)

    @cached_property
    def notes(self) -> list[str]:
        """Sentences on loads, limits, names that are too uncertain, and impossible parameters."""
        joints, here = self.prepared.dataset.joints, [a.term for a in self.attributions if a.kept]
        notes = tell_loads(self.prepared, self.predicted, self.after) + tell_limits(
            self.answer.limits, joints
        )
        notes += tell_other_loads(self.after, here) + list(filter(None, [self.far_links[1]]))
        notes += [f"{joints[j]}: {told}." for j, told in self.answer.suspected.items()]
        notes += [one.describe(joints) for one in self.impossible]
        return notes + [
            f"{joints[term.joint]}: the named body alone makes its error larger; the corrected "
            "model gives its drive an inertia of its own, which is no name."
            for term in self.helped
        ]

    @cached_property
    def estimates(self) -> dict[str, list[Estimate]]:
        """Parameters with intervals of the models ``before``, ``proposed`` and ``after``."""
        stages = ("before", "proposed", "after")
        return {stage: estimate(getattr(self, stage), most_rows=self.policy.most_rows) for stage in stages}

    @cached_property
    def models(self) -> dict[str, RobotModel]:
        """Models ``before`` and ``after`` as the simulator loads them."""
        regressions = {"before": self.before, "after": self.after}
        return {
            stage: make_corrected_model(self.prepared, model, self.estimates[stage], stage)
            for stage, model in regressions.items()
        }
