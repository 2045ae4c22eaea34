"""Text as recorders write it: what stands around the numbers, names, units and shares of a rated torque."""

import numpy as np
import pandas as pd
import pytest

from wearscope.errors import InputError
from wearscope.starters.columns import find_groups, find_time, match_pattern
from wearscope.starters.conversion import convert_recordings
from wearscope.starters.mapped import Mapped
from wearscope.starters.recordings import read_recording
from wearscope.starters.text_files import read_text

T = np.arange(0.0, 14.0, 0.01)
Q = np.column_stack([0.4 * np.sin(T), 0.3 * np.cos(2.0 * T)])
TAU = np.column_stack([3.0 * np.sin(T) + 0.25, 2.0 * np.cos(T)])
NAMES = ["time", "q_1", "q_2", "tau_1", "tau_2"]
LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    "</inertial></link>"
)
URDF = f"""<robot name="r"><link name="b"/>
{LINK.format("x")}{LINK.format("y")}
<joint name="left_axis" type="revolute"><parent link="b"/><child link="x"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
<joint name="right_axis" type="revolute"><parent link="x"/><child link="y"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="9" velocity="9"/></joint></robot>"""


def rows(separator=",", point="."):
    table = np.column_stack([T, Q, TAU])
    lines = [separator.join(f"{one:.9g}" for one in row) for row in table]
    return "\n".join(line.replace(".", point) for line in lines) + "\n"


HEADER = ",".join(NAMES) + "\n"
WRAPPED = {
    "lines above": ("Export of a trace\nController: 7, 3.2\n\n" + HEADER, rows(), "utf-8"),
    "as many cells above": ("File,a.svdx,,,\nRate,100,,,\n" + HEADER, rows(), "utf-8"),
    "commented names": ("# " + HEADER, rows(), "utf-8"),
    "byte-order mark": (HEADER, rows(), "utf-8-sig"),
    "two bytes a letter": (HEADER, rows(), "utf-16"),
    "sums below": (HEADER, rows() + "Mean,0,0,1.5,2\n", "utf-8"),
    "decimal commas, sums below": (
        HEADER.replace(",", ";"),
        rows(";", ",") + "Mittelwert;0,5;0,5;1,5;2\n",
        "utf-8",
    ),
    "a separator at each line's end": (HEADER, rows().replace("\n", ",\n"), "utf-8"),
    "a column twice": (
        HEADER.replace("q_1", "q_1,q_1"),
        "".join(
            ",".join([line.split(",")[0], line.split(",")[1], *line.split(",")[1:]]) + "\n"
            for line in rows().splitlines()
        ),
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


def test_a_first_row_that_is_not_whole_is_no_header(tmp_path):
    first, rest = rows().split("\n", 1)
    cut = first.split(",")
    (tmp_path / "a.csv").write_text(HEADER + ",".join([cut[0], "", "", *cut[3:]]) + "\n" + rest)
    frame, _ = read_recording(tmp_path / "a.csv")
    assert list(frame.columns) == NAMES and len(frame) == len(T)


def test_a_column_that_stands_twice_with_other_values_is_refused(tmp_path):
    table = pd.DataFrame(np.column_stack([T, Q, TAU]), columns=["time", "q_1", "q_1", "tau_1", "tau_2"])
    table.to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(InputError, match="'q_1' stands twice"):
        read_recording(tmp_path / "a.csv")


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
    ],
)  # fmt: skip
def test_names_as_makers_write_them(columns, kind, first):
    groups = find_groups(columns, ["left_axis", "right_axis"], kind)
    assert groups[0].columns[0] == first


@pytest.mark.parametrize(
    ("columns", "time"),
    [
        (["Sec", "NanoSec", "measured_q_A1"], ("Sec", "NanoSec")),
        (["header.stamp.sec", "header.stamp.nanosec", "q1"], ("header.stamp.sec", "header.stamp.nanosec")),
        (["seconds", "q1"], ("seconds",)),
        (["vel_rad_per_sec_1", "q1"], ()),
    ],
)
def test_the_time_is_found_by_its_name(columns, time):
    assert find_time(columns) == time


def test_columns_without_a_pattern_are_given_as_a_list():
    columns = ["shoulder", "elbow, left", "s_tau", "e_tau"]
    assert match_pattern("s_tau, e_tau", columns, ["j1", "j2"], "torque").columns == ("s_tau", "e_tau")
    assert match_pattern("elbow, left", columns, ["j1"], "position").columns == ("elbow, left",)
    for wrong in ("s_tau", "s_tau,e", "s_tau,e_tau,shoulder"):
        with pytest.raises(InputError, match="nor a column for each of j1, j2"):
            match_pattern(wrong, columns, ["j1", "j2"], "torque")


@pytest.mark.parametrize(
    ("name", "factor"),
    [("Istgeschwindigkeit [mm/min]", 1e-3 / 60.0), ("speed (deg/s)", np.pi / 180.0),
     ("Drehzahl [1/min]", np.pi / 30.0), ("Drehzahl [U/min]", np.pi / 30.0),
     ("speed [m/min]", 1.0 / 60.0), ("velocity [rad/s]", 1.0)],
)  # fmt: skip
def test_speeds_by_the_minute(name, factor):
    np.testing.assert_allclose(find_groups([name], ["axis"], "velocity")[0].factors, factor)


def test_a_row_of_units_is_obeyed(tmp_path):
    """Degrees, turns in a minute and thousandths of a rated torque, which needs that torque."""
    (tmp_path / "robot.urdf").write_text(URDF)
    head = [f"Axis {k} Actual {kind}" for kind in ("Position", "Velocity", "Torque") for k in (1, 2)]
    text = ";".join(["Time", *head]) + "\n" + "s;deg;deg;rpm;rpm;‰;‰\n"
    v = np.column_stack([0.4 * np.cos(T), -0.6 * np.sin(2.0 * T)])
    rated = np.array([5.0, 20.0])
    table = np.column_stack([T, np.degrees(Q), v * 30.0 / np.pi, TAU / rated * 1e3])
    text += "\n".join(";".join(f"{one:.9g}".replace(".", ",") for one in row) for row in table)
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match="in ‰ of a rated torque; give --torque-constant"):
        convert_recordings([tmp_path / "a.csv"], tmp_path / "robot.urdf", Mapped())
    mapped = Mapped(torque_constant=(rated / 1e3).tolist())
    made = convert_recordings([tmp_path / "a.csv"], tmp_path / "robot.urdf", mapped).runs[0].frame
    n = 400
    for k, joint in enumerate(("left_axis", "right_axis")):
        np.testing.assert_allclose(made[f"q_{joint}"][:n], Q[:n, k], atol=1e-7)
        np.testing.assert_allclose(made[f"qd_{joint}"][:n], v[:n, k], atol=1e-7)
        np.testing.assert_allclose(made[f"tau_{joint}"][:n], TAU[:n, k], atol=1e-6)


@pytest.mark.parametrize("end", ["\x0b", "\x0c", "\u0085", "\u2028"])
def test_lines_that_no_table_ends_are_one_line(tmp_path, end):
    """Python splits texts there, pandas does not."""
    (tmp_path / "a.csv").write_text(end.join(["t,q", *(f"{k},1" for k in range(99))]), encoding="utf-8")
    with pytest.raises(InputError, match="is a single line"):
        read_text(tmp_path / "a.csv")


def test_names_without_a_row_are_told(tmp_path):
    (tmp_path / "a.csv").write_text("t,q\n\nt,q\n")
    with pytest.raises(InputError, match="holds no row of numbers"):
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
