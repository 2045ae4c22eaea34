"""The problem that a prepared data set poses: torque to explain, declared terms, and all candidates."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy import fft, interpolate

from wearscope.closed_loop.inference.gram import Fit, Gram
from wearscope.closed_loop.inference.layout import Layout
from wearscope.closed_loop.inference.reversal import make_reversal
from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.intake.filtering import low_pass, rows
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.intake.signals import join_signals
from wearscope.closed_loop.model.declared import declared_terms
from wearscope.closed_loop.model.inertials import inertial_penalty
from wearscope.closed_loop.model.joint_flexibility import PASSES, take_out_swing
from wearscope.closed_loop.model.terms import Candidate, ModelTerm, make_candidate
from wearscope.effects.base import (
    Effect,
    MeasurementEffect,
    load_effect,
)
from wearscope.effects.vocabulary import candidate_effects, given_effects

#: Start values for compliances: frequencies at which a link swings against the held motor, over the common
#: cut-off. Below 1 a link answers with the opposite sign within the band.
_SWINGS = (4.0, 2.0, 1.3, 0.9, 0.65, 0.5)
#: Start values for delays, times the common cut-off.
_LAGS = (0.0, 0.08, 0.2, 0.4)
#: Number of ripples that are sought in a joint's residual, and most rows for that.
_PEAKS, _MOST_ROWS = 8, 4000
#: Largest coefficient that is believed, over the one that intake notes.
_AROUND = 1.2


class Problem:
    """A prepared data set with its candidates.

    Parameters
    ----------
    prepared : Prepared
    declared : sequence of Effect
    own : sequence of Effect
        The user's own, candidates in addition to the vocabulary.
    late : sequence of ModelTerm
        Delays that were found, by which channels are moved: what is left of each is fitted as if declared.
    """

    def __init__(
        self,
        prepared: Prepared,
        declared: Sequence[Effect],
        own: Sequence[Effect] = (),
        late: Sequence[ModelTerm] = (),
    ) -> None:
        train = prepared.runs_for("train")
        self.layout = Layout.of(prepared)
        self.known = np.concatenate([run.reduce(run.known) for run in train])
        self.target = np.concatenate([run.measured for run in train]) - self.known
        folds = self.layout.folds
        # Two recordings have a motion of their own each: what is fitted on one may say nothing of the other.
        several = folds.by_run and len(np.unique(folds.recording)) > 2
        self.gram = Gram(self.layout if several else self.layout.by_fifths, self.target)
        fields = prepared.dataset.fields
        self.declared, self.own, self.late = list(declared), list(own), list(late)
        self.inertial = fields.robot.inertials == "approximate"
        stated = {name for name, value in fields.robot if value is not None}
        self.given = given_effects(self.declared, stated)
        fixed = {effect.name for effect in self.given}
        if fields.robot.inertials == "trusted":
            fixed.add("rigid_body")
        self.effects = candidate_effects(self.declared, own, fixed, prepared.n)
        self._take_signals(prepared)
        self._made: dict[tuple, Candidate | None] = {}
        self._waves: dict[tuple[str, int], tuple[np.ndarray, np.ndarray]] = {}
        self._gravity: dict[int, np.ndarray] = {}
        self._reversals: dict[int, Term] = {}
        self._same: set[int] = set()

    @cached_property
    def base(self) -> tuple[Term, ...]:
        """The declared model's terms, inertial deviations first."""
        chosen = [self._deviations] if self.inertial else []
        for term in self.declared_terms:
            candidate = self._make_one(term.effect, term.joint, np.array(term.shape))
            chosen.append(Term(candidate, term.subset))
        for joint in np.flatnonzero(self.prepared.moving & (self.prepared.reversals.width > 0.0)).tolist():
            if joint not in self._reversals:
                self._reversals[joint] = make_reversal(self.prepared, joint)
            chosen.append(self._reversals[joint])
        return tuple(chosen)

    @cached_property
    def _deviations(self) -> Term:
        """Deviations of all inertial parameters, which no direction of motion changes."""
        rows = np.concatenate([run.bodies for run in self.train])
        joints, penalty = tuple(range(self.prepared.n)), inertial_penalty(self.prepared)
        each = tuple(rows[:, j] for j in joints)
        candidate = Candidate(load_effect("rigid_body"), joints[-1], ((),), joints, each, penalty)
        return Term(candidate, tuple(range(len(penalty))))

    def reverse_over(self, reversals: Reversals) -> "Problem":
        """The same problem with other friction reversals; columns that do not depend on them are kept."""
        other = copy(self)
        other.__dict__.pop("base", None)
        same = other._same = set(np.flatnonzero(~reversals.differ(self.prepared.reversals)).tolist())
        other._take_signals(self.prepared.reverse_over(reversals))
        other._made = {key: made for key, made in self._made.items() if _keeps(made, key[1], same)}
        other._reversals = {joint: term for joint, term in self._reversals.items() if joint in same}
        return other

    def _take_signals(self, prepared: Prepared) -> None:
        """Take the signals of a prepared data set."""
        self.prepared = prepared
        self.train = prepared.runs_for("train")
        self.joined = join_signals(run.signals for run in self.train)
        stated = declared_terms(prepared, self.declared, self.given, self.joined)
        self.declared_terms = [*stated, *self.late]

    def remake(self, term: Term) -> Term:
        """A term of a model along this problem's signals; errors of the record and bending are kept."""
        made, shape = term.candidate, np.array(term.model_term.shape)
        if not term.follows_direction or (not made.effect.empirical and _keeps(made, made.joint, self._same)):
            return term
        again = make_candidate(made.effect, made.joint, self.prepared, shape[None])
        if made.effect.empirical:
            again = replace(again, rows=(again.rows[0][:, : len(term.subset)],))
        return replace(term, candidate=replace(again, penalty=made.penalty), shape=0)

    def candidate(self, effect: Effect, joint: int) -> Candidate | None:
        """Candidate of an effect at a joint along the motion; None where the motion cannot show it."""
        key = (effect.name, joint)
        if key not in self._made:
            self._made[key] = self._make(effect, joint)
        return self._made[key]

    def _make(self, effect: Effect, joint: int) -> Candidate | None:
        p = self.prepared
        if not p.moving[joint] or (effect.per_robot and joint != p.n - 1):
            return None
        if not (effect.is_usable(self.joined, joint) and effect.acts_on(p.dataset.position_unit[joint])):
            return None
        if ModelTerm(effect, joint, (), ()).is_deflection and not effect.shape:
            return self._bend(effect, joint)
        made = make_candidate(effect, joint, p, effect.shapes(self.joined, joint))
        return made if made.joints and any(np.any(x) for x in made.rows) else None

    def _bend(self, effect: Effect, joint: int) -> Candidate | None:
        """Compliance about several values: each with the gear's torque solved from the motion alone."""
        s, p, band = self.joined, self.prepared, self.prepared.band
        inertia = float(
            np.mean(np.concatenate([r.signals.load_slopes(joint)[2][:, joint] for r in self.train]))
        )
        if inertia <= 0.0:
            return None
        ((_, upper),) = p.bound(effect.coefficients, joint)
        values = [1.0 / (inertia * (2 * np.pi * f * band.torque) ** 2) for f in _SWINGS]
        values = [c for c in values if c <= upper] or [upper]
        parts: list[list[np.ndarray]] = []
        for run in self.train:
            columns = [_solve_bent(effect, joint, run, c, inertia) for c in values]
            parts.append([run.reduce_columns(x) for x in columns])
        stacked = np.concatenate([np.concatenate(own, axis=-1) for own in parts])
        felt = tuple(j for j in range(s.q.shape[1]) if self.prepared.moving[j] and np.any(stacked[:, j]))
        rows = tuple(np.ascontiguousarray(stacked[:, j]) for j in felt)
        return Candidate(effect, joint, ((),) * len(values), felt, rows)

    def measurement_candidate(self, effect: MeasurementEffect, joint: int, fit: Fit) -> Candidate:
        """Candidate of an error of the recorded torque conditional on a model, which predicts that torque."""
        motor = self.known[:, joint] + fit.predict(joint)
        for term, span in zip(fit.terms, fit.spans, strict=True):
            if isinstance(term.effect, MeasurementEffect) and term.joint == joint:
                motor = motor - term.at_joint(joint) @ fit.theta[span]
        if effect.kind == "gain":
            return Candidate(effect, joint, ((),), (joint,), (motor[:, None],))
        lags = [lag / self.prepared.band.torque for lag in _LAGS]
        lags += [-lag for lag in lags[1:]]
        columns = []
        for run, own in zip(self.train, self.layout.unpack(motor), strict=True):
            spline = interpolate.CubicSpline(run.t, own)
            slope = -spline(run.t, 1)
            late = [spline(np.clip(run.t - lag, run.t[0], run.t[-1])) for lag in lags]
            columns.append(
                np.column_stack(
                    [slope if lag == 0 else (x - own) / lag for x, lag in zip(late, lags, strict=True)]
                )
            )
        return Candidate(effect, joint, ((),) * len(lags), (joint,), (np.concatenate(columns),))

    def periodic_candidate(self, effect: Effect, joint: int, residual: np.ndarray) -> Candidate | None:
        """Candidate of an effect that is periodic in position, at the periods that a residual shows.

        Parameters
        ----------
        effect : Effect
            Its first shape parameter is the wavenumber.
        joint : int
        residual : ndarray (M,)
        """
        p = self.prepared
        if not p.moving[joint]:
            return None
        shapes = effect.shapes(self.joined, joint)
        keep = self.layout.keep[:, joint]
        pick = np.flatnonzero(keep)
        pick = pick[:: max(1, len(pick) // _MOST_ROWS)]
        if len(pick) < 30:
            return None
        if (effect.name, joint) not in self._waves:
            q, v, k = self.at_rows("q")[pick, joint], self.at_rows("v")[pick, joint], shapes[:, 0]
            seen = np.abs(v)[:, None] * k < 2 * np.pi * p.band.torque
            wave = np.exp(1j * q[:, None] * k).astype(np.complex64) * seen
            self._waves[effect.name, joint] = wave, np.maximum(seen.sum(axis=0), 10)
        wave, count = self._waves[effect.name, joint]
        power = np.abs(residual[pick].astype(np.float32) @ wave) ** 2 / count
        rises = np.concatenate([[True], power[1:] >= power[:-1]])
        falls = np.concatenate([power[:-1] >= power[1:], [True]])
        peaks = np.flatnonzero(rises & falls)
        peaks = np.sort(peaks[np.argsort(-power[peaks])][:_PEAKS])
        made = [self._make_one(effect, joint, shapes[k]) for k in peaks]
        named = tuple(one.shapes[0] for one in made)
        columns = np.concatenate([one.rows[0] for one in made], axis=1)
        return replace(made[0], shapes=named, rows=(columns,), tried=max(1.0, len(shapes) / len(peaks)))

    def _make_one(self, effect: Effect, joint: int, shape: np.ndarray) -> Candidate:
        """Candidate of an effect with one shape (k,)."""
        key = (effect.name, joint, shape.tobytes())
        if key not in self._made:
            self._made[key] = make_candidate(effect, joint, self.prepared, shape[None])
        made = self._made[key]
        assert made is not None
        return made

    def gravity(self, joint: int) -> np.ndarray:
        """Torque (M,) of gravity at a joint, at the rows of the training runs."""
        if joint not in self._gravity:
            parts = []
            for run in self.train:
                q = run.signals.q[rows(run.band, len(run.signals.t))]
                still = np.zeros_like(q)
                parts.append(run.signals.rigid_body.inverse_dynamics(q, still, still)[:, joint])
            self._gravity[joint] = np.concatenate(parts)
        return self._gravity[joint]

    def at_rows(self, name: str) -> np.ndarray:
        """A signal (M, n) at the rows of the training runs."""
        return np.concatenate(
            [getattr(run.signals, name)[rows(run.band, len(run.signals.t))] for run in self.train]
        )

    def bounds(self, term: ModelTerm) -> list[tuple[float, float]]:
        """Believable bounds of a term's coefficients at its joint, then of its shape parameters.

        A size that intake notes of the first coefficient is believed.
        """
        effect = term.effect
        parameters = (*(effect.coefficients[k] for k in term.subset), *effect.shape)
        bounds = self.prepared.bound(parameters, term.joint)
        if (effect.name, term.joint) in self.prepared.noted:
            noted = _AROUND * self.prepared.noted[effect.name, term.joint]
            bounds[0] = min(bounds[0][0], noted), max(bounds[0][1], noted)
        return bounds


def _keeps(made: Candidate | None, joint: int, same: set[int]) -> bool:
    """Whether a candidate at a joint stays the same where only the joints of `same` keep their reversals."""
    if made is not None and not made.effect.follows_direction:
        return True
    alone = made is None or (len(made.joints) == 1 and not made.effect.selects_signals)
    return alone and joint in same


def _solve_bent(
    effect: Effect, joint: int, run: PreparedRun, compliance: float, inertia: float
) -> np.ndarray:
    """Regressors (N, n, 1) of a compliance, linear about a value, with the gear's torque that it gives.

    The link's torque solves tau = rigid(motor) + compliance * regressor(tau): a fixed point in the frequency
    domain with the swing of the mean inertia taken out, damped where the link would ring.
    """
    s, band = run.signals, run.band
    rigid = low_pass(s.load, band.gear, band.rate)
    size = fft.next_fast_len(2 * len(s.t))
    square = (2 * np.pi * fft.rfftfreq(size, 1.0 / band.rate)) ** 2
    stiff = 1.0 - square * compliance * inertia
    gain = take_out_swing(stiff)
    through = rigid.copy()
    column = np.empty(0)
    for _ in range(PASSES):
        column = effect.columns(replace(s, transmitted=through), joint, np.zeros(0))
        bent = low_pass(compliance * column[:, joint, 0], band.gear, band.rate)
        left = rigid[:, joint] + bent - through[:, joint]
        through = through.copy()
        through[:, joint] += fft.irfft(fft.rfft(left, size) * gain, size)[: len(left)]
    return effect.columns(replace(s, transmitted=through), joint, np.zeros(0))
