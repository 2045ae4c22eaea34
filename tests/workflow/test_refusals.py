"""What is wrong with a study is told in one sentence, before anything is simulated."""

import re
import shutil
from pathlib import Path

import pytest
import yaml
from clones import ROOT, TINY, run_ill
from plain_robot import write_plain_robot


def refuse(folder: Path, config: dict, *words: str, target: str = "check") -> str:
    """The run ends before any simulation, with one sentence that holds the words."""
    (folder / "bad.yaml").write_text(yaml.safe_dump(config))
    told = run_ill(folder, target, study="bad.yaml")
    lines = [line for line in told.splitlines() if all(word in line for word in words)]
    assert lines, told[-3000:]
    assert not list(folder.glob("results/bad/traces"))
    return lines[0]


FACTORS = yaml.safe_load((ROOT / TINY / "config.yaml").read_text())["factors"]
COLD = FACTORS | {"w3": FACTORS["w3"] | {"range": [10, 70]}}
OPTION = {"own": {"use": f"{TINY}/torque_change.py", "options": {"fail_abov": 1}}}
UNESTIMABLE = {"kind": "full_factorial", "levels": 2}


@pytest.mark.parametrize(
    ("target", "change", "words"),
    [
        ("check", {"robots": ["huge"]}, ("robots", "huge", "medium")),
        ("check", {"factors": COLD}, ("w3", "10", "axis_1")),
        ("design", {"design": UNESTIMABLE}, ("model 'full'", "aliased")),
        ("check", {"detectors": {"A": "residual_enrgy"}}, ("residual_enrgy", "residual_energy")),
        ("check", {"detectors": OPTION}, ("torque_change.py", "fail_abov")),
    ],
    ids=["unknown robot", "too cold", "unestimable design", "unknown detector", "unknown option"],
)
def test_a_setting_that_is_wrong_is_told(clone, bad, target, change, words):
    refuse(clone, bad | change, *words, target=target)


@pytest.mark.slow
def test_factor_that_moves_no_torque_is_told(clone, bad):
    bad["robots"] = [write_plain_robot(clone)]
    refuse(clone, bad, "factors.f", "wear moves no recorded torque", "robot 'plain'", "carry_over")
    bad["carry_over"] = {"plain": {"source": "medium", "effects": ["wear"]}}
    refuse(clone, bad, "factors.w3", "temperature moves no recorded torque", "screening: drop")


@pytest.mark.slow
def test_infeasible_cycle_is_told(clone, bad):
    text = (clone / TINY / "short_moves.py").read_text()
    far = "far = plan.finish()\n    return Reference(far.t, far.q + 5.0, far.v, far.a)"
    (clone / "too_far.py").write_text(text.replace("return plan.finish()", far))
    bad["cycles"] = ["too_far.py"]
    refuse(
        clone, bad, "test-cycle 'too_far' on robot 'medium'", "beyond its limit", "slow the test-cycle down"
    )


@pytest.mark.slow
def test_urdf_without_inertia_is_told(clone, bad):
    shutil.copytree(clone / "config" / "robots" / "medium", clone / "light", dirs_exist_ok=True)
    urdf = clone / "light" / "robot.urdf"
    urdf.write_text(re.sub(r"<inertial>.*?</inertial>", "", urdf.read_text(), count=3, flags=re.DOTALL))
    bad["robots"] = ["light"]
    refuse(clone, bad, "robot.urdf", "inerti")


def test_a_setting_that_stands_twice_is_told(clone):
    (clone / "bad.yaml").write_text((clone / TINY / "config.yaml").read_text() + "seed: 1\nseed: 2\n")
    told = run_ill(clone, "check", study="bad.yaml")
    assert re.search(r"bad\.yaml: is not readable YAML \(line \d+, .*'seed' stands twice", told)


@pytest.mark.parametrize("place", ["results/bad", pytest.param("results/tracking", marks=pytest.mark.slow)])
def test_a_file_where_results_are_to_be_is_told(clone, bad, place):
    path, aside = clone / place, clone / "aside"
    path.parent.mkdir(exist_ok=True)
    if path.exists():
        path.rename(aside)
    path.write_text("mine")
    try:
        refuse(clone, bad, f"{place}: is a file, no folder; move it away")
        assert path.read_text() == "mine"
    finally:
        path.unlink()
        if aside.exists():
            aside.rename(path)


def test_a_brace_in_a_path_of_a_data_set_is_told(clone, tmp_path):
    data = tmp_path / "{arm}"
    shutil.copytree(ROOT / "src" / "wearscope" / "example_data", data)
    told = run_ill(clone, "-n", "closed_loop", "--config", f"dataset={data}")
    assert "the path holds a brace" in told and str(data) in told
