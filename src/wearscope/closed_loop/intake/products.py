"""What one fit of all joints' torques leaves, from the products of its columns; see `joint_fit`."""

from dataclasses import dataclass, replace
from functools import cached_property

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
    found : ndarray (n, P + D)
        Coefficients of the links, each over what costs `_COST`, and of each joint's drive.
    """

    left: np.ndarray
    cost: float
    friction: np.ndarray
    found: np.ndarray

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
    grams : ndarray (n, P + D + 2, P + D + 2)
        Over the torque's variance; zeros where a joint says nothing. The links' columns are each over what
        costs `_COST`.
    scale : ndarray (n,)
        Spread of the torques; 0 where a joint says nothing.
    """

    grams: np.ndarray
    scale: np.ndarray

    @property
    def heard(self) -> list[int]:
        """Joints that say something."""
        return [int(j) for j in np.flatnonzero(self.scale)]

    @property
    def size(self) -> int:
        """Number of the links' columns."""
        return self.grams.shape[1] - len(DRIVE) - 2

    def resize(self, size: np.ndarray) -> "Products":
        """Products of torques divided by a size (n,), -1 where turned round."""
        factor = np.repeat(size[:, None], self.grams.shape[1], axis=1)
        factor[:, -1] = 1.0
        return Products(self.grams * factor[:, :, None] * factor[:, None, :], self.scale / np.abs(size))

    def tell(self, way: np.ndarray) -> float:
        """Share of the links' values along a way (P,) that the torques tell, and not the links' cost."""
        links = _COST * np.eye(self.size) + self.grams[:, : self.size, : self.size].sum(axis=0)
        return 1.0 - _COST * float(way @ np.linalg.solve(links, way)) / max(float(way @ way), 1e-300)

    def run_backwards(self) -> "Products":
        """Products of friction that gives power."""
        sign = np.ones(self.grams.shape[1])
        sign[self.size : -2][FRICTION] = -1.0
        return replace(self, grams=self.grams * np.outer(sign, sign))

    def fit(self) -> Fit:
        """Fit all joints at once."""
        p, heard = self.size, self.heard
        moved, own, right, whole = self._solve()
        grams = self.grams[heard]
        found = np.zeros((len(self.scale), p + len(DRIVE)))
        found[heard] = z = np.column_stack([np.tile(moved, (len(heard), 1)), own])
        left, friction = np.full(len(found), np.nan), np.zeros(len(found))
        # A body that needs far more torque than there is cancels to rounding errors, which are no fit.
        rounding = z.shape[1] * np.finfo(float).eps * (whole + 2.0 * np.sum(np.abs(z * right), axis=1))
        gone = _form(z, grams[:, :-2, :-2]) - 2.0 * np.sum(z * right, axis=1)
        left[heard] = np.maximum(whole + gone, rounding)
        friction[heard] = _form(z[:, p:][:, FRICTION], grams[:, p:-2, p:-2][:, FRICTION, FRICTION])
        return Fit(left, _COST * float(moved @ moved), friction, found)

    @cached_property
    def total(self) -> float:
        """What `fit` leaves in all, at less expense."""
        moved, own, right, whole = self._solve()
        # Of coefficients that are held at zero or best, the products with the torque are what is explained.
        parts = np.append(-right[:, : self.size] @ moved, whole - np.sum(right[:, self.size :] * own, axis=1))
        rounding = self.grams.shape[1] * np.finfo(float).eps * float(whole.sum())
        return max(float(parts.sum()), rounding)

    def _solve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients of the links (P,) and of each drive (K, D); products of the K torques less the bodies.

        The last are those with the columns, (K, P + D), and with themselves, (K,).
        """
        p, d, heard = self.size, len(DRIVE), self.heard
        grams = self.grams[heard]
        right = grams[:, :-2, -1] - grams[:, :-2, -2]
        whole = grams[:, -1, -1] - 2.0 * grams[:, -1, -2] + grams[:, -2, -2]
        links = _COST * np.eye(p) + grams[:, :p, :p].sum(axis=0)
        links += _HELD * links.diagonal().max() * np.eye(p)
        cross = grams[:, :p, p:-2].transpose(1, 0, 2).reshape(p, -1)
        drive = np.zeros((len(heard), d, len(heard), d))
        drive[range(len(heard)), :, range(len(heard))] = grams[:, p:-2, p:-2]
        root = np.linalg.cholesky(links)
        all_right = np.column_stack([cross, right[:, :p].sum(axis=0)])
        solved = linalg.solve_triangular(root, all_right, lower=True, check_finite=False)
        own = _solve_non_negative(
            drive.reshape(right[:, p:].size, right[:, p:].size) - solved[:, :-1].T @ solved[:, :-1],
            right[:, p:].ravel() - solved[:, :-1].T @ solved[:, -1],
        )
        rest = solved[:, -1] - solved[:, :-1] @ own
        moved = linalg.solve_triangular(root, rest, lower=True, trans=1, check_finite=False)
        return moved, own.reshape(-1, d), right, whole

    def miss(self, any_size: bool = False) -> float:
        """What all joints leave, with torques as they are or each of any size."""
        return self.any_size if any_size else self.total

    @property
    def any_size(self) -> float:
        """What each joint by itself leaves, with a body of any size or none."""
        own = self.grams[:, self.size :, self.size :]
        return float(sum(_left(own[j], np.arange(len(DRIVE) + 1), 1.0)[0] for j in self.heard))

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


def _form(z: np.ndarray, grams: np.ndarray) -> np.ndarray:
    """Forms z' G z for each of some z (K, P) and G (K, P, P)."""
    return np.asarray(np.sum((grams @ z[:, :, None])[:, :, 0] * z, axis=1))


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
