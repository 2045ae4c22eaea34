"""Which of the scored candidates gives the name, and what stands beside it."""

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from wearscope.closed_loop.model.prediction import refit
from wearscope.closed_loop.model.blocks import Folds
from wearscope.closed_loop.model.candidates import Family, joined_signals, reduce_columns
from wearscope.closed_loop.model.estimation import free_shapes
from wearscope.closed_loop.intake.preprocessing import Prepared
from wearscope.closed_loop.model.regression import Entry, Regression, partial_fit
from wearscope.closed_loop.selection.evidence import DRIFTS, MATERIAL, Scored, Scorer, adjust_p_values, separates
from wearscope.closed_loop.selection.whitening import drift_p_value

#: Share of a joint's held-out loss that no drift has with a signal; and no chance.
_BEYOND_DOUBT, _BEYOND_CHANCE = 0.7, 0.5
#: Least delay that is believed, in samples.
_LEAST_DELAY = 0.1
_DISAGREE = ("runs do not agree", "parts of the run do not agree")


@dataclass(frozen=True)
class TraceOptions:
    """Thresholds of the trace.

    Attributes
    ----------
    alpha : float
        Family-wise level of the block sign-flip test.
    alpha_run, alpha_part : float
        Level of the test that held-out runs agree; that held-out parts of a single run do, which are less
        independent of each other.
    alpha_open : float
        The same where the effect removes most of the loss, and for what may stand beside another name.
    alpha_drift : float
        Family-wise level where what a candidate leaves drifts.
    minimum_gain : float
        Least share of the joint's current loss that a named effect must remove on held-out runs.
    minimum_share : float
        The same, of the loss that the declared model leaves.
    alpha_unknown : float
        Level for the empirical term, which can be anything: more than all of 999 random signs give.
    least_unknown, minimum_unknown : float
        Least share of the current loss that it must remove on held-out runs; the same of the loss that the
        declared model leaves.
    flips : int
    seed : int
    """

    alpha: float = 0.005
    alpha_run: float = 0.0025
    alpha_part: float = 1e-4
    alpha_open: float = 0.05
    alpha_drift: float = 0.001
    minimum_gain: float = 0.08
    minimum_share: float = 0.02
    alpha_unknown: float = 0.001
    least_unknown: float = 0.1
    minimum_unknown: float = 0.06
    flips: int = 999
    seed: int = 20260
    most_steps: int = 12


@dataclass
class Choice:
    """Chooses among scored candidates.

    Attributes
    ----------
    prepared : Prepared
    options : TraceOptions
    folds : Folds
    flips : ndarray (F, B)
        Random signs of the blocks.
    families : list of Family
        All candidates.
    declared : ndarray (n,)
        Held-out loss of the declared model by joint.
    """

    prepared: Prepared
    options: TraceOptions
    folds: Folds
    flips: np.ndarray
    families: list[Family]
    declared: np.ndarray

    def left(self, s: Scored) -> float:
        """Held-out loss beside which a candidate was scored over that of the declared model, at its joint."""
        return s.joint_loss / float(self.declared[s.entry.joint])

    def passes(self, s: Scored, least: float, alpha: float) -> bool:
        """Whether a candidate beats the current model at a level; its reason says why not."""
        o = self.options
        if s.reason:
            return False
        if s.p_block > alpha and not self.is_local(s):
            s.reason = "not significant once all candidates are counted"
        elif s.cv_share < least or (
            s.cv_share * self.left(s) < o.minimum_share and not (s.extends and self.folds.agree_by_run)
        ):
            s.reason = "too little gained on held-out runs"
        elif s.entry.effect.name == "time_delay" and abs(s.beta[0]) < _LEAST_DELAY / self.prepared.band.rate:
            s.reason = "less than a tenth of a sample: within what the channels' clocks allow"
        elif s.entry.effect.name == "torque_ripple" and not self.folds.by_run:
            s.reason = "one run cannot show that its phase stays from run to run"
        elif s.p_run > self.level_of_agreement(s):
            s.reason = _DISAGREE[not self.folds.agree_by_run]
        return not s.reason

    def level_of_agreement(self, s: Scored) -> float:
        """Level of the test that runs agree, nearly any where whole runs foretell most of another."""
        o = self.options
        if not self.folds.agree_by_run:
            return o.alpha_part
        return o.alpha_open if s.cv_share >= _BEYOND_CHANCE else o.alpha_run

    def is_local(self, s: Scored) -> bool:
        """Whether whole runs foretell most of another and agree on it.

        Random signs cannot show an effect that lies in a few blocks, as a sticking spot or a lost motion
        does: too many of them leave those blocks as they are.
        """
        agree = self.folds.agree_by_run and s.p_run <= self.options.alpha_run
        return agree and s.cv_share >= _BEYOND_DOUBT

    def choose(
        self, model: Regression, scored: list[Scored], least: float
    ) -> tuple[Scored | None, list[Scored]]:
        """Best candidate that passes, the simplest of those like it, and its rivals.

        Returns
        -------
        best : Scored or None
        rivals : list of Scored
            Other effects that the runs cannot tell apart from it, best first.
        """
        able = sorted(
            (s for s in scored if self.passes(s, least, self.options.alpha)), key=lambda s: -s.cv_gain
        )
        while able and not self.stands_out(model, able[0]):
            able[0].reason = DRIFTS
            del able[0]
        if not able:
            return None, []
        best = able[0]
        near = [s for s in able if s.cv_gain > 0.5 * best.cv_gain and touches(s.entry, best.entry)]
        if any(s.entry.effect is not best.entry.effect for s in near):
            for s in near:
                self.sharpen(model, s)
            near.sort(key=lambda s: -s.cv_gain)
            best = next(s for s in near if s is best or self.stands_out(model, s))
        tied = [s for s in near if s is best or not self.tells_apart(model, best, s)]
        tied = [s for s in tied if s is best or self.stands_out(model, s)]
        simplest = self.simplest(tied)
        # A name as simple that gains as much is as good, unless its form misses most of what is left.
        tied += [
            s
            for s in near
            if cost(s) <= cost(simplest)
            and s.cv_gain >= simplest.cv_gain
            and s.entry.joint == best.entry.joint
            and 1.0 - s.cv_share < 2.0 * (1.0 - best.cv_share)
            and not any(s is t for t in tied)
            and self.stands_out(model, s)
        ]
        simplest = self.simplest(tied)
        tied += [s for s in scored if self.is_open(s, best) and not self.tells_apart(model, best, s)]
        rivals: dict[str, Scored] = {}
        for s in sorted(tied, key=lambda s: -s.cv_gain):
            plain = s is best or cost(s) <= cost(simplest)
            if plain and s.entry.effect.name != simplest.entry.effect.name:
                rivals.setdefault(s.entry.effect.name, s)
        return simplest, list(rivals.values())

    def is_open(self, s: Scored, best: Scored) -> bool:
        """Whether a candidate is refused for nothing but runs that agree too little to name it by."""
        return (
            s.reason in _DISAGREE
            and s.p_run <= self.options.alpha_open
            and s.cv_gain > 0.5 * best.cv_gain
            and touches(s.entry, best.entry)
        )

    def simplest(self, tied: list[Scored]) -> Scored:
        """Cheapest of the candidates; among equals a counterbalance that is one, then the largest gain."""
        return min(tied, key=lambda s: (cost(s), not self.balances(s), -s.cv_gain))

    def sharpen(self, model: Regression, s: Scored) -> None:
        """Take a candidate's shape from the grid to its best continuous value, its significance kept."""
        entry = self.refine(model, s.entry)
        if entry.shape == s.entry.shape:
            return
        columns = [
            reduce_columns(entry.effect, entry.joint, np.array([entry.shape]), run)
            for run in self.prepared.runs_for("train")
        ]
        family = Family(entry.effect, entry.joint, np.array([entry.shape]), columns)
        finer = Scorer(model, self.folds, self.flips).score(family, [np.array(entry.subset)])[0]
        if finer.cv_gain > s.cv_gain:
            s.entry, s.beta = finer.entry, finer.beta
            s.cv_gain, s.cv_share, s.cv_loss = finer.cv_gain, finer.cv_share, finer.cv_loss

    def stands_out(self, model: Regression, s: Scored) -> bool:
        """Whether a candidate is significant, all of them counted, beside a drift of what it leaves."""
        if not self.folds.agree_by_run or s.cv_share >= _BEYOND_DOUBT:
            return True
        p_value = drift_p_value(model, s.entry, self.flips)
        return p_value * len(self.families) <= self.options.alpha_drift

    def tells_apart(self, model: Regression, best: Scored, other: Scored) -> bool:
        """Whether the runs tell the best candidate from another one.

        They do if held-out losses differ outside their noise, or if the best still gains significantly with
        the other one in the model.
        """
        o = self.options
        if best.entry.effect is other.entry.effect:
            return other.cv_gain < 0.9 * best.cv_gain
        if separates(best.cv_loss, other.cv_loss, MATERIAL * best.cv_gain):
            return True
        beside = refit(model, [*model.entries, other.entry])
        scorer = Scorer(beside, self.folds, self.flips)
        family = self.family_of(best.entry)
        again = scorer.score(family)
        adjust_p_values(again)
        needed = max(again, key=lambda s: s.cv_gain)
        # A single run repeats too little for what is left of its residual to be a fair measure.
        material = needed.cv_share >= 0.1 if self.folds.by_run else needed.cv_gain >= MATERIAL * best.cv_gain
        return material and needed.p_block <= o.alpha and needed.p_run <= o.alpha_open

    def family_of(self, entry: Entry) -> Family:
        """Candidate family that an entry was chosen from."""
        return next(f for f in self.families if f.effect.name == entry.effect.name and f.joint == entry.joint)

    def balances(self, s: Scored) -> bool:
        """Whether a counterbalance does what one is built for: take gravity's load off the joint."""
        if s.entry.effect.name != "gravity_counterbalance":
            return False
        joint, opposed, scale = s.entry.joint, 0.0, 0.0
        for run in self.prepared.runs_for("train"):
            torque = s.entry.columns(run)[:, joint] @ s.beta
            still = np.zeros_like(run.signals.q)
            gravity = run.signals.rigid_body.inverse_dynamics(run.signals.q, still, still)[:, joint]
            opposed += float(torque @ gravity)
            scale += float(np.linalg.norm(torque) * np.linalg.norm(run.signals.load[:, joint]))
        # Where gravity gives nothing but round-off there is nothing to balance.
        return opposed < -1e-6 * scale

    def refine(self, model: Regression, entry: Entry) -> Entry:
        """Best continuous shape of an entry beside a model, from its grid value."""
        free = free_shapes(entry)
        if not free or entry.effect.name == "unknown":
            return entry
        train = self.prepared.runs_for("train")
        start = np.array(entry.shape)

        def shaped(x: float) -> np.ndarray:
            shape = start.copy()
            shape[free[0]] = start[free[0]] * np.exp(x)
            return shape

        def loss(x: float) -> float:
            columns = [reduce_columns(entry.effect, entry.joint, shaped(x)[None], run) for run in train]
            family = model.correlate(columns, entry.joint, len(entry.effect.coefficients))
            return -float(partial_fit(model, family.select(np.array(entry.subset))).gain[0])

        width = 0.8
        if entry.effect.name == "torque_ripple":
            travel = np.ptp(joined_signals(train).q[:, entry.joint])
            width = min(0.3, np.pi / max(travel, 1e-12) / start[free[0]])
        result = optimize.minimize_scalar(
            loss, bounds=(-width, width), method="bounded", options={"maxiter": 14, "xatol": 1e-4}
        )
        if result.fun < loss(0.0):
            return Entry(entry.effect, entry.joint, tuple(shaped(result.x)), entry.subset)
        return entry


def touches(a: Entry, b: Entry) -> bool:
    """Whether two entries act on a common joint."""
    return a.joint == b.joint or a.effect.spread or b.effect.spread


def cost(s: Scored) -> int:
    """Complexity of a candidate: coefficients, and shape parameters that were searched."""
    searched = s.entry.effect.search is not None
    return s.size + (1 if searched and s.entry.effect.name != "cross_coupling" else 0)
