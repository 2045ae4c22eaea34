"""Two measured machines: what is named, the error on runs that were not fitted, and no joint worse."""

import re
import shutil

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from folders import change_runs, find_real

from wearscope.cli.main import wearscope
from wearscope.closed_loop.diagnosis import diagnose

pytestmark = pytest.mark.slow


def close(name):
    return diagnose(find_real(name)).verdict


def test_ball_screw_axis_is_predicted_within_3_percent():
    """Janot, Gautier, Brunot: 5.98 % on the test run with inertia, viscous, Coulomb and offset."""
    verdict = close("emps")
    assert {"viscous_asymmetry", "time_delay"} <= {entry["effect"] for entry in verdict["verdict"]}
    assert verdict["joints"]["slide"]["left_percent"] < 2.8
    assert not any("rigid body" in note for note in verdict["notes"])


def test_an_offset_of_every_run_is_named_and_displaces_no_name(tmp_path):
    """A constant of 2.7 N, 5 % of the training run's force (RMS), is added to both runs of the axis."""
    plain = close("emps")
    folder = shutil.copytree(find_real("emps"), tmp_path / "emps")
    change_runs(folder, lambda table: table.assign(tau_slide=table["tau_slide"] + 2.7))
    shifted = diagnose(folder).verdict
    names = [{e["effect"] for e in verdict["verdict"] if e["in_model"]} for verdict in (plain, shifted)]
    assert names[0] == {"viscous_asymmetry", "time_delay", "concave_viscous"}
    assert names[1] == names[0] | {"torque_offset"}
    errors = [verdict["joints"]["slide"]["rms_after"] for verdict in (plain, shifted)]
    assert errors[1] < 1.05 * errors[0]


@pytest.mark.parametrize("delay", [0.02, -0.02])
def test_a_delay_of_the_axis_is_taken_out_whole(tmp_path, delay):
    """Its force is moved by 20 ms, most of a period of the cut-off; 0.8 ms are the axis's own."""
    folder = shutil.copytree(find_real("emps"), tmp_path / "emps")
    late = lambda table: np.interp(table["t"] - delay, table["t"], table["tau_slide"])  # noqa: E731
    change_runs(folder, lambda table: table.assign(tau_slide=late(table)))
    verdict = diagnose(folder).verdict
    named = {entry["effect"]: entry for entry in verdict["verdict"] if entry["in_model"]}
    assert {"time_delay", "viscous_asymmetry"} <= named.keys()
    assert named["time_delay"]["parameters"]["delay"]["value"] == pytest.approx(delay - 0.0008, abs=3e-4)
    assert verdict["joints"]["slide"]["left_percent"] < 3.0


def test_industrial_arm_has_a_balancer_and_another_load_and_no_joint_is_worse():
    """Weigand et al.: a hydraulic balancer at axis 2; the load is another one than the URDF's."""
    verdict = close("kr300")
    named = {(entry["joint"], entry["effect"]): entry for entry in verdict["verdict"]}
    assert named["a2", "gravity_counterbalance"]["status"] == "confirmed"
    load = [entry for (_, effect), entry in named.items() if effect in ("payload_error", "inertial_error")]
    assert [entry["in_model"] for entry in load] == [True]
    assert not any(state["error"] == "larger" for state in verdict["joints"].values())
    for joint, percent in (("a1", 5.7), ("a2", 6.2), ("a3", 5.1)):
        assert verdict["joints"][joint]["left_percent"] < percent
    assert any(note.startswith("a1: the named body alone") for note in verdict["notes"])


@pytest.mark.parametrize("delay", [0.04, -0.04, 0.0])
def test_delayed_torques_of_a_double_pendulum_are_told(tmp_path, delay):
    """Both joints; 6 ms are the recorder's own. The model leaves a third of the torques (RMS)."""
    files = []
    for path in sorted(find_real("double_pendulum").glob("*.csv")):
        table = pd.read_csv(path)
        for name in ("tau_meas1", "tau_meas2"):
            table[name] = np.interp(table["time"] - delay, table["time"], table[name])
        files.append(str(tmp_path / path.name))
        table.iloc[50:-50].to_csv(files[-1], index=False)
    urdf = str(find_real("double_pendulum") / "acrobot.urdf")
    done = CliRunner().invoke(
        wearscope, ["new", "dataset", *files, "--urdf", urdf, "--name", "d", "--in", str(tmp_path)]
    )
    told = re.search(r"come (\d+) ms (late|early)", f"{done.output} {done.exception}")
    assert (told is None) == (delay == 0.0)
    if told:
        assert told[2] == ("late" if delay > 0 else "early")
        assert int(told[1]) == pytest.approx(1000 * abs(delay + 0.006), abs=6)
