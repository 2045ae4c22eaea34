"""Weighted least squares: every fit is solved from sums of the blocks' Gram matrices."""

from dataclasses import dataclass, field

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.model.blocks import Block
from wearscope.closed_loop.model.inertials import find_penalty, inertial_penalty
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import Signals
from wearscope.effects.unknown import COARSE

#: Relative change of a joint's residual scale below which the weights are settled; largest number of rounds.
SETTLED, ROUNDS = 0.01, 30
#: Weight that fixes a coefficient, over the runs' own information on it.
_HOLD = 1e8
#: Penalties relative to the mean square of a hat function: on squared differences of neighbouring heights of
#: a coarse spline, and on squared heights of every spline.
_ROUGHNESS, _SHRINKAGE = 0.001, 0.01


def regularise(knots: int) -> np.ndarray:
    """Penalty (m, m) on a spline's heights, which matters where there is next to no data.

    There a coarse spline continues smoothly (Eilers and Marx 1996), and every spline tends to zero. The
    penalty also determines a spline's constant part where another term of the model has a constant too.
    """
    penalty = _SHRINKAGE * np.eye(knots)
    if knots <= COARSE:
        difference = np.diff(np.eye(knots), axis=0)
        penalty += _ROUGHNESS * difference.T @ difference
    return penalty


def penalise(columns: np.ndarray) -> np.ndarray:
    """Penalty (m, m) for a spline's columns (M, m) along a recording, scaled by their mean square."""
    return float(np.mean((columns**2).sum(axis=0))) * regularise(columns.shape[1])


@dataclass
class Regression:
    """The current model's normal equations, block by block.

    Attributes
    ----------
    prepared : Prepared
    entries : list of ModelTerm
    sigma : ndarray (n,)
        Residual scale by joint, whose inverse square weighs the rows.
    inertial : bool
        Whether deviations of the inertial parameters are among the columns, first.
    held : dict of int to ndarray
        Coefficients by index of their entry that are known and not fitted.
    signals : list of Signals, optional
        Signals of each training run, with the motors' and the gears' torque where terms act on them; those of
        the motion alone where None.
    """

    prepared: Prepared
    entries: list[ModelTerm]
    sigma: np.ndarray
    inertial: bool
    blocks: list[Block]
    held: dict[int, np.ndarray] = field(default_factory=dict)
    signals: list[Signals] | None = None
    columns: list[np.ndarray] = field(default_factory=list)

    def __post_init__(self) -> None:
        runs = self.prepared.runs_for("train")
        if self.signals is None:
            self.signals = [run.signals for run in runs]
        self.spans: list[slice] = []
        start = 10 * self.prepared.n if self.inertial else 0
        for entry in self.entries:
            self.spans.append(slice(start, start + len(entry.subset)))
            start += len(entry.subset)
        self.columns = [self.take_columns(run, s) for run, s in zip(runs, self.signals, strict=True)]
        self.target = [run.measured - run.reduce(run.known) for run in runs]
        self.weigh_by(self.sigma)

    def take_columns(self, run: PreparedRun, signals: Signals) -> np.ndarray:
        """Reduced regressors (M, n, P) of all terms along one run's signals."""
        parts = [np.zeros((len(run.t), self.prepared.n, 0))]
        if self.inertial:
            parts.append(run.bodies)
        for entry in self.entries:
            if entry.effect.spread:
                parts.append(run.reduce_columns(entry.columns(signals)))
                continue
            own = entry.effect.columns(signals, entry.joint, np.array(entry.shape))[:, list(entry.subset)]
            full = np.zeros((len(run.t), self.prepared.n, own.shape[1]))
            full[:, entry.joint] = run.reduce_columns(own, entry.joint)
            parts.append(full)
        return np.concatenate(parts, axis=2)

    def weigh_by(self, sigma: np.ndarray) -> None:
        """Weigh the rows by another residual scale (n,)."""
        self.sigma = sigma
        self.weights = [run.keep / sigma for run in self.prepared.runs_for("train")]
        self._sum_blocks()

    def _sum_blocks(self) -> None:
        """Sum the products of columns and target over each block, and add priors and known coefficients."""
        self.p = self.columns[0].shape[2]
        count = len(self.blocks)
        self.gram = np.zeros((count, self.p, self.p))
        self.score = np.zeros((count, self.p))
        for b, block in enumerate(self.blocks):
            rows = slice(block.start, block.stop)
            w = self.weights[block.run][rows]
            x = (self.columns[block.run][rows] * w[:, :, None]).reshape(w.size, self.p)
            y = self.target[block.run][rows] * w
            self.gram[b] = x.T @ x
            self.score[b] = x.T @ y.reshape(-1)
        self.weak_prior = self._make_prior()
        hold = np.zeros(self.p)
        value = np.zeros(self.p)
        for i, coefficients in self.held.items():
            span = self.spans[i]
            hold[span] = _HOLD * np.maximum(np.einsum("bii->i", self.gram)[span], 1e-12)
            value[span] = coefficients
        self.prior = self.weak_prior + np.diag(hold)
        self.pull = hold * value
        self._moments: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def moments(self, mask: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Normal equations (P, P), (P,) over the blocks of `mask` (all blocks where None)."""
        key = b"" if mask is None else mask.tobytes()
        if key not in self._moments:
            pick = slice(None) if mask is None else mask
            self._moments[key] = (
                self.gram[pick].sum(axis=0) + self.prior,
                self.score[pick].sum(axis=0) + self.pull,
            )
        return self._moments[key]

    @property
    def inertial_prior(self) -> np.ndarray:
        """Prior precision (P, P) of the inertial deviations from the URDF's values; zero elsewhere."""
        prior = np.zeros(self.p)
        if self.inertial:
            prior[: 10 * self.prepared.n] = np.diag(inertial_penalty(self.prepared))
        for entry, span in zip(self.entries, self.spans, strict=True):
            penalty = find_penalty(self.prepared, entry.effect)
            if penalty is not None:
                prior[span] = np.diag(penalty)[list(entry.subset)]
        return np.diag(prior)

    def _make_prior(self) -> np.ndarray:
        """Prior precision (P, P) of inertial deviations and of empirical terms; next to nothing elsewhere."""
        diagonal = np.einsum("bii->i", self.gram)
        precision = self.inertial_prior + np.diag(1e-10 * np.maximum(diagonal, 1e-12))
        for entry, span in zip(self.entries, self.spans, strict=True):
            if entry.effect.empirical:
                precision[span, span] += diagonal[span].mean() * regularise(len(entry.subset))
        return precision

    def solve(self, mask: np.ndarray | None = None) -> np.ndarray:
        """Parameters (P,) from the blocks of `mask` (all blocks where None)."""
        return np.linalg.solve(*self.moments(mask))

    def solve_without(self, index: int) -> np.ndarray:
        """Parameters (P,) with those of one entry held at zero and all others fitted to all blocks."""
        a, b = self.moments()
        free = np.ones(self.p, dtype=bool)
        free[self.spans[index]] = False
        theta = np.zeros(self.p)
        theta[free] = np.linalg.solve(a[np.ix_(free, free)], b[free])
        return theta

    def solve_bounded(self) -> np.ndarray:
        """Parameters (P,) within the physical bounds of the effects, as a simulator needs them.

        Residuals use `solve` instead: an effect that the model lacks can push a declared parameter beyond its
        bounds, and they must show that.
        """
        lower, upper = np.full(self.p, -np.inf), np.full(self.p, np.inf)
        for entry, span in zip(self.entries, self.spans, strict=True):
            parameters = [entry.effect.coefficients[k] for k in entry.subset]
            lower[span] = [parameter.lower for parameter in parameters]
            upper[span] = [parameter.upper for parameter in parameters]
        a, b = self.moments()
        theta = np.linalg.solve(a, b)
        held = np.zeros(self.p, dtype=bool)
        for _ in range(self.p):
            bounded = np.clip(theta, lower, upper)
            beyond = (bounded != theta) & ~held
            if not beyond.any():
                break
            held |= beyond
            free = ~held
            theta = bounded
            theta[free] = np.linalg.solve(
                a[np.ix_(free, free)], b[free] - a[np.ix_(free, held)] @ theta[held]
            )
        return theta

    def residuals(self, theta: np.ndarray) -> list[np.ndarray]:
        """Residual torque (M, n) of each training run, all rows."""
        return [y - x @ theta for y, x in zip(self.target, self.columns, strict=True)]
