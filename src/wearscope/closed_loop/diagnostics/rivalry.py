"""What a run would add to the evidence between names that the runs so far cannot tell apart."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from wearscope.closed_loop.intake.design_effect import JoinedBlocks
from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.closed_loop.intake.signals import join_signals
from wearscope.closed_loop.model.prediction import find_operating_point
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import reduce_columns
from wearscope.effects.base import Effect, MeasurementEffect, Signals, TransmissionEffect, WaveEffect

#: Number of start shapes that represent all shapes of a name.
_SHAPES = 9
#: Factors on estimated shape parameters, for values that refining a shape or a faster motion may reach.
_REFINED = ((0.5, 1.0, 2.0, 4.0), (0.6, 1.0, 1.6))
#: Standard errors, and share of the loss left, by which two names must differ to be told apart.
ERRORS, MATERIAL = 2.0, 0.02


@dataclass(frozen=True)
class Name:
    """One rival name: an effect at its joint, with the shapes and subsets of coefficients to fit."""

    effect: Effect
    joint: int
    shapes: np.ndarray
    subsets: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Along:
    """A run under a model: signals with the torques that terms act on, and columns (M, n, P) of its terms."""

    run: PreparedRun
    signals: Signals
    columns: np.ndarray
    made: dict[tuple, np.ndarray] = field(default_factory=dict)

    def reduce(self, name: Name) -> np.ndarray:
        """Columns of all shapes of a name; they are made once, even if two terms have it as a rival."""
        key = (name.effect.name, name.joint, name.shapes.tobytes())
        if key not in self.made:
            self.made[key] = reduce_columns(name.effect, name.joint, name.shapes, self.run, self.signals)
        return self.made[key]


def look_along(model: Regression, run: PreparedRun, effects: Sequence[Effect]) -> Along:
    """A planned run under a model, with the motor and gear torques that some effects need."""
    every, signals = (*effects, *(entry.effect for entry in model.entries)), run.signals
    if any(isinstance(effect, MeasurementEffect | TransmissionEffect) for effect in every):
        planned = copy(model)
        planned.prepared = replace(model.prepared, runs=[run])
        (signals,) = find_operating_point(planned)
    return Along(run, signals, model.take_columns(run, signals))


@dataclass(frozen=True)
class Sums:
    """Gram matrix of one or several runs, and their weighted columns.

    Attributes
    ----------
    gram : ndarray (K, K)
        Products of the model's columns and, after them, those of every name's shapes.
    rows : float
        Number of rows that count at the joints where the names act.
    parts : tuple of (float, ndarray (M, n, K))
        How often each run counts, and its weighted columns.
    """

    gram: np.ndarray
    rows: float
    parts: tuple[tuple[float, np.ndarray], ...]

    def add(self, other: "Sums", times: float = 1.0) -> "Sums":
        """Sums of these runs and of another, the latter `times` times."""
        more = tuple((times * count, x) for count, x in other.parts)
        return Sums(self.gram + times * other.gram, self.rows + times * other.rows, self.parts + more)


@dataclass(frozen=True)
class Contrast:
    """Distance of a name's torque from the best fit by another name and all other terms.

    Attributes
    ----------
    evidence : float
        Expected difference of the losses [residual variances].
    angle : float
        Angle between the name's torque and the other's model [deg].
    residual : ndarray (K,)
        Coefficients of the difference of the two torques.
    """

    evidence: float
    angle: float
    residual: np.ndarray


class Rivalry:
    """Rival names of one term, compared on recorded and planned runs next to the rest of the model.

    Parameters
    ----------
    model : Regression
        The model with the named term.
    index : int
        Index of the named term among its entries.
    names : list of Name
        The named effect first.
    """

    def __init__(self, model: Regression, index: int, names: list[Name]) -> None:
        self.model, self.names = model, names
        self.theta = model.solve()
        self.base = np.delete(np.arange(model.p), model.spans[index])
        self.joints = sorted(
            {j for name in names for j in (range(model.prepared.n) if name.effect.spread else (name.joint,))}
        )
        self.spans = self._lay_out()
        train = model.prepared.runs_for("train")
        along = find_operating_point(model)
        seen = [Along(run, s, model.take_columns(run, s)) for run, s in zip(train, along, strict=True)]
        self.recorded = self.sum_along(seen)
        parts = [x for _, x in self.recorded.parts]
        target = np.concatenate(
            [(y * w).reshape(-1) for y, w in zip(model.target, model.weights, strict=True)]
        )
        score = np.concatenate([x.reshape(-1, x.shape[2]) for x in parts]).T @ target
        self.prior = model.prior[np.ix_(self.base, self.base)]
        self.betas = [self._fit(k, score) for k in range(len(names))]
        lengths = np.array([block.stop - block.start for block in model.blocks])
        self.length = int(np.median(lengths))
        blocks = JoinedBlocks(np.cumsum(lengths) - lengths, np.array([block.run for block in model.blocks]))
        residuals = zip(model.residuals(self.theta), model.weights, strict=True)
        left = np.concatenate([residual * weight for residual, weight in residuals])
        self.inflation = max(blocks.find_design_effect(left[:, j]) for j in self.joints)

    def _lay_out(self) -> list[list[slice]]:
        """Column span of every shape and subset of each name, after the model's columns; sets `picks`."""
        spans, start = [], len(self.base)
        self.picks: list[list[tuple[int, tuple[int, ...]]]] = []
        for name in self.names:
            own, picks = [], []
            for s in range(len(name.shapes)):
                for subset in name.subsets:
                    own.append(slice(start, start + len(subset)))
                    picks.append((s, subset))
                    start += len(subset)
            spans.append(own)
            self.picks.append(picks)
        return spans

    def _columns(self, seen: Along) -> np.ndarray:
        """Weighted columns (M, n, K) of the model and all names along a run."""
        parts = [seen.columns[..., self.base]]
        for name, picks in zip(self.names, self.picks, strict=True):
            made = seen.reduce(name)
            count = len(name.effect.coefficients)
            made = made[..., [s * count + c for s, subset in picks for c in subset]]
            if made.ndim == 2:
                full = np.zeros((len(made), self.model.prepared.n, made.shape[1]))
                full[:, name.joint] = made
                made = full
            parts.append(made)
        return np.concatenate(parts, axis=2) * (seen.run.keep / self.model.sigma)[:, :, None]

    def sum_along(self, runs: Sequence[Along]) -> Sums:
        """Sums of runs, recorded or planned."""
        parts = [self._columns(seen) for seen in runs]
        rows = sum(float(np.any(x[:, self.joints] != 0.0, axis=2).sum()) for x in parts)
        flat = [x.reshape(-1, x.shape[2]) for x in parts]
        return Sums(sum(x.T @ x for x in flat), rows, tuple((1.0, x) for x in parts))

    def _project(self, gram: np.ndarray) -> np.ndarray:
        """Gram matrix of the names' columns after the model is projected out."""
        p = len(self.base)
        cross = gram[:p, p:]
        return gram[p:, p:] - cross.T @ np.linalg.solve(self._inner(gram), cross)

    def _inner(self, gram: np.ndarray) -> np.ndarray:
        """Normal matrix (P, P) of the model without the names."""
        p = len(self.base)
        inner = gram[:p, :p] + self.prior
        return inner + 1e-9 * np.diag(np.maximum(np.diag(inner), 1e-12))

    def _fit(self, k: int, score: np.ndarray) -> np.ndarray:
        """Coefficients (K - P,) of a name's best shape and subset on the recorded runs."""
        p, gram = len(self.base), self.recorded.gram
        reduced = score[p:] - gram[p:, :p] @ np.linalg.solve(self._inner(gram), score[:p])
        left = self._project(gram)
        best, most = np.zeros(len(reduced)), -np.inf
        for span in self.spans[k]:
            own = slice(span.start - p, span.stop - p)
            beta = _solve(left[own, own], reduced[own], np.diag(gram)[span])
            gain = float(beta @ reduced[own])
            if gain > most:
                best, most = np.zeros(len(reduced)), gain
                best[own] = beta
        return best

    def contrast(self, sums: Sums, true: int, model: int) -> Contrast:
        """Difference of one name's torque, if it is the truth, from the best fit by another name."""
        p = len(self.base)
        left, beta = self._project(sums.gram), self.betas[true]
        whole = float(beta @ left @ beta)
        taken, away = 0.0, beta
        for span in self.spans[model]:
            own = slice(span.start - p, span.stop - p)
            cross = left[own] @ beta
            fit = _solve(left[own, own], cross, np.diag(sums.gram)[span])
            gain = float(2 * fit @ cross - fit @ left[own, own] @ fit)
            if gain > taken:
                taken, away = gain, beta.copy()
                away[own] -= fit
        evidence = max(whole - taken, 0.0)
        angle = np.degrees(np.arcsin(np.sqrt(np.clip(evidence / whole, 0.0, 1.0)))) if whole > 0 else 0.0
        inner = self._inner(sums.gram)
        onto = -np.linalg.solve(inner, sums.gram[:p, p:] @ away)
        return Contrast(evidence, float(angle), np.concatenate([onto, away]))

    def worst(self, sums: Sums) -> Contrast:
        """The contrast of least evidence between the named effect and another, either being the truth."""
        pairs = [(0, k) for k in range(1, len(self.names))] + [(k, 0) for k in range(1, len(self.names))]
        return min((self.contrast(sums, a, b) for a, b in pairs), key=lambda c: c.evidence)

    def score(self, sums: Sums, contrast: Contrast) -> float:
        """Standard errors by which held-out losses tell the names apart, beyond those that are needed.

        The standard error of the sum over blocks includes the noise and the uneven spread of the evidence,
        since evidence in only a few blocks may be due to chance.
        """
        energy = 0.0
        for count, x in sums.parts:
            away = np.sum((x @ contrast.residual) ** 2, axis=1)
            blocks = np.add.reduceat(away, np.arange(0, len(away), self.length))
            energy += count * float(np.sum(blocks**2))
        error = float(np.sqrt(4.0 * self.inflation * contrast.evidence + energy))
        if error <= 0.0:
            return -ERRORS
        return (contrast.evidence - max(ERRORS * error, MATERIAL * sums.rows)) / error


def _solve(inner: np.ndarray, score: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Least-squares solution with a small ridge, which keeps directions that the model spans near zero."""
    return np.linalg.solve(inner + np.diag(1e-7 * size + 1e-30), score)


def spread_shapes(effect: Effect, shapes: np.ndarray) -> np.ndarray:
    """Shapes (S, k), and those around them that a refinement may reach, within their bounds."""
    if isinstance(effect, WaveEffect):  # a wavenumber is known far more precisely than these factors
        return shapes
    for factors, k in zip(_REFINED, effect.estimated_shapes(), strict=False):
        parameter = effect.shape[k]
        grown = [shapes]
        for factor in factors:
            other = shapes.copy()
            other[:, k] = np.clip(other[:, k] * factor, parameter.lower, parameter.upper)
            grown.append(other)
        shapes = np.unique(np.vstack(grown), axis=0)
    return shapes


def list_names(model: Regression, index: int, equivalent: list[str], effects: list[Effect]) -> list[Name]:
    """The named effect of a term and its equivalents, with shapes and subsets of coefficients to fit."""
    term = model.entries[index]
    known = {effect.name: effect for effect in effects}
    joined = join_signals(run.signals for run in model.prepared.runs_for("train"))
    names = []
    for name in [term.effect.name, *equivalent]:
        effect = term.effect if name == term.effect.name else known[name]
        joint = model.prepared.n - 1 if effect.per_robot else term.joint
        shapes = effect.shapes(joined, joint)
        pick = np.unique(np.linspace(0, len(shapes) - 1, min(_SHAPES, len(shapes))).round().astype(int))
        shapes = spread_shapes(effect, shapes[pick])
        if effect is term.effect and term.shape:
            shapes = np.vstack([shapes, np.array(term.shape)])
        subsets = tuple(tuple(map(int, subset)) for subset in effect.subsets())
        names.append(Name(effect, joint, shapes, subsets))
    return names
