"""Recordings in the layouts that recorders write: the signals come out as they went in."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from hostile.bags import write_states
from rosbags.rosbag2 import StoragePlugin
from urdf_texts import Joint, describe_robot

from wearscope.checking.dataset import check_dataset
from wearscope.checking.own_code import make_batch
from wearscope.errors import InputError
from wearscope.robots.model import load_model
from wearscope.starters.conversion import convert_recordings
from wearscope.starters.dataset import write_dataset
from wearscope.starters.held import find_hold
from wearscope.starters.mapped import Mapped
from wearscope.starters.recordings import read_recording
from wearscope.starters.stamps import find_rate, order_rows, to_seconds

URDF = Path(__file__).parents[2] / "config" / "robots" / "medium" / "robot.urdf"
JOINTS = [f"axis_{k}" for k in range(1, 7)]
GEAR = [-105.0, 210.0, 60.0, -99.0, 79.2, -99.0]
SHORT = 3000


@pytest.fixture(scope="module")
def batches():
    """Three motions of the medium robot at 250 Hz."""
    model = load_model("medium").replace(payload=None)
    names = ("point_to_point", "slow_reversals", "spot_welding")
    return [make_batch(model, name, 0.0, seed) for seed, name in enumerate(names)]


@pytest.fixture(scope="module")
def truth(batches):
    """The beginning of the first."""
    start = 250
    rows = slice(start, start + SHORT)
    one = batches[0]
    return one.t[rows] - one.t[start], one.q[rows], one.qd[rows], one.tau[rows]


def convert(path, **mapped):
    return convert_recordings([path], URDF, Mapped(**{"joints": JOINTS, **mapped}))


def log(folder, frame):
    """A recording as CSV."""
    frame.to_csv(folder / "log.csv", index=False)
    return folder / "log.csv"


def whole(converted):
    """Both parts of a lone recording, as one table."""
    return pd.concat([run.frame for run in converted.runs], ignore_index=True)


def assert_same(converted, truth, rows=slice(0, 300), rtol=1e-9, atol=1e-9):
    t, q, _, tau = truth
    frame = whole(converted)
    for k, joint in enumerate(JOINTS):
        np.testing.assert_allclose(frame[f"q_{joint}"][rows], q[rows, k], rtol=rtol, atol=atol)
        np.testing.assert_allclose(frame[f"tau_{joint}"][rows], tau[rows, k], rtol=rtol, atol=1e3 * atol)
    np.testing.assert_allclose(frame["t"][rows], t[rows], atol=1e-6)
    assert converted.rate == 250.0


def table(truth, time, position, torque, q=1.0, tau=1.0, first=1):
    """A recording's columns, in other units where `q` and `tau` are no 1."""
    t, positions, _, torques = truth
    signals = ((position, positions * q), (torque, torques * tau))
    return pd.DataFrame(
        {time: t} | {name.format(k + first): x[:, k] for name, x in signals for k in range(6)}
    )


LAYOUTS = {
    "own names": ("t", "q_axis_{}", "tau_axis_{}", 1.0, 1),
    "rtde": ("timestamp", "actual_q_{}", "actual_torque_{}", 1.0, 0),
    "brackets": ("time [s]", "position[{}]", "effort[{}]", 1.0, 0),
    "degrees by name": ("Time", "A{}_Pos[deg]", "A{}_Trq[Nm]", 180.0 / np.pi, 1),
    "degrees by size": ("time", "q{}", "tau{}", 180.0 / np.pi, 1),
    "paths": ("time", "/joint_states/axis_{}/position", "/joint_states/axis_{}/effort", 1.0, 1),
    "camel": ("TimeStamp", "JointPosition{}", "JointTorque{}", 1.0, 1),
    "kuka": ("Zeit", "AxisAct_A{}", "MotorTorque_A{}", 1.0, 1),
    "abb": ("timestamp", "feedback_joint_{}", "motor_torque_{}", 180.0 / np.pi, 1),
    "joints alone": ("time", "J{}", "J{}_torque", 1.0, 1),
    "mujoco": ("time", "jointpos_axis_{}", "jointactuatorfrc_axis_{}", 1.0, 1),
    "german drives": ("Zeitstempel", "Achse{}.Lageistwert", "Achse{}.Momentenistwert", 1.0, 1),
    "lerobot": ("timestamp", "observation.state_{}", "observation.effort_{}", 1.0, 0),
    "numbers from 0 next to joints from 1": ("t", "axis_{}_q", "axis_{}_tau", 1.0, 0),
    "units at the end": ("t_s", "pos_axis_{}_deg", "axis_{}_torque_Nm", 180.0 / np.pi, 1),
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
def test_columns_of_any_naming(layout, truth, tmp_path):
    time, position, torque, factor, first = layout
    frame = table(truth, time, position, torque, q=factor, first=first)
    frame.insert(1, "target_q_note", 0.0)
    assert_same(convert(log(tmp_path, frame)), truth)


@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", ","), (";", "."), ("\t", "."), ("|", "."), (" ", ".")]
)
def test_any_separator(separator, decimal, truth, tmp_path):
    file = tmp_path / "log.csv"
    table(truth, "t", "q{}", "tau{}").to_csv(file, index=False, sep=separator, decimal=decimal)
    assert_same(convert(file), truth)


CLOCKS = {
    "ms": lambda t: 1e3 * t,
    "us": lambda t: np.round(1e6 * t),
    "ns since 1970": lambda t: np.round(1e9 * t).astype("int64") + 1_716_190_000 * 10**9,
    "s since 1970": lambda t: t + 1_716_190_000.0,
    "ms since 1970": lambda t: 1e3 * t + 1_716_190_000e3,
    "dates": lambda t: pd.Timestamp("2024-05-20T08:00:00Z") + pd.to_timedelta(t, unit="s"),
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_clocks_of_any_unit_and_origin(clock, truth, tmp_path):
    frame = table(truth, "time", "q{}", "tau{}")
    converted = convert(log(tmp_path, frame.assign(time=CLOCKS[clock](frame["time"]))))
    assert_same(converted, truth)
    assert any("epoch" in note for note in converted.notes) == ("since 1970" in clock)


def test_motor_side_currents_and_signed_gears(truth, tmp_path, refuses):
    constant, gear = 0.2, np.array(GEAR)
    signals = ("t", "motor_pos_{}", "actual_current_{} [mA]")
    frame = table(truth, *signals, q=gear, tau=1e3 / gear / constant, first=0)
    file = log(tmp_path, frame.assign(**{f"motor_vel_{k}": truth[2][:, k] * gear[k] for k in range(6)}))
    refuses(convert, file, side="motor", gear_ratio=GEAR)
    refuses(convert, file, side="motor", torque_constant=[constant])
    converted = convert(file, side="motor", gear_ratio=GEAR, torque_constant=[constant])
    assert_same(converted, truth, rtol=1e-7)
    np.testing.assert_allclose(whole(converted)["qd_axis_3"][:300], truth[2][:300, 2], atol=1e-9)


@pytest.mark.parametrize(("name", "gear"), [("motor{}_pos", GEAR), ("q_motor_{}", [9.0] * 6)])
def test_angles_named_as_a_motors_are_no_degrees_without_a_word(truth, tmp_path, name, gear, refuses):
    q = 3.0 * truth[1][:300, 0]
    file = log(tmp_path, table(truth, "t", name, "tau_{}", q=3.0 * np.array(gear), first=0))
    refuses(convert, file)
    for want, options in (
        (q, {"side": "motor", "gear_ratio": gear}),
        (np.radians(q * gear[0]), {"position_units": ["deg"]}),
    ):
        np.testing.assert_allclose(whole(convert(file, **options))["q_axis_1"][:300], want, rtol=1e-7)


def test_measured_values_before_commanded_ones(truth, tmp_path):
    frame = table(truth, "t", "actual_q_{}", "actual_current_{}", first=0)
    for k in range(6):
        frame.insert(1, f"target_q_{k}", 0.0)
        frame.insert(1, f"target_moment_{k}", 7.0)
    assert_same(convert(log(tmp_path, frame), torque_constant=[1.0]), truth)


@pytest.mark.parametrize("lists", [True, False], ids=["lists", "columns"])
def test_joint_states_go_by_the_names_next_to_them(truth, tmp_path, lists):
    """Drivers sort joints by the alphabet: their numbers are not the URDF's."""
    t, q, qd, tau = truth
    order = [2, 1, 0, 5, 4, 3]
    names, values = [JOINTS[k] for k in order], {"position": q, "velocity": qd, "effort": tau}
    if lists:
        frame = pd.DataFrame({"Time": t, "name": [str(names)] * len(t)})
        frame = frame.assign(
            **{kind: [str(row) for row in x[:, order].tolist()] for kind, x in values.items()}
        )
    else:
        frame = pd.DataFrame({"%time": (1e9 * t).astype(np.int64)})
        frame = frame.assign(**{f"field.name{k}": name for k, name in enumerate(names)})
        for kind, x in values.items():
            frame = frame.assign(**{f"field.{kind}{k}": x[:, j] for k, j in enumerate(order)})
    assert_same(convert(log(tmp_path, frame)), truth)
    if lists:
        frame = frame.assign(**{kind: x[:, order].tolist() for kind, x in values.items()}).drop(
            columns="name"
        )
        frame.to_parquet(tmp_path / "log.parquet")
        assert_same(convert(tmp_path / "log.parquet", joints=names), truth)


@pytest.mark.parametrize("stated", [{}, {"position": "m[*].q", "torque": "m[*].tauEst", "velocity": "none"}])
def test_a_part_of_the_joints_has_the_numbers_that_it_has_among_all(truth, tmp_path, stated):
    frame = table(truth, "tick", "m[{}].q", "m[{}].tauEst", first=0).assign(tick=np.arange(SHORT) * 4)
    read = whole(convert(log(tmp_path, frame), joints=["axis_5", "axis_2"], patterns=stated))
    for j in (4, 1):
        np.testing.assert_allclose(read[f"q_axis_{j + 1}"][:300], truth[1][:300, j], atol=1e-9)
        np.testing.assert_allclose(read[f"tau_axis_{j + 1}"][:300], truth[3][:300, j], atol=1e-9)


def hold(x, rows, first=0):
    """Values that a recorder writes again until the next one comes, `rows` later."""
    at = np.arange(len(x))
    return x[np.maximum((at - first) // rows * rows + first, 0)]


@pytest.mark.parametrize("rows", [4, 10])
def test_positions_that_are_held_give_their_own_rows(truth, tmp_path, rows):
    """Torques are new in each row; their mean over a hold stands at its first row. The last joint rests."""
    t, q, qd, tau = truth
    q = np.column_stack([q[:, :5], np.full(len(q), 0.3)])
    held = (t, hold(q, rows), qd, tau)
    made = convert(log(tmp_path, table(held, "t", "q{}", "tau{}")))
    frame = whole(made).iloc[3:100]
    at = np.round(frame["t"].to_numpy() * 250.0).astype(int)
    assert made.rate == pytest.approx(250.0 / rows)
    assert any(note.startswith(f"position is held over {rows} rows") for note in made.notes)
    moving = np.ptp(q[:, 0][at]) > 0.1
    assert moving and set(at % rows) == {0}
    half = (rows - rows % 2) // 2
    mean = np.array([tau[k - half : k + half + 1].mean(axis=0) for k in at])
    for k, joint in enumerate(JOINTS):
        np.testing.assert_allclose(frame[f"q_{joint}"], q[at, k], atol=1e-9)
        np.testing.assert_allclose(frame[f"tau_{joint}"], mean[:, k], rtol=1e-6, atol=1e-6)


def test_a_slow_encoder_is_not_held():
    angle = np.abs(np.mod(np.arange(4000) * 0.001, 2.0) - 1.0)
    noise = np.random.default_rng(0).normal(size=4000)
    assert find_hold(np.round(angle, 2)) == 1
    assert find_hold(np.round(3.0 * noise)) == 1
    assert find_hold(hold(noise, 7, 3)) == 7


def test_columns_that_are_written_by_turns_are_brought_together(truth, tmp_path):
    t, _, qd, _ = truth
    slow = np.column_stack([np.sin((0.5 + 0.1 * k) * t) for k in range(6)])
    frame = table((t, slow, qd, 10.0 * slow), "t", "q{}", "tau{}")
    row = np.arange(len(frame))
    frame.loc[row % 2 == 1, [f"q{k}" for k in range(1, 7)]] = np.nan
    frame.loc[row % 10 != 1, [f"tau{k}" for k in range(1, 7)]] = np.nan
    frame["temp1"] = np.where(row % 100 == 1, 30.0, np.nan)
    made = convert(log(tmp_path, frame))
    assert made.rate == 25.0
    for k, joint in enumerate(JOINTS):
        q, tau = (whole(made)[f"{kind}_{joint}"][5:100] for kind in ("q", "tau"))
        np.testing.assert_allclose(q, 0.1 * tau, atol=2e-3)
        assert np.ptp(tau) > 5.0, k


def test_patterns_name_what_cannot_be_told(truth, tmp_path, refuses):
    file = log(tmp_path, table(truth, "t", "x{}", "y{}"))
    assert_same(convert(file, patterns={"position": "x*", "torque": "y*"}), truth)
    for patterns in ({}, {"position": "z*", "torque": "y*"}, {"position": "x*", "torque": "x*"}):
        refuses(convert, file, patterns=patterns)
    refuses(convert, file, joints=JOINTS[:1] * 2)


def test_lost_repeated_unordered_and_empty_rows(truth, tmp_path):
    frame = table(truth, "t", "q{}", "tau{}").astype(object)
    frame = frame.drop(index=[50, 51, 120])
    frame.loc[200, "q3"] = None
    frame = pd.concat([frame.loc[:300], frame.loc[[300]], frame.loc[301:]])
    order = np.arange(len(frame))
    order[[150, 151]] = order[[151, 150]]
    converted = convert(log(tmp_path, frame.iloc[order]))
    assert [run.name for run in converted.runs] == ["log_first", "log_last"]
    kept = np.delete(np.arange(SHORT), [50, 51, 120, 200])
    assert_same(converted, [one[kept] for one in truth])
    told = " ".join(converted.notes)
    assert "1 rows out of order were sorted" in told and "1 rows with a repeated time" in told
    assert "1 of 2997 rows are not whole" in told


@pytest.mark.parametrize("pattern", [[0.010, 0.010, 0.012], [0.004, 0.0041, 0.0039]])
def test_a_clock_that_jitters_has_its_mean_or_median_rate(pattern):
    t = np.cumsum(np.tile(pattern, 400))
    rate = find_rate(t)
    assert min(abs(rate * np.mean(pattern) - 1.0), abs(rate * np.median(pattern) - 1.0)) < 0.01


def test_a_clock_coarser_than_its_samples_is_spread():
    true = np.arange(2000) / 2000.0
    coarse = pd.Series(np.floor(true * 1000.0))
    t, _ = to_seconds(coarse, "t")
    rows, spread, notes = order_rows(t, "t")
    np.testing.assert_allclose(spread[:-2], true[rows][:-2], atol=6e-4)
    assert find_rate(spread) == 2000.0 and "coarser" in notes[0]


def test_stamps_of_seconds_and_nanoseconds_with_an_empty_row(tmp_path, truth):
    frame = table(truth, "time", "q{}", "tau{}")
    stamps = (frame.pop("time") * 1e9).round().astype("int64") + 1_700_000_000_900_000_000
    frame.insert(0, "header.stamp.sec", (stamps // 10**9).astype(float))
    frame.insert(1, "header.stamp.nanosec", (stamps % 10**9).astype(float))
    frame.loc[2000, "header.stamp.nanosec"] = np.nan
    assert_same(convert(log(tmp_path, frame)), truth)


def test_clocks_that_are_none_get_one_sentence(tmp_path, truth, refuses):
    for change, unit in (
        (lambda t: t[::-1], {"time_unit": "s"}),
        (np.ones_like, {}),
        (np.ones_like, {"time_unit": "s"}),
        (lambda t: t > 0.0, {}),
    ):
        frame = table(truth, "t", "q{}", "tau{}")
        refuses(convert, log(tmp_path, frame.assign(t=change(truth[0]))), **unit)


def write_bag(folder, batch, plugin, rows, apart=False):
    """Joint states in the order that a driver happens to have, as one message or one a joint."""
    order, messages = [2, 0, 1, 5, 4, 3], []
    for row in range(rows):
        stamp = 1_716_190_000_000_000_000 + round(batch.t[row] * 1e9)
        for part in [[k] for k in order] if apart else [order]:
            signals = {"position": batch.q, "velocity": batch.qd, "effort": batch.tau}
            fields = {kind: x[row, part] for kind, x in signals.items()}
            messages.append((stamp, stamp, fields | {"name": [JOINTS[k] for k in part]}))
    write_states(folder, messages, plugin)
    return folder


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP], ids=["sqlite", "mcap"])
@pytest.mark.parametrize("apart", [False, True], ids=["together", "joint by joint"])
def test_joint_states_of_ros_2(plugin, apart, batches, tmp_path, refuses):
    bag = write_bag(tmp_path / "bag", batches[0], plugin, SHORT, apart)
    path = next(bag.glob("*.mcap")) if plugin == StoragePlugin.MCAP else bag
    converted = convert(path)
    one = batches[0]
    truth = one.t[:SHORT], one.q[:SHORT], one.qd[:SHORT], one.tau[:SHORT]
    assert_same(converted, truth)
    refuses(convert, path, topic="/other")


def test_a_bag_that_is_none_and_a_bag_without_its_reader_get_one_sentence(tmp_path, monkeypatch):
    (tmp_path / "x.mcap").write_bytes(b"nothing of the kind")
    with pytest.raises(InputError, match=r"x\.mcap: cannot be read as a ROS 2 bag"):
        convert(tmp_path / "x.mcap")
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(InputError, match=r"wearscope\[ros\]"):
        read_recording(tmp_path / "x.mcap")


def log_all(folder, batches, rows=None):
    """Recordings of the batches as CSV, and their names."""
    files = [folder / f"{name}.csv" for name in "abcd"[: len(batches)]]
    for file, one in zip(files, batches, strict=True):
        parts = [x[:rows] for x in (one.t, one.q, one.qd, one.tau)]
        table(parts, "t", "q{}", "tau{}").to_csv(file, index=False)
    return files


def test_the_last_recording_is_the_test_or_the_one_that_is_named(batches, tmp_path, refuses):
    files = log_all(tmp_path, batches, SHORT)
    uses = lambda **mapped: [run.use for run in convert_recordings(files, URDF, Mapped(**mapped)).runs]  # noqa: E731
    assert uses() == ["train", "train", "test"]
    assert uses(test=["a.csv"]) == ["test", "train", "train"]
    refuses(uses, test=["d.csv"])


def test_what_is_written_passes_the_check(batches, tmp_path):
    """Joint by joint too: a coarse encoder's joints at rest are no fault."""
    sweeps = make_batch(load_model("medium").replace(payload=None), "axis_sweeps", 0.0, 9)
    coarse = [replace(one, q=np.round(one.q, 4)) for one in [*batches, sweeps]]
    mapped = Mapped()
    converted = convert_recordings(log_all(tmp_path, coarse), URDF, mapped)
    (tmp_path / "arm").mkdir()
    write_dataset(tmp_path / "arm", "arm", URDF, converted, mapped)
    assert check_dataset(tmp_path / "arm").problems == []
    assert "axis_1" in (tmp_path / "arm" / "dataset.yaml").read_text()


def test_a_recording_of_nothing_or_one_row_is_refused(tmp_path, refuses):
    """One row has no step of time, from which a rate would be taken."""
    for text in ("", "\n\n", "t,q\n", "t,q1,tau1\n0,0.1,abc\n0.01,0.2,1\n"):
        (tmp_path / "monday.csv").write_text(text)
        refuses(convert, tmp_path / "monday.csv", joints=JOINTS[:1])


def test_radians_stated_as_degrees_are_noted(tmp_path, truth):
    path = log(tmp_path, table(truth, "t", "q_axis_{}", "tau_axis_{}"))
    told = "read as deg, as stated, though none exceeds"
    assert any(told in note for note in convert(path, position_units=["deg"]).notes)
    assert not any(told in note for note in convert(path, position_units=["rad"]).notes)


MIXED = describe_robot(
    Joint("no", "0 0 1", 2, limits="-3 3 9 9"), Joint("2", "1 0 0", 2, kind="prismatic", limits="0 0.4 9 9")
)


def mixed(folder, names, *factors, whole=False, **mapped):
    """Recording of a joint that turns and one that slides, as it is and as it is read."""
    (folder / "m.urdf").write_text(MIXED)
    t = np.arange(1500) / 100.0
    q = np.column_stack([0.9 * np.sin(t), 0.2 + 0.1 * np.cos(2.0 * t)])
    kept = q * factors
    if whole:
        kept = np.mod(np.round(kept), 4096.0)
    table = dict(zip(["time", *names, "tau_1", "tau_2"], np.column_stack([t, kept, q]).T, strict=True))
    pd.DataFrame(table).to_csv(folder / "a.csv", index=False)
    made = convert_recordings([folder / "a.csv"], folder / "m.urdf", Mapped(**mapped))
    frame = made.runs[0].frame
    return q[: len(frame)], frame[["q_no", "q_2"]].to_numpy(), made


@pytest.mark.parametrize(
    ("names", "factors", "stated"),
    [
        (("pos_1_deg", "pos_2_mm"), (57.29578, 1e3), ()),
        (("pos_1", "pos_2"), (1.0, 1e3), ("rad", "mm")),
        (("pos_1", "pos_2"), (57.29578, 1e3), ()),
        (("pos_1", "pos_2"), (57.29578, 1.0), ("deg",)),
        (("pos_1", "pos_2"), (1.0, 1e3), ("mm",)),
    ],
)
def test_a_slides_unit_is_not_that_of_a_joint_that_turns(tmp_path, names, factors, stated):
    q, read, _ = mixed(tmp_path, names, *factors, position_units=stated)
    np.testing.assert_allclose(read, q, rtol=1e-6, atol=1e-9)


def test_counters_that_begin_again_are_unwrapped(tmp_path, refuses):
    turns, metre = 60_000.0, 90_000.0
    refuses(mixed, tmp_path, ("pos_1", "pos_2"), turns / (2.0 * np.pi), metre, whole=True)
    given = tmp_path, ("pos_1", "pos_2"), turns / (2.0 * np.pi), metre
    q, read, _ = mixed(*given, whole=True, counts_per_turn=[turns, metre])
    np.testing.assert_allclose(read - read[0], q - q[0], atol=1.1e-4)


@pytest.mark.parametrize("held", [1, 4])
@pytest.mark.parametrize("turn", [360.0, 2.0 * np.pi])
def test_angles_that_begin_again_at_a_full_turn_are_those_of_one_turn(tmp_path, turn, held):
    """Degrees and radians, with a jittering clock, held over rows, and files of two rates."""
    (tmp_path / "m.urdf").write_text(MIXED)
    rng, true = np.random.default_rng(3), []
    for k, rate in enumerate((400.0, 100.0)):
        t = np.arange(20.0 * rate) / rate + 0.05 / rate * rng.normal(size=int(20.0 * rate))
        q = (0.1 - 0.2 * k) + 1.4 * np.sin(t + k)
        seen = q if held == 1 else q[np.arange(len(q)) // held * held]
        table = {"time": t, "pos_1": seen / (2.0 * np.pi) * turn % turn, "pos_2": 0.2 + 0.1 * np.cos(t)}
        pd.DataFrame({**table, "tau_1": q, "tau_2": t}).to_csv(tmp_path / f"{k}.csv", index=False)
        true.append((t - t[0], q))
    files = [tmp_path / f"{k}.csv" for k in range(2)]
    made = convert_recordings(files, tmp_path / "m.urdf", Mapped())
    for run, (t, q) in zip(made.runs, true, strict=True):
        assert np.abs(run.frame["q_no"] - np.interp(run.frame["t"], t, q)).max() < 0.06
    assert any("no: unwrapped where a full turn begins again" in one for one in made.notes)


def test_names_that_yaml_takes_for_something_else(tmp_path):
    _, _, made = mixed(tmp_path, ("pos_1", "pos_2"), 1.0, 1.0)
    mapped = Mapped(gravity=[0.0, -9.81, 0.0], readings={"": "motor", "2": "none"})
    (tmp_path / "off").mkdir()
    write_dataset(tmp_path / "off", "off", tmp_path / "m.urdf", made, mapped)
    fields = yaml.safe_load((tmp_path / "off" / "dataset.yaml").read_text())
    assert fields["name"] == "off" and fields["robot"]["joints"] == ["no", "2"]
    assert fields["robot"]["gravity"] == [0.0, -9.81, 0.0] and fields["torque"] == {
        "no": "motor",
        "2": "none",
    }


def test_a_count_of_rows_is_no_clock(refuses):
    counts = pd.Series(np.arange(500))
    refuses(to_seconds, counts, "f: column 'sample'", name="sample")
    for name in ("time", "t_ms"):
        assert find_rate(to_seconds(counts, "f", name=name)[0]) == 1000.0
    assert find_rate(to_seconds(100 * counts, "f", name="time_us")[0]) == 10_000.0


@pytest.mark.parametrize(("option", "factor"), [((), 1.0), ((0.001,), 0.001)])
def test_torques_in_another_unit_take_its_size(truth, tmp_path, option, factor):
    frame = table(truth, "t", "q{}", "tau{}", tau=1.0 / factor)
    assert_same(convert(log(tmp_path, frame), torque_constant=option), truth)


def test_velocities_may_be_left_out(truth, tmp_path):
    frame = table(truth, "t", "q{}", "tau{}")
    frame[[f"qd{k + 1}" for k in range(6)]] = 100.0 * truth[2]
    file = log(tmp_path, frame)
    assert "qd_axis_1" in whole(convert(file))
    assert "qd_axis_1" not in whole(convert(file, patterns={"velocity": "none"}))


@pytest.mark.parametrize("stamp", ["seconds", "dates"])
def test_a_file_whose_clock_restarts_holds_several_recordings(truth, tmp_path, stamp):
    one = table(truth, "time", "q_axis_{}", "tau_axis_{}")
    parts = [one.iloc[:900], one.iloc[:700], one.iloc[:800]]
    whole_file = pd.concat(parts, ignore_index=True)
    if stamp == "dates":
        stamps = pd.Timestamp("2026-03-01") + pd.to_timedelta(whole_file["time"], unit="s")
        whole_file["time"] = stamps.dt.strftime("%Y-%m-%dT%H:%M:%S.%f")
    converted = convert(log(tmp_path, whole_file))
    assert [run.name for run in converted.runs] == ["log-1", "log-2", "log-3"]
    assert [run.use for run in converted.runs] == ["train", "train", "test"]
    for run, part in zip(converted.runs, parts, strict=True):
        np.testing.assert_allclose(run.frame["q_axis_1"], part["q_axis_1"], rtol=1e-9)
        np.testing.assert_allclose(run.frame["t"], part["time"], atol=1e-6)
    assert "log.csv: its clock restarts, so that it is taken as 3 recordings." in converted.notes
    one.to_csv(tmp_path / "other.csv", index=False)
    files, mapped = [tmp_path / "other.csv", tmp_path / "log.csv"], Mapped(joints=JOINTS, test=["log.csv"])
    uses = [run.use for run in convert_recordings(files, URDF, mapped).runs]
    assert uses == ["train", "test", "test", "test"]
