"""The empirical term: splines of every signal at a joint, in as few hat functions as the runs ask for."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from wearscope.closed_loop.candidates import Family
from wearscope.closed_loop.preparation import Prepared
from wearscope.closed_loop.scoring import Scored, Scorer
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


def score_splines(scorer: Scorer, family: SplineFamily) -> Iterator[Scored]:
    """Score every signal and level of a family, no block counting for more than the middle one."""
    capped = scorer.model.reweigh(scorer.cap_blocks(family.joint))
    finest = family.count
    regressors = scorer.model.correlate(family.columns, family.joint, finest)
    for knots in (k for k in LEVELS if k <= finest):
        combined = regressors.combine(coarsen(finest, knots))
        for shape in range(len(family.shapes)):
            yield scorer.score_regressors(
                family.level(shape, knots), combined.at(shape), np.arange(knots), capped
            )
