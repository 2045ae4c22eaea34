"""Torque of servos from what their buses give: planted torques come back by every law."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from urdf_texts import Joint, describe_robot

from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.intake.servo import merge_notes, restore_duty, take_torques
from wearscope.closed_loop.verdict import list_speed_torques
from wearscope.errors import InputError
from wearscope.robots.servos import read_servos

KT, RESISTANCE, GEAR, VOLTS, GAIN, FULL = 0.01, 2.5, 30.0, 7.4, 2.0, 885.0
CONSTANT = KT * GEAR
COULOMB, VISCOUS, HEAVY = 0.02, 0.008, 0.45
SERVO = {"kt": KT, "gear_ratio": GEAR, "resistance": RESISTANCE}
URDF = describe_robot(Joint("arm", "0 -1 0", 0.46, "0 0 -0.1", "1e-4 1e-4 1e-4", limits="-3 3 1 10"))


def move(phase=0.0, seconds=8.0, rate=200.0):
    """A motion of a loaded joint, its torque, and the columns of a servo that makes it."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    w = 2 * np.pi * np.array([0.4, 0.9])[:, None]
    size, shift = np.array([0.8, 0.3])[:, None], np.array([phase, 2 * phase])[:, None]
    q = (size * np.sin(w * t + shift)).sum(axis=0)
    v = (size * w * np.cos(w * t + shift)).sum(axis=0)
    a = -(size * w**2 * np.sin(w * t + shift)).sum(axis=0)
    inertia = 0.46 * 0.01 + 1e-4
    torque = HEAVY * np.sin(q) + inertia * a + COULOMB * np.tanh(v / 0.02) + VISCOUS * v
    duty = (torque * RESISTANCE / CONSTANT + CONSTANT * v) / VOLTS
    frame = pd.DataFrame(
        {
            "t": t,
            "q_arm": q,
            "goal_arm": q + duty / GAIN,
            "duty_arm": np.round(duty * FULL),
            "current_arm": torque / CONSTANT,
            "volts_arm": VOLTS,
        }
    )
    return frame, torque, v


def read(frame, servos=None, joints=("arm",), **servo):
    servos = read_servos("dataset.yaml", servos or SERVO | servo, joints)
    t, q = frame["t"].to_numpy(), frame[[f"q_{joint}" for joint in joints]].to_numpy()
    return take_torques(Path("run.csv"), frame, joints, servos, t, q)


LAWS = [{"law": "duty", "duty_full": FULL}, {"law": "voltage", "gain": GAIN}, {"law": "current"}]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law["law"])
def test_every_law_gives_the_planted_torque(law):
    frame, torque, _ = move()
    found = read(frame, **law).tau[:, 0]
    assert np.abs(found - torque)[5:-5].max() < 2e-3 * np.abs(torque).max()


def test_the_supply_is_the_recorded_one_or_the_stated_one():
    frame, torque, _ = move()
    halved = frame.assign(volts_arm=VOLTS / 2)
    stated = read(frame.drop(columns="volts_arm"), volts=VOLTS, **LAWS[0]).tau
    np.testing.assert_array_equal(stated, read(frame, **LAWS[0]).tau)
    assert np.std(read(halved, **LAWS[0]).tau[:, 0] - torque) > 0.1


def test_the_drive_saturates():
    frame, _, v = move()
    frame["goal_arm"] += 10.0
    found = read(frame, law="voltage", gain=GAIN, duty_limit=0.9).tau[:, 0]
    stall = 0.9 * VOLTS * CONSTANT / RESISTANCE
    np.testing.assert_allclose(found[5:-5], (stall - CONSTANT**2 / RESISTANCE * v)[5:-5], atol=1e-3)


@pytest.mark.parametrize("lost", ["wrapped", "size"])
def test_a_duty_without_its_sign_gets_it_back(lost):
    frame, _, _ = move()
    signed = frame["duty_arm"].to_numpy()
    recorded = np.where(signed < 0, signed + 65536, signed) if lost == "wrapped" else np.abs(signed)
    goal, q, off = frame["goal_arm"].to_numpy(), frame["q_arm"].to_numpy(), np.zeros(len(frame), dtype=bool)
    found, notes = restore_duty("duty", recorded, FULL, goal, q, off)
    np.testing.assert_allclose(found * FULL, signed, atol=1.0)
    assert len(notes) == 1


def test_each_run_tells_its_gain():
    frame, torque, _ = move()
    told = read(frame, gain=2.5, **LAWS[0]).notes
    said = "run.csv: the gain of arm is 2 of full duty for each unit of error, 0.8 times the stated one."
    assert told == (said,)
    shuffled = frame["goal_arm"].sample(frac=1.0, random_state=1).to_numpy()
    assert read(frame.assign(goal_arm=shuffled), **LAWS[0]).notes == ()
    recorded = read(frame.assign(gain_arm=GAIN), law="voltage").tau[:, 0]
    assert np.abs(recorded - torque)[5:-5].max() < 2e-3 * np.abs(torque).max()


def test_notes_of_one_text_are_one():
    notes = [f"{name}.csv: a fact: so." for name in "abcde"] + ["a.csv: another."]
    assert merge_notes(notes) == ["a.csv, b.csv, c.csv and 2 more: a fact: so.", "a.csv: another."]


def test_a_duty_that_does_not_follow_the_error_is_not_turned():
    frame, _, _ = move()
    size = np.abs(np.roll(frame["duty_arm"].to_numpy(), 100))
    goal, q = frame["goal_arm"].to_numpy(), frame["q_arm"].to_numpy()
    with pytest.raises(InputError, match="record it with its sign"):
        restore_duty("duty", size, FULL, goal, q, np.zeros(len(frame), dtype=bool))


def record(folder, change=lambda frame: frame):
    (folder / "runs").mkdir(parents=True)
    (folder / "robot.urdf").write_text(URDF)
    lines = [
        "name: servo", "robot: {urdf: robot.urdf, joints: [arm]}", "sample_rate: 200",
        "servo: {law: duty, kt: 0.3, resistance: 2.5, duty_full: 885}",
        "declared_effects: [rigid_body, coulomb, viscous]", "runs:",
    ]  # fmt: skip
    for name, use, phase in (("a", "train", 0.0), ("b", "train", 1.0), ("c", "test", 2.0)):
        change(move(phase)[0]).to_csv(folder / "runs" / f"{name}.csv", index=False)
        lines.append(f"- {{file: runs/{name}.csv, use: {use}}}")
    (folder / "dataset.yaml").write_text("\n".join(lines))
    return read_dataset(folder, lambda urdf, joints: [False])


def fit(prepared):
    """Friction [N m, N m s/rad] that the training runs show next to the declared body."""
    rows = [
        (run.reduce(np.column_stack([run.signals.sign[:, 0], run.signals.v[:, 0]])),
         run.measured[:, 0] - run.reduce(run.known)[:, 0], run.keep[:, 0])
        for run in prepared.runs_for("train")
    ]  # fmt: skip
    columns = np.vstack([x[keep] for x, _, keep in rows])
    return np.linalg.lstsq(columns, np.concatenate([y[keep] for _, y, keep in rows]), rcond=None)[0]


def test_back_emf_is_told_from_viscous_friction(tmp_path):
    level, slope = fit(prepare(record(tmp_path / "arm")))
    assert slope == pytest.approx(VISCOUS, abs=0.001)
    assert level == pytest.approx(COULOMB, abs=0.002)


def test_the_whole_coefficient_of_the_speed_is_told(tmp_path):
    viscous = SimpleNamespace(
        entry=SimpleNamespace(joint=0, effect=SimpleNamespace(name="viscous")),
        values={"slope": 0.008},
        intervals={"slope": (0.006, 0.010)},
    )
    told = list_speed_torques(record(tmp_path / "arm"), [viscous])["arm"]
    assert told["back_emf"] == pytest.approx(0.036)
    assert told["speed_coefficient"]["value"] == pytest.approx(0.044)
    assert told["speed_coefficient"]["ci95"] == pytest.approx([0.042, 0.046])


def test_rows_with_the_torque_off_do_not_count(tmp_path):
    def switch(frame):
        off = (frame["t"] > 3.0) & (frame["t"] < 5.0)
        frame.loc[off, "duty_arm"] = 0.0
        return frame.assign(on_arm=(~off).astype(int))

    dataset = record(tmp_path / "arm", switch)
    prepared = prepare(dataset)
    for run in prepared.runs:
        assert not run.keep[(run.t > 3.0) & (run.t < 5.0)].any()
        assert run.keep[(run.t > 1.0) & (run.t < 2.5)].any()
    assert fit(prepared) == pytest.approx([COULOMB, VISCOUS], abs=0.002)
    assert any("is off in" in note for note in dataset.notes)


@pytest.mark.parametrize(
    ("servo", "told"),
    [
        ({"law": "duty", "kt": 0.3}, "law duty needs resistance"),
        ({"law": "duty", "resistance": 2.5}, "kt is missing"),
        ({"law": "duty", "kt": -0.3, "resistance": 2.5}, "kt should be greater than 0, but is -0.3"),
        ({"law": "duty", "kt": True, "resistance": 2.5}, "kt should be a number"),
        ({"law": "pwm", "kt": 0.3}, "law should be 'voltage', 'duty' or 'current'"),
        ({"law": "current", "kt": 0.3, "ratio": 2}, "no field 'ratio'"),
        ({"leg": {"law": "current", "kt": 0.3}}, "no joint 'leg'"),
    ],
)
def test_constants_that_are_missing_or_impossible_get_one_sentence(servo, told):
    with pytest.raises(InputError, match=told):
        read_servos("dataset.yaml", servo, ["arm"])


@pytest.mark.parametrize(
    ("law", "column", "told"),
    [
        (LAWS[0], "duty_arm", "'duty_arm' is missing, which servo law duty needs"),
        (LAWS[1], "goal_arm", "'goal_arm' is missing, which servo law voltage needs"),
        ({"law": "voltage"}, "none", "'gain_arm' is missing, and servo states no gain"),
        (LAWS[2], "current_arm", "'current_arm' is missing, which servo law current needs"),
        (LAWS[0], "volts_arm", "'volts_arm' is missing, and servo states no volts"),
    ],
)
def test_a_law_without_its_columns_gets_one_sentence(law, column, told):
    frame, _, _ = move()
    with pytest.raises(InputError, match=told):
        read(frame.drop(columns=column, errors="ignore"), **law)


def test_counts_beyond_the_full_duty_get_one_sentence():
    frame, _, _ = move()
    with pytest.raises(InputError, match=r"beyond duty_full 1; correct servo\.duty_full"):
        read(frame, law="duty")


def test_a_joint_without_a_servo_keeps_its_torque():
    frame, torque, _ = move()
    frame = frame.assign(q_leg=0.0, tau_leg=3.0)
    found = read(frame, {"arm": SERVO | LAWS[0]}, ["arm", "leg"])
    np.testing.assert_array_equal(found.tau[:, 1], 3.0)
    assert np.abs(found.tau[:, 0] - torque)[5:-5].max() < 1e-2
