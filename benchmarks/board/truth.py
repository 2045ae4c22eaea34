"""How large a planted effect is, how large it must be to be found at all, and whether it can be told apart.

Everything is worked out on the training runs where the joint moves, smoothed and thinned as in `features`
(the common band), and before any verdict is looked at. Let f be the effect's torque less what refitting the
declared effects and the other planted effects at the joint absorbs, and n all that separates the recorded
torque from the true model along the measured motion (`measured`: noise of the torque, and what noise of the
positions does through speeds and accelerations), both in that band. A test of one coefficient by blocks has
the non-centrality

    d = sum f^2 / sqrt(sum_b (sum_{t in b} f n)^2),

with blocks b of `BLOCK_SECONDS`, or four memories of the noise where that is longer. The *just findable
size* is the size at which d reaches what `POWER` of such tests pass at level `LEVEL`, corrected for `NAMES`
names at each of the n joints, with as many degrees of freedom as the effect has blocks (weighted by its
power in each); and at which the effect is at least `MATERIAL` of the noise variance. Noise of the positions
grows with the square of the frequency, and whoever looks may leave it out: of the bands below `EDGES_HZ` the
one counts in which the effect is found most easily. It knows nothing of the tracer.

An effect is *separable* where, for every rival family with no more columns than its own, the rival leaves at
least `MARGIN` more of f's variance than the effect's own form leaves, and that difference would
itself be found (d^2 times the margin at least the critical d^2). Effects below the just findable size are
recorded as such; they are no misses. The rivals of an undeclared standard effect (rotor inertia, Coulomb,
viscous, offset) are the other standard ones alone, since richer forms come after their simple parents.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt
from scipy.stats import t as student

from benchmarks.board.features import CUTOFF_HZ, KEPT_RATE_HZ, Families

Array = NDArray[np.float64]

LEVEL = 0.01
POWER = 0.9
NAMES = 25
MATERIAL = 0.02
BLOCK_SECONDS = 0.5
MOST_ROWS = 12000
EDGES_HZ = (CUTOFF_HZ, 10.0, 5.0)
"""Edges of the bands in which an effect may be looked for; the one that shows it best counts."""


MARGIN = 0.05
"""Share of an effect's variance that a rival must leave beyond what the effect's own form leaves."""

ONE_COEFFICIENT = {
    "coulomb_asymmetry": "half_difference",
    "viscous_asymmetry": "half_difference",
    "quadratic_viscous": "slope",
    "load_dependent_friction": "coefficient",
    "joint_spring": "stiffness",
}
"""Effects of many forms, the usual one linear in one main parameter, and that parameter's name.

Coulomb friction far from its reversal and the slope of viscous friction are the same in any form.
"""

PLAIN = ("rotor_inertia", "coulomb", "viscous")
"""What every joint may be expected to have."""

SAME_THING = {
    "rotor_inertia_error": ("rotor_inertia", "rotor_inertia_error"),
    "rotor_inertia": ("rotor_inertia", "rotor_inertia_error"),
}
"""Two names of one column."""

CONTAINED = {"presliding_hysteresis": ("coulomb",)}
"""Names of what a planted effect becomes far from its reversals; elsewhere they are no part of its name.

Springs that slip have slid to the last after a while, and are Coulomb friction from then on.
"""


def accepted_names(effect: str) -> tuple[str, ...]:
    """Names that mean the planted effect."""
    return SAME_THING.get(effect, (effect,))


def project_parameter(families: Families, effect: str, torque: list[Array]) -> float | None:
    """Coefficient of the usual form nearest to a planted torque.

    Refitted with it are the declared effects, plain friction and rotor inertia: it is what a perfect fit of
    the usual form would find; None where the form has free shape parameters.
    """
    if effect not in ONE_COEFFICIENT:
        return None
    moving = families.moving()
    target = families.pool(torque)[moving]
    beside = [families.variants(name)[0] for name in PLAIN if name in families.names()]
    together = np.hstack([families.variants(effect)[0], families.declared, *beside])[moving]
    scale = np.sqrt(np.mean(together**2, axis=0)) + 1e-300
    solution, *_ = np.linalg.lstsq(together / scale, target, rcond=1e-10)
    return float(solution[0] / scale[0])


@dataclass(frozen=True)
class Findability:
    """`distance` is d, `critical` what it must reach, `findable` the factor on the size that just does."""

    distance: float
    critical: float
    findable: float


def orthonormal(columns: Array, rcond: float = 1e-9) -> Array:
    """Orthonormal basis (N, r) of columns (N, k), scaled alike first."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    kept = columns[:, scale > 0] / scale[scale > 0]
    if kept.shape[1] == 0:
        return np.zeros((len(columns), 0))
    u, s, _ = np.linalg.svd(kept, full_matrices=False)
    return np.asarray(u[:, s > rcond * s[0]])


def measure_findability(
    kept: Array, noise: Array, block: NDArray[np.int64], joints: int, level: float = LEVEL
) -> Findability:
    """Non-centrality of the block test of one effect, and the factor on its size that makes it just findable.

    Parameters
    ----------
    kept : array (N,)
        The effect's torque, not absorbed by anything else.
    noise : array (N,)
    block : array of int (N,)
        Number of the block of each row.
    joints : int
    level : float
    """
    power = np.bincount(block, kept**2)
    score = np.bincount(block, kept * noise)
    total = float(power.sum())
    if total <= 0.0:
        return Findability(0.0, np.inf, np.inf)
    blocks = total**2 / float(np.sum(power**2))
    free = max(blocks - 1.0, 1.0)
    critical = float(student.ppf(1 - level / (2 * NAMES * joints), free) + student.ppf(POWER, free))
    distance = total / float(np.sqrt(np.sum(score**2)) + 1e-300)
    material = float(np.sqrt(MATERIAL * np.mean(noise**2) / np.mean(kept**2)))
    return Findability(distance, critical, max(critical / distance, material))


class JointView:
    """One joint's training rows in the common band: families, noise and blocks, thinned to `MOST_ROWS`.

    Parameters
    ----------
    families : Families
    noise : list of array (N,)
        What separates the record from the true model along the measured motion at this joint, by track.
    memory : float
        Time over which that noise is autocorrelated [s].
    joints : int
        Number of joints of the machine.
    extra : tuple of array (rows, k) and array (k,), optional
        Further columns that are refitted (inertial parameters), smoothed and pooled, and the standard
        deviations of their coefficients a priori. They enter as so many rows more, in which all else is zero.
    """

    def __init__(
        self, families: Families, noise: list[Array], memory: float, joints: int,
        extra: tuple[Array, Array] | None = None,
    ):  # fmt: skip
        self.families, self.joints = families, joints
        moving = np.flatnonzero(families.moving())
        self.moving_share = len(moving) / sum(families.lengths())
        self.rows = moving[:: max(1, -(-len(moving) // MOST_ROWS))]
        pooled = families.pool(noise)
        self.noise = pooled[self.rows]
        self.noise_below = {edge: self._narrow(pooled, edge) for edge in EDGES_HZ}
        seconds = max(BLOCK_SECONDS, 4 * memory)
        pieces, start = [], 0
        for length in families.lengths():
            pieces.append(start + np.arange(length) // max(1, round(seconds * KEPT_RATE_HZ)))
            start = int(pieces[-1][-1]) + 1
        self.block = np.concatenate(pieces)[self.rows]
        self.refitted = families.declared
        self.padding = 0
        self.prior = np.zeros((0, self.refitted.shape[1]))
        if extra is not None:
            columns, spread = extra
            self.padding = len(spread)
            prior = np.diag(float(np.sqrt(np.mean(self.noise**2))) / spread)
            self.prior = np.hstack([np.zeros((self.padding, self.refitted.shape[1])), prior])
            self.refitted = np.hstack([self.refitted, columns])
        self.base = np.vstack([self.refitted[self.rows], self.prior])
        self._variants: dict[str, list[Array]] = {}

    def _narrow(self, signal: Array, edge: float) -> Array:
        """Rows of this view of a pooled signal (N,), below another edge."""
        if edge >= CUTOFF_HZ:
            return signal[self.rows]
        sos = butter(3, edge, fs=KEPT_RATE_HZ, output="sos")
        tracks = np.split(signal, np.cumsum(self.families.lengths())[:-1])
        return np.concatenate([sosfiltfilt(sos, x) for x in tracks])[self.rows]

    def _find(self, target: Array, others: list[Array], columns: Array) -> Findability:
        """Findability of a pooled torque (N,) in the band that shows it best.

        `others` are pooled like it; `columns` are all that absorb it, on this view's rows.
        """
        scale = np.sqrt(np.mean(columns**2, axis=0)) + 1e-300
        onto = self._pad(target[self.rows][:, None])[:, 0]
        absorbed, *_ = np.linalg.lstsq(columns / scale, onto, rcond=1e-9)
        everywhere = np.hstack([self.refitted, *(x[:, None] for x in others)])
        left = target - everywhere @ (absorbed / scale)
        found = [
            measure_findability(self._narrow(left, edge), noise, self.block, self.joints)
            for edge, noise in self.noise_below.items()
        ]
        return min(found, key=lambda f: f.findable)

    def _pad(self, columns: Array) -> Array:
        return np.vstack([columns, np.zeros((self.padding, columns.shape[1]))])

    def variants(self, name: str) -> list[Array]:
        """Columns of every variant of a family on this view's rows."""
        if name not in self._variants:
            self._variants[name] = [self._pad(x[self.rows]) for x in self.families.variants(name)]
        return self._variants[name]

    def judge(
        self, effect: str, torque: list[Array], others: list[list[Array]],
        rivals_among: tuple[str, ...] | None = None,
    ) -> dict[str, Any]:  # fmt: skip
        """Findability and rivals of one planted effect among others.

        Parameters
        ----------
        effect : str
        torque : list of array (N,)
            Its torque at this joint, by track.
        others : list of list of array
            The other planted effects' torques at this joint.
        rivals_among : tuple of str, optional
            Names that count as rivals; by default all.

        Returns
        -------
        dict
            `unabsorbed` (RMS in the common band over all rows, rest counted as nothing), `findable` (factor),
            `rivals` (name to margin), `nearest` (coefficient or None).
        """
        pooled, pooled_others = self.families.pool(torque), [self.families.pool(other) for other in others]
        target = self._pad(pooled[self.rows][:, None])[:, 0]
        columns = np.hstack([self.base, *(self._pad(x[self.rows][:, None]) for x in pooled_others)])
        basis = orthonormal(columns)
        kept = target - basis @ (basis.T @ target)
        found = self._find(pooled, pooled_others, columns)
        names = set(self.families.names())
        known = [name for name in accepted_names(effect) if name in names]
        own_left, own_columns = (0.0, 99) if not known else (np.inf, 99)
        for name in known:
            variants = self.variants(name)
            own_columns = min(own_columns, *(x.shape[1] for x in variants))
            own_left = min(own_left, *(self._left(kept, x, basis) for x in variants))
        rivals: dict[str, float] = {}
        among = names if rivals_among is None else names & set(rivals_among)
        for name in sorted(among - set(accepted_names(effect))):
            variants = [x for x in self.variants(name) if x.shape[1] <= own_columns]
            if not variants:
                continue
            margin = min(self._left(kept, x, basis) for x in variants) - own_left
            if margin < MARGIN or margin * found.distance**2 < found.critical**2:
                rivals[name] = round(margin, 4)
        return {
            "unabsorbed": float(np.sqrt(self.moving_share * np.mean(kept[: len(self.rows)] ** 2))),
            "findable": found.findable,
            "rivals": rivals,
            "nearest": project_parameter(self.families, effect, torque) if known else None,
        }

    @staticmethod
    def _left(kept: Array, columns: Array, basis: Array) -> float:
        free = columns - basis @ (basis.T @ columns)
        whole = np.sqrt(np.mean(columns**2, axis=0)) + 1e-300
        free = free[:, np.sqrt(np.mean(free**2, axis=0)) > 1e-6 * whole]
        if free.shape[1] == 0:
            return 1.0
        own = orthonormal(free)
        return 1.0 - float(np.sum((own.T @ kept) ** 2)) / max(float(np.sum(kept**2)), 1e-300)
