"""The load on the gears, on which friction may depend: the corrected bodies' load, once they are known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.joint_flexibility import rigid_link_torque
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm

#: Largest relative difference of the corrected bodies' load from the load along which effects were fitted.
OTHER = 0.03


def find_other_loads(model: Regression, terms: Sequence[ModelTerm]) -> list[ModelTerm]:
    """Terms that were fitted along another load than that of the model's bodies.

    Parameters
    ----------
    model : Regression
    terms : sequence of ModelTerm
        Terms to look at.
    """
    listed = [
        term
        for term in terms
        if "load_{joint}" in term.effect.depends_on and not (term.effect.spread or term.effect.empirical)
    ]
    if not listed:
        return []
    theta, runs = model.solve(), model.prepared.runs_for("train")
    taken = np.concatenate([run.signals.load for run in runs])
    off = np.concatenate([rigid_link_torque(model, theta, run.signals) for run in runs]) - taken
    other = np.linalg.norm(off, axis=0) > OTHER * np.linalg.norm(taken, axis=0)
    return [term for term in listed if other[term.joint]]


def take_loads(prepared: Prepared, model: Regression) -> Prepared:
    """A prepared data set with the load of a model's bodies.

    Parameters
    ----------
    prepared : Prepared
    model : Regression
        Model of the same machine.
    """
    theta = model.solve()
    runs = [
        replace(run, signals=replace(run.signals, load=rigid_link_torque(model, theta, run.signals)))
        for run in prepared.runs
    ]
    return replace(prepared, runs=runs)
