"""State of each joint: its residual is noise, or structure that no name and no generic term explains."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from wearscope.closed_loop.diagnostics.residual_tests import (
    Residual,
    Seen,
    compare_noise,
    measure_rms,
    see_motion,
    see_runs,
    see_test_error,
    see_time,
)
from wearscope.closed_loop.inference.answer import Left
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.prediction import find_repeats, predict_full
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.vocabulary import say_effect

State = Literal["explained", "corrected", "unexplained", "not_judged"]


@dataclass(frozen=True)
class JointState:
    """State of a joint, and the structure in its residual.

    Attributes
    ----------
    joint : int
    state : str
    unexplained_rms : float or None
        RMS of the structure [torque unit of the joint]: in the training runs, or in the test runs where it is
        seen in these alone.
    depends_on : list of str
        Signals that it depends on, as far as that is known.
    reason : str
        How it was seen.
    """

    joint: int
    state: State
    unexplained_rms: float | None = None
    depends_on: list[str] = field(default_factory=list)
    reason: str = ""


def judge_joints(
    prepared: Prepared,
    after: Regression,
    named: Sequence[ModelTerm],
    left: Mapping[int, Left],
    policy: Policy,
    withdrawn: Sequence[tuple[ModelTerm, float, str]] = (),
) -> list[JointState]:
    """State of every joint, from what the corrected model leaves of the training runs.

    Autocorrelated noise counts as noise. A residual is structure if it depends on the motion, differs by run,
    changes in time, or makes the test runs' error larger than the training runs'.

    Parameters
    ----------
    prepared : Prepared
    after : Regression
        The corrected model.
    named : sequence of ModelTerm
        Named terms of the corrected model.
    left : mapping of int to Left
        By joint, structure that the search found and that no term could explain.
    policy : Policy
    withdrawn : sequence of (ModelTerm, float, str)
        Named terms that the corrected model lacks, each with its share of the held-out loss and the reason.
    """
    theta = after.solve()
    runs = {use: prepared.runs_for(use) for use in ("train", "test")}
    full = {use: [run.tau - predict_full(after, theta, run) for run in some] for use, some in runs.items()}
    filtered = {
        use: [run.reduce_columns(x) for run, x in zip(some, full[use], strict=True)]
        for use, some in runs.items()
    }
    repeats = list_train_repeats(prepared)
    states, moving = [], int(prepared.moving.sum())
    for j, name in enumerate(prepared.dataset.joints):
        if not prepared.moving[j]:
            states.append(JointState(j, "not_judged"))
            continue
        train, test = (
            [Residual(run, x[:, j], run.keep[:, j]) for run, x in zip(runs[use], filtered[use], strict=True)]
            for use in ("train", "test")
        )
        rms, error = measure_rms(train), measure_rms(test)
        inside = [
            *_from_withdrawn(prepared, withdrawn, j),
            *_from_left(left, j),
            *see_motion(train, test, repeats),
            *see_runs(train, j, name, moving),
            *see_time(train, prepared.band.torque, moving, policy),
        ]
        noisier = compare_noise([x[:, j] for x in full["train"]], [x[:, j] for x in full["test"]])
        inside = [one for one in inside if one.share >= policy.structure_share]
        seen = [*inside, *see_test_error(train, error, noisier)]
        if not seen or not rms > 0.0:
            corrected = any(term.joint == j for term in named)
            states.append(JointState(j, "corrected" if corrected else "explained"))
            continue
        # Structure in the training runs tells more than a large error on the test runs.
        most = max(inside or seen, key=lambda one: one.share)
        size = np.sqrt(min(most.share, 1.0)) * rms
        if not inside:
            size = np.sqrt(max(error**2 - (noisier * rms) ** 2, 0.0))
        ordered = sorted(seen, key=lambda one: -one.share)
        known = next((one.depends_on for one in ordered if one.depends_on), [])
        states.append(JointState(j, "unexplained", float(size), known, most.reason))
    return states


def list_train_repeats(prepared: Prepared) -> list[tuple[int, int]]:
    """Pairs of training runs that follow the same trajectory, as indices among the training runs."""
    train = [i for i, run in enumerate(prepared.runs) if run.use == "train"]
    place = {i: k for k, i in enumerate(train)}
    return [(place[a], place[b]) for a, b in find_repeats(prepared) if a in place and b in place]


def _from_left(left: Mapping[int, Left], joint: int) -> list[Seen]:
    """Structure that the search found at a joint and that no term could explain."""
    return [Seen(one.share, one.depends_on, one.reason) for j, one in left.items() if j == joint]


def _from_withdrawn(
    prepared: Prepared, withdrawn: Sequence[tuple[ModelTerm, float, str]], joint: int
) -> list[Seen]:
    """Structure that a withdrawn name explains in the training runs and not in the test runs."""
    seen = []
    for term, share, why in (one for one in withdrawn if one[0].joint == joint):
        depends = list(dict.fromkeys(term.effect.name_signals(term.shape, prepared.dataset.joints, joint)))
        told = f"{say_effect(term.effect.name)} fits the training runs, but is left out: {why}"
        seen.append(Seen(share, depends, told))
    return seen
