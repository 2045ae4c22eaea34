"""Parameters of a fitted model with intervals that autocorrelated residuals do not make too narrow."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from wearscope.closed_loop.intake.direction import FORMS, Reversals
from wearscope.closed_loop.model.blocks import make_folds
from wearscope.closed_loop.model.delays import find_shift
from wearscope.closed_loop.model.joint_flexibility import make_instruments
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm, reduce_columns
from wearscope.effects.vocabulary import plain_friction

#: Relative information below which a spline's height counts as unknown; the best known height has 1.
_INFORMED = 1e-3


@dataclass
class JointFit:
    """All free values of a model, estimated together.

    Attributes
    ----------
    theta : ndarray (p,)
        Coefficients, those of the inertial parameters first.
    covariance : ndarray (p + s, p + s)
        Covariance of the coefficients, then of the free shapes, the reversals' widths and forms, and plain
        friction without a name.
    width : ndarray (p + s,)
        Half of each value's 95 % interval.
    moved : ndarray (p + s,)
        Part of `width`: how far another form of a reversal, or plain friction without a name, would move the
        value.
    owners : list of (int, int)
        Entry and shape parameter of each free shape.
    told : ndarray (p + s,)
        Information on each value.
    """

    theta: np.ndarray
    covariance: np.ndarray
    width: np.ndarray
    moved: np.ndarray
    owners: list[tuple[int, int]]
    told: np.ndarray


@dataclass
class Estimate:
    """Parameters of one entry.

    Attributes
    ----------
    entry : ModelTerm
    values : dict of str to float
        Every parameter in use, coefficients and shape.
    intervals : dict of str to tuple
        95 % interval of every parameter that was estimated.
    """

    entry: ModelTerm
    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]

    @property
    def sureness(self) -> float:
        """Largest size of a coefficient over half its interval; infinite if there is one without an interval.

        Below 1 the intervals of all coefficients hold zero.
        """
        names = [self.entry.effect.coefficients[k].name for k in self.entry.subset]
        sizes = [
            abs(self.values[name]) / max(0.5 * float(np.ptp(self.intervals[name])), 1e-300)
            if name in self.intervals
            else np.inf
            for name in names
        ]
        return float(max(sizes))


#: Step of the logarithm of a reversal's width for the derivative; prior standard deviation of another form's
#: share.
_STEP, _FORM = 0.02, 0.5


def _reversal_gradients(model: Regression, theta: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Derivatives of the prediction with respect to the width and form of the reversals, and their priors.

    Widths and forms were chosen on the same runs, so their uncertainty is part of friction's.

    Returns
    -------
    list of ndarray (M, n, 3 K)
        By run, for each of K joints whose reversal has a width: the derivative by the logarithm of its width,
        and the differences to the other forms.
    ndarray (3 K,)
        Prior precision of their coefficients, which are zero where width and form are right.
    """
    prepared, train = model.prepared, model.prepared.runs_for("train")
    today = prepared.reversals
    wide = np.flatnonzero(today.width > 0.0)
    gradients = [np.zeros((len(run.t), prepared.n, len(wide), len(FORMS))) for run in train]
    at = {int(j): k for k, j in enumerate(wide)}
    wider = Reversals(today.width * np.exp(_STEP), today.form)
    ways = [(wider, 1.0 / _STEP)] + [(today.change_form(k), 1.0) for k in range(1, len(FORMS))]
    for way, (reversals, factor) in enumerate(ways if at else ()):
        for r, run in enumerate(prepared.try_reversals(reversals)):
            for term, span in zip(model.entries, model.spans, strict=True):
                if (
                    term.joint not in at
                    or term.effect.spread
                    or term.is_measurement_error
                    or term.is_deflection
                ):
                    continue
                shape, pick = np.array([term.shape]), list(term.subset)
                x = reduce_columns(term.effect, term.joint, shape, run)[:, pick]
                change = (x - model.columns[r][:, term.joint, span]) @ theta[span] * factor
                gradients[r][:, term.joint, at[term.joint], way] += change
    precision = np.tile([0.0] + [1.0 / _FORM**2] * (len(FORMS) - 1), len(wide))
    return [g.reshape(*g.shape[:2], -1) for g in gradients], precision


def _list_plain(model: Regression) -> list[np.ndarray]:
    """Columns (M, n, k) by run of unnamed plain friction, of which every joint may have a little."""
    there = [
        [e.effect for e in model.entries if e.joint == j and not e.effect.spread]
        for j in range(model.prepared.n)
    ]
    places = [
        (effect, int(j))
        for j in np.flatnonzero(model.prepared.moving)
        for effect in plain_friction()
        if not any(effect.name in (e.name, *e.contains) for e in there[j])
    ]
    columns = []
    for run in model.prepared.runs_for("train"):
        columns.append(np.zeros((len(run.t), model.prepared.n, len(places))))
        for k, (effect, j) in enumerate(places):
            columns[-1][:, j, k] = reduce_columns(effect, j, np.zeros((1, 0)), run)[:, 0]
    return columns


def _shape_gradients(model: Regression, theta: np.ndarray) -> tuple[list[np.ndarray], list[tuple[int, int]]]:
    """Derivative (M, n) by run of the prediction with respect to each free shape, and the shape's place."""
    train = model.prepared.runs_for("train")
    gradients: list[list[np.ndarray]] = [[] for _ in train]
    owners = []
    for i, (entry, span) in enumerate(zip(model.entries, model.spans, strict=True)):
        for k in [] if entry.effect.empirical else entry.effect.estimated_shapes(entry.subset):
            owners.append((i, k))
            step = 1e-3 * max(abs(entry.shape[k]), 1e-12)
            shapes = np.array([entry.shape, entry.shape])
            shapes[0, k] -= step
            shapes[1, k] += step
            for r, run in enumerate(train):
                x = reduce_columns(entry.effect, entry.joint, shapes, run, (model.signals or [])[r])
                x = x.reshape(*x.shape[:-1], 2, -1)[..., list(entry.subset)]
                slope = (x[..., 1, :] - x[..., 0, :]) @ theta[span] / (2 * step)
                full = np.zeros((len(slope), model.prepared.n))
                if entry.effect.spread:
                    full = slope
                else:
                    full[:, entry.joint] = slope
                gradients[r].append(full)
    return [
        np.stack(g, axis=2) if g else np.zeros((len(run.t), model.prepared.n, 0))
        for g, run in zip(gradients, train, strict=True)
    ], owners


def estimate_jointly(model: Regression, most_rows: float = np.inf, conditional: bool = False) -> JointFit:
    """Coefficients and free shapes of a model with their joint covariance.

    The covariance is the sandwich of the normal equations with blocks of rows as clusters (Liang and Zeger
    1986), scaled by B/(B - p) for B blocks and p effective parameters per joint. The prior on a body's
    inertial parameters counts as observations with their own scatter. Intervals take Student's t with as many
    degrees of freedom as clusters carry the parameter's information, less one. Where a regressor was made
    from the measured torque, its noise-free instrument takes its place in the scores.

    No form is exact, so more rows than some tell no more: intervals are at least as wide as with that many
    independent rows of each joint, as in the score of names (Miller and Dunson 2019, JASA 114).

    Parameters
    ----------
    model : Regression
    most_rows : float
        Most independent rows of a joint that count; all by default.
    conditional : bool
        Whether the intervals are conditional on the names; else they include plain friction without a name.
        It is True where a coefficient is compared with zero: the search has weighed that friction against it.
    """
    theta = model.solve()
    extra, owners = _shape_gradients(model, theta)
    reversals, precision = _reversal_gradients(model, theta)
    plain = [g[:, :, :0] for g in reversals] if conditional else _list_plain(model)
    precision = np.concatenate([precision, np.zeros(plain[0].shape[2])])
    extra = [np.concatenate(every, axis=2) for every in zip(extra, reversals, plain, strict=True)]
    instruments = make_instruments(model, model.held)
    residuals = model.residuals(theta)
    p = model.p + extra[0].shape[2]
    blocks = len(model.blocks)
    prior = np.zeros(p)
    prior[p - len(precision) :] = precision
    held = np.diag(prior)
    held[: model.p, : model.p] += model.weak_prior
    hessian, least = held.copy(), held.copy()
    rows_of = sum(run.keep.sum(axis=0) for run in model.prepared.runs_for("train"))
    share = np.minimum(most_rows / np.maximum(rows_of, 1), 1.0)
    scores = np.zeros((blocks, p))
    information = np.zeros((blocks, p))
    for b, block in enumerate(model.blocks):
        rows = slice(block.start, block.stop)
        w = model.weights[block.run][rows]
        x = np.concatenate([model.columns[block.run][rows], extra[block.run][rows]], axis=2) * w[:, :, None]
        less = (x * np.sqrt(share)[:, None]).reshape(w.size, p)
        least += less.T @ less
        x = x.reshape(w.size, p)
        z = x.copy()
        z[:, : model.p] = (instruments[block.run][rows] * w[:, :, None]).reshape(w.size, model.p)
        e = (residuals[block.run][rows] * w).reshape(-1)
        hessian += z.T @ x
        information[b] = (z**2).sum(axis=0)
        scores[b] = z.T @ e
    inverse = _invert(hessian)
    # Each joint's torque is a separate observation; degrees of freedom that a prior fixes are not subtracted.
    taken = float(np.trace(inverse @ (hessian - held))) / max(int(model.prepared.moving.sum()), 1)
    meat = scores.T @ scores * blocks / max(blocks - taken, 1.0) + np.diag(prior)
    meat[: model.p, : model.p] += model.inertial_prior
    covariance = inverse @ meat @ inverse.T
    error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # A mixture of forms, and unnamed plain friction, would shift the estimates by this much.
    free = np.arange(p) >= p - plain[0].shape[2]
    moved = np.abs(inverse @ np.where(free | (prior > 0.0), scores.sum(axis=0), 0.0))
    carried = information.sum(axis=0) ** 2 / np.maximum((information**2).sum(axis=0), 1e-300)
    told = information.sum(axis=0)
    width = stats.t.ppf(0.975, np.maximum(carried - 1, 1)) * error
    width = np.maximum(width, stats.norm.ppf(0.975) * np.sqrt(np.maximum(np.diag(_invert(least)), 0.0)))
    width = np.maximum(width, _measure_by_part(model, inverse, scores))
    return JointFit(theta, covariance, width + moved, moved, owners, told)


def _measure_by_part(model: Regression, inverse: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """Half of each value's 95 % interval, with runs as clusters, or parts of runs where there are few.

    Parameters
    ----------
    model : Regression
    inverse : ndarray (p, p)
        Inverse of the normal matrix.
    scores : ndarray (B, p)
        Scores by block.
    """
    files = [run.file for run in model.prepared.runs_for("train")]
    parts = make_folds(model.blocks, files).parts
    moved = inverse @ np.stack([scores[parts == k].sum(axis=0) for k in np.unique(parts)], axis=1)
    count = moved.shape[1]
    error = np.sqrt((moved**2).sum(axis=1) * count / (count - 1))
    return np.asarray(stats.t.ppf(0.975, count - 1) * error)


def _invert(matrix: np.ndarray) -> np.ndarray:
    scale = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
    return np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-12) / np.outer(scale, scale)


def estimate(model: Regression, most_rows: float = np.inf, conditional: bool = False) -> list[Estimate]:
    """Estimates of all entries of a model, in their order; see `estimate_jointly`."""
    joint = estimate_jointly(model, most_rows, conditional)
    theta, width, owners, told = joint.theta, joint.width, joint.owners, joint.told
    estimates = []
    for i, (entry, span) in enumerate(zip(model.entries, model.spans, strict=True)):
        values: dict[str, float] = {}
        intervals: dict[str, tuple[float, float]] = {}
        for k, index in zip(entry.subset, range(span.start, span.stop), strict=True):
            name = entry.effect.coefficients[k].name
            shift = find_shift(model.prepared, entry.joint) if name == "delay" else 0.0
            values[name] = float(theta[index]) + shift
            # A fixed delay is not estimated, nor is anything without informative rows.
            if i in model.held and entry.is_measurement_error:
                continue
            if entry.effect.empirical and told[index] < _INFORMED * told[span].max():
                continue
            intervals[name] = (values[name] - float(width[index]), values[name] + float(width[index]))
        for k, parameter in enumerate(entry.effect.shape_of(entry.subset)):
            values[parameter.name] = float(entry.shape[k])
            if (i, k) in owners:
                index = model.p + owners.index((i, k))
                intervals[parameter.name] = (
                    float(entry.shape[k] - width[index]),
                    float(entry.shape[k] + width[index]),
                )
        estimates.append(Estimate(entry, values, intervals))
    return estimates


def draw_parameters(
    model: Regression, joint: JointFit, rng: np.random.Generator, draws: int
) -> list[tuple[np.ndarray, list[dict[str, float]]]]:
    """Draws of parameters: normal, with the estimate's correlations and each value's own interval.

    Parameters
    ----------
    model : Regression
    joint : JointFit
        Fit of the model, from `estimate_jointly`.
    rng : numpy.random.Generator
    draws : int

    Returns
    -------
    list of (ndarray (p,), list of dict)
        Coefficients within their physical bounds, and every parameter in use by entry.
    """
    variance = np.diag(joint.covariance)
    error = np.sqrt(np.maximum(variance, 1e-300))
    correlation = joint.covariance / np.outer(error, error)
    values, vectors = np.linalg.eigh((correlation + correlation.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    # Student's t widens each interval by its own degrees of freedom; an uninformed value does not vary.
    spread = np.where((variance > 0.0) & np.isfinite(joint.width), joint.width / stats.norm.ppf(0.975), 0.0)
    best = model.solve_bounded()
    drawn = []
    for _ in range(draws):
        away = spread * (root @ rng.standard_normal(len(spread)))
        theta = best + away[: model.p]
        for entry, span in zip(model.entries, model.spans, strict=True):
            used = [entry.effect.coefficients[k] for k in entry.subset]
            theta[span] = np.clip(theta[span], [p.lower for p in used], [p.upper for p in used])
        named = []
        for i, (entry, span) in enumerate(zip(model.entries, model.spans, strict=True)):
            own = dict(
                zip([entry.effect.coefficients[k].name for k in entry.subset], theta[span], strict=True)
            )
            for k, parameter in enumerate(entry.effect.shape_of(entry.subset)):
                value = entry.shape[k]
                if (i, k) in joint.owners:
                    value += away[model.p + joint.owners.index((i, k))]
                own[parameter.name] = float(np.clip(value, parameter.lower, parameter.upper))
            named.append({name: float(value) for name, value in own.items()})
        drawn.append((theta, named))
    return drawn
