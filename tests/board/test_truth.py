"""Findability against its known answer, plants that add up, and the spectra of the noises."""

import numpy as np
import pandas as pd
import pytest
from folders import plan
from scipy.signal import welch

from benchmarks.board.disturbances import make_noise
from benchmarks.board.generate import generate_dataset
from benchmarks.board.recipe import Planted, Recipe
from benchmarks.board.truth import measure_findability

PLANS = plan(("fourier", 30.0), ("sweep", 30.0), ("points", 30.0))


def test_the_distance_in_white_noise_is_the_matched_filters():
    rng = np.random.default_rng(0)
    rows, sigma = 20000, 2.0
    effect, noise = 0.1 * np.sin(np.arange(rows)), sigma * rng.normal(size=rows)
    found = measure_findability(effect, noise, np.arange(rows) // 25, 6)
    assert found.distance == pytest.approx(np.sqrt(np.sum(effect**2)) / sigma, rel=0.08)
    # twice the effect stands twice as far out, and half the factor makes it just findable
    double = measure_findability(2 * effect, noise, np.arange(rows) // 25, 6)
    assert double.distance == pytest.approx(2 * found.distance)
    assert double.findable == pytest.approx(found.findable / 2)


def test_an_effect_in_one_block_or_in_none_cannot_be_found():
    noise = np.random.default_rng(1).normal(size=1000)
    block = np.arange(1000) // 25
    once = np.where(block == 3, 1.0, 0.0)
    spread = np.full(1000, np.sqrt(1 / 40))
    assert measure_findability(once, noise, block, 1).findable > 5 * (
        measure_findability(spread, noise, block, 1).findable
    )
    assert measure_findability(np.zeros(1000), noise, block, 1).findable == np.inf


def test_plants_on_different_joints_add_up(tmp_path):
    plants = [Planted("viscous_asymmetry", "elbow", 4.0), Planted("torque_offset", "waist", 3.0)]
    recipe = Recipe(duration=6.0, plans=PLANS)
    both = generate_dataset(tmp_path / "d1", "arm3", plants, 2, recipe)
    for joint, other in (("elbow", "waist"), ("waist", "elbow")):
        (entry,) = [p for p in both["planted"] if p["joint"] == joint]
        train = both["signals"]["run"] < 2
        worth = np.sqrt(np.mean(both["signals"][f"effect_{joint}"][train] ** 2))
        assert worth / both["noise_rms"][joint] == pytest.approx(entry["measured_size"], rel=0.01)
        assert other != joint
    assert not both["signals"]["effect_shoulder"].any()


def test_undeclared_friction_is_truth_with_its_own_parameter(tmp_path):
    recipe = Recipe(duration=6.0, plans=PLANS, declared=("rigid_body", "rotor_inertia"), reversal=0.001)
    plants = [Planted("coulomb", "slide", np.nan, 20.0), Planted("viscous", "slide", np.nan, 100.0)]
    truth = generate_dataset(tmp_path / "d1", "stage", plants, 1, recipe)
    coulomb, viscous = truth["planted"]
    assert coulomb["standard"] and viscous["standard"]
    assert coulomb["parameters"]["level"]["value"] == 20.0
    assert coulomb["separable"] and coulomb["times_findable"] > 2
    # Any form of either has the same level and slope: they are compared as planted.
    assert viscous["parameters"]["slope"] == {"value": 100.0, "unit": "N s/m"}


def test_the_nearest_parameter_is_sought_beside_friction_that_is_not_declared(tmp_path):
    nearest = []
    for folder, declared in (("a", ("coulomb", "viscous")), ("b", ())):
        recipe = Recipe(duration=6.0, plans=PLANS, declared=("rigid_body", "rotor_inertia", *declared))
        plants = [Planted("quadratic_viscous", "slide", 4.0)]
        if not declared:
            plants += [Planted("coulomb", "slide", np.nan, 20.0), Planted("viscous", "slide", np.nan, 100.0)]
        truth = generate_dataset(tmp_path / folder / "d1", "stage", plants, 1, recipe)
        (entry,) = [p for p in truth["planted"] if p["effect"] == "quadratic_viscous"]
        main = entry["parameters"]["slope"]
        nearest.append(main["nearest"] / main["value"])
    assert nearest[0] == pytest.approx(nearest[1], rel=0.02)


def test_noise_is_a_share_of_the_torque_with_friction_that_nobody_declared(tmp_path):
    """A recording is as noisy whether its friction is declared or not."""
    noise = []
    for folder, declared in (("a", ("coulomb", "viscous")), ("b", ())):
        recipe = Recipe(
            duration=6.0, plans=PLANS, declared=("rigid_body", "rotor_inertia", *declared), noise_level=0.01
        )
        level = {"coulomb": 300.0, "viscous": 900.0}
        plants = [] if declared else [Planted(name, "slide", np.nan, size) for name, size in level.items()]
        truth = generate_dataset(tmp_path / folder / "d1", "stage", plants, 1, recipe)
        run = pd.read_parquet(sorted((tmp_path / folder / "d1" / "runs").glob("*.parquet"))[0])
        noise.append(truth["noise_rms"]["slide"] / np.sqrt(np.mean(run["tau_slide"] ** 2)))
    assert noise[1] == pytest.approx(0.01, rel=0.2)
    assert noise[0] == pytest.approx(noise[1], rel=0.2)


RATE = 500.0


def spectrum(kind, **how):
    x = make_noise(kind, 60000, np.array([3.0]), RATE, np.random.default_rng(2), **how)[:, 0]
    assert np.sqrt(np.mean(x**2)) == pytest.approx(3.0, rel=0.2)
    return x, *welch(x, RATE, nperseg=4096)


@pytest.mark.parametrize("kind", ["plain", "heavy", "jitter"])
def test_white_noises_are_flat(kind):
    _, frequency, power = spectrum(kind)
    low, high = power[(frequency > 1) & (frequency < 60)], power[frequency > 190]
    assert low.mean() == pytest.approx(high.mean(), rel=0.15)


@pytest.mark.parametrize("memory", [0.02, 0.06, 0.2])
def test_coloured_noise_remembers_as_long_as_it_says(memory):
    x, _, _ = spectrum("coloured", memory=memory)
    lag = round(memory * RATE)
    kept = np.mean(x[lag:] * x[:-lag]) / np.mean(x**2)
    assert kept == pytest.approx(np.exp(-1.0), abs=0.09)


def test_a_hum_stands_at_its_frequency_and_harmonics_at_multiples():
    _, frequency, power = spectrum("hum", frequency=23.0)
    assert frequency[np.argmax(power)] == pytest.approx(23.0, abs=0.2)
    _, frequency, power = spectrum("harmonics", frequency=11.0)
    floor = np.median(power)
    for order in (1, 2, 3):
        assert power[np.abs(frequency - 11.0 * order) < 0.4].max() > 20 * floor


def test_drift_is_red_and_a_knock_is_short():
    _, frequency, power = spectrum("drift")
    assert power[1] > 30 * power[frequency > 100].mean()
    x = make_noise("event", 10000, np.array([1.0]), RATE, np.random.default_rng(3))[:, 0]
    smooth = np.convolve(x, np.ones(100) / 100, "same")
    assert 50 < np.sum(np.abs(smooth) > 0.5 * np.abs(smooth).max()) < 400
