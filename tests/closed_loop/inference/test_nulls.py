"""From the board's generator to the verdict where nothing is wrong: no noise of any kind gets a name."""

from itertools import cycle

import numpy as np
import pytest
from folders import PLANS

from benchmarks.board.disturbances import NOISES
from benchmarks.board.draw_machines import draw_machine
from benchmarks.board.generate import generate_dataset
from benchmarks.board.recipe import Recipe
from wearscope.closed_loop.run import close_loop

#: What follows time and no motion: it may be said to be left, but not named.
IN_TIME = ("hum", "event", "harmonics")


def close_on(folder, machine, seed, **changed):
    recipe = Recipe(**({"duration": 8.0, "rate": 125.0, "plans": PLANS} | changed))
    generate_dataset(folder / "d1", machine, [], seed, recipe)
    return close_loop(folder / "d1", folder / "out", light=True)


@pytest.mark.parametrize(("noise", "level"), [*zip(NOISES, cycle((0.1, 0.03)), strict=False)])
def test_noise_is_given_no_name(tmp_path, noise, level):
    verdict = close_on(tmp_path, "arm3", 21, noise=noise, noise_level=level)
    assert verdict["verdict"] == []
    for joint in verdict["joints"].values():
        assert joint["rms_after"] == joint["rms_before"]
        assert joint["state"] == "explained" or noise in IN_TIME


@pytest.mark.parametrize("declared", [("rigid_body",), ("rigid_body", "coulomb", "viscous")])
def test_a_slide_with_less_declared_is_given_no_name_either(tmp_path, declared):
    """The generator lets act what is declared, and nothing else."""
    verdict = close_on(tmp_path, "stage", 22, noise_level=0.1, declared=declared)
    assert verdict["verdict"] == []


@pytest.mark.parametrize(("noise", "seed"), [("plain", 1), ("coloured", 2)])
def test_a_light_wrist_has_no_gear_fault_in_a_torque_of_much_noise(tmp_path, noise, seed):
    """The transmitted torque of a wrist is mostly the noise of what it is to explain."""
    machine = draw_machine("light_wrist", np.random.default_rng(seed), joints=3)
    verdict = close_on(tmp_path, machine, seed, noise=noise, noise_level=0.1)
    assert verdict["verdict"] == []
