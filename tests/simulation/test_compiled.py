"""What the set-up compiles is all that a study's simulations, detectors and scope compile."""

import os

import pytest
from calls import call_python

USE = """
import numpy as np
import wearscope
from wearscope.checking.own_code import make_batch
from wearscope.demonstration.motions import make_motion
from wearscope.demonstration.twin import STEP, TWIN, simulate_run
from wearscope.detectors.base import load_detector
from wearscope.evaluation.scope_kde import detection_probabilities, draw_runs
from wearscope.robots.model import load_model

wearscope.simulate("large", "slow_reversals", wear=20.0, temperature=40.0, step=0.001, seed=3)
model = load_model("large")
detector = load_detector("wear_temperature_fit")
detector.fit([make_batch(model, "axis_sweeps", 0.0, seed) for seed in (1, 2)], 2, model)
detector.test_quantity(make_batch(model, "axis_sweeps", 5.0, 3))
nodes, *weights = draw_runs(1, 0, 1000)
detection_probabilities(nodes, np.stack([nodes + 1.0, nodes + 2.0]), *weights, runs=1000)
motion = make_motion(TWIN, "fourier", 1, 2.0, 1.0 / STEP)
simulate_run(TWIN, motion, 30.0, "load_dependent_friction", 1.0)
"""


def run(*command, **names):
    done = call_python(*command, env=os.environ | names)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_nothing_is_compiled_that_the_set_up_compiles(tmp_path):
    names = {"NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_DEBUG_CACHE": "1"}
    assert "data saved to" in run("-m", "wearscope.jobs.compiled", **names)
    told = run("-c", USE, **names)
    assert "data loaded from" in told
    assert "data saved to" not in told
