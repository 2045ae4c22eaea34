"""Short events taken out of recordings: a push is no wear, whatever a detector makes of its torque."""

from dataclasses import replace

import numpy as np

from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.declared import fit_declared_model
from wearscope.closed_loop.model.events import (
    Event,
    find_events,
    mark_events,
    take_out_common,
    take_out_state,
)
from wearscope.closed_loop.model.prediction import find_repeats, predict_reduced
from wearscope.effects.base import load_effect


def bridge_events(prepared: Prepared) -> tuple[Prepared, list[Event]]:
    """Recordings without the torque of short events, and the events.

    A push at one link is felt at others, too little to be found there. So within an event, at all joints,
    what the declared model and all that goes with the joint's state leave at the common bandwidth is taken
    out; noise above it stays.
    """
    joints = prepared.dataset.joints
    names = [name for name in prepared.dataset.fields.declared_effects if not name.endswith(".py")]
    problem = Problem(prepared, [load_effect(name) for name in names])
    terms = [term for term in problem.declared_terms if not term.is_measurement_error]
    model = fit_declared_model(prepared, terms, problem.inertial, problem.layout.blocks)
    theta = model.solve()
    left = [run.measured - predict_reduced(model, theta, run) for run in prepared.runs]
    left = take_out_state(prepared.runs, left)
    left = take_out_common(prepared.runs, left, find_repeats(prepared))
    events = find_events(prepared.runs, left, joints, prepared.moving, prepared.top_speed)
    if not events:
        return prepared, []
    runs = []
    for run, rest in zip(prepared.runs, left, strict=True):
        t, tau = run.signals.t, run.tau.copy()
        marked = np.any([mark_events(run, t, events, joint) for joint in joints], axis=0)
        for j in range(len(joints)):
            tau[marked, j] -= np.interp(t[marked], run.t, rest[:, j])
        runs.append(replace(run, tau=tau))
    return replace(prepared, runs=runs), events
