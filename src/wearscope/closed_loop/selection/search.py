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

from wearscope.closed_loop.model.prediction import is_late, refit, update_prediction
from wearscope.closed_loop.model.blocks import Folds, make_blocks, make_folds
from wearscope.closed_loop.model.candidates import (
    Family,
    applies,
    candidate_names,
    follows_torque,
    joined_signals,
    make_family,
    reduce_columns,
)
from wearscope.closed_loop.selection.rule import Choice, TraceOptions
from wearscope.closed_loop.model.declared import declared_entries, fit_scale
from wearscope.closed_loop.intake.preprocessing import Prepared
from wearscope.closed_loop.model.regression import Entry, Regression
from wearscope.closed_loop.selection.unexplained import Rest
from wearscope.closed_loop.selection.evidence import Found, Scored, Scorer, adjust_p_values, make_flips
from wearscope.effects.base import load_effect

#: Effects that a joint can have several of.
_REPEATABLE = frozenset({"torque_ripple", "cross_coupling", "unknown"})


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
        names = candidate_names(fields.declared_effects, fields.robot.rotor_inertia is not None)
        self.joined = joined_signals(prepared.runs_for("train"))
        update_prediction(self.before)
        self.families = [
            make_family(effect, joint, prepared, self.joined)
            for effect in map(load_effect, names)
            for joint in range(prepared.n)
            if applies(effect, joint, prepared)
        ]
        self.choice = Choice(prepared, options, self.folds, self.flips, self.families, self.declared)
        self.rows: list[dict] = []

    def fit(self, entries: list[Entry]) -> Regression:
        """Regression of the declared entries and further ones."""
        return refit(self.before, self.before.entries + entries)

    def score_all(self, model: Regression, families: list[Family]) -> list[Scored]:
        """Score all variants of the families beside a model, p-values adjusted over all of them."""
        update_prediction(model)
        scorer = Scorer(model, self.folds, self.flips)
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
            taken, rivals = self.choice.choose(model, scored, o.minimum_gain)
            self.record(step, scored, taken)
            step += 1
            if taken is None:
                break
            found = self.add(found, self.choice.refine(model, taken.entry), rivals, taken)
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
            taken, rivals = self.choice.choose(model, scored, self.options.minimum_gain)
            kin = [s for s in scored if s.entry.effect is f.entry.effect and s.entry.joint == joint]
            own = max(kin, key=lambda s: s.cv_gain)
            needed = own.cv_share >= self.options.minimum_gain
            if taken is None or taken.entry.effect is f.entry.effect:
                better = False
            else:
                better = not needed or self.choice.tells_apart(model, taken, own)
            if better and taken is not None:
                entry = self.choice.refine(model, taken.entry)
                again = Found(entry, [r.entry.effect.name for r in rivals], taken)
                self.progress(f"{f.entry.label} is replaced by {again.entry.label}")
                found = [again if k is f else k for k in found]
            elif not needed:
                self.progress(f"{f.entry.label} is taken back: not needed beside the others")
                found = others
            elif taken is not None and taken.entry.effect is f.entry.effect:
                shape = self.choice.refine(model, taken.entry).shape
                entry = Entry(f.entry.effect, joint, shape, f.entry.subset)
                again = Found(entry, [r.entry.effect.name for r in rivals], taken)
                found = [again if k is f else k for k in found]
        return found
