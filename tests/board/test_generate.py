"""The generator: physics, sizes, determinism, sealed truth, and the folder's form."""

import hashlib

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
import yaml
from folders import plan

from benchmarks.board.disturbances import NOISES, make_noise
from benchmarks.board.generate import generate_dataset
from benchmarks.board.machines import MACHINES, Body
from benchmarks.board.motions import make_motion
from benchmarks.board.outside import OUTSIDE
from benchmarks.board.physics import STRUCTURAL, Active, Setting, behave, make_plant
from benchmarks.board.recipe import Planted, Recipe
from benchmarks.board.terms import NAMED
from wearscope.demonstration.twin import quantise

SHORT = Recipe(duration=7.0, plans=plan(("fourier", 24.0), ("sweep", 52.0), ("points", 40.0)))


def frictionless(machine, rotor=0.0):
    n = len(machine.joints)
    zero = np.zeros(n)
    return Setting(machine, zero, zero, rotor + zero, np.full(n, 1e-3))


def test_torque_does_the_work_that_the_energy_gains():
    machine = MACHINES["arm3"]
    body = Body(machine.urdf, machine.gravity, machine.payload_mass, machine.payload_com)
    motion = make_motion(machine, "fourier", 4, 5.0, 1000.0)
    setting = frictionless(machine, rotor=1.3)
    run = behave(setting, motion, np.zeros_like(motion.q), [], body)
    power = np.sum(run.tau * run.v, axis=1)
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2) / 1000.0])
    model, data = body.model, body.data
    energy = np.array(
        [
            pin.computeKineticEnergy(model, data, q, v)
            + pin.computePotentialEnergy(model, data, q)
            + 0.65 * v @ v
            for q, v in zip(motion.q, motion.v, strict=True)
        ]
    )
    assert np.abs(work - (energy - energy[0])).max() < 1e-4 * np.ptp(energy)


def move_stage(kind, effect, size):
    """The stage without friction along a motion, with one structural effect."""
    machine = MACHINES["stage"]
    body = Body(machine.urdf, machine.gravity, 0.0, (0.0, 0.0, 0.0))
    motion = make_motion(machine, kind, 4, 5.0, 1000.0)
    plant = make_plant(effect, machine, 0, np.random.default_rng(0))
    return motion, behave(frictionless(machine), motion, np.zeros_like(motion.q), [Active(plant, size)], body)


def test_elastic_joint_stretches_by_torque_over_stiffness():
    motion, run = move_stage("fourier", "joint_elasticity", 1e-5)
    assert np.allclose(run.q - motion.q, 62.0 * motion.a * 1e-5)
    # without rotor or friction the motor carries the link's torque alone, wherever it is itself
    assert np.allclose(run.tau, 62.0 * motion.a)
    assert np.allclose(run.declared, 62.0 * run.a)


def test_lost_motion_never_exceeds_half_the_gap():
    motion, run = move_stage("sweep", "backlash", 2e-4)
    ahead = (run.q - motion.q)[:, 0]
    assert 0.9e-4 < np.abs(ahead).max() <= 1e-4
    assert np.all(ahead * motion.a[:, 0] >= -1e-15)


def test_a_late_torque_channel_repeats_the_torque():
    motion, run = move_stage("fourier", "time_delay", 0.007)
    assert np.allclose(run.tau[500:, 0], 62.0 * motion.a[493:-7, 0])


@pytest.mark.parametrize("effect", [*NAMED, *STRUCTURAL, *OUTSIDE])
def test_every_plant_makes_torque_of_the_size_asked_for(effect, tmp_path):
    machine = "arm3"
    joint = "elbow" if effect in ("cross_coupling", "payload_error") else "shoulder"
    if effect == "backlash":
        joint = "waist"
    truth = generate_dataset(tmp_path / "d1", machine, [Planted(effect, joint, 4.0)], 2, SHORT)
    (entry,) = truth["planted"]
    train = truth["signals"]["run"] < 2
    worth = truth["signals"][f"effect_{entry['joint']}"][train]
    assert np.sqrt(np.mean(worth**2)) / truth["noise_rms"][entry["joint"]] == pytest.approx(4.0, rel=0.02)
    assert entry["measured_size"] == pytest.approx(4.0, rel=0.1)
    assert 0 < entry["unabsorbed_size"] < 4.6
    assert entry["outside"] == (effect in OUTSIDE)


@pytest.mark.parametrize("noise", NOISES)
def test_nulls_hold_nothing_but_noise(noise, tmp_path):
    recipe = Recipe(noise=noise, duration=6.0, plans=SHORT.plans)
    truth = generate_dataset(tmp_path / "d1", "stage", [], 3, recipe)
    signals = truth["signals"]
    assert truth["planted"] == []
    assert np.all(signals["effect_slide"] == 0.0)
    recorded = np.concatenate(
        [pd.read_parquet(tmp_path / "d1" / "runs" / f"r{i}.parquet")["tau_slide"] for i in (1, 2, 3)]
    )
    assert np.allclose(recorded - signals["clean_slide"], signals["noise_slide"])
    rms = np.sqrt(np.mean(signals["noise_slide"] ** 2))
    assert rms == pytest.approx(truth["noise_rms"]["slide"], rel=0.35)


@pytest.mark.parametrize("noise", NOISES)
def test_noise_does_not_follow_its_neighbours_and_has_its_size(noise):
    x = make_noise(noise, 20000, np.array([1.0, 3.0]), 250.0, np.random.default_rng(1))
    assert np.allclose(np.sqrt(np.mean(x**2, axis=0)), [1.0, 3.0], rtol=0.25)
    if noise not in ("drift", "hum", "event"):
        assert abs(np.corrcoef(x.T)[0, 1]) < 0.1
    close = np.corrcoef(x[1:, 0], x[:-1, 0])[0, 1]
    assert close < 0.05 if noise in ("plain", "jitter", "heavy") else close > 0.02


def test_encoder_error_is_about_a_count():
    q = np.linspace(0, 1, 5000)[:, None]
    read = quantise(q, np.array([1e-4]), np.random.default_rng(0))
    assert np.allclose(np.round(read / 1e-4), read / 1e-4)
    assert 0.3e-4 < np.std(read - q) < 1.0e-4


def digest(folder):
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


def test_equal_seeds_give_equal_bytes_and_seed_zero_is_a_seed(tmp_path):
    plant = [Planted("stribeck", "slide", 4.0)]
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        generate_dataset(tmp_path / name / "d1", "stage", plant, seed, SHORT)
    first, again, other = (digest(tmp_path / name / "d1") for name in "abc")
    assert first == again
    assert first["runs/r1.parquet"] != other["runs/r1.parquet"]


def test_noise_and_motion_do_not_depend_on_what_is_planted(tmp_path):
    null = generate_dataset(tmp_path / "a" / "d1", "stage", [], 4, SHORT)["signals"]
    full = generate_dataset(tmp_path / "b" / "d1", "stage", [Planted("stribeck", "slide", 2.0)], 4, SHORT)
    signals = full["signals"]
    assert np.array_equal(null["noise_slide"], signals["noise_slide"])
    assert np.allclose(signals["clean_slide"] - signals["effect_slide"], null["clean_slide"])


def test_the_truth_is_not_in_the_folder(tmp_path):
    effect = "presliding_hysteresis"
    truth = generate_dataset(tmp_path / "d1", "stage", [Planted(effect, "slide", 8.0)], 5, SHORT)
    assert truth["planted"][0]["effect"] == effect
    for file in (tmp_path / "d1").rglob("*"):
        if file.is_file():
            content = file.read_bytes().lower()
            for word in (effect.encode(), b"plant", b"truth", b"slip", b"clean", b"noise", b"seed"):
                assert word not in content, (file, word)


@pytest.mark.parametrize("machine", MACHINES)
def test_the_folder_keeps_to_the_format(machine, tmp_path):
    recipe = Recipe(duration=7.0, temperatures=True, plans=SHORT.plans)
    generate_dataset(tmp_path / "d1", machine, [], 6, recipe)
    document = yaml.safe_load((tmp_path / "d1" / "dataset.yaml").read_text())
    assert document["name"] == "d1"
    robot, rate = document["robot"], document["sample_rate"]
    model = pin.buildModelFromXML((tmp_path / "d1" / robot["urdf"]).read_text())
    assert list(model.names)[1:] == robot["joints"]
    assert len(robot["rotor_inertia"]) == len(robot["gear_ratio"]) == model.nv
    assert robot["inertials"] in ("trusted", "approximate")
    assert {run["use"] for run in document["runs"]} == {"train", "test"}
    expected = {("m", "N"), ("rad", "N m")}
    assert (document["units"]["q"], document["units"]["tau"]) in expected
    for run in document["runs"]:
        table = pd.read_parquet(tmp_path / "d1" / run["file"])
        wanted = ["t"] + [f"{p}_{j}" for j in robot["joints"] for p in ("q", "tau", "temp")]
        assert sorted(table.columns) == sorted(wanted)
        assert np.isfinite(table.to_numpy()).all()
        assert np.allclose(np.diff(table["t"]), 1 / rate)
        assert set(run.get("payload", {"mass": 0, "com": 0})) == {"mass", "com"}


def test_approximate_inertials_miss_the_masses_and_say_so(tmp_path):
    recipe = Recipe(duration=6.0, inertia_error=0.05, plans=SHORT.plans)
    generate_dataset(tmp_path / "d1", "arm3", [], 1, recipe)
    document = yaml.safe_load((tmp_path / "d1" / "dataset.yaml").read_text())
    assert document["robot"]["inertials"] == "approximate"
    told = pin.buildModelFromXML((tmp_path / "d1" / "robot.urdf").read_text())
    true = pin.buildModelFromXML(MACHINES["arm3"].urdf)
    for a, b in zip(list(told.inertias)[1:], list(true.inertias)[1:], strict=True):
        ratio = a.mass / b.mass
        assert 0.8 < ratio < 1.25
        assert abs(ratio - 1) > 1e-4
        assert np.allclose(a.inertia, ratio * b.inertia, rtol=1e-4)
        assert np.allclose(a.lever, b.lever)


def test_an_effect_left_out_is_left_out_of_the_declaration(tmp_path):
    for effect, gone in (("rotor_inertia_error", "rotor_inertia"), ("viscous", "viscous")):
        folder = tmp_path / effect / "d1"
        truth = generate_dataset(folder, "stage", [Planted(effect, "slide", 8.0)], 1, SHORT)
        assert gone not in yaml.safe_load((folder / "dataset.yaml").read_text())["declared_effects"]
        assert gone not in truth["declared"]


def test_separability_of_three_effects(tmp_path):
    def plant(effect):
        folder = tmp_path / effect / "d"
        return generate_dataset(folder, "arm3", [Planted(effect, "waist", 4.0)], 1, SHORT)["planted"][0]

    assert plant("viscous_asymmetry")["separable"]
    # at rest friction is undetermined, and where the joint moves the two are one
    assert "coulomb_asymmetry" in plant("torque_offset")["rivals"]
    spring = plant("joint_spring")
    assert not spring["separable"] and "gravity_counterbalance" in spring["rivals"]


def test_nearest_parameter_is_the_planted_one_where_the_form_is_shared(tmp_path):
    truth = generate_dataset(tmp_path / "d1", "stage", [Planted("viscous_asymmetry", "slide", 4.0)], 1, SHORT)
    parameter = truth["planted"][0]["parameters"]["half_difference"]
    assert parameter["nearest"] == pytest.approx(parameter["value"], rel=0.02)


def test_bad_requests_are_refused_before_anything_is_written(tmp_path, refuses):
    for robot, planted, recipe in (
        ("arm9", [], SHORT),
        ("stage", [Planted("stribeck", "hip", 1.0)], SHORT),
        ("stage", [Planted("gremlins", "slide", 1.0)], SHORT),
        ("stage", [Planted("payload_error", "slide", 1.0)], SHORT),
        ("stage", [Planted("cross_coupling", "slide", 1.0)], SHORT),
        ("stage", [], Recipe(noise="pink")),
    ):
        refuses(generate_dataset, tmp_path / "d1", robot, planted, 0, recipe)
        assert not (tmp_path / "d1").exists()
