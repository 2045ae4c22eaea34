"""Compiles ahead what studies run: ``python -m wearscope.jobs.compiled``, the last step of the set-up.

Numba compiles a function at its first call and caches the machine code next to the source file, until that
file changes. This module calls every such function once on small inputs, so that no study waits for
compilation. It also imports every module that a study imports, because Python caches byte-code in the same
way.
"""

import pkgutil
from importlib import import_module

import numpy as np

import wearscope
from wearscope.checking.own_code import make_batch
from wearscope.cycles.base import load_cycle
from wearscope.demonstration.motions import make_motion
from wearscope.demonstration.twin import STEP as TWIN_STEP
from wearscope.demonstration.twin import TWIN, simulate_run
from wearscope.detectors.base import load_detector
from wearscope.evaluation.sampled_scope import detect_tabulated, table_nodes
from wearscope.evaluation.scope_kde import detection_probabilities, draw_runs
from wearscope.plugins import list_names
from wearscope.robots.model import load_model
from wearscope.simulation.study import Conditions, simulate_point

#: Robot, test-cycle and integration step [s] of the trial calls. Their choice does not matter: Numba compiles
#: the same code for any.
ROBOT, CYCLE, STEP = "medium", "point_to_point", 0.004


def import_all() -> None:
    """Import all modules of the package except the exports, whose packages may not be installed."""
    for found in pkgutil.walk_packages(wearscope.__path__, "wearscope."):
        if not found.name.startswith("wearscope.export.") and not found.name.endswith("__main__"):
            import_module(found.name)


def compile_ahead() -> None:
    """Compile simulators, detectors and the scope's density estimates, unless they are cached already."""
    model = load_model(ROBOT)
    simulate_point(model, load_cycle(CYCLE).build(model, 0.05, STEP), Conditions((1.0,)), seed=1)
    nominal = [make_batch(model, CYCLE, 0.0, seed) for seed in (1, 2)]
    for name in list_names("detectors", "DETECTOR"):
        detector = load_detector(name)
        detector.fit(nominal, 0, model)
        detector.test_quantity(make_batch(model, CYCLE, 1.0, 3))
    nodes, weights0, weights1 = draw_runs(1, 0, 100)
    detection_probabilities(nodes, nodes[None] + 1.0, weights0, weights1, 100)
    levels = table_nodes()
    detect_tabulated(np.stack([levels, levels + 1.0]), levels, np.ones(1))
    simulate_run(
        TWIN, make_motion(TWIN, "sweep", 1, 1.0, 1.0 / TWIN_STEP), 40.0, "gravity_counterbalance", 0.0
    )


if __name__ == "__main__":
    import_all()
    compile_ahead()
