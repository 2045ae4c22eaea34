"""Whatever the files of a data set hold, reading gives a data set or one sentence, and stays in it."""

import os
import threading
from pathlib import Path

import numpy as np
import pytest
import yaml
from hostile.files import spoil_urdf
from hostile.samples import FIELDS, make_table, write_dataset
from hostile.tables import spoil_csv, spoil_parquet
from hostile.trees import spoil_bytes, spoil_often, spoil_yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from wearscope.closed_loop.intake.data_folder import find_inside
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.dataset_fields import folder_name
from wearscope.closed_loop.posing import find_prismatic
from wearscope.errors import InputError

SPOILED = {
    "dataset.yaml": (spoil_yaml, spoil_bytes), "a.csv": (spoil_csv, spoil_bytes),
    "b.parquet": (spoil_parquet, spoil_bytes), "robot.urdf": (spoil_urdf,),
}  # fmt: skip


@pytest.fixture
def whole(tmp_path):
    """The folder as it should be; each test breaks what it likes."""
    write_dataset(tmp_path / "data")
    return tmp_path / "data"


def read(folder):
    """True where the folder is read; a refusal must be one sentence about it."""
    try:
        dataset = read_dataset(folder, find_prismatic)
    except InputError as error:
        text = str(error)
        assert text.startswith(str(folder)) and "\n" not in text and len(text) < 3000, text
        assert text.endswith((".", "?")), text
        return False
    assert all(len(run.load().t) >= 50 for run in dataset.runs)
    return True


def test_the_documented_folder_is_read(whole):
    assert read(whole)


@pytest.mark.parametrize("count", [12, pytest.param(120, marks=pytest.mark.slow)])
def test_a_spoiled_file_gives_a_data_set_or_one_sentence(whole, count):
    for name, spoil in ((name, one) for name, ways in SPOILED.items() for one in ways):
        sound = (whole / name).read_bytes()
        for content in spoil_often(spoil, sound, count):
            (whole / name).write_bytes(content)
            read(whole)
        (whole / name).write_bytes(sound)


def write(text, file="dataset.yaml"):
    return lambda folder: (folder / file).write_text(text)


def name_outside(change):
    """A file beside the folder that a field names, itself or by a link."""

    def write_fields(folder):
        fields = yaml.safe_load(yaml.safe_dump(FIELDS))
        (folder.parent / "outside.csv").write_text((folder / "a.csv").read_text())
        (folder.parent / "outside.urdf").write_text((folder / "robot.urdf").read_text())
        (folder / "linked.csv").symlink_to(folder.parent / "outside.csv")
        change(fields)
        (folder / "dataset.yaml").write_text(yaml.safe_dump(fields))

    return write_fields


def name_file(name):
    return name_outside(lambda fields: fields["runs"][0].update(file=name))


def replace_by_pipe(name):
    def change(folder):
        (folder / name).unlink()
        os.mkfifo(folder / name)

    return change


BOMB = ["a0: &a0 [x, x]"] + [f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]" for k in range(1, 25)]
OUTSIDE = "does not lie in the data set's folder"
REFUSED = {
    "nested_deeply": (write("name: d\nrobot: " + "[" * 5000 + "]" * 5000), "nested too deeply"),
    "long_number": (write("sample_rate: " + "1" * 6000), "not readable as YAML"),
    "alias_bomb": (write("\n".join(BOMB)), "more than 120000 values"),
    "python_tag": (write("name: !!python/object/apply:os.system ['touch x']"), "not readable as YAML"),
    "holds_itself": (write("&a\nname: *a\n"), "not readable as YAML"),
    "parent": (name_file("../outside.csv"), OUTSIDE),
    "absolute": (name_file("/etc/passwd"), OUTSIDE),
    "windows": (name_file("C:\\x.csv"), OUTSIDE),
    "link": (name_file("linked.csv"), "a link that leads out of the data set's folder"),
    "urdf": (name_outside(lambda fields: fields["robot"].update(urdf="../outside.urdf")), OUTSIDE),
    "effect": (name_outside(lambda fields: fields.update(effects=["../evil.py"])), OUTSIDE),
    "pipe_yaml": (replace_by_pipe("dataset.yaml"), "is no plain file"),
    "pipe_run": (replace_by_pipe("a.csv"), "is no plain file"),
    "pipe_urdf": (replace_by_pipe("robot.urdf"), "is no plain file"),
    "folder_as_run": (lambda f: ((f / "a.csv").unlink(), (f / "a.csv").mkdir()), "is no plain file"),
    "header_only": (write(",".join(make_table(0)) + "\n", "a.csv"), "holds 0 rows"),
    "empty": (write("", "a.csv"), "cannot be read whole"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_would_hang_or_lead_outside_is_refused(whole, kind):
    change, told = REFUSED[kind]
    change(whole)
    said = []

    def run():
        try:
            read_dataset(whole, find_prismatic)
        except InputError as error:
            said.append(str(error))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(20.0)
    (whole / "a.csv").rmdir() if (whole / "a.csv").is_dir() else None
    assert said and told in said[0] and "\n" not in said[0], said


@pytest.mark.parametrize(
    "write",
    [
        lambda table, file: table.to_csv(file, index=False, sep=";"),
        lambda table, file: table.to_csv(file, index=False, sep="\t"),
        lambda table, file: table.to_csv(file, index=False, sep=";", decimal=","),
        lambda table, file: table.assign(größe=1.0).to_csv(file, index=False, encoding="latin1"),
        lambda table, file: table.assign(größe="µ").to_csv(file, index=False, sep=";", encoding="latin1"),
    ],
    ids=["semicolons", "tabs", "decimal_commas", "latin_1", "latin_1_semicolons"],
)
def test_csv_of_other_countries_is_read(whole, write):
    write(make_table(0), whole / "a.csv")
    assert read(whole)
    run = read_dataset(whole, find_prismatic).runs[0].load()
    np.testing.assert_allclose(run.q[:, 0], make_table(0)["q_j1"], rtol=1e-12)


@pytest.mark.parametrize("name", ["my robot", "a_b-c.d", "2024", "Ünal 7", 7, "x"])
def test_names_that_make_a_folder_are_taken(name):
    made = folder_name(name, "d")
    assert made and "/" not in made and " " not in made and made.strip(".")


@pytest.mark.parametrize(
    "name",
    ["..", ".", "...", ". .", "", " ", "a/b", "../x", "a\nb", " x", "x ", "$(ls)", "a" * 300, None, True, []],
)
def test_names_that_make_none_are_refused(name):
    with pytest.raises(InputError, match="the results' folder is called like it"):
        folder_name(name, "d")


@settings(max_examples=120, deadline=None, derandomize=True)
@given(name=st.text(max_size=40))
def test_no_path_leads_outside(name):
    folder = Path("/tmp/data")
    try:
        path = find_inside(folder, name, "dataset.yaml: runs[].file")
    except InputError:
        return
    assert path.resolve().is_relative_to(folder.resolve())


def test_channels_sessions_and_own_effects_are_read(whole):
    fields = yaml.safe_load(yaml.safe_dump(FIELDS))
    fields |= {"channels": {"clock_j": "A"}, "effects": ["mine.py"], "reference": ["2024-05-01", "after"]}
    fields["declared_effects"] = ["rigid_body", "mine.py"]
    for run, session in zip(fields["runs"], fields["reference"], strict=True):
        run["session"] = session
    text = yaml.safe_dump(fields).replace("'2024-05-01'", "2024-05-01")
    (whole / "dataset.yaml").write_text(text)
    (whole / "mine.py").write_text("raise SystemExit('a data set must not run code')\n")
    assert not read(whole)
    for seed, file in enumerate(("a.csv", "b.parquet")):
        table = make_table(seed).assign(clock_j=np.arange(1000.0))
        table.to_csv(whole / file, index=False) if seed == 0 else table.to_parquet(whole / file, index=False)
    dataset = read_dataset(whole, find_prismatic)
    assert [run.session for run in dataset.runs] == ["2024-05-01", "after"]
    assert dataset.fields.reference == ["2024-05-01", "after"]
    np.testing.assert_array_equal(dataset.runs[0].load().channels["clock_j"], np.arange(1000.0))
