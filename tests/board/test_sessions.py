"""A machine's sessions: what is planted is what was said, and scores say what was found."""

import numpy as np
import pandas as pd
import pytest
import yaml

from benchmarks.board.session_cases import KINDS, STEP, SWING, Day, draw_case
from benchmarks.board.session_folder import write_sessions
from benchmarks.board.session_score import score_sessions, summarise_sessions


def test_a_case_is_the_same_for_its_number_and_seed():
    assert draw_case(3, 1).name == draw_case(3, 1).name
    assert len({draw_case(k, s).name for k in range(3) for s in range(3)}) == 9


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_does_what_it_is_called(kind):
    for number in range(12):
        case = draw_case(number, 5, kind)
        healthy, later = [d for d in case.days if d.healthy], [d for d in case.days if not d.healthy]
        assert case.days == (*healthy, *later) and len(healthy) >= 3
        assert not any(d.wear or d.load or d.gain for d in [*healthy, *later[: case.onset]])
        assert any(p.use == "train" for d in healthy for p in d.runs)
        changed = later[case.onset]
        assert bool(changed.wear) == ("wear" in kind)
        assert bool(changed.load) == (kind == "load") and bool(changed.gain) == (kind == "drive")
        if kind == "wear_step":
            assert {d.wear for d in later[case.onset :]} == {STEP}
        if kind.startswith("swing"):
            warmth = [d.temperature for d in later]
            assert np.ptp(warmth) > SWING - 1.1
            seen = [d.temperature for d in healthy]
            inside = min(seen) - 1e-9 <= min(warmth) and max(warmth) <= max(seen) + 1e-9
            assert inside == (case.thermometer == "seen")


def read_torque(folder, truth_or_case, day: Day, joint: str) -> np.ndarray:
    document = yaml.safe_load((folder / "dataset.yaml").read_text())
    files = [run["file"] for run in document["runs"] if run["session"] == day.name]
    return np.concatenate([pd.read_parquet(folder / file)[f"tau_{joint}"] for file in files])


def test_planted_wear_is_in_the_recordings_and_the_truth_is_not(tmp_path):
    number = next(k for k in range(60) if draw_case(k, 9, "wear_step").machine.name == "slide")
    case = draw_case(number, 9, "wear_step")
    folder = tmp_path / case.name
    truth = write_sessions(folder, case)
    # The same case without its wear: what differs is the wear.
    plain = [Day(d.name, d.healthy, d.temperature, 0.0, d.load, d.gain, d.runs) for d in case.days]
    from dataclasses import replace

    other = replace(case, days=tuple(plain))
    write_sessions(tmp_path / "plain", other)
    day = case.days[-1]
    torque = read_torque(folder, case, day, "j1") - read_torque(tmp_path / "plain", other, day, "j1")
    planted = truth["sessions"][-1]
    moving = np.abs(torque) > 0.2 * np.abs(torque).max()
    assert np.sqrt(np.mean(torque[moving] ** 2)) == pytest.approx(planted["torque"], rel=0.2)
    text = (folder / "dataset.yaml").read_text()
    assert "wear" not in text and case.kind not in text and case.kind not in folder.name
    first = case.days[0]
    np.testing.assert_array_equal(
        read_torque(folder, case, first, "j1"), read_torque(tmp_path / "plain", other, first, "j1")
    )


def entry(effect, joint, since, parameter="level", ci95=(0.0, 1.0), equivalent=()):
    return {"joint": joint, "effect": effect, "parameter": parameter, "change": 0.5, "ci95": list(ci95),
            "unit": "N m", "since": since, "equivalent": list(equivalent)}  # fmt: skip


@pytest.fixture
def worn():
    number = next(
        k for k in range(60) if (c := draw_case(k, 2, "wear_step")).onset == 1 and len(c.machine.joints) > 1
    )
    return draw_case(number, 2, "wear_step")


def score(case, said, planted=("wear", 0.1)):
    later = [d.name for d in case.days if not d.healthy]
    blank = {"wear": 0.0, "torque": 0.0, "load": False, "gain": 0.0}
    truth = {
        "joint": "j1", "mass": 2.0,
        "sessions": [{"session": s, **blank, **({planted[0]: planted[1]} if k >= 1 else {})}
                     for k, s in enumerate(later)],
    }  # fmt: skip
    told = {"sessions": [{"session": s, "changes": said(k, later), "cannot_tell": []}
                         for k, s in enumerate(later)]}  # fmt: skip
    changes = pd.DataFrame(columns=["session", "joint", "effect", "change_low", "change_high"])
    return pd.DataFrame(score_sessions(case, truth, told, changes))


def test_scores_of_the_right_answer(worn):
    rows = score(worn, lambda k, later: [entry("coulomb", "j1", later[1])] if k else [])
    assert not rows["false"].any() and rows["found"][1:].all() and rows["since_right"][1:].all()
    shares = summarise_sessions(rows).set_index("question")["share"]
    assert shares.filter(like="nothing changed: false alarms").iloc[0] == 0.0
    assert shares.filter(like="wear step of a tenth: found in the first two").iloc[0] == 1.0


@pytest.mark.parametrize(
    ("said", "false", "found"),
    [
        (lambda k, later: [entry("coulomb", "j1", later[0])], True, True),
        (lambda k, later: [entry("coulomb", "j2", later[1])] if k else [], True, False),
        (
            lambda k, later: [entry("joint_spring", "j1", later[1], equivalent=["wear"])] if k else [],
            True,
            False,
        ),
        (lambda k, later: [], False, False),
    ],
)
def test_wrong_answers_are_scored_wrong(worn, said, false, found):
    rows = score(worn, said)
    assert rows["false"].any() == false and bool(rows["found"][1:].any()) == found
    prompt = summarise_sessions(rows).set_index("question")["share"].filter(like="found in the first two")
    if not found:
        assert prompt.iloc[0] == 0.0


def test_late_answer_is_not_prompt_and_its_first_session_is_wrong(worn):
    rows = score(worn, lambda k, later: [entry("coulomb", "j1", later[3])] if k >= 3 else [])
    shares = summarise_sessions(rows).set_index("question")["share"]
    assert shares.filter(like="wear step of a tenth: found in the first two").iloc[0] == 0.0
    assert shares.filter(like="wear: right first session").iloc[0] == 0.0


def test_mass_counts_where_its_interval_holds_it(worn):
    for ci95, covered in (((1.5, 2.5), True), ((2.5, 3.0), False)):
        rows = score(
            worn,
            lambda k, later, ci95=ci95: [entry("payload_error", "j3", later[1], "mass", ci95)] if k else [],
            ("load", True),
        )
        assert rows["found"][1:].all() and set(rows["covered"][1:]) == {covered}
