"""Files on which jobs depend: what a robot's model and a data set name, and what they must not."""

import shutil
from pathlib import Path

import pytest
import yaml
from changed_fields import changed_fields

from wearscope.errors import InputError
from wearscope.jobs.study_files import NamedDataSet, NamedRobot

MEDIUM = Path(__file__).parents[2] / "config" / "robots" / "medium"


@pytest.fixture
def machine(tmp_path):
    """A folder with two sessions, and names of files that are not there or not in it."""
    folder = tmp_path / "machine"
    (folder / "runs").mkdir(parents=True)
    for name in ("robot.urdf", "own.py", "runs/a.csv", "runs/b.csv", "../outside.csv"):
        (folder / name).write_text("")
    content = {
        "name": "arm",
        "robot": {"urdf": "robot.urdf"},
        "reference": ["1"],
        "effects": ["own.py", "gone.py", "stribeck"],
        "runs": [
            {"file": "runs/a.csv", "session": 1},
            {"file": "runs/b.csv", "session": "later"},
            {"file": "../outside.csv", "session": "later"},
        ],
    }
    (folder / "dataset.yaml").write_text(yaml.safe_dump(content))
    return folder


def name_files(folder, files):
    return [Path(file).relative_to(folder).as_posix() for file in files]


def test_files_of_a_data_set_are_those_that_lie_in_its_folder(machine):
    for path in (machine, machine / "dataset.yaml"):
        data = NamedDataSet(str(path))
        assert (data.name, data.file) == ("arm", str(machine / "dataset.yaml"))
        assert name_files(machine, data.files) == ["robot.urdf", "runs/a.csv", "runs/b.csv", "own.py"]
        assert data.effects == ["own.py", "gone.py", "stribeck"]


def test_a_session_depends_on_its_own_runs(machine):
    data = NamedDataSet(str(machine))
    assert name_files(machine, data.list_session_files(["later"])) == ["robot.urdf", "runs/b.csv", "own.py"]
    before = data.take_session_fields(["1"])
    assert yaml.safe_load(before)["runs"] == [{"file": "runs/a.csv", "session": 1}]
    data.content["runs"].append({"file": "runs/c.csv", "session": "new"})
    data.content["reference"].append("new")
    assert data.take_session_fields(["1"]) == before


def test_what_snakemake_reads_as_a_pattern_is_refused(machine, refuses):
    (machine / "runs" / "a.csv").rename(machine / "runs" / "{a}.csv")
    text = (machine / "dataset.yaml").read_text().replace("runs/a.csv", "'runs/{a}.csv'")
    (machine / "dataset.yaml").write_text(text)
    with pytest.raises(InputError, match=r"^config: dataset: .*\{a\}\.csv: the path holds a brace"):
        _ = NamedDataSet(str(machine)).files
    refuses(NamedDataSet, str(machine.rename(machine.with_name("{arm}"))))


def test_a_robot_has_its_urdf_and_its_effects(tmp_path, refuses):
    folder = shutil.copytree(MEDIUM, tmp_path / "arm")
    with changed_fields(folder / "model.yaml") as model:
        model["effects"][0]["effect"] = "own.py"
    refuses(NamedRobot, str(folder), False)
    robot = NamedRobot(str(folder), ["own.py"])
    assert robot.list_files() == [str(folder / "model.yaml"), str(folder / "robot.urdf")]
    files = robot.list_effect_files()
    own, others = ([one for one in files if (one.parent == folder) is there] for there in (True, False))
    assert own == [folder / "own.py"] and {one.parent.name for one in others} == {"effects"}
    (folder / "robot.urdf").unlink()
    refuses(robot.list_files)
