"""Text as recorders write it: what stands around the numbers, names, units and shares of a rated torque."""

import gzip
import re
import zipfile

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat
from urdf_texts import Joint, describe_robot

from wearscope.errors import InputError
from wearscope.starters.columns import find_groups, find_time, match_pattern
from wearscope.starters.conversion import convert_recordings
from wearscope.starters.mapped import Mapped
from wearscope.starters.recordings import read_recording
from wearscope.starters.states import spread_states
from wearscope.starters.text_files import read_text

T = np.arange(0.0, 14.0, 0.01)
Q = np.column_stack([0.4 * np.sin(T), 0.3 * np.cos(2.0 * T)])
TAU = np.column_stack([3.0 * np.sin(T) + 0.25, 2.0 * np.cos(T)])
NAMES = ["time", "q_1", "q_2", "tau_1", "tau_2"]
URDF = describe_robot(*(Joint(f"{side}_axis", "0 1 0", limits="-3 3 9 9") for side in ("left", "right")))


def table():
    return pd.DataFrame(np.column_stack([T, Q, TAU]), columns=NAMES)


def rows(separator=",", point="."):
    text = table().to_csv(index=False, header=False, sep=separator, float_format="%.9g")
    return text.replace(".", point)


def assert_same(made, **truth):
    """Whether the first 400 rows of a conversion are as recorded."""
    for k, joint in enumerate(("left_axis", "right_axis")):
        for one, x in ({"q": Q, "tau": TAU} | truth).items():
            np.testing.assert_allclose(made.runs[0].frame[f"{one}_{joint}"][:400], x[:400, k], atol=1e-7)


def convert(folder, *files, **mapped):
    (folder / "robot.urdf").write_text(URDF)
    return convert_recordings(files or [folder / "a.csv"], folder / "robot.urdf", Mapped(**mapped))


def log(folder, names, *columns):
    np.savetxt(folder / "a.csv", np.column_stack(columns), "%.9g", ",", header=",".join(names), comments="")


HEADER = ",".join(NAMES) + "\n"
WRAPPED = {
    "lines above": ("Export of a trace\nController: 7, 3.2\n\n" + HEADER, rows(), "utf-8"),
    "as many cells above": ("File,a.svdx,,,\nRate,100,,,\n" + HEADER, rows(), "utf-8"),
    "commented names": ("# " + HEADER, rows(), "utf-8"),
    "byte-order mark": (HEADER, rows(), "utf-8-sig"),
    "two bytes a letter": (HEADER, rows(), "utf-16"),
    "sums below": (HEADER, rows() + "Mean,0,0,1.5,2\n", "utf-8"),
    "decimal commas": (HEADER.replace(",", ";"), rows(";", ",") + "Mittelwert;0,5;0,5;1,5;2\n", "utf-8"),
    "a separator at each line's end": (HEADER, rows().replace("\n", ",\n"), "utf-8"),
    "a column twice": (
        HEADER.replace("q_1", "q_1,q_1"),
        re.sub(r"(?m)^([^,]*),([^,]*)", r"\1,\2,\2", rows()),
        "utf-8",
    ),
}


@pytest.mark.parametrize("kind", WRAPPED)
def test_what_stands_around_the_numbers_is_left_out(kind, tmp_path):
    above, numbers, encoding = WRAPPED[kind]
    (tmp_path / "a.csv").write_text(above + numbers, encoding=encoding)
    frame, _ = read_recording(tmp_path / "a.csv")
    got = frame[NAMES].apply(pd.to_numeric, errors="coerce").dropna().to_numpy()[: len(T)]
    np.testing.assert_allclose(got, np.column_stack([T, Q, TAU]), rtol=1e-7, atol=1e-12)


def by_row(key, names, values=("position", "torque"), sort="time"):
    """A row for each joint and time."""
    long = [
        pd.DataFrame({"time": T, key: name, values[0]: Q[:, k], values[1]: TAU[:, k]})
        for k, name in enumerate(names)
    ]
    return pd.concat(long).sort_values(sort, kind="stable").to_csv(index=False)


def say_time(form, start="2026-03-11 23:59:55", **options):
    stamps = pd.Timestamp(start) + pd.to_timedelta(T, unit="s")
    return table().assign(time=[form(one) for one in stamps]).to_csv(index=False, **options)


def say_in_german(x):
    return f"{x:,.6f}".translate(str.maketrans(",.", ".,"))


TABLES = {
    "joints by name": by_row("joint", ["left_axis", "right_axis"]),
    "joints by number": by_row("axis", [1, 2], ("position_rad", "torque_Nm")),
    "joints one below the other": by_row("joint", ["left_axis", "right_axis"], sort="joint"),
    "fortran": table().to_csv(index=False, float_format="%.9E").replace("E", "D"),
    "printed signs": table().to_csv(index=False).replace("-", "\u2212"),
    "a date and a time": say_time(lambda one: one.strftime("%d/%m/%Y,%H:%M:%S.%f"), "2026-03-11").replace(
        "time,", "Date,Time,"
    ).replace('"', ""),
    "a moment of arrival": table().assign(
        arrival_time=1e9 + T + np.random.default_rng(0).exponential(0.02, len(T))
    )[["arrival_time", *NAMES]].to_csv(index=False),
    "units at the end": "t,J1_rad,J2_rad,J1_Nm,J2_Nm\n" + table().to_csv(index=False, header=False),
    "signals": table().melt("time", var_name="signal").sort_values("time", kind="stable").to_csv(index=False),
    "german dates": say_time(
        lambda one: one.strftime("%d.%m.%Y %H:%M:%S,%f"), sep=";", decimal=","
    ),
    "american dates": say_time(lambda one: one.strftime("%m/%d/%Y %I:%M:%S.%f %p")),
    "times of the day": say_time(lambda one: one.strftime("%H:%M:%S.%f")),
    "days": table().assign(time=46000.25 + T / 86400.0).to_csv(index=False, float_format="%.15g"),
    "thousands": table().assign(time=[f"{1000.0 * one:,.1f}" for one in T]).to_csv(index=False),
    "german thousands": table().assign(time=1000.0 * T).map(say_in_german).to_csv(index=False, sep=";"),
    "names over kinds": ",left_axis,,right_axis,\ntime" + ",position,torque" * 2 + "\n"
    + table()[["time", "q_1", "tau_1", "q_2", "tau_2"]].to_csv(index=False, header=False),
    "kinds over names": "time,position,,torque,\n,1,2,1,2\n".replace("1", "J1").replace("2", "J2")
    + table().to_csv(index=False, header=False),
    "torque and force": "left_axis pos [deg],left_axis torque [Nm],right_axis pos [deg],"
    + "right_axis force [kN],data.t\n"
    + table().assign(q_1=np.degrees(Q[:, 0]), q_2=np.degrees(Q[:, 1]), tau_2=TAU[:, 1] / 1000.0)[
        ["q_1", "tau_1", "q_2", "tau_2", "time"]
    ].to_csv(index=False, header=False),
}  # fmt: skip


@pytest.mark.parametrize("kind", TABLES)
def test_tables_of_other_forms_are_the_same_recording(kind, tmp_path):
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for file in files:
        file.write_text(TABLES[kind])
    made = convert(tmp_path, *files)
    frame = made.runs[0].frame
    t = frame["t"].to_numpy()
    assert len(frame) == len(T) and np.allclose(t - t[0], T, atol=1e-5)
    for k, joint in enumerate(made.joints):
        assert np.allclose(frame[f"q_{joint}"], Q[:, k], atol=1e-6)
        assert np.allclose(frame[f"tau_{joint}"], TAU[:, k], atol=1e-5)


def pack(path, name, text, more=()):
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(text.encode()))
        return path
    with zipfile.ZipFile(path, "w") as archive:
        for one in (name, *more):
            archive.writestr(one, text)
    return path


@pytest.mark.parametrize("name", ["a.jsonl", "a.json", "a.npz", "a.mat"])
def test_json_and_arrays_are_tables(name, tmp_path):
    whole = table()
    tau = whole[["tau_1", "tau_2"]].to_numpy()
    arrays = {"rate": 100.0, "tau": tau, **{k: whole[k].to_numpy() for k in ("time", "q_1", "q_2")}}
    if name == "a.npz":
        np.savez(tmp_path / name, **arrays)
    elif name == "a.mat":
        savemat(tmp_path / name, arrays)
    else:
        whole.to_json(tmp_path / name, orient="records", lines=name == "a.jsonl", double_precision=12)
    frame, _ = read_recording(tmp_path / name)
    assert sorted(frame.columns) == sorted(NAMES)
    assert np.allclose(frame[NAMES], whole[NAMES])


def test_of_matlab_the_longest_numeric_arrays_are_read(tmp_path):
    """Structures, samples along either side; what is shorter is told, what is no number is no column."""
    q = np.linspace(0.0, 1.0, 12).reshape(6, 2)
    inner = {"q": q.T, "time": np.arange(6.0)[:, None], "robot": {"tool": np.eye(3), "name": "arm"}}
    savemat(tmp_path / "a.mat", {"run": inner, "z": q[:, 0] * 1j, "tau_test": q[:5]})
    frame, told = read_recording(tmp_path / "a.mat")
    assert list(frame.columns) == ["run_q_1", "run_q_2", "run_time"]
    assert np.array_equal(frame[["run_q_1", "run_q_2"]], q)
    assert told == ["a.mat: arrays with fewer than 6 samples are left out: run_robot_tool, tau_test."]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "Mat file appears to be truncated"),
        (b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM", "HDF reader for matlab v7.3"),
        (b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM\x0e\x00\x00\x00\xff", "could not read bytes"),
    ],
)
def test_a_mat_that_cannot_be_read_says_so(content, reason, tmp_path):
    (tmp_path / "a.mat").write_bytes(content)
    with pytest.raises(InputError, match=f"a.mat: cannot be read as a table .*{reason}.*; save it as CSV"):
        read_recording(tmp_path / "a.mat")


def test_a_mat_with_a_structure_without_end_is_refused(tmp_path, refuses):
    savemat(tmp_path / "a.mat", {"run": np.array([{"q": 1.0}] * 3)})
    content = (tmp_path / "a.mat").read_bytes()
    shape = np.array([1, 3], dtype="<i4").tobytes()
    (tmp_path / "a.mat").write_bytes(content.replace(shape, np.array([1, 1 << 24], dtype="<i4").tobytes(), 1))
    refuses(read_recording, tmp_path / "a.mat")


@pytest.mark.parametrize("lines", [True, False])
def test_lists_in_json_are_columns(lines, tmp_path):
    whole = pd.DataFrame({"ts": T, "joint_positions": Q.tolist(), "joint_torques": TAU.tolist()})
    file = tmp_path / ("a.jsonl" if lines else "a.json")
    whole.to_json(file, orient="records", lines=lines, double_precision=12)
    assert_same(convert(tmp_path, file))


def test_what_is_no_table_of_json_or_arrays_is_told(tmp_path, refuses):
    (tmp_path / "a.jsonl").write_text('{"time": 0, "q": {"left": 1, "right": 2}}\n' * 9)
    refuses(read_recording, tmp_path / "a.jsonl")
    np.savez(tmp_path / "b.npz", q=np.array([{}], dtype=object))
    with pytest.raises(InputError, match="cannot be read as a table"):
        read_recording(tmp_path / "b.npz")


@pytest.mark.parametrize("name", ["a.csv.gz", "a.zip"])
def test_a_packed_table_is_read_and_what_is_none_is_told(name, tmp_path):
    frame, _ = read_recording(pack(tmp_path / name, "inner/a.csv", HEADER + rows()))
    assert list(frame.columns) == NAMES and np.allclose(frame[["q_1", "q_2"]], Q)
    with pytest.raises(InputError, match=rf"{name}: is a single line"):
        read_recording(pack(tmp_path / name, "a.csv", HEADER))
    (tmp_path / name).write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(InputError, match=rf"{name}: cannot be read as a table"):
        read_recording(tmp_path / name)


def test_packed_files_that_are_several_large_or_no_table_are_told(tmp_path, monkeypatch, refuses):
    refuses(read_recording, pack(tmp_path / "a.zip", "a.csv", HEADER, ["b.csv"]))
    refuses(read_recording, pack(tmp_path / "a.zip", "a.pdf", HEADER))
    monkeypatch.setattr("wearscope.limits.TABLE_BYTES", 2000)
    refuses(read_recording, pack(tmp_path / "a.csv.gz", "a.csv", HEADER + "1,1,1,1,1\n" * 1000))


@pytest.mark.parametrize(
    "other",
    [
        {"channel_mode": np.where(np.sin(T) > 0, "a", "b")},
        {"joint": np.arange(len(T)) // 700},
        {"run_id": np.arange(len(T)) // 700, "time": np.tile(T[:700], 2)},
    ],
    ids=["state", "joint that is tested", "recording"],
)
def test_what_changes_now_and_then_is_no_joint(tmp_path, other):
    frame = table().assign(**other)
    frame.to_csv(tmp_path / "a.csv", index=False)
    assert list(spread_states(read_recording(tmp_path / "a.csv")[0]).columns) == list(frame.columns)


def test_cells_that_are_no_numbers_are_told_not_left_out(tmp_path, refuses):
    frame = table().astype({"q_2": object})
    frame.loc[::7, "q_2"] = "1.2.3"
    frame.to_csv(tmp_path / "a.csv", index=False)
    refuses(convert, tmp_path)


def test_a_first_row_that_is_not_whole_is_no_header(tmp_path):
    first, rest = rows().split("\n", 1)
    cut = first.split(",")
    (tmp_path / "a.csv").write_text(HEADER + ",".join([cut[0], "", "", *cut[3:]]) + "\n" + rest)
    frame, _ = read_recording(tmp_path / "a.csv")
    assert list(frame.columns) == NAMES and len(frame) == len(T)


def test_a_column_that_stands_twice_with_other_values_is_refused(tmp_path, refuses):
    log(tmp_path, ["time", "q_1", "q_1", "tau_1", "tau_2"], T, Q, TAU)
    refuses(read_recording, tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("columns", "kind", "first"),
    [
        (["q_d[0]", "q_d[1]", "q[0]", "q[1]"], "position", "q[0]"),
        (["ASPos.A1", "ASPos.A2", "AIPos.A1", "AIPos.A2"], "position", "AIPos.A1"),
        (["Left Sollposition", "Right Sollposition", "Left Istposition", "Right Istposition"], "position",
         "Left Istposition"),
        (["motorcurrent_left", "motorcurrent_right"], "current", "motorcurrent_left"),
        (["MACur1", "MACur2"], "current", "MACur1"),
        (["eff_left", "eff_right"], "torque", "eff_left"),
        (["Left Kraft", "Right Kraft"], "torque", "Left Kraft"),
        (["Soll_left [°]", "Soll_right [°]", "Ist_left [°]", "Ist_right [°]"], "position", "Ist_left [°]"),
        (["Ist_left [°]", "Ist_right [°]", "Ist_left [°/s]", "Ist_right [°/s]"], "velocity",
         "Ist_left [°/s]"),
        (["est trq left", "est trq right", "trq left", "trq right"], "torque", "trq left"),
        (["motor_q_left", "motor_q_right", "link_q_left", "link_q_right"], "position", "link_q_left"),
        (["motor_vel_left", "motor_vel_right"], "velocity", "motor_vel_left"),
        (["axisQCmd_A1", "axisQCmd_A2", "axisQMsr_A1", "axisQMsr_A2"], "position", "axisQMsr_A1"),
        (["qpos_0", "qpos_1", "qvel_0", "qvel_1"], "position", "qpos_0"),
        (["qfrc_actuator_0", "qfrc_actuator_1"], "torque", "qfrc_actuator_0"),
        (["Axis1.PosDiff", "Axis2.PosDiff", "Axis1.ActVelo", "Axis2.ActVelo"], "velocity", "Axis1.ActVelo"),
        (["FB PULSE AXIS1", "FB PULSE AXIS2"], "position", "FB PULSE AXIS1"),
        (["computed_torque_1", "computed_torque_2", "motor_torque_1", "motor_torque_2"], "torque",
         "motor_torque_1"),
        (["motor_iq_1", "motor_iq_2"], "current", "motor_iq_1"),
        (["qd1", "qd2", "dq1", "dq2"], "velocity", "dq1"),
        (["qd1", "qd2"], "velocity", "qd1"),
        (["jp1", "jp2", "jv1", "jv2"], "position", "jp1"),
        (["jp1", "jp2", "jv1", "jv2"], "velocity", "jv1"),
        (["Posición_1", "Posición_2", "Par_1 [Nm]", "Par_2 [Nm]"], "position", "Posición_1"),
        (["Posición_1", "Posición_2", "Par_1 [Nm]", "Par_2 [Nm]"], "torque", "Par_1 [Nm]"),
        (["Velocità_1", "Velocità_2", "Coppia_1", "Coppia_2"], "velocity", "Velocità_1"),
        (["ref_joint_1", "ref_joint_2", "fdb_joint_1", "fdb_joint_2"], "position", "fdb_joint_1"),
    ],
)  # fmt: skip
def test_names_as_makers_write_them(columns, kind, first):
    groups = find_groups(columns, ["left_axis", "right_axis"], kind)
    assert groups[0].columns[0] == first


def test_letters_are_those_of_the_joints_names():
    """As a maker's joint_1_s stands in its controller's columns: S."""
    columns = ["Time(ms)", "FB pulse L", "FB pulse S", "CMD pulse L", "CMD pulse S", "Torque L", "Torque S"]
    found = [find_groups(columns, ["joint_1_s", "joint_2_l"], kind)[0] for kind in ("position", "torque")]
    assert [one.columns for one in found] == [("FB pulse S", "FB pulse L"), ("Torque S", "Torque L")]


@pytest.mark.parametrize(
    ("columns", "time"),
    [
        (["Sec", "NanoSec", "measured_q_A1"], ("Sec", "NanoSec")),
        (["header.stamp.sec", "header.stamp.nanosec", "q1"], ("header.stamp.sec", "header.stamp.nanosec")),
        (["ZeitInSec", "ZeitInNanoSec", "q"], ("ZeitInSec", "ZeitInNanoSec")),
        (["seconds", "q1"], ("seconds",)),
        (["UTC", "q1"], ("UTC",)),
        (["vel_rad_per_sec_1", "q1"], ()),
    ],
)
def test_the_time_is_found_by_its_name(columns, time):
    assert find_time(columns) == time


def test_columns_without_a_pattern_are_given_as_a_list(refuses):
    columns = ["shoulder", "elbow, left", "s_tau", "e_tau"]
    assert match_pattern("s_tau, e_tau", columns, ["j1", "j2"], "torque").columns == ("s_tau", "e_tau")
    assert match_pattern("elbow, left", columns, ["j1"], "position").columns == ("elbow, left",)
    for wrong in ("s_tau", "s_tau,e", "s_tau,e_tau,shoulder"):
        refuses(match_pattern, wrong, columns, ["j1", "j2"], "torque")


@pytest.mark.parametrize(
    ("name", "factor"),
    [("Istgeschwindigkeit [mm/min]", 1e-3 / 60.0), ("speed (deg/s)", np.pi / 180.0),
     ("Drehzahl [1/min]", np.pi / 30.0), ("Drehzahl [U/min]", np.pi / 30.0),
     ("speed [m/min]", 1.0 / 60.0), ("vel_m_per_min", 1.0 / 60.0), ("vel_deg_per_s", np.pi / 180.0),
     ("velocity [rad/s]", 1.0), ("speed (mrad/s)", 1e-3)],
)  # fmt: skip
def test_speeds_by_the_minute(name, factor):
    np.testing.assert_allclose(find_groups([name], ["axis"], "velocity")[0].factors, factor)


def test_a_row_of_units_is_obeyed(tmp_path, refuses):
    """Degrees, turns in a minute and thousandths of a rated torque, which needs that torque."""
    head = [f"Axis {k} Actual {kind}" for kind in ("Position", "Velocity", "Torque") for k in (1, 2)]
    v, rated = np.column_stack([0.4 * np.cos(T), -0.6 * np.sin(2.0 * T)]), np.array([5.0, 20.0])
    table = pd.DataFrame(np.column_stack([T, np.degrees(Q), v * 30.0 / np.pi, TAU / rated * 1e3]))
    text = ";".join(["Time", *head]) + "\ns;deg;deg;rpm;rpm;‰;‰\n"
    text += table.to_csv(index=False, header=False, sep=";", decimal=",", float_format="%.9g")
    (tmp_path / "a.csv").write_text(text)
    refuses(convert, tmp_path)
    assert_same(convert(tmp_path, torque_constant=(rated / 1e3).tolist()), qd=v)


@pytest.mark.parametrize(
    ("constant", "told"), [((), "in mnm by their names"), ((1e-3,), "times --torque-constant")]
)
def test_a_torque_constant_is_for_one_unit_of_the_column_whose_name_says_a_unit(constant, told, tmp_path):
    log(tmp_path, ["t", "q_1", "q_2", "torque_1_mNm", "torque_2_mNm"], T, Q, 1e3 * TAU)
    made = convert(tmp_path, torque_constant=constant)
    assert any(told in one for one in made.notes)
    assert_same(made)


@pytest.mark.parametrize(
    ("unit", "factor", "told"),
    [
        ("[cNm]", 1e-2, "in cnm by their names"),
        ("(lb-ft)", 1.35582, "in lbft by their names"),
        ("[counts]", 1.0, "in N m (N of a slide), as 'counts' is no known unit (else --torque-constant)"),
    ],
)
def test_the_unit_of_a_torque_is_that_of_its_name_or_said_to_be_unknown(unit, factor, told, tmp_path):
    head = ["t", "Pos 1 [Grad]", "Pos 2 [Grad]", f"torque 1 {unit}", f"torque 2 {unit}"]
    log(tmp_path, head, T, np.rad2deg(Q), TAU / factor)
    made = convert(tmp_path)
    assert any(told in one for one in made.notes)
    assert_same(made)


@pytest.mark.parametrize("unit", ["_pct", " [% rated]", " [%]"])
def test_a_share_of_a_rated_torque_is_no_torque(unit, tmp_path, refuses):
    log(tmp_path, ["t", "q1", "q2", f"torque1{unit}", f"torque2{unit}"], T, Q, TAU)
    refuses(convert, tmp_path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        *(
            (end.join(["t,q", *(f"{k},1" for k in range(99))]), "is a single line")
            for end in "\v\f\x85\u2028"
        ),
        ("t,q\n\nt,q\n", "holds no row of numbers"),
    ],
)
def test_lines_that_no_table_ends_are_one_line_and_names_alone_are_told(tmp_path, text, told):
    """Python splits texts there, pandas does not."""
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=told):
        read_text(tmp_path / "a.csv")


def test_a_row_that_is_longer_than_the_others_loses_no_value_silently(tmp_path):
    rows = [f"{k},1,2" for k in range(60)]
    for where in (0, 1, 30, 59):
        longer = [f"{row},7,8" if k == where else row for k, row in enumerate(rows)]
        (tmp_path / "a.csv").write_text("\n".join(["t,q,tau", *longer]))
        try:
            frame, _ = read_recording(tmp_path / "a.csv")
        except InputError as error:
            assert "cannot be read as a table" in str(error)
        else:
            assert 7 in frame.to_numpy() and 8 in frame.to_numpy()


def test_printed_signs_in_columns_of_text_are_signs(tmp_path):
    text = table().astype(str).apply(lambda one: one.str.replace("-", "\u2212"))
    text.to_parquet(tmp_path / "signs.parquet")
    frame, _ = read_recording(tmp_path / "signs.parquet")
    assert np.allclose(frame.astype(float), table()) and (table() < 0).any().any()


@pytest.mark.parametrize(
    "write",
    [
        lambda row: str(list(np.array(row))),
        lambda row: str(tuple(np.array(row))),
        lambda row: repr(np.array(row)),
        lambda row: repr(np.array(row, dtype=np.float32)),
        lambda row: f"array('d', {row})",
        lambda row: f"tensor({row})",
    ],
    ids=["numbers of numpy", "tuple", "array", "array of single precision", "standard array", "tensor"],
)
def test_lists_as_python_prints_them_are_read(write):
    rows = [[0.25, -1.5], [3.0, 1e-05]]
    frame = spread_states(pd.DataFrame({"time": [0.0, 0.1], "position": [write(row) for row in rows]}))
    assert list(frame.columns) == ["time", "position_0", "position_1"]
    np.testing.assert_allclose(frame[["position_0", "position_1"]].astype(float), rows, rtol=1e-6)
