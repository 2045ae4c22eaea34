"""Notes on a load that is not as declared: in some runs only, or one that the runs do not determine."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.estimation import estimate
from wearscope.closed_loop.model.loads import find_other_loads
from wearscope.closed_loop.model.prediction import Predicted, find_signals, refit
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import PayloadEffect, load_effect
from wearscope.effects.vocabulary import session_effects

#: Smallest share of the residual, over all joints, that loads by run must explain.
_MOST = 0.5
#: A body may replace refitted masses where it removes this share of the loss that they remove.
_ALIKE = 0.9
#: Refitted masses are reported where they add more than this share of a joint's torque (RMS). A
#: URDF's masses may well be wrong by as much.
_USUAL = 0.1
#: How a note on refitted masses begins.
MASSES = "The refitted masses"
#: What refitted masses may come from.
_CAUSES = (
    "masses of the URDF are off, or a load, balancer, drive's inertia or torque constant is not as declared."
)
#: How the note on loads by run begins.
_DIFFERS = "The load differs between runs"
#: Least singular value of a run's load columns that counts, over the largest one.
_SEEN = 1e-3
#: Columns of a load (R, P), residual (R,) and columns of a model (R, M) in one half of a run.
_Half = tuple[np.ndarray, np.ndarray, np.ndarray]


def tell_loads(prepared: Prepared, predicted: Sequence[Predicted], after: Regression) -> list[str]:
    """A sentence where loads that differ between runs explain most of a model's residual; else nothing.

    A load that is fitted to one half of a run must predict the residual of the other half better than the
    load of all other runs does. The model's own coefficients are refitted together with such loads, since
    they absorbed part of them.

    Parameters
    ----------
    prepared : Prepared
    predicted : sequence of Predicted
        Predictions along all runs.
    after : Regression
        The corrected model.
    """
    effect = _find_payload()
    files = list(dict.fromkeys(p.run.file for p in predicted))
    if effect is None or len(files) < 2:
        return []
    gathered = _gather(prepared, predicted, effect, files, after)
    if any(len(y) < 4 * x.shape[1] for pair in gathered for x, y, _ in pair):
        return []
    whole = max(sum(float(y @ y) for pair in gathered for _, y, _ in pair), 1e-300)
    size = np.sqrt(np.mean(np.concatenate([x**2 for pair in gathered for x, *_ in pair]), axis=0))
    scaled = [[(x / np.maximum(size, 1e-300), y, m) for x, y, m in pair] for pair in gathered]
    change = _fit_again(after, [one for pair in scaled for one in pair])
    rows = [[(x, y - m @ change) for x, y, m in pair] for pair in scaled]
    own, common = 0.0, 0.0
    loads = np.zeros((len(rows), 2, len(size)))
    for k, pair in enumerate(rows):
        others = _solve([one for i, other in enumerate(rows) if i != k for one in other])
        for half, (x, y) in enumerate(pair):
            loads[k, half] = _solve([pair[half]])
            own += _miss(*pair[1 - half], loads[k, half])
            common += _miss(x, y, others)
    share = 1.0 - own / whole
    if share < _MOST or 1.0 - common / whole > 0.5 * share:
        return []
    told = f"{_DIFFERS}: loads by run explain {100 * share:.0f} % of what is left"
    unit = max(size[0], 1e-300)  # 0 where the joint's motion needs no torque that depends on the load's mass
    mass, error = loads[..., 0].mean(axis=1) / unit, np.ptp(loads[..., 0], axis=1) / unit
    if 2.0 * error.max() < np.ptp(mass):
        heavier = mass > mass.mean()
        added = float(mass[heavier].mean() - mass[~heavier].mean())
        each_way = 1.0 / heavier.sum() + 1.0 / (~heavier).sum()
        # The difference of a run's halves is twice the error of their mean. Runs with the same load may still
        # differ by more than that.
        apart = mass - np.where(heavier, mass[heavier].mean(), mass[~heavier].mean())
        free = max(len(mass) - 2, 1)
        squares = {len(mass): 0.25 * float(np.mean(error**2)), free: float(apart @ apart) / free}
        wide = max(stats.t.ppf(0.975, dof) * np.sqrt(one * each_way) for dof, one in squares.items())
        each = ", ".join(f"{file} {m - mass.min():.2g} kg" for file, m in zip(files, mass, strict=True))
        middle, low, high = _round_alike(added, added - wide, added + wide)
        told = (
            f"{_DIFFERS}, {', '.join(np.array(files)[heavier])} with {middle} kg ({low} to {high}) more than "
            f"the others: loads by run explain {100 * share:.0f} % of what is left (by run: {each})"
        )
    return [f"{told}. State each run's payload, or leave out the runs with another load."]


def _round_alike(middle: float, low: float, high: float, sign: str = "") -> list[str]:
    """A value and its interval, with the decimals that the interval's first significant digit needs."""
    decimals = int(np.clip(-np.floor(np.log10(max(0.5 * (high - low), 1e-300))), 0, 4))
    return [f"{one:{sign}.{decimals}f}" for one in (middle, low, high)]


def tell_other_loads(after: Regression, terms: Sequence[ModelTerm]) -> list[str]:
    """A sentence on each load-dependent effect whose load differs from that of the corrected model's bodies.

    Parameters
    ----------
    after : Regression
        The corrected model.
    terms : sequence of ModelTerm
        Its named terms.
    """
    return [
        f"{after.prepared.dataset.joints[term.joint]}: {term.effect.name} is fitted to another load than the "
        "corrected model's, which the runs do not settle; its coefficient may be wrong. State the payload or "
        "the masses, and diagnose again."
        for term in find_other_loads(after, terms)
    ]


def tell_masses(after: Regression, most_rows: float) -> tuple[list[str], str]:
    """Joints whose links were refitted unusually far, and a sentence; both empty where there are none.

    The links act as a payload, as one link, or as several.

    Parameters
    ----------
    after : Regression
        The corrected model.
    most_rows : float
        Most independent rows of a joint that an interval counts.
    """
    prepared, n = after.prepared, after.prepared.n
    held = any(term.effect.spread and not term.is_deflection for term in after.entries)
    if not after.inertial or held:
        return [], ""
    joints, runs = prepared.dataset.joints, prepared.runs_for("train")
    stated = np.linalg.norm(np.concatenate([run.reduce(run.known) for run in runs]), axis=0)
    added = np.concatenate(after.columns)[..., : 10 * n] @ after.solve()[: 10 * n]
    added = np.linalg.norm(added, axis=0)
    change = added / np.maximum(stated, 1e-300)
    # What is smaller than the noise, as where a link's mass is on its axis, tells no mass.
    seen = prepared.moving & (added > after.sigma * np.sqrt(sum(len(run.t) for run in runs)))
    far = np.flatnonzero((change > _USUAL) & seen).tolist()
    if not far:
        return [], ""
    change = np.where(seen, change, 0.0)
    shares = _share_links(after)
    alike = [int(k) for k in np.argsort(-shares) if shares[k] >= _ALIKE]
    told, of_payload = _tell_body(after, alike[0], most_rows) if alike else ("", False)
    if not told:
        why = "no mass or moment of one link is certain" if alike else "no single link explains that"
        return [joints[j] for j in far], (
            f"{MASSES} change the bodies' torque by up to {100 * change.max():.0f} % (RMS), and {why}: "
            f"{', '.join(f'{joints[j]} {100 * change[j]:.0f} %' for j in far)}. Either {_CAUSES}"
        )
    removes = f"it removes {100 * shares[alike[0]]:.0f} % of the error that they remove"
    if of_payload:
        return [joints[alike[0]]], (
            f"{MASSES} act as a payload of {told} in addition to the stated one: {removes}. State it, if the "
            f"machine carries it; otherwise {_CAUSES}"
        )
    links = [joints[k] for k in alike]
    return links, (
        f"{MASSES} act as a change of the link that {' or '.join(links)} moves, of {told}: {removes}. "
        f"Either {_CAUSES}"
    )


def _share_links(after: Regression) -> np.ndarray:
    """Share (n,) of what the refitted masses remove from the loss that each link's alone remove."""
    normal, score = after.moments()
    n = after.prepared.n

    def remove(links: Sequence[int]) -> float:
        free = np.append(np.repeat(np.isin(np.arange(n), links), 10), np.ones(after.p - 10 * n, dtype=bool))
        return float(score[free] @ np.linalg.solve(normal[np.ix_(free, free)], score[free]))

    least, most = remove([]), remove(range(n))
    return np.array([remove([k]) - least for k in range(n)]) / max(most - least, 1e-300)


def _tell_body(after: Regression, link: int, most_rows: float) -> tuple[str, bool]:
    """Mass or moments of a body that is added to a link, and whether it can be a payload.

    The text is empty where neither is known.
    """
    prepared, n = after.prepared, after.prepared.n
    effect = load_effect("inertial_error").for_robot(n)
    body = ModelTerm(effect, link, (), tuple(range(10 * link, 10 * link + 10)))
    # A slide's weight is a constant, which a balancer or the sensor's zero may be as well.
    offset, has = load_effect("torque_offset"), {(term.joint, term.effect.name) for term in after.entries}
    slides = [j for j, unit in enumerate(prepared.dataset.position_unit) if unit == "m"]
    free = [ModelTerm(offset, j, (), (0,)) for j in slides if (j, offset.name) not in has]
    model = refit(
        Regression(prepared, after.entries, after.sigma, False, after.blocks), [*after.entries, *free, body]
    )
    own = model.spans[-1]
    # The prior is that of a URDF's errors. Where a body exceeds it, what only the prior tells is less sure.
    prior, values = np.diag(model.inertial_prior)[own], model.solve()[own]
    excess = max(float(np.max(prior * values**2)) - 1.0, 0.0)
    more = stats.norm.ppf(0.975) * np.sqrt(excess * np.linalg.inv(model.moments()[0])[own, own] ** 2 @ prior)
    found = estimate(model, most_rows=most_rows)[-1].intervals
    ends = (np.array(list(found.values())) + np.outer(more, [-1.0, 1.0]))[:4]
    bodies = [run.signals.rigid_body for run in prepared.runs_for("train")]
    # The mass is unknown where the motions do not tell it from inertia that the drives or masses may have.
    low, high = ends[0]
    weighed = not low <= 0.0 <= high
    heaviest = abs(values[0]) if weighed else max(-low, high)
    # No machine carries less than nothing, nor anything further away than the robot reaches.
    enough = high >= 0.0 or any(one.payload for one in bodies)
    possible = link == n - 1 and enough and np.linalg.norm(values[1:4]) <= bodies[0].reach * heaviest
    if weighed:
        mass, least, most = _round_alike(values[0], low, high, "+")
        told = f"{mass} kg ({least} to {most} if the URDF's other masses are right)"
    else:
        some = np.where(np.abs(values[1:4]) < 1e-3 * np.abs(values[1:4]).max(), 0.0, values[1:4])
        # Where the motions show only the sum of a moment and the mass, neither is known.
        known = (some == 0.0) | (np.abs(some) > np.ptp(ends[1:], axis=1))
        moments = ", ".join(f"{m:+.3g}" if k else "unknown" for m, k in zip(some, known, strict=True))
        frame = prepared.dataset.joints[link]
        told = f"unknown mass, with moments of {moments} kg m about the frame of {frame}"
        told = told if (known & (some != 0.0)).any() else ""
    return told, possible


def _find_payload() -> PayloadEffect | None:
    return next((one for one in session_effects() if isinstance(one, PayloadEffect)), None)


def _gather(
    prepared: Prepared,
    predicted: Sequence[Predicted],
    effect: PayloadEffect,
    files: Sequence[str],
    after: Regression,
) -> list[list[_Half]]:
    """Arrays of each file's first and second half in time, as `_Half` has them, over the residual's scale."""
    left = [p.run.measured - p.after for p in predicted]
    keep = [p.run.keep & prepared.moving for p in predicted]
    square = sum(np.sum(np.where(k, x, 0.0) ** 2, axis=0) for x, k in zip(left, keep, strict=True))
    scale = np.sqrt(np.maximum(square / np.maximum(sum(k.sum(axis=0) for k in keep), 1), 1e-300))
    theta, gathered = after.solve(), []
    known = {id(run): x for run, x in zip(prepared.runs_for("train"), after.columns, strict=True)}
    for file in files:
        own = [i for i, p in enumerate(predicted) if p.run.file == file]
        middle = np.median(np.concatenate([predicted[i].run.t for i in own]))
        parts = []
        for i in own:
            run = predicted[i].run
            load = run.reduce_columns(
                effect.columns(replace(run.signals, carries=True), prepared.n - 1, np.zeros(0))
            )
            model = known.get(id(run))
            model = after.take_columns(run, find_signals(after, theta, run)) if model is None else model
            late = np.broadcast_to((run.t >= middle)[:, None], keep[i].shape)[keep[i]]
            some = [x[keep[i]] for x in (load / scale[:, None], left[i] / scale, model / scale[:, None])]
            parts.append((late, some))
        pair = []
        for half in (False, True):
            x, y, z = ([some[k][late == half] for late, some in parts] for k in range(3))
            pair.append((np.concatenate(x), np.concatenate(y), np.concatenate(z)))
        gathered.append(pair)
    return gathered


def _fit_again(after: Regression, halves: Sequence[_Half]) -> np.ndarray:
    """Change (M,) of the model's coefficients, refitted together with a separate load for each half run."""
    normal, right = after.prior.copy(), np.zeros(after.p)
    for load, left, model in halves:
        basis, sizes, _ = np.linalg.svd(load, full_matrices=False)
        basis = basis[:, sizes > _SEEN * sizes[0]]
        rest = model - basis @ (basis.T @ model)
        normal += rest.T @ rest
        right += rest.T @ left
    return np.asarray(np.linalg.solve(normal, right))


def _solve(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    x, y = (np.concatenate(one) for one in zip(*parts, strict=True))
    return np.asarray(np.linalg.lstsq(x, y, rcond=_SEEN)[0])


def _miss(x: np.ndarray, y: np.ndarray, load: np.ndarray) -> float:
    return float(np.sum((y - x @ load) ** 2))
