"""The closed loop's page on outcomes made by hand: what it says, and that it needs nothing else."""

import copy
import json
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pandas as pd
import pytest

from wearscope.closed_loop.inference.policy import Policy
from wearscope.errors import InputError
from wearscope.reporting.closed_loop import (
    against_signal,
    dominant_signals,
    read_closed_loop,
)
from wearscope.reporting.closed_loop_page import write_closed_loop_page
from wearscope.reporting.loop_outcome import (
    describe_joint,
    doubt_simulation,
    draw_curves,
    loop_strip,
    render_parameters,
)
from wearscope.reporting.loop_words import conclude_loop
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


def page(folder):
    write_closed_loop_page(folder)
    return (folder / "report.html").read_text(encoding="utf-8")


def written(html):
    """The page without its scripts and style."""
    return re.sub(r"(?s)<(script|style)\b.*?</\1>", "", html)


def text_of(html):
    plain = re.sub(r"<[^>]+>", " ", written(html))
    return re.sub(r"[ \n]+", " ", plain.replace("\N{NO-BREAK SPACE}", " "))


def test_page_needs_nothing_else_and_escapes_what_it_is_given(tmp_path):
    write(tmp_path, VERDICT)
    html = page(tmp_path)
    assert "<script src" not in html
    html = written(html)
    assert "@import" not in html
    for link in re.findall(r'(?:src|href)="([^"]*)"', html):
        assert link.startswith(("data:", "#")) or (tmp_path / link).suffix in (".yaml", ".csv", ".py"), link
    assert not re.search(r"url\((?!['\"]?data:)", html)
    assert "made &lt;by&gt; hand" in html and "<by>" not in html and "<were>" not in html
    # Links lead to sections, and every image says what it shows.
    for anchor in re.findall(r'href="#([^"]*)"', html):
        assert f'id="{anchor}"' in html
    assert all(alt for alt in re.findall(r'<img [^>]*alt="([^"]*)"', html))
    assert "&lt;span" not in html and "nan" not in text_of(html)


def test_page_says_status_equivalent_unknown_and_what_got_worse(tmp_path):
    write(tmp_path, VERDICT)
    html = page(tmp_path)
    text = text_of(html)
    named = "a Stribeck friction confirmed Or concave viscous friction: these runs do not tell."
    assert f"{named} It removes 62 % (95 %: 55 to 70) of the residual variance." in text
    refuted = "b Unknown refuted It adds 12 % (95 %: 4 to 20) to the residual variance."
    unnamed = "No named effect explains it; it depends on position of a and direction of b."
    assert f"{refuted} {unnamed} Left out of the corrected model." in text
    assert "8 heights of a spline not in it −3 to 4" in text
    assert "a Stribeck friction (exponent 2) level not in it 2.5 2 to 3 N m" in text
    assert "2 → 1 N m RMS, noise floor" in text
    assert "larger by 7 %" in text and text.count("larger by") == 1
    assert "runs/r2.parquet 15 16" in text and "runs/r2.parquet 20 10" in text
    assert "30 % of the rows of a do not count" in text
    assert "record for longer" in text
    assert "closed by wearscope 1.2.3." in text and "abc" not in text


def test_refuted_effects_come_first_and_in_red(tmp_path):
    joints = [ENTRY | {"joint": "a"}, UNKNOWN | {"joint": "b"}]
    doubtful = ENTRY | {"effect": "viscous_asymmetry", "status": "not_confirmed", "error_reduction": 0.004}
    doubtful |= {"error_reduction_ci95": [-0.01, 0.02]}
    write(tmp_path, VERDICT | {"verdict": [doubtful, *joints]})
    html = page(tmp_path)
    cards = re.findall(r'<div class="card (\w+)"[^>]*><h3>([\w ]+)(.*?)</div>', html, re.DOTALL)
    said = [
        (kind, title, re.findall(r"<strong>([\w ]+)</strong> <span[^>]*>([\w ]+)", body))
        for kind, title, body in cards
    ]
    assert said == [
        ("bad", "b", [("Unknown", "refuted"), ("Error", "larger by 7 ")]),
        (
            "unsure",
            "a",
            [
                ("Viscous asymmetry", "not confirmed"),
                ("Stribeck friction", "confirmed"),
                ("Error", "smaller"),
            ],
        ),
    ]
    assert "It removes 0.4 % (95 %: −1.0 to 2.0)" in text_of(html)
    # Its size next to its name; a spline has none.
    assert text_of(html).count("Level: 2.5 N m (95 %: 2 to 3).") == 2 and "Height" not in text_of(html)


def test_page_of_none_says_so(tmp_path):
    verdict = copy.deepcopy(VERDICT) | {"verdict": []}
    for joint in JOINTS:
        verdict["joints"][joint]["state"] = "explained"
    write(tmp_path, verdict)
    text = text_of(page(tmp_path))
    assert "The declared model suffices" in text
    assert text.count(": nothing added") == 2
    assert "Structure that no named effect" not in text


def test_what_is_left_is_said_and_an_empty_verdict_next_to_it_is_no_none(tmp_path):
    verdict = copy.deepcopy(VERDICT) | {"verdict": []}
    verdict["joints"]["b"] |= {
        "state": "unexplained", "unexplained_rms": 0.8, "depends_on": ["q_a", "t"],
        "reason": "a line at 3 Hz in time",
    }  # fmt: skip
    write(tmp_path, verdict)
    html = page(tmp_path)
    text = text_of(html)
    assert "declared model suffices" not in text
    said = "No effect that the test runs bear out was named, and 3 % of the torque is left at b, part of it"
    assert said in text
    assert "structure left, 3 % of the torque 0.8 N m RMS of it depends on position of a and time" in text
    loop = read_closed_loop(tmp_path)
    assert loop.foremost() == "b" and dominant_signals(loop, "b")[:2] == ["q_a", "t"]
    verdict["joints"]["b"]["depends_on"] = []
    write(tmp_path, verdict)
    assert "0.8 N m RMS of it: a line at 3 Hz in time" in text_of(page(tmp_path))
    verdict["joints"]["b"]["reason"] = ""
    write(tmp_path, verdict)
    assert "0.8 N m RMS of it: it depends on no known signal" in text_of(page(tmp_path))


@pytest.mark.parametrize(
    "left, structure, noise, small",
    [(0.4, 0.8, 1.5, True), (0.4, 1.6, 1.5, False), (4.0, 0.8, 1.5, False), (0.4, 0.8, None, False)],
)
def test_structure_below_noise_and_torque_is_small_and_its_size_is_said(
    tmp_path, left, structure, noise, small
):
    verdict = copy.deepcopy(VERDICT) | {"verdict": []}
    verdict["joints"]["a"]["state"] = "explained"
    verdict["joints"]["b"] |= {
        "state": "unexplained", "unexplained_rms": structure, "depends_on": ["q_a"],
        "left_percent": left, "noise_floor": noise,
    }  # fmt: skip
    write(tmp_path, verdict)
    text = text_of(page(tmp_path))
    kind, answer = conclude_loop(read_closed_loop(tmp_path).verdict)
    assert f"{left:g} % of the torque is left at b" in answer and f"{structure:g} N m RMS of it" in text
    assert kind == ("good" if small else "bad") and ("suffices within the noise" in answer) == small
    assert f"{'small structure' if small else 'structure'} left, {left:g} % of the torque" in text


def test_effect_of_the_whole_robot_is_said_once_and_of_the_robot(tmp_path):
    whole = ENTRY | {"joint": "b", "effect": "payload_error", "equivalent": []}
    write(tmp_path, VERDICT | {"verdict": [whole]})
    text = text_of(page(tmp_path))
    assert "of the residual variance at all joints together" in text
    assert "The robot Payload error confirmed It removes" in text
    assert text.count("Payload error") == 1 and text.count(": nothing added") == 2


def test_what_the_corrected_model_lacks_is_said_with_its_reason(tmp_path):
    why = "it makes the test runs' error of a larger"
    body = {"joint": "b", "effect": "payload_error", "equivalent": [], "in_model": False, "left_out": why}
    write(tmp_path, VERDICT | {"verdict": [ENTRY | {"equivalent": []}, ENTRY | body]})
    kind, answer = conclude_loop(read_closed_loop(tmp_path).verdict)
    assert kind == "unsure"
    assert "payload error of the robot (left out of the corrected model). With the other one, the" in answer
    html = page(tmp_path)
    assert re.search(r'<div class="card unsure"[^>]*><h3>The robot', html)
    text = unescape(text_of(html))
    assert f"Left out of the corrected model: {why}." in text
    assert text.count("Left out of the corrected model") == 1


def test_failed_simulation_is_an_alarm(tmp_path):
    verdict = copy.deepcopy(VERDICT)
    for joint in JOINTS:
        verdict["forward"][joint]["after"] = {
            "torque_rms": None, "motion_rms": None, "outcome": "1 of 1 runs: failed: the robot fell over",
        }  # fmt: skip
    write(tmp_path, verdict, failed=True)
    html = page(tmp_path)
    assert html.count('<div class="alarm">') == 1
    assert "Simulated forward, model after: 1 of 1 runs: failed: the robot fell over" in html
    # What cannot be simulated is not recommended as a robot of a study.
    action = str(loop_strip(read_closed_loop(tmp_path)).action)
    assert action.startswith("The corrected model cannot be simulated: the robot fell over")
    assert "as a robot of a study" not in action


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


def test_events_and_thresholds_are_on_the_page(tmp_path):
    """A moment of a clock that counts from 1970 has its hundredths."""
    push = {"run": "runs/r2.parquet", "joint": "a", "t": 1700000002.5, "seconds": 0.4, "size": -7.0}
    limit = {"a": {"threshold": 3.2, "false_alarms_per_hour_at_most": 90.0}}
    felt = push | {"joint": "b", "t": 1700000002.6, "seconds": 0.5, "size": 2.0}
    write(tmp_path, VERDICT | {"events": [push, felt], "collision_thresholds": limit})
    text = text_of(page(tmp_path))
    assert "runs/r2.parquet 1700000002.50 0.60 a −7 N m, b 2 N m" in text
    assert "a 3.2 N m not known: record longer runs" in text
    write(tmp_path, VERDICT | {"events": [], "collision_thresholds": limit})
    assert "No push and no collision was seen." in text_of(page(tmp_path))


def test_light_loop_has_a_page_without_what_was_not_examined(tmp_path):
    verdict = {k: v for k, v in VERDICT.items() if k not in ("undetermined", "forward")}
    write(tmp_path, verdict, light=True)
    text = text_of(page(tmp_path))
    assert "Outcome" in text and "Simulated forward" not in text and "cannot tell" not in text


def test_equal_tables_give_equal_pages(tmp_path):
    write(tmp_path, VERDICT)
    assert page(tmp_path) == page(tmp_path)


def test_folder_without_a_loop_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"verdict\.json.*close the loop first"):
        write_closed_loop_page(tmp_path)


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
    rows = against_signal(loop, "b", "load_a")
    assert len(rows) == 2 * 140
    assert np.allclose(rows["x"], np.tile(3 * np.cos(T[60:]), 2))
    assert against_signal(loop, "b", "t")["x"].max() == pytest.approx(T[-1])
    assert len(against_signal(loop, "b", "temp_a")) == 0


def test_the_loop_is_concluded_in_one_sentence_no_surer_than_its_parts(tmp_path):
    write(tmp_path, VERDICT)
    kind, text = conclude_loop(read_closed_loop(tmp_path).verdict)
    assert kind == "unsure" and text == (
        "The declared model lacks Stribeck friction or concave viscous friction at a. With it, the error "
        "on the test runs falls by up to 50 %, at a from 2 to 1 N m, but grows by 7 % at b."
    )
    sure = copy.deepcopy(VERDICT) | {"verdict": [ENTRY | {"equivalent": []}]}
    sure["joints"]["b"] |= {"rms_after": 1.5}
    write(tmp_path, sure)
    kind, text = conclude_loop(read_closed_loop(tmp_path).verdict)
    assert kind == "good" and text.endswith("at a from 2 to 1 N m.")
    sure["verdict"][0]["status"] = "not_confirmed"
    sure["joints"]["b"]["state"] = "unexplained"
    write(tmp_path, sure)
    kind, text = conclude_loop(read_closed_loop(tmp_path).verdict)
    assert kind == "unsure" and "Stribeck friction at a (not confirmed)" in text
    assert text.endswith(". 3 % of the torque is left at b, part of it unexplained.")
    refuted = sure | {"verdict": [ENTRY | {"status": "refuted"}]}
    write(tmp_path, refuted)
    kind, text = conclude_loop(read_closed_loop(tmp_path).verdict)
    assert kind == "bad" and "bear out" in text
    nothing = copy.deepcopy(VERDICT) | {"verdict": []}
    for joint in JOINTS:
        nothing["joints"][joint]["state"] = "explained"
    write(tmp_path, nothing)
    assert conclude_loop(read_closed_loop(tmp_path).verdict)[0] == "good"


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ({}, None),
        ({"torque_factors": {"a": 1.3, "b": 1.3}}, "Torques are 1.3 times what the URDF's masses need"),
        (
            {"torque_factors": {"a": 0.7}},
            "Torques at a are 0.7 times what the URDF's masses need: the payload, masses, "
            "torque constants or positions' scale are off, or a balancer is undeclared",
        ),
        ({"far_links": ["b"]}, "Masses were refitted far from the URDF at b"),
    ],
)
def test_masses_that_nobody_believes_are_the_caveat_of_a_verdict_that_finds_nothing(said, told, tmp_path):
    verdict = copy.deepcopy(VERDICT) | {"verdict": []} | said
    for joint in JOINTS:
        verdict["joints"][joint]["state"] = "explained"
    write(tmp_path, verdict)
    strip = loop_strip(read_closed_loop(tmp_path))
    assert strip.kind == ("unsure" if told else "good")
    assert ("once its masses are refitted" in strip.answer) == bool(told)
    assert strip.caveat.startswith(told or "Only 1 training run")


@pytest.mark.parametrize(
    ("error", "after", "told"),
    [
        ("smaller", 1.0, "smaller"),
        ("same", 2.02, "same"),
        ("larger", 2.4, "larger by 20 %"),
        ("larger", 2.002, "larger by 0.1 %"),
        (None, None, "n/a"),
    ],
)
def test_a_joint_s_card_says_what_became_of_the_error(error, after, told, tmp_path):
    verdict = copy.deepcopy(VERDICT)
    joint = next(iter(verdict["joints"]))
    verdict["joints"][joint] |= {"rms_before": 2.0, "rms_after": after, "error": error}
    write(tmp_path, verdict)
    card = describe_joint(read_closed_loop(tmp_path), joint)
    assert card["change"] == told


def test_the_next_step_is_one_that_helps(tmp_path):
    verdict = copy.deepcopy(VERDICT) | {"verdict": [], "next_measurement": []}
    for joint in JOINTS:
        verdict["joints"][joint]["state"] = "explained"

    def advise(**changed):
        write(tmp_path, verdict | changed)
        return loop_strip(read_closed_loop(tmp_path))

    assert advise().action.startswith("Keep the declared model")
    doubted = advise(torque_factors={"a": 1.3})
    assert doubted.action.startswith("Weigh the payload") and "--inertials trusted" in doubted.action
    event = {"joint": "a", "run": "runs/r2.parquet", "t": 1.0, "seconds": 0.2, "size": 3.0}
    assert "Rows of 1 short event (a push, a collision) count in no fit." in advise(events=[event]).sure
    doubtful = ENTRY | {"status": "not_confirmed", "equivalent": []}
    assert advise(verdict=[doubtful]).action.startswith("The test runs do not decide")
    verdict["joints"]["b"]["state"] = "unexplained"
    assert 'href="#residual"' in advise().action


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


URDF = """<robot name="r"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 {z}"/>
<mass value="{m}"/></inertial></link></robot>"""


def write_models(folder, level=(10.0, 12.0), mass=(5.0, 5.5)):
    """Models before and after whose Coulomb friction and mass were fitted."""
    for stage, value, kilograms in zip(("before", "after"), level, mass, strict=True):
        effect = {"joint": "a", "effect": "coulomb", "parameters": {"level": value}}
        effect |= {"intervals": {"level": [value - 1, value + 1]}}
        rigid = {"joint": "a", "effect": "rigid_body"}
        fields = {"effects": [rigid, effect], "payload": {"mass": 2.0, "com": [0.0, 0.0, 0.1]}}
        (folder / f"model_{stage}.yaml").write_text(json.dumps(fields))
        (folder / f"model_{stage}.urdf").write_text(URDF.format(z=0.25, m=kilograms))


def test_what_was_fitted_is_a_table_with_intervals_and_units(tmp_path):
    write(tmp_path, VERDICT)
    without = render_parameters(read_closed_loop(tmp_path))
    assert "Coulomb" not in without and "Stribeck" in without
    write_models(tmp_path)
    (tmp_path / "robot.urdf").write_text(URDF.format(z=0.2, m=4.0))
    text = re.sub(r"<[^>]+>", " ", render_parameters(read_closed_loop(tmp_path, tmp_path / "robot.urdf")))
    row = " ".join(text.split())
    assert re.search(r"a Coulomb friction \w+( \w+)* 10 12 11 to 13 N m", row), row
    assert "mass declared [kg] mass before [kg] mass after [kg] centre of mass declared [m]" in row
    assert "arm 4 5 5.5 0, 0, 0.2 0, 0, 0.25" in row
    assert "payload, as declared 2 2 2 0, 0, 0.1 0, 0, 0.1" in row


def test_an_error_is_smaller_only_where_it_falls_by_more_than_half_a_percent(tmp_path):
    for after, word in ((0.0065, "smaller"), (0.00653, "same")):
        verdict = copy.deepcopy(VERDICT)
        verdict["joints"]["a"] |= {"rms_before": 0.00655, "rms_after": after, "error": "smaller"}
        write(tmp_path, verdict)
        assert describe_joint(read_closed_loop(tmp_path), "a")["change"] == word
