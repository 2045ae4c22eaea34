"""Servo columns and LeRobot data sets as they come, converted."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from click.testing import CliRunner
from folders import find_real
from urdf_texts import Joint, describe_robot

from wearscope import limits
from wearscope.cli.main import wearscope
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.errors import InputError
from wearscope.robots.servos import read_servos
from wearscope.starters.conversion import convert_recordings
from wearscope.starters.dataset import write_dataset
from wearscope.starters.mapped import Mapped
from wearscope.starters.servos import PRESETS, read_servo_option
from wearscope.storage.tables import check_unpacked


def write_urdf(folder, joints):
    path = folder / "robot.urdf"
    turns = [Joint(one, "1 0 0", 0.4, moments="1e-4 1e-4 1e-4", limits="-3 3 1 10") for one in joints]
    path.write_text(describe_robot(*turns))
    return path


def table(count=1000):
    t = np.arange(count) / 100.0
    return pd.DataFrame(
        {
            "timestamp": t,
            "position": np.sin(t),
            "speed": np.cos(t),
            "goal_position": np.sin(t + 0.1),
            "load": np.round(300 * np.cos(t)).astype(int) % 65536,
            "input_volts": 7.4,
            "temp": 30,
            "torque_enable": True,
        }
    )


def test_columns_of_a_servo_bus_are_found_by_their_names(tmp_path):
    table().to_csv(tmp_path / "run.csv", index=False)
    urdf = write_urdf(tmp_path, ["arm"])
    mapped = Mapped(servo=read_servo_option("xl330"))
    converted = convert_recordings([tmp_path / "run.csv"], urdf, mapped)
    frame = pd.concat([run.frame for run in converted.runs])
    for ours, theirs in {
        "q": "position", "qd": "speed", "goal": "goal_position", "duty": "load", "volts": "input_volts",
        "on": "torque_enable", "temp": "temp",
    }.items():  # fmt: skip
        np.testing.assert_array_equal(frame[f"{ours}_arm"][:300], table()[theirs][:300].astype(float))
    assert "tau_arm" not in frame
    folder = tmp_path / "made"
    folder.mkdir()
    write_dataset(folder, "made", urdf, converted, mapped)
    stated = yaml.safe_load((folder / "dataset.yaml").read_text())["servo"]
    assert read_servos("", stated, ["arm"])["arm"] == mapped.servo


def test_goals_have_the_unit_of_the_positions(tmp_path):
    given = table()
    given[["position", "goal_position"]] *= 180.0 / np.pi
    given.to_csv(tmp_path / "run.csv", index=False)
    mapped = Mapped(servo=read_servo_option("mx64,gain=3"), position_units=["deg"])
    converted = convert_recordings([tmp_path / "run.csv"], write_urdf(tmp_path, ["arm"]), mapped)
    goal = converted.runs[0].frame["goal_arm"]
    assert 500 < len(goal) < 900
    np.testing.assert_allclose(goal, table()["goal_position"][: len(goal)])


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_servos(name):
    assert read_servo_option(f"{name},gain=2,kt=0.5").kt == 0.5


def test_servos_that_are_none_get_one_sentence(refuses):
    for option in ("xl999", "law=duty,kt=x", "law=duty,kt=0.3", "xl330,kt=-1", "xl330,sped=1"):
        refuses(read_servo_option, option)


def test_a_law_whose_column_is_not_found_gets_one_sentence(tmp_path, refuses):
    for lost, option in (("load", "xl330"), ("goal_position", "mx64,gain=2"), ("input_volts", "xl330")):
        table().drop(columns=lost).to_csv(tmp_path / "run.csv", index=False)
        mapped = Mapped(servo=read_servo_option(option))
        refuses(convert_recordings, [tmp_path / "run.csv"], write_urdf(tmp_path, ["arm"]), mapped)


JOINTS = ["shoulder", "elbow"]


def write_lerobot(folder, with_effort=True, layout="v3.0", size=1.0):
    """Two episodes of two joints; in format 3 in one file, in format 2 in a file each."""
    count, rng = 400, np.random.default_rng(5)
    state, effort, goal = rng.normal(size=(3, 2 * count, 2)).astype(np.float32)
    state *= np.float32(size)
    t = np.arange(count, dtype=np.float32) / 50
    columns = {
        "observation.state": state, "action": goal, "observation.effort": effort,
    }  # fmt: skip
    if not with_effort:
        del columns["observation.effort"]
    names = {"observation.state": "pos", "action": "pos", "observation.effort": "effort"}
    features = {
        name: {"dtype": "float32", "shape": [2], "names": [f"{joint}.{names[name]}" for joint in JOINTS]}
        for name in columns
    }
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(
        json.dumps({"codebase_version": layout, "fps": 50, "features": features})
    )
    whole = pa.table(
        {name: pa.array(list(values)) for name, values in columns.items()}
        | {"timestamp": np.tile(t, 2), "episode_index": np.repeat([0, 1], count)}
    )
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    if layout == "v3.0":
        pq.write_table(whole, data / "file-000.parquet")
    else:
        for k in range(2):
            pq.write_table(whole.slice(k * count, count), data / f"episode_{k:06d}.parquet")
    return state.reshape(2, count, 2), effort.reshape(2, count, 2), goal.reshape(2, count, 2)


@pytest.mark.parametrize("layout", ["v2.1", "v3.0"])
def test_lerobot_episodes_become_runs(layout, tmp_path):
    state, effort, _ = write_lerobot(tmp_path / "set", layout=layout)
    converted = convert_recordings(
        [tmp_path / "set"], write_urdf(tmp_path, JOINTS), Mapped(position_units=["rad"])
    )
    assert [(run.name, run.use) for run in converted.runs] == [
        ("episode_000000", "train"),
        ("episode_000001", "test"),
    ]
    assert converted.rate == 50.0
    for k, run in enumerate(converted.runs):
        for j, joint in enumerate(JOINTS):
            np.testing.assert_array_equal(run.frame[f"q_{joint}"], state[k, :, j])
            np.testing.assert_array_equal(run.frame[f"tau_{joint}"], effort[k, :, j])


@pytest.mark.parametrize(("size", "doubted"), [(1.0, False), (25.0, True), (60.0, False)])
def test_lerobot_positions_that_may_be_per_cent_are_doubted(tmp_path, size, doubted):
    state, _, _ = write_lerobot(tmp_path / "set", size=size)
    converted = convert_recordings([tmp_path / "set"], write_urdf(tmp_path, JOINTS), Mapped())
    told = [note for note in converted.notes if "use_degrees" in note]
    assert len(told) == doubted
    if doubted:
        assert f"no position exceeds {np.abs(state).max():.4g}" in told[0]


def test_lerobot_without_effort_needs_a_servo(tmp_path, refuses):
    _, _, goal = write_lerobot(tmp_path / "set", with_effort=False)
    urdf = write_urdf(tmp_path, JOINTS)
    refuses(convert_recordings, [tmp_path / "set"], urdf, Mapped())
    mapped = Mapped(servo=read_servo_option("mx64,gain=2,volts=12"), position_units=["rad"])
    converted = convert_recordings([tmp_path / "set"], urdf, mapped)
    np.testing.assert_array_equal(converted.runs[1].frame["goal_elbow"], goal[1, :, 1])


def test_a_damaged_lerobot_data_set_gets_one_sentence(tmp_path, monkeypatch, refuses):
    write_lerobot(tmp_path / "set")
    urdf = write_urdf(tmp_path, JOINTS)
    file = tmp_path / "set" / "data" / "chunk-000" / "file-000.parquet"
    again = Path(shutil.copy(file, file.with_name("file-001.parquet")))
    together = ("UNPACKED_BYTES", 1.5 * check_unpacked(file), "GB of memory together; download fewer")
    for name, most, told in (together, ("RUNS", 1, "more than 1 episodes")):
        with monkeypatch.context() as bounds, pytest.raises(InputError, match=told):
            bounds.setattr(limits, name, most)
            convert_recordings([tmp_path / "set"], urdf, Mapped())
    again.unlink()
    table = pq.read_table(file)
    column = table.column_names.index("observation.state")
    bodies = pa.array([{"a": 1.0}] * len(table))
    pq.write_table(table.set_column(column, "observation.state", bodies), file)
    with pytest.raises(InputError, match="cannot be read as a LeRobot data set"):
        convert_recordings([tmp_path / "set"], urdf, Mapped())
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(InputError, match="cannot be read as a LeRobot data set"):
        convert_recordings([tmp_path / "set"], urdf, Mapped())
    file.unlink()
    refuses(convert_recordings, [tmp_path / "set"], urdf, Mapped())
    (tmp_path / "set" / "meta" / "info.json").write_text("{}")
    with pytest.raises(InputError, match=r"info.json: cannot be read"):
        convert_recordings([tmp_path / "set"], urdf, Mapped())


PENDULUM = describe_robot(Joint("arm", "0 -1 0", 0.49, "0 0 -0.1", "1e-4 1e-4 1e-4", limits="-3 3 1 15"))


@pytest.fixture
def urdf(tmp_path):
    """The pendulum's."""
    path = tmp_path / "pendulum.urdf"
    path.write_text(PENDULUM)
    return path


@pytest.mark.slow
def test_a_real_servo_from_its_own_columns(tmp_path, urdf):
    """Signs and gains of the XL330's runs, and what opposes its speed, known to 0.038 to 0.046 N m s/rad."""
    files = [
        one for kind in ("*_and_down*.csv", "sin*.csv") for one in sorted(find_real("servo_xl330").glob(kind))
    ]
    files = [file for file in files if not file.name.startswith("lift")]
    made = tmp_path / "made"
    made.mkdir()
    mapped = Mapped(servo=read_servo_option("xl330"))
    write_dataset(made, "made", urdf, convert_recordings(files, urdf, mapped), mapped)
    dataset = read_dataset(made, lambda path, joints: [False])
    assert any("negative values as 16 bits" in note for note in dataset.notes)
    for file in files:
        kp = float(file.stem.partition("kp")[2])
        told = next(note for note in dataset.notes if note.startswith(file.stem) and "the gain of" in note)
        gain = float(told.partition("gain of arm is ")[2].split()[0])
        assert gain == pytest.approx(kp * 4096 / (2 * np.pi) / (256 * 885), rel=0.05)
    rows = []
    for run in prepare(dataset).runs:
        q, v, sign = (x[:, 0] for x in (run.signals.q, run.signals.v, run.signals.sign))
        torque = run.tau[:, 0]
        columns = [np.sin(q), np.cos(q), run.signals.a[:, 0], sign, v, np.abs(torque) * sign, torque]
        rows.append(run.reduce(np.column_stack(columns))[run.keep[:, 0]])
    x = np.vstack(rows)
    found = np.linalg.lstsq(x[:, :-1], x[:, -1], rcond=None)[0]
    assert mapped.servo.back_emf + found[4] == pytest.approx(0.042, abs=0.009)
    assert 0.2 < found[5] < 0.6, "friction grows with the motor's torque"
    named = {entry["effect"]: entry for entry in diagnose(made).verdict["verdict"]}
    # Of the load of the refitted arm, which is 1.3 times the stated one's.
    low, high = named["load_dependent_friction"]["parameters"]["coefficient"]["ci95"]
    assert 0.3 < low < high < 0.7


@pytest.mark.slow
def test_all_recordings_of_a_real_servo_have_the_documented_answer(tmp_path, urdf):
    files = sorted(find_real("servo_xl330").glob("*.csv"))
    options = ["--urdf", str(urdf), "--servo", "xl330", "--name", "servo", "--in", str(tmp_path)]
    options += ["--test", "sin_sin_kp200.csv", "--test", "up_and_down_kp400.csv"]
    done = CliRunner().invoke(wearscope, ["new", "dataset", *map(str, files), *options])
    assert done.exit_code == 0, done.output
    verdict = diagnose(tmp_path / "servo").verdict
    (entry,) = (one for one in verdict["verdict"] if one["effect"] == "load_dependent_friction")
    coefficient = entry["parameters"]["coefficient"]
    assert coefficient["value"] == pytest.approx(0.47, abs=0.03)
    assert coefficient["ci95"][0] < 0.6 < coefficient["ci95"][1]
    speed = verdict["servos"]["arm"]["speed_coefficient"]
    assert speed["ci95"][0] < 0.042 < speed["ci95"][1] and speed["value"] == pytest.approx(0.040, abs=0.002)
    assert verdict["joints"]["arm"]["left_percent"] < 13.0


def test_registers_of_a_servo_are_brought_to_its_units(tmp_path, urdf):
    """Counts from the middle of the turn, tenths of a volt: as if they had been recorded in rad and V."""
    t = np.arange(0.0, 12.0, 0.01)
    q = 0.8 * np.sin(t)
    counts = np.round(2048 + q * 4096 / (2 * np.pi))
    table = {"Timestamp": t, "Present Position": counts, "Present PWM": 300 * np.cos(t)}
    for name, volts in (("tenths", 74), ("volts", 7.4)):
        pd.DataFrame({**table, "Present Input Voltage": np.full(len(t), volts)}).to_csv(
            tmp_path / f"{name}.csv", index=False
        )
        mapped = Mapped(servo=read_servo_option("sts3215"), counts_per_turn=[4096.0])
        made = convert_recordings([tmp_path / f"{name}.csv"], urdf, mapped).runs[0].frame
        np.testing.assert_allclose(made["q_arm"], q[: len(made)], atol=8e-4)
        np.testing.assert_allclose(made["volts_arm"], 7.4, rtol=1e-12)
