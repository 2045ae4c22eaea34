"""What one fit of all joints' torques leaves, from the products of its columns; see `joint_fit`."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, optimize

#: Speeds over which friction falls, over the largest one.
FALLS = (0.05, 0.3)
#: Columns of a drive, each of which has a coefficient of zero or more; `FRICTION` of them take power.
_FALLING = tuple(f"falling {k}" for k in FALLS)
DRIVE = ("inertia", "Coulomb", "viscous", *_FALLING, "load", *(f"load {one}" for one in _FALLING))
FRICTION = slice(1, len(DRIVE))
#: Shares of variance that links cost where they differ from the stated ones by what `Rows` allows.
_COST = 0.02
#: What the stated reading must leave for others to be asked, in shares of a torque's variance.
DOUBTFUL = 0.015
#: Share of a torque's variance that is none.
NONE = 0.01
_HELD = 1e-9


@dataclass(frozen=True)
class Fit:
    """What a fit of all joints leaves.

    Attributes
    ----------
    left : ndarray (n,)
        Share of each torque's variance; NaN where a joint says nothing.
    cost : float
        Of links that differ from the stated ones.
    friction : ndarray (n,)
        Share of the variance that friction makes.
    found : dict of int to ndarray
        By joint, coefficients of its links over what costs `_COST`, and of its drive.
    """

    left: np.ndarray
    cost: float
    friction: np.ndarray
    found: dict[int, np.ndarray]

    @property
    def total(self) -> float:
        """Of all joints, and the links' cost."""
        return float(np.nansum(self.left)) + self.cost

    @property
    def is_doubtful(self) -> bool:
        """Whether enough is left for another reading to be asked for."""
        return self.total >= DOUBTFUL


@dataclass(frozen=True)
class Products:
    """Products of the columns of each joint: links, drive, stated body, torque.

    Attributes
    ----------
    grams : list of ndarray
        By joint, over the torque's variance; empty where a joint says nothing.
    scale : ndarray (n,)
        Spread of the torques.
    size : int
        Number of the links' columns, each over what costs `_COST`.
    """

    grams: list[np.ndarray]
    scale: np.ndarray
    size: int

    @property
    def heard(self) -> list[int]:
        """Joints that say something."""
        return [j for j, gram in enumerate(self.grams) if gram.size]

    def resize(self, size: np.ndarray) -> "Products":
        """Products of torques divided by a size (n,), -1 where turned round."""
        grams = []
        for gram, one in zip(self.grams, size.tolist(), strict=True):
            scale = np.append(np.full(max(len(gram) - 1, 0), one), 1.0)[: len(gram)]
            grams.append(gram * np.outer(scale, scale))
        return replace(self, grams=grams, scale=self.scale / np.abs(size))

    def run_backwards(self) -> "Products":
        """Products of friction that gives power."""
        p, d = self.size, len(DRIVE)
        sign = np.ones(p + d + 2)
        sign[p : p + d][FRICTION] = -1.0
        return replace(
            self, grams=[gram * np.outer(sign, sign) if gram.size else gram for gram in self.grams]
        )

    def fit(self) -> Fit:
        """Fit all joints at once."""
        n, p, d = len(self.grams), self.size, len(DRIVE)
        heard = self.heard
        links = np.diag(np.full(p, _COST))
        cross, drive = np.zeros((p, d * len(heard))), np.zeros((d * len(heard), d * len(heard)))
        right_links, right = np.zeros(p), np.zeros(d * len(heard))
        made = []
        for k, j in enumerate(heard):
            part, at = self.grams[j], slice(d * k, d * (k + 1))
            # Torque less the stated body.
            b = part[:, -1] - part[:, -2]
            links += part[:p, :p]
            cross[:, at] = part[:p, p : p + d]
            drive[at, at] = part[p : p + d, p : p + d]
            right_links += b[:p]
            right[at] = b[p : p + d]
            made.append((part, b, float(b[-1] - b[-2])))
        links += _HELD * float(np.diag(links).max()) * np.eye(p)
        factor = linalg.cho_factor(links)
        solved = linalg.cho_solve(factor, np.column_stack([cross, right_links]))
        found = _solve_non_negative(drive - cross.T @ solved[:, :-1], right - cross.T @ solved[:, -1])
        moved = solved[:, -1] - solved[:, :-1] @ found
        left, friction, every = np.full(n, np.nan), np.zeros(n), dict[int, np.ndarray]()
        for k, j in enumerate(heard):
            part, b, whole = made[k]
            own = found[d * k : d * (k + 1)]
            z = every[j] = np.concatenate([moved, own])
            # A body that needs far more torque than there is cancels to rounding errors, which are no fit.
            rounding = len(z) * np.finfo(float).eps * whole
            left[j] = max(whole - 2 * z @ b[: p + d] + z @ part[: p + d, : p + d] @ z, rounding)
            rubs = own[FRICTION]
            friction[j] = rubs @ part[p : p + d, p : p + d][FRICTION, FRICTION] @ rubs
        return Fit(left, _COST * float(moved @ moved), friction, every)

    def miss(self, any_size: bool = False) -> float:
        """What all joints leave, with torques as they are or each of any size."""
        return self.any_size if any_size else self.fit().total

    @property
    def any_size(self) -> float:
        """What each joint by itself leaves, with a body of any size or none."""
        factor, left, without = self.fit_sizes()
        return float(np.nansum(np.where(factor > 0.0, np.minimum(left, without), without)))

    def fit_sizes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Each joint by itself with a torque of any size, also turned round.

        A drive's inertia takes part only in what the body leaves of the torque: where both move alike, no
        fit tells how much each has, and the factor is that of the declared body alone.

        Returns
        -------
        factor, left, without : ndarray (n,)
            Torque over what the body needs, negative where the torque is turned round, its friction with it;
            share of the variance that is left with it, and without a body.
        """
        n, p, d = len(self.grams), self.size, len(DRIVE)
        factor, left, without = (np.full(n, np.nan) for _ in range(3))
        for j in self.heard:
            gram = self.grams[j][p:, p:]
            without[j] = _left(gram, np.arange(d), 1.0)[0]
            left[j] = np.inf
            for way in (1.0, -1.0):
                one, found = _left(gram, np.arange(d + 1), way)
                plain, held = _left(gram, np.arange(1, d + 1), way)
                none = _left(gram, np.arange(1, d), way)[0]
                size = held[-1] if plain - one < NONE * (none - one) else found[-1]
                if one < left[j]:
                    left[j], factor[j] = one, way * size
        return factor, left, without


def _left(gram: np.ndarray, picked: np.ndarray, sign: float) -> tuple[float, np.ndarray]:
    a, b = gram[np.ix_(picked, picked)], sign * gram[picked, -1]
    found = _solve_non_negative(a, b)
    return float(max(gram[-1, -1] - 2 * found @ b + found @ a @ found, 0.0)), found


def _solve_non_negative(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Least x' a x - 2 x' b with x >= 0, for a (K, K) without negative eigenvalues."""
    size = np.sqrt(np.diag(a))
    some = np.flatnonzero(size > 1e-8 * size.max(initial=0.0))
    out = np.zeros(len(b))
    if len(some):
        one, right = a[np.ix_(some, some)] / np.outer(size[some], size[some]), b[some] / size[some]
        try:
            root = np.linalg.cholesky(one + _HELD * np.eye(len(one))).T
        except np.linalg.LinAlgError:  # by rounding, of columns that say next to nothing
            values, vectors = linalg.eigh(one)
            root = np.sqrt(np.maximum(values, 0.0) + _HELD)[:, None] * vectors.T
        out[some] = optimize.nnls(root, np.linalg.solve(root.T, right))[0] / size[some]
    return out
