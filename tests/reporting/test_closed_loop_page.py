"""The closed loop's page on outcomes made by hand: what it says, and that it needs nothing else.

What is said of each case stands in the file of this name that ends in ``.txt``.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from wearscope.closed_loop.inference.policy import Policy
from wearscope.reporting.closed_loop import (
    against_signal,
    dominant_signals,
    read_closed_loop,
)
from wearscope.reporting.closed_loop_page import (
    doubt_simulation,
    draw_curves,
    loop_strip,
    render_events,
    render_outcome,
    render_parameters,
    write_closed_loop_page,
)
from wearscope.storage import tables

JOINTS = ["a", "b"]
RUNS = {"runs/r1.parquet": "train", "runs/r2.parquet": "test"}
T = np.arange(200) / 25.0


def one_joint(before, after, floor):
    return {
        "unit": "N m", "rms_as_declared": before * 1.1, "rms_before": before, "rms_after": after,
        "rms_before_ci95": [0.9 * before, 1.1 * before], "rms_after_ci95": [0.9 * after, 1.1 * after],
        "noise_floor": floor, "state": "corrected", "left_percent": 3.0,
        "error": "smaller" if after < before else "larger",
        "unexplained_rms": None, "depends_on": [],
        "reason": "", "test_runs": {"runs/r2.parquet": [before, after]},
        "relative_error_percent": {"runs/r2.parquet": [10 * before, 10 * after]},
    }  # fmt: skip


ENTRY = {
    "joint": "a", "effect": "stribeck", "equivalent": ["concave_viscous"],
    "depends_on": ["qd_a", "sign_qd_a"],
    "parameters": {"level": {"value": 2.5, "ci95": [2.0, 3.0], "unit": "N m"}}, "fixed": {"exponent": 2.0},
    "error_reduction": 0.62, "error_reduction_ci95": [0.55, 0.7], "status": "confirmed",
}  # fmt: skip
UNKNOWN = {
    "joint": "b", "effect": "unknown", "equivalent": [], "depends_on": ["q_a", "sign_qd_b"],
    "parameters": {
        f"height{k}": {"value": k - 3.0, "ci95": [k - 4.0, k - 2.0], "unit": "N m"} for k in range(8)
    },
    "fixed": {}, "error_reduction": -0.12, "error_reduction_ci95": [-0.2, -0.04], "status": "refuted",
}  # fmt: skip
VERDICT = {
    "dataset": "made <by> hand",
    "verdict": [UNKNOWN, ENTRY],
    "rule": Policy(flips=499).model_dump(),
    "version": "1.2.3 (abc)",
    "joints": {"a": one_joint(2.0, 1.0, 0.5), "b": one_joint(1.5, 1.6, None)},
    "band": {"motion_hz": 20.0, "torque_hz": 6.0},
    "notes": ["runs/r1.parquet: spikes of tau_a in 3 rows <were> bridged."],
    "undetermined": [
        {"joint": "b", "effect": "warm_up_drift", "reason": "too short", "motion": "record for longer"}
    ],
    "forward": {
        joint: {
            stage: {"torque_rms": 1.0, "motion_rms": 1e-3, "outcome": "ok"} for stage in ("before", "after")
        }
        for joint in JOINTS
    },
}


def write(folder, verdict, light=False, failed=False):
    rng = np.random.default_rng(0)
    tables.write_text(folder / "verdict.json", json.dumps(verdict))
    keys = [(run, use, joint) for run, use in RUNS.items() for joint in JOINTS]
    frames, own = [], []
    for run, use, joint in keys:
        noise = rng.standard_normal((3, len(T)))
        frames.append(
            pd.DataFrame(
                {
                    "t": T + 5.0, "run": run, "use": use, "joint": joint, "measured": 10 * noise[0],
                    "residual_before": noise[1], "residual_after": noise[2],
                    "counts": np.arange(len(T)) >= 60,
                }
            )
        )  # fmt: skip
        own.append(
            pd.DataFrame(
                {"t": T + 5.0, "run": run, "joint": joint, "q": np.sin(T), "qd": np.cos(T), "temp": np.nan}
            ).assign(qdd=-np.sin(T), load=3 * np.cos(T), sign_qd=np.sign(np.cos(T)))
        )
    tables.write_table(folder / "residual.parquet", pd.concat(frames))
    if light:
        return
    tables.write_table(folder / "signals.parquet", pd.concat(own))
    stages = [(joint, stage) for joint in JOINTS for stage in ("before", "after")]
    rows = []
    for run in ("runs/r2.parquet", "all"):
        for joint, stage in stages:
            lost = failed and stage == "after"
            value = np.nan if lost else 1.0
            sizes = {f"{k}_rms{e}": value for k in ("torque", "motion") for e in ("", "_low", "_high")}
            outcome = "failed: the robot fell over" if lost else "ok"
            rows.append(
                {"joint": joint, "run": run, "stage": stage, "seconds": 8.0, "outcome": outcome} | sizes
            )
    tables.write_table(folder / "forward.parquet", pd.DataFrame(rows))


URDF = """<robot name="r"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 {z}"/>
<mass value="{m}"/></inertial></link></robot>"""


def write_models(folder):
    """Models before and after whose Coulomb friction and mass were fitted."""
    for stage, value, kilograms in (("before", 10.0, 5.0), ("after", 12.0, 5.5)):
        effect = {"joint": "a", "effect": "coulomb", "parameters": {"level": value}}
        effect |= {"intervals": {"level": [value - 1, value + 1]}}
        rigid = {"joint": "a", "effect": "rigid_body"}
        fields = {"effects": [rigid, effect], "payload": {"mass": 2.0, "com": [0.0, 0.0, 0.1]}}
        (folder / f"model_{stage}.yaml").write_text(json.dumps(fields))
        (folder / f"model_{stage}.urdf").write_text(URDF.format(z=0.25, m=kilograms))


def page(folder):
    write_closed_loop_page(folder)
    return (folder / "report.html").read_text(encoding="utf-8")


def changed(verdict=(), a=None, b=None, **fields):
    """The verdict with other entries, numbers of joints and fields; without entries, both are explained."""
    state = {} if verdict else {"state": "explained"}
    joints = {
        name: VERDICT["joints"][name] | state | (own or {}) for name, own in zip(JOINTS, (a, b), strict=True)
    }
    return VERDICT | {"verdict": list(verdict), "joints": joints} | fields


ALONE = ENTRY | {"equivalent": []}
DOUBTFUL = ALONE | {
    "status": "not_confirmed", "error_reduction": 0.004, "error_reduction_ci95": [-0.01, 0.02],
}  # fmt: skip
LEFT = {
    "state": "unexplained", "unexplained_rms": 0.8, "depends_on": ["q_a", "t"],
    "reason": "a line at 3 Hz in time",
}  # fmt: skip
LACKED = {"in_model": False, "left_out": "it makes the test runs' error of a larger"}
#: A moment of a clock that counts from 1970 has its hundredths.
PUSH = {"run": "runs/r2.parquet", "joint": "a", "t": 1700000002.5, "seconds": 0.4, "size": -7.0}
LIMIT = {"a": {"threshold": 3.2, "false_alarms_per_hour_at_most": 90.0}}
LOST = {"torque_rms": None, "motion_rms": None, "outcome": "1 of 1 runs: failed: the robot fell over"}
CASES = {
    "as found": VERDICT,
    "the worst joint is first": VERDICT | {
        "verdict": [DOUBTFUL | {"effect": "viscous_asymmetry"}, ENTRY, UNKNOWN]
    },
    "nothing is lacking": changed(),
    "structure is left": changed(b=LEFT),
    "structure of a known form": changed(b=LEFT | {"depends_on": []}),
    "structure of no known form": changed(b=LEFT | {"depends_on": [], "reason": ""}),
    "small structure": changed(b=LEFT | {"left_percent": 0.4, "noise_floor": 1.5}),
    "structure above the noise": changed(
        b=LEFT | {"left_percent": 0.4, "noise_floor": 1.5, "unexplained_rms": 1.6}
    ),
    "structure of much of the torque": changed(b=LEFT | {"left_percent": 4.0, "noise_floor": 1.5}),
    "structure next to unknown noise": changed(b=LEFT | {"left_percent": 0.4, "noise_floor": None}),
    "an effect of the whole robot": changed([ALONE | {"joint": "b", "effect": "payload_error"}]),
    "an effect is left out": changed([ALONE, ALONE | {"joint": "b", "effect": "payload_error"} | LACKED]),
    "a name is sure": changed([ALONE], b={"rms_after": 1.5, "error": "same"}),
    "a name is not confirmed": changed([DOUBTFUL], b=LEFT | {"rms_after": 1.5, "error": "same"}),
    "an unconfirmed name is left out": changed([DOUBTFUL | {"in_model": False}]),
    "a name is refuted": changed([ENTRY | {"status": "refuted"}], b=LEFT),
    "short events": VERDICT | {
        "events": [PUSH, PUSH | {"joint": "b", "t": 1700000002.6, "seconds": 0.5, "size": 2.0}],
        "collision_thresholds": LIMIT,
    },
    "no event": VERDICT | {"events": [], "collision_thresholds": LIMIT},
    "torques too large": changed(torque_factors={"a": 1.3, "b": 1.3}, next_measurement=[]),
    "torques of a joint too small": changed(torque_factors={"a": 0.7}, next_measurement=[]),
    "masses far from the URDF": changed(far_links=["b"], next_measurement=[]),
    "the corrected model cannot be simulated": VERDICT | {
        "forward": {joint: {"before": LOST | {"outcome": "ok"}, "after": LOST} for joint in JOINTS}
    },
    "an error stays": changed(a={"rms_after": 2.02, "error": "same"}),
    "an error grows": changed(a={"rms_after": 2.4, "error": "larger"}),
    "an error grows a little": changed(a={"rms_after": 2.002, "error": "larger"}),
    "an error falls by half a percent": changed(a={"rms_before": 6.55, "rms_after": 6.5, "error": "smaller"}),
    "an error falls by less": changed(a={"rms_before": 6.55, "rms_after": 6.53, "error": "smaller"}),
    "an error is unknown": changed(a={"rms_after": None, "error": None}),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_loop_says_what_its_verdict_holds(case, tmp_path, says):
    """Top of the page, cards, events and parameters; the charts have tests of their own."""
    write(tmp_path, CASES[case])
    loop = read_closed_loop(tmp_path)
    strip = loop_strip(loop)
    top = (strip.kind, strip.answer, strip.sure, strip.caveat, strip.action)
    says(case, *top, render_outcome(loop), render_events(loop), render_parameters(loop))


def test_the_page_has_what_was_examined_and_a_light_loop_s_what_there_is(tmp_path, says):
    write(tmp_path, CASES["the corrected model cannot be simulated"], failed=True)
    says("the whole page", page(tmp_path))
    light = tmp_path / "light"
    write(light, {k: v for k, v in VERDICT.items() if k not in ("undetermined", "forward")}, light=True)
    says("the page of a light loop", page(light))


def test_what_is_left_leads_the_page(tmp_path):
    write(tmp_path, CASES["structure is left"])
    loop = read_closed_loop(tmp_path)
    assert loop.foremost() == "b" and dominant_signals(loop, "b")[:2] == ["q_a", "t"]


def test_what_was_fitted_is_a_table_with_intervals_and_units(tmp_path, says):
    write(tmp_path, VERDICT)
    write_models(tmp_path)
    (tmp_path / "robot.urdf").write_text(URDF.format(z=0.2, m=4.0))
    fitted = render_parameters(read_closed_loop(tmp_path, tmp_path / "robot.urdf"))
    says("fitted parameters and bodies", fitted)


@pytest.mark.parametrize(("after", "worse"), [(2.0, True), (1.1, False)])
def test_a_simulation_that_strays_further_than_the_declared_model_s_is_said(after, worse):
    rows = [
        {"joint": joint, "run": "all", "stage": stage, "outcome": "ok", "motion_rms": middle,
         "motion_rms_low": 0.9 * middle, "motion_rms_high": 1.1 * middle}
        for joint, stage, middle in (("a", "before", 1.0), ("a", "after", after), ("b", "before", 1.0),
                                     ("b", "after", 0.5))
    ]  # fmt: skip
    told = doubt_simulation(pd.DataFrame(rows))
    assert ("further from the measured motion at a: 2 against 1." in told) == worse and bool(told) == worse
    assert doubt_simulation(None) == ""


def test_folder_without_a_loop_is_refused(tmp_path, refuses):
    refuses(write_closed_loop_page, tmp_path)


def test_residual_is_set_against_the_signals_of_the_right_joint(tmp_path):
    write(tmp_path, VERDICT)
    profile = [
        {"joint": joint, "signal": signal, "stage": "before", "median": sign * size}
        for joint in JOINTS for signal, size in (("q_a", 1.0), ("qd_b", 2.0)) for sign in (-1, 1)
    ]  # fmt: skip
    loop = replace(read_closed_loop(tmp_path), profiles=pd.DataFrame(profile))
    # The verdict's signals first, the direction as speed, then those along which medians scatter most.
    assert dominant_signals(loop, "b") == ["q_a", "qd_b"]
    assert dominant_signals(loop, "a") == ["qd_a", "qd_b", "q_a"]
    # What is left comes before a refuted name.
    loop.verdict["joints"]["b"]["depends_on"] = ["qd_b"]
    assert dominant_signals(loop, "b") == ["qd_b", "q_a"]
    rows = against_signal(loop, "b", "load_a")
    assert len(rows) == 2 * 140
    assert np.allclose(rows["x"], np.tile(3 * np.cos(T[60:]), 2))
    assert against_signal(loop, "b", "t")["x"].max() == pytest.approx(T[-1])
    assert len(against_signal(loop, "b", "temp_a")) == 0


def test_a_card_draws_the_residual_over_the_signal_that_the_verdict_names(tmp_path):
    write(tmp_path, VERDICT)
    loop = read_closed_loop(tmp_path)
    drawn = draw_curves(loop, "a")
    before, after = re.findall(r'd="([^"]*)"', drawn)
    assert before != after and before.count("M") == after.count("M") == 280
    assert "speed of a [rad/s]" in drawn and "nan" not in drawn
    over_time = draw_curves(replace(loop, signals=None), "a")
    assert "time since the start of the run [s]" in over_time
    assert draw_curves(replace(loop, residual=loop.residual.assign(counts=False)), "a") == ""
