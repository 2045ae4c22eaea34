"""`check`: everything that is wrong, in one list; nothing where all is well; never anything but sentences."""

import shutil
from pathlib import Path

import pandas as pd
import pytest
import yaml
from changed_fields import changed_fields

from wearscope.checking.dataset import check_dataset
from wearscope.checking.own_code import check_file, make_batch
from wearscope.checking.robot import check_model, check_robot_folder
from wearscope.checking.study import check_study
from wearscope.cli.check import inspect
from wearscope.errors import Findings
from wearscope.home import find_home
from wearscope.robots.model import load_model
from wearscope.starters.conversion import convert_recordings
from wearscope.starters.dataset import write_dataset
from wearscope.starters.mapped import Mapped

ROOT = Path(__file__).parents[2]
QUICK = yaml.safe_load((ROOT / "config" / "quick.yaml").read_text())
ARM = ROOT / "config" / "robots" / "medium"


def told(found, *parts):
    """Whether each part stands in a problem of its own."""
    return all(sum(part in one for one in found.problems) == 1 for part in parts)


@pytest.fixture
def arm(tmp_path):
    """A copy of the medium robot to spoil: its folder, and a function that rewrites the model."""
    folder = tmp_path / "arm"
    shutil.copytree(ARM, folder)

    def change(edit):
        with changed_fields(folder / "model.yaml") as fields:
            edit(fields)
        return folder

    return change


@pytest.mark.parametrize("name", ["medium", "large"])
def test_nothing_is_wrong_with_the_platform_s_robots(name):
    assert check_robot_folder(name).problems == []


@pytest.mark.parametrize("name", ["config.yaml", "quick.yaml"])
def test_nothing_is_wrong_with_the_platform_s_studies(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert inspect(f"config/{name}").problems == []


def test_all_that_is_wrong_with_a_study_is_said_at_once():
    config = {
        **QUICK,
        "detectorz": {},
        "robots": ["medium", "nobody"],
        "cycles": ["point_to_point", "no_cycle"],
        "detectors": {
            "A": "residual_energy",
            "B": "no_detector",
            "C": {"use": "friction_fit", "options": {"x": 1}},
        },
        "snr": {"sigma": -1},
    }
    found = check_study(config, "study", ROOT)
    assert told(
        found, "detectorz is no known setting", "snr.sigma", "robot 'nobody'", "there is no 'no_cycle'",
        "there is no 'no_detector'", "detectors.C: friction_fit: the detector refuses",
    )  # fmt: skip
    assert len(found.problems) == 6


def test_a_design_that_cannot_be_made_is_refused_before_it_is_run():
    """`run` would refuse it when its first job makes it."""
    design = {"kind": "central_composite", "generators": ["w3 = f w1", "w5 = nothing"]}
    found = check_study({**QUICK, "design": design}, "study", ROOT)
    assert told(found, "nothing")


def test_a_misspelt_setting_is_told_before_what_it_leaves_missing():
    config = {key: value for key, value in QUICK.items() if key != "detectors"}
    found = check_study({**config, "detectorz": QUICK["detectors"]}, "study", ROOT)
    assert found.problems[0] == "config: detectorz is no known setting; did you mean detectors?"
    assert found.problems[1] == "config: detectors is missing; add it."


def test_all_that_is_wrong_with_a_robot_is_said_at_once(arm):
    def spoil(fields):
        fields["drive"]["speed_limit"][0] = -1
        fields["sensors"]["torque_nose"] = 1
        del fields["effects"][2]["joint"]

    found = Findings("arm")
    assert check_model(arm(spoil), found) is None
    assert told(found, "effects[2].joint: is missing")

    def mend(fields):
        fields["effects"][2]["joint"] = "axis_3"

    found = Findings("arm")
    check_model(arm(mend), found)
    assert told(found, "speed_limit[0]", "torque_nose: there is no such key")


def test_effects_that_are_wrong_are_each_named(arm):
    def spoil(fields):
        del fields["effects"][0]["parameters"]["eta3"]
        fields["effects"][1]["effect"] = "friction_wear"
        fields["effects"][2]["parameters"]["eta99"] = 1.0

    found = Findings("arm")
    check_model(arm(spoil), found)
    assert told(found, "no value for 'eta3'", "there is no 'friction_wear'", "no parameter 'eta99'")


@pytest.mark.parametrize(
    ("edit", "factor"),
    [
        (lambda fields: fields.pop("payload"), "factors.w5: payload mass error moves no recorded torque"),
        (
            lambda fields: fields.update(effects=fields["effects"][1:]),
            "factors.f: wear moves no recorded torque",
        ),
        (lambda fields: fields.update(effects=[]), "factors.w3: temperature moves no recorded torque"),
    ],
    ids=["payload", "wear", "temperature"],
)
def test_a_factor_that_moves_nothing_is_named(edit, factor, arm):
    found = check_study({**QUICK, "robots": [str(arm(edit))]}, "study", ROOT)
    assert any(factor in one for one in found.problems)


def test_a_factor_that_the_study_drops_is_a_note(arm):
    config = {**QUICK, "robots": [str(arm(lambda fields: fields.pop("payload")))], "screening": "drop"}
    found = check_study(config, "study", ROOT)
    assert found.problems == [] and any("factors.w5" in one and "dropped" in one for one in found.notes)


def test_a_motor_that_is_too_weak_is_named_for_every_cycle(arm):
    def spoil(fields):
        fields["drive"]["torque_limit"][1] = 100.0

    problems = check_robot_folder(arm(spoil)).problems
    assert len(problems) == 6 and all("joint 'axis_2' would need the torque" in one for one in problems)


def test_noise_free_sensors_are_noted(arm):
    found = check_robot_folder(arm(lambda fields: fields["sensors"].pop("torque_noise")))
    assert any("sensors.torque_noise is 0 or missing" in one for one in found.notes)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A data set that passes."""
    folder = tmp_path_factory.mktemp("data")
    model = load_model("medium").replace(payload=None)
    files = []
    for k, name in enumerate(["point_to_point", "axis_sweeps", "spot_welding"]):
        batch = make_batch(model, name, 0.0, k)
        columns = (
            {"t": batch.t}
            | {f"q{j}": batch.q[:, j] for j in range(6)}
            | {f"tau{j}": batch.tau[:, j] for j in range(6)}
        )
        files.append(folder / f"{k}.csv")
        pd.DataFrame(columns).to_csv(files[-1], index=False)
    target = folder / "arm"
    target.mkdir()
    mapped = Mapped()
    write_dataset(
        target, "arm", ARM / "robot.urdf", convert_recordings(files, ARM / "robot.urdf", mapped), mapped
    )
    return target


@pytest.fixture
def spoilt(data, tmp_path):
    folder = tmp_path / "arm"
    shutil.copytree(data, folder)
    return folder


def rewrite(folder, **changes):
    fields = yaml.safe_load((folder / "dataset.yaml").read_text())
    (folder / "dataset.yaml").write_text(yaml.safe_dump(fields | changes))


def test_nothing_is_wrong_with_a_data_set_that_passes(data):
    found = check_dataset(data)
    assert found.problems == [] and any("zero phase" in one for one in found.notes)


def test_all_that_is_wrong_with_a_data_set_is_said_at_once(spoilt):
    (spoilt / "runs" / "0.parquet").unlink()
    (spoilt / "runs" / "1.parquet").write_bytes(b"nothing")
    rewrite(spoilt, declared_effects=["rigid_body", "colomb"], channels={"t": "s"})
    found = check_dataset(spoilt)
    assert told(
        found,
        "0.parquet: no such file",
        "1.parquet: cannot be read whole",
        "no effect 'colomb'",
        "channels: 't'",
    )
    assert len(found.problems) == 4


def test_a_unit_that_is_none_is_told_once(spoilt):
    rewrite(spoilt, units={"q": "°", "tau": "N·m"})
    found = check_dataset(spoilt)
    assert told(found, "'units.q' should be 'rad' or 'm'", "'units.tau' should be 'N m' or 'N'")
    assert len(found.problems) == 2


def test_fields_that_are_wrong_are_each_named(spoilt):
    rewrite(spoilt, sample_rate="fast", runs=[{"file": "runs/0.parquet", "use": "both"}])
    assert told(check_dataset(spoilt), "'sample_rate'", "'runs[0].use'")


BROKEN = "class D:\n    def fit(self, n, a, m): pass\n    def test_quantity(self, b): return {}\nDETECTOR = D"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("DETECTOR = 3", "DETECTOR is no class"),
        (BROKEN.format("1 / 0"), "ZeroDivisionError"),
        (BROKEN.format("float('nan')"), "finite"),
        ("CYCLE = 3", "CYCLE is no"),
        ("EFFECT = 3", "EFFECT"),
    ],
)
def test_own_code_that_is_wrong_gets_a_sentence(text, problem, tmp_path):
    (tmp_path / "own.py").write_text(text)
    found = check_file(tmp_path / "own.py")
    assert len(found.problems) == 1 and problem in found.problems[0]


def test_a_file_without_anything_to_check_says_so(tmp_path, refuses):
    (tmp_path / "own.py").write_text("x = 1")
    refuses(check_file, tmp_path / "own.py")


def test_the_home_s_names_can_be_checked():
    assert inspect("quick").what.endswith(str(find_home() / "config" / "quick.yaml"))
