"""Structure without a name: splines of one or two signals at a joint, or of its past."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from wearscope.closed_loop.inference.motion_dependence import list_past
from wearscope.closed_loop.inference.score import Model, Score
from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.intake.signals import join_signals, thin_signals
from wearscope.closed_loop.intake.threads import map_runs
from wearscope.closed_loop.model.column_cache import CachedColumns, ColumnCache
from wearscope.closed_loop.model.regression import penalise
from wearscope.closed_loop.model.terms import Candidate, reduce_columns
from wearscope.effects.base import Effect, Signals
from wearscope.effects.unknown import COARSE, LEVELS, PRODUCT, SLOW, list_signals
from wearscope.effects.vocabulary import empirical_effect

#: Largest memory for columns that are kept [bytes].
_CACHE = 2**29
#: Share of the least gain that signals at the rows, without the filter, must show; most signals that are
#: then evaluated exactly.
_ROUGHLY, _MOST = 0.6, 4
#: Numbers of hat functions of a spline of the past. A line has 2; it alone carries over to runs whose joint
#: reverses at other places.
_PAST = (2, LEVELS[0])
PAST = replace(empirical_effect(), name="what_the_motion_has_been", depends_on=())
"""What a joint's torque owes to its past; never named, since no model holds it."""


class Splines:
    """Structure without a name: splines of signals at a joint, and of what its motion has been.

    Parameters
    ----------
    prepared : Prepared
    joined : Signals
        Of all training runs.
    cache : int
        Bytes of columns that are kept; the others are made again when they are needed.
    """

    def __init__(self, prepared: Prepared, joined: Signals, cache: int = _CACHE) -> None:
        self.prepared, self.joined = prepared, joined
        self.effect = empirical_effect()
        self.runs = prepared.runs_for("train")
        # The generic term has no memory, so that all runs can be evaluated as one run.
        self.thinned = join_signals(
            replace(thin_signals(run), sign=run.reduce(run.signals.sign)) for run in self.runs
        )
        self._cache = ColumnCache(cache)
        self._rough: dict[int, list[Candidate]] = {}
        self._exact: dict[tuple[int, tuple[float, ...]], Candidate] = {}

    def list_terms(
        self, model: Model, joint: int, score: Score, past: bool = False, every: bool = False
    ) -> Iterator[Term]:
        """Splines that explain most of a joint's residual, at least a given share.

        Parameters
        ----------
        model : Model
        joint : int
        score : Score
        past : bool
            Whether splines of the joint's past are listed too, which no model can hold: they only compete.
        every : bool
            Whether those are listed too of which few runs cannot show that they carry over to other motions.
        """
        fit, policy = model.fit, score.policy
        loss = float(fit.fitted[joint] * fit.weight[joint])
        able: list[tuple[float, Candidate]] = []
        count = 0
        for finest in self._roughly(joint):
            if not (every or self._carries_over(finest, score.recordings)):
                continue
            count += len(list_levels(finest.shapes[0]))
            gain = float(fit.add(finest, range(finest.count)).gain[0]) / max(loss, 1e-300)
            if gain > _ROUGHLY * policy.structure_share:
                able.append((gain, finest))
        able.sort(key=lambda one: -one[0])
        for _, finest in able[:_MOST]:
            for level in list_levels(finest.shapes[0]):
                # Fine detail of a single run may not carry over to others.
                if level <= COARSE or score.layout.folds.by_run:
                    made = self._exactly(joint, (*finest.shapes[0][:-1], float(level)))
                    yield Term(made, tuple(range(made.count)), 0, float(count))
        if past:
            for codes, columns in list_past(model.problem.train, joint, _PAST):
                effect = replace(PAST, depends_on=tuple(f"{code}_{{joint}}" for code in codes))
                # An offset stays with the model, which loses the past in the end.
                own = columns - columns[model.problem.layout.keep[:, joint]].mean(axis=0)
                made = Candidate(effect, joint, ((),), (joint,), [own], penalise(own))
                gain = float(fit.add(made, range(made.count)).gain[0]) / max(loss, 1e-300)
                if gain > policy.structure_share:
                    yield Term(made, tuple(range(made.count)), 0, float(count))

    def _carries_over(self, candidate: Candidate, recordings: int) -> bool:
        """Whether runs tell a spline from a coincidence: two of the joint's own motion, three of others."""
        signals = list_signals(candidate.shapes[0])
        own = all(code not in SLOW and source == candidate.joint for code, source in signals)
        return recordings >= (2 if own else 3)

    def _roughly(self, joint: int) -> Iterator[Candidate]:
        """Candidates at a joint from the signals at the rows: each signal and product, at its finest."""
        if joint not in self._rough:
            made = []
            for shape in self.effect.shapes(self.joined, joint):
                make = partial(_evaluate, self.effect, self.thinned, joint, shape)
                made.append(self._wrap(joint, shape, CachedColumns(self._cache, make)))
            self._rough[joint] = made
        return iter(self._rough[joint])

    def _exactly(self, joint: int, shape: tuple[float, ...]) -> Candidate:
        """A candidate from the full-rate signals, through the common filter."""
        key = (joint, shape)
        if key not in self._exact:
            make = partial(_reduce, self.effect, self.runs, joint, np.array([shape]))
            self._exact[key] = self._wrap(joint, np.array(shape), CachedColumns(self._cache, make))
        return self._exact[key]

    def _wrap(self, joint: int, shape: np.ndarray, rows: Sequence[np.ndarray]) -> Candidate:
        named = (tuple(float(v) for v in shape),)
        return Candidate(self.effect, joint, named, (joint,), rows, penalise(rows[0]))


def list_levels(shape: tuple[float, ...]) -> list[int]:
    """Numbers of hat functions to try for a spline, up to the finest level of a shape."""
    return [PRODUCT] if shape[5] >= 0 else [k for k in LEVELS if k <= shape[-1]]


def _evaluate(effect: Effect, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
    """Columns (M, m) of one shape along signals."""
    return np.ascontiguousarray(effect.columns(signals, joint, shape)[:, : int(shape[-1])])


def _reduce(effect: Effect, runs: list[PreparedRun], joint: int, shapes: np.ndarray) -> np.ndarray:
    """Columns (M, m) of one shape (1, k) along runs, through the common filter."""
    parts = map_runs(partial(reduce_columns, effect, joint, shapes), runs)
    return np.concatenate([x[:, : int(shapes[0, -1])] for x in parts])
