"""The empirical term: splines of every signal at a joint, in as few hat functions as the runs ask for."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from wearscope.closed_loop.model.blocks import Folds
from wearscope.closed_loop.model.candidates import Family
from wearscope.closed_loop.intake.preprocessing import Prepared
from wearscope.closed_loop.model.regression import Regression, Regressors, block_scores, partial_fit
from wearscope.closed_loop.selection.evidence import Scored, Scorer, find_memory, flip_blocks, join_blocks
from wearscope.effects.base import Signals, load_effect
from wearscope.effects.unknown import LEVELS, coarsen

#: Signals whose columns are made at once: all but the hat functions in use are then dropped.
_AT_ONCE = 8


@dataclass
class SplineFamily(Family):
    """Splines at one joint that have the same number of hat functions."""

    @property
    def count(self) -> int:
        """Columns of each shape."""
        return int(self.shapes[0, -1])

    def level(self, shape: int, knots: int) -> "SplineFamily":
        """One shape with fewer knots."""
        shapes = self.shapes[shape : shape + 1].copy()
        shapes[:, -1] = knots
        return replace(self, shapes=shapes)


def make_spline_families(joint: int, prepared: Prepared, joined: Signals) -> list[SplineFamily]:
    """Families of the empirical term at a joint, by their finest level.

    Only the finest level's columns are filtered: those of the coarser ones are sums of them.
    """
    effect = load_effect("unknown")
    shapes = effect.shapes(joined, joint)
    order = sorted(range(len(shapes)), key=lambda k: shapes[k, -1])
    families = []
    for knots, same in groupby(order, key=lambda k: int(shapes[k, -1])):
        own = shapes[list(same)]
        columns = []
        for run in prepared.runs_for("train"):
            parts = []
            for start in range(0, len(own), _AT_ONCE):
                part = own[start : start + _AT_ONCE]
                x = effect.stack(run.signals, joint, part)
                x = x.reshape(len(x), len(part), -1)[..., :knots].reshape(len(x), -1)
                parts.append(run.reduce(x))
            columns.append(np.concatenate(parts, axis=-1))
        families.append(SplineFamily(effect, joint, own, columns))
    return families


class SignTest:
    """Significance of what is left at a joint by random signs of blocks.

    The odds that serve for the named effects tell little of a spline with many hat functions where a few loud
    blocks carry the residual, or where the residual drifts. Here no block has a larger weight than with the
    middle one's residual, which is the same whatever the signs, and blocks that remember each other turn
    their signs together.

    Parameters
    ----------
    model : Regression
    joint : int
    folds : Folds
    flips : ndarray (F, B)
    """

    def __init__(self, model: Regression, joint: int, folds: Folds, flips: np.ndarray) -> None:
        self.model, self.joint, self.folds, self.flips = model, joint, folds, flips
        loss = model.block_power(model.solve())[:, joint]
        self.caps = np.sqrt(np.minimum(1.0, np.median(loss[loss > 0.0]) / np.maximum(loss, 1e-300)))
        self.capped = model.reweigh(self.caps)
        self.run = np.array([block.run for block in model.blocks])
        self.sums = self._sum([x[:, joint] for x in model.columns])
        self.target = self._sum([y[:, [joint]] for y in model.target])[:, 0]

    def _sum(self, columns: list[np.ndarray]) -> np.ndarray:
        """Weighed sums (B, k) of columns (M, k) at the joint by block."""
        weighed = [x * w[:, [self.joint]] for x, w in zip(columns, self.model.weights, strict=True)]
        return np.array([weighed[b.run][b.start : b.stop].sum(axis=0) for b in self.model.blocks])

    def sum_columns(self, family: SplineFamily) -> np.ndarray:
        """Weighed sums (B, s, m) of a family's columns by block."""
        return self._sum(family.columns).reshape(len(self.run), -1, family.count)

    def test(self, regressors: Regressors, sums: np.ndarray) -> tuple[float, np.ndarray]:
        """Statistic of one shape, and the same under random signs, (F,).

        Parameters
        ----------
        regressors : Regressors
        sums : ndarray (B, m)
            Of its columns by block.
        """
        weighed = regressors.reweigh(self.caps)
        left = self.caps * self._hold_out(regressors, sums)
        together = self.flips[:, join_blocks(self.run, find_memory(left, self.run))]
        inner = partial_fit(self.model, regressors).inner
        return flip_blocks(block_scores(self.capped, weighed), inner, together)

    def _hold_out(self, regressors: Regressors, sums: np.ndarray) -> np.ndarray:
        """Sums (B,) of the residual that the model with one shape leaves of held-out blocks."""
        model = self.model
        left = np.empty(len(self.run))
        for train, test in zip(self.folds.train, self.folds.test, strict=True):
            beta = partial_fit(model, regressors, train).beta[0]
            gram, score = model.moments(train)
            theta = np.linalg.solve(gram, score - regressors.cross[train, 0].sum(axis=0).T @ beta)
            left[test] = self.target[test] - sums[test] @ beta - self.sums[test] @ theta
        return left


def score_splines(scorer: Scorer, family: SplineFamily) -> Iterator[Scored]:
    """Score every signal and level of a family."""
    finest = family.count
    test = SignTest(scorer.model, family.joint, scorer.folds, scorer.flips)
    regressors = scorer.model.correlate(family.columns, family.joint, finest)
    sums = test.sum_columns(family)
    for knots in (k for k in LEVELS if k <= finest):
        onto = coarsen(finest, knots)
        combined = regressors.combine(onto)
        for shape in range(len(family.shapes)):
            one = combined.at(shape)
            tested = test.test(one, sums[:, shape] @ onto)
            yield scorer.score_regressors(family.level(shape, knots), one, np.arange(knots), tested)
