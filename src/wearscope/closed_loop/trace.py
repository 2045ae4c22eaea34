"""Tracing the residual to the effects that the model lacks, one at a time.

At each step every candidate at every joint is fitted beside the current model, all of its parameters with it.
The one with the largest cross-validated gain is taken if it beats the current model on held-out runs, its
score is significant with all candidates tried corrected for, and every run agrees; what the runs cannot
tell apart from it is said beside it. It goes on until nothing passes. Structure that no name explains is then
described by an empirical term, and named effects that the empirical term makes superfluous are taken back.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy import optimize

from wearscope.closed_loop.assessment import is_late, refit, update_prediction
from wearscope.closed_loop.candidates import (
    Family,
    applies,
    candidate_names,
    follows_torque,
    joined_signals,
    make_family,
    reduce_columns,
)
from wearscope.closed_loop.estimation import free_shapes
from wearscope.closed_loop.preparation import Prepared
from wearscope.closed_loop.regression import (
    Entry,
    Folds,
    Regression,
    make_blocks,
    make_folds,
    partial_fit,
)
from wearscope.closed_loop.rest import Rest
from wearscope.closed_loop.scoring import (
    DRIFTS,
    MATERIAL,
    Found,
    Scored,
    Scorer,
    adjust_p_values,
    make_flips,
    separates,
)
from wearscope.closed_loop.whitening import drift_p_value
from wearscope.effects.base import load_effect

#: Share of a joint's held-out loss that no drift has with a signal.
_BEYOND_DOUBT = 0.7
#: Least delay that is believed, in samples.
_LEAST_DELAY = 0.1
#: Effects that a joint can have several of.
_REPEATABLE = frozenset({"torque_ripple", "cross_coupling", "unknown"})


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
class Trace:
    """Outcome of the trace.

    Attributes
    ----------
    found : list of Found
    before, after : Regression
    candidates : list of dict
        One row a candidate and step.
    folds : Folds
    """

    found: list[Found]
    before: Regression
    after: Regression
    candidates: list[dict] = field(default_factory=list)
    folds: Folds | None = None


def declared_entries(prepared: Prepared) -> list[Entry]:
    """Entries of the declared effects that have parameters to fit."""
    fields = prepared.dataset.fields
    entries = []
    joined = joined_signals(prepared.runs_for("train"))
    for name in fields.declared_effects:
        if name == "rigid_body" or (name == "rotor_inertia" and fields.robot.rotor_inertia is not None):
            continue
        effect = load_effect(name)
        for joint in range(prepared.n):
            if not applies(effect, joint, prepared):
                continue
            shapes = effect.shapes(joined, joint)
            subset = effect.subsets()[-1]
            entries.append(
                Entry(effect, joint, tuple(shapes[len(shapes) // 2]), tuple(int(i) for i in subset))
            )
    return entries


def fit_scale(prepared: Prepared, entries: list[Entry], inertial: bool, blocks: list) -> Regression:
    """Regression weighted by the residual scale of each joint."""
    sigma = np.array(
        [
            max(np.std(np.concatenate([r.measured[:, j] for r in prepared.runs_for("train")])), 1e-9)
            for j in range(prepared.n)
        ]
    )
    for _ in range(2):
        model = Regression(prepared, entries, sigma, inertial, blocks)
        sigma = residual_scale(model)
    return Regression(prepared, entries, sigma, inertial, blocks)


def residual_scale(model: Regression) -> np.ndarray:
    """Root mean square residual of each joint over the rows that count."""
    residuals = model.residuals(model.solve())
    total = np.zeros(model.prepared.n)
    count = np.zeros(model.prepared.n)
    for r, w in zip(residuals, model.weights, strict=True):
        total += ((r * (w > 0)) ** 2).sum(axis=0)
        count += (w > 0).sum(axis=0)
    return np.sqrt(np.maximum(total / np.maximum(count, 1), 1e-18))


class Tracer:
    """Names the effects that a prepared data set's declared model lacks.

    Parameters
    ----------
    prepared : Prepared
    options : TraceOptions
    progress : callable
        Called with a line of text at each step.
    """

    def __init__(
        self, prepared: Prepared, options: TraceOptions, progress: Callable[[str], None] = lambda _: None
    ) -> None:
        self.prepared = prepared
        self.options = options
        self.progress = progress
        fields = prepared.dataset.fields
        self.inertial = fields.robot.inertials == "approximate" and "rigid_body" in fields.declared_effects
        self.blocks = make_blocks(prepared)
        self.folds = make_folds(self.blocks)
        self.flips = make_flips(options.flips, len(self.blocks), options.seed)
        self.before = fit_scale(prepared, declared_entries(prepared), self.inertial, self.blocks)
        self.declared = self.before.cross_validate_joints(self.folds)
        self.current = self.declared
        names = candidate_names(fields.declared_effects, fields.robot.rotor_inertia is not None)
        self.joined = joined_signals(prepared.runs_for("train"))
        update_prediction(self.before)
        self.families = [
            make_family(effect, joint, prepared, self.joined)
            for effect in map(load_effect, names)
            for joint in range(prepared.n)
            if applies(effect, joint, prepared)
        ]
        self.rows: list[dict] = []

    def fit(self, entries: list[Entry]) -> Regression:
        """Regression of the declared entries and further ones."""
        return refit(self.before, self.before.entries + entries)

    def score_all(self, model: Regression, families: list[Family]) -> list[Scored]:
        """Score all variants of the families beside a model, p-values adjusted over all of them."""
        update_prediction(model)
        scorer = Scorer(model, self.folds, self.flips)
        self.current = scorer.joint_loss
        named = {(e.effect.name, e.joint): e for e in model.entries}
        scored: list[Scored] = []
        for family in families:
            name = family.effect.name
            present = named.get((name, family.joint))
            if present is not None and name not in _REPEATABLE:
                scored += self.score_extensions(scorer, present)
                continue
            if follows_torque(family):
                family.columns = [
                    reduce_columns(family.effect, family.joint, family.shapes, run)
                    for run in self.prepared.runs_for("train")
                ]
            scored += scorer.score(family)
        adjust_p_values(scored)
        return scored

    def score_extensions(self, scorer: Scorer, present: Entry) -> list[Scored]:
        """Score the further coefficients of richer variants of an effect that is in the model."""
        further = present.effect.richer_subsets(present.subset)
        if not further or is_late(present):
            return []
        shapes = np.array([present.shape])
        columns = [
            reduce_columns(present.effect, present.joint, shapes, run)
            for run in self.prepared.runs_for("train")
        ]
        scored = scorer.score(Family(present.effect, present.joint, shapes, columns), further)
        for s in scored:
            s.extends = True
        return scored

    def left(self, s: Scored) -> float:
        """Held-out loss now over that of the declared model, at the candidate's joint."""
        return float(self.current[s.entry.joint] / self.declared[s.entry.joint])

    def passes(self, s: Scored, least: float, alpha: float) -> bool:
        """Whether a candidate beats the current model at a level; its reason says why not."""
        o = self.options
        if s.reason:
            return False
        if s.p_block > alpha:
            s.reason = "not significant once all candidates are counted"
        elif s.cv_share < least or (
            s.cv_share * self.left(s) < o.minimum_share and not (s.extends and self.folds.agree_by_run)
        ):
            s.reason = "too little gained on held-out runs"
        elif s.entry.effect.name == "time_delay" and abs(s.beta[0]) < _LEAST_DELAY / self.prepared.band.rate:
            s.reason = "less than a tenth of a sample: within what the channels' clocks allow"
        elif s.entry.effect.name == "torque_ripple" and not self.folds.by_run:
            s.reason = "one run cannot show that its phase stays from run to run"
        elif s.p_run > (o.alpha_run if self.folds.agree_by_run else o.alpha_part):
            s.reason = "runs do not agree" if self.folds.agree_by_run else "parts of the run do not agree"
        return not s.reason

    def record(self, step: int, scored: list[Scored], taken: Scored | None) -> None:
        """Keep a row of each candidate for the candidates table."""
        joints = self.prepared.dataset.joints
        for s in scored:
            self.rows.append(
                {
                    "step": step,
                    "joint": joints[s.entry.joint],
                    "effect": s.entry.effect.name,
                    "coefficients": " ".join(s.entry.effect.coefficients[k].name for k in s.entry.subset),
                    "shape": " ".join(f"{v:.6g}" for v in s.entry.shape),
                    "cv_gain": s.cv_share,
                    "p_value": s.p_block,
                    "p_runs": s.p_run,
                    "isolability": s.isolability,
                    "taken": s is taken,
                    "reason": "taken" if s is taken else (s.reason or "another candidate gained more"),
                }
            )

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
        rivals: dict[str, Scored] = {}
        for s in sorted(tied, key=lambda s: -s.cv_gain):
            plain = s is best or cost(s) <= cost(simplest)
            if plain and s.entry.effect.name != simplest.entry.effect.name:
                rivals.setdefault(s.entry.effect.name, s)
        return simplest, list(rivals.values())

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
        beside = self.fit([*model.entries[len(self.before.entries) :], other.entry])
        scorer = Scorer(beside, self.folds, self.flips)
        family = self.family_of(best.entry)
        again = scorer.score(family)
        adjust_p_values(again)
        needed = max(again, key=lambda s: s.cv_gain)
        # A single run repeats too little for what is left of its residual to be a fair measure.
        material = needed.cv_share >= 0.1 if self.folds.by_run else needed.cv_gain >= MATERIAL * best.cv_gain
        return material and needed.p_block <= o.alpha and needed.p_run <= 0.05

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
            width = min(0.3, np.pi / max(np.ptp(self.joined.q[:, entry.joint]), 1e-12) / start[free[0]])
        result = optimize.minimize_scalar(
            loss, bounds=(-width, width), method="bounded", options={"maxiter": 14, "xatol": 1e-4}
        )
        if result.fun < loss(0.0):
            return Entry(entry.effect, entry.joint, tuple(shaped(result.x)), entry.subset)
        return entry

    def run(self) -> Trace:
        """Trace the residual.

        Returns
        -------
        Trace
        """
        o = self.options
        found: list[Found] = []
        model = self.before
        step = 0
        while step < o.most_steps:
            scored = self.score_all(model, self.families)
            taken, rivals = self.choose(model, scored, o.minimum_gain)
            self.record(step, scored, taken)
            step += 1
            if taken is None:
                break
            found = self.add(found, self.refine(model, taken.entry), rivals, taken)
            entry = taken.entry
            self.progress(f"step {step}: {entry.label}, {100 * taken.cv_share:.0f} % of the held-out loss")
            model = self.fit([f.entry for f in found])
        found = self.revise(found)
        found, model = Rest(self).explain(found, step)
        return Trace(found, self.before, model, self.rows, self.folds)

    def add(self, found: list[Found], entry: Entry, rivals: list[Scored], taken: Scored) -> list[Found]:
        """Add an effect to those found, or further coefficients to one of them."""
        for i, f in enumerate(found):
            same = f.entry.effect is entry.effect and f.entry.joint == entry.joint
            if same and entry.effect.name not in _REPEATABLE:
                merged = tuple(sorted({*f.entry.subset, *entry.subset}))
                richer = Entry(entry.effect, entry.joint, f.entry.shape, merged)
                return [*found[:i], Found(richer, f.equivalent, f.scored), *found[i + 1 :]]
        return [*found, Found(entry, [r.entry.effect.name for r in rivals], taken)]

    def revise(self, found: list[Found]) -> list[Found]:
        """Ask of each effect again, with all later ones in the model, whether it is needed and the best."""
        for f in list(found):
            others = [k for k in found if k is not f]
            model = self.fit([k.entry for k in others])
            joint = f.entry.joint
            nearby = [
                family
                for family in self.families
                if family.joint == joint or family.effect.spread or f.entry.effect.spread
            ]
            scored = self.score_all(model, nearby)
            taken, rivals = self.choose(model, scored, self.options.minimum_gain)
            kin = [s for s in scored if s.entry.effect is f.entry.effect and s.entry.joint == joint]
            own = max(kin, key=lambda s: s.cv_gain)
            needed = own.cv_share >= self.options.minimum_gain
            if taken is None or taken.entry.effect is f.entry.effect:
                better = False
            else:
                better = not needed or self.tells_apart(model, taken, own)
            if better and taken is not None:
                again = Found(self.refine(model, taken.entry), [r.entry.effect.name for r in rivals], taken)
                self.progress(f"{f.entry.label} is replaced by {again.entry.label}")
                found = [again if k is f else k for k in found]
            elif not needed:
                self.progress(f"{f.entry.label} is taken back: not needed beside the others")
                found = others
            elif taken is not None and taken.entry.effect is f.entry.effect:
                shape = self.refine(model, taken.entry).shape
                entry = Entry(f.entry.effect, joint, shape, f.entry.subset)
                again = Found(entry, [r.entry.effect.name for r in rivals], taken)
                found = [again if k is f else k for k in found]
        return found


def touches(a: Entry, b: Entry) -> bool:
    """Whether two entries act on a common joint."""
    return a.joint == b.joint or a.effect.spread or b.effect.spread


def cost(s: Scored) -> int:
    """Complexity of a candidate: coefficients, and shape parameters that were searched."""
    searched = s.entry.effect.search is not None
    return s.size + (1 if searched and s.entry.effect.name != "cross_coupling" else 0)
