"""Whatever the files of a data set hold, reading gives a data set or one sentence, and stays in it."""

import os
import string
import threading

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wearscope.closed_loop.intake.data_folder import find_inside
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.dataset_fields import folder_name
from wearscope.closed_loop.posing import find_prismatic
from wearscope.errors import InputError

URDF = (
    '<robot name="r"><link name="base"/><link name="one"><inertial><mass value="2"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="j" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/></joint>'
    "</robot>"
)
FUZZ = settings(
    max_examples=int(os.environ.get("WEARSCOPE_FUZZ", "120")),
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
FIELDS = {
    "name": "my robot",
    "robot": {"urdf": "robot.urdf", "joints": ["j"]},
    "sample_rate": 100.0,
    "declared_effects": ["rigid_body"],
    "runs": [{"file": "a.csv", "use": "train"}, {"file": "b.parquet", "use": "test"}],
}


def make_table(seed):
    t = np.arange(200) / 100.0
    noise = np.random.default_rng(seed).normal(size=200)
    return pd.DataFrame({"t": t, "q_j": np.sin((3 + seed) * t), "tau_j": np.cos(4 * t) + noise})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("data")


@pytest.fixture
def whole(folder):
    """The folder as it should be; each test breaks what it likes."""
    for file in folder.iterdir():
        file.unlink()
    (folder / "robot.urdf").write_text(URDF)
    (folder / "dataset.yaml").write_text(yaml.safe_dump(FIELDS))
    make_table(0).to_csv(folder / "a.csv", index=False)
    make_table(1).to_parquet(folder / "b.parquet", index=False)
    return folder


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
    assert folder_name("my robot", "d") == "my-robot"


ODD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=20),
    st.sampled_from(["..", "../../x", "/etc/passwd", "a.csv", "train", "rad", "{name}", "$(ls)", "j", "\0"]),
    st.lists(st.integers(), max_size=3),
    st.dictionaries(st.text(max_size=5), st.integers(), max_size=2),
)
PLACES = [
    ("name",), ("robot",), ("robot", "urdf"), ("robot", "joints"), ("robot", "gravity"), ("sample_rate",),
    ("robot", "torque_limit"), ("units",), ("declared_effects",), ("runs",), ("runs", 0), ("runs", 0, "file"),
    ("runs", 1, "use"), ("runs", 0, "payload"), ("runs", 0, "session"), ("effects",), ("channels",),
    ("accept",), ("reference",), ("extra",),
]  # fmt: skip


@FUZZ
@given(place=st.sampled_from(PLACES), value=ODD)
def test_any_value_of_a_field_gives_a_data_set_or_one_sentence(whole, place, value):
    fields = yaml.safe_load(yaml.safe_dump(FIELDS))
    inner = fields
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    try:
        text = yaml.safe_dump(fields, allow_unicode=True)
    except yaml.YAMLError:
        return
    (whole / "dataset.yaml").write_text(text, encoding="utf-8", errors="surrogatepass")
    read(whole)


@FUZZ
@given(cut=st.integers(0, 400), new=st.binary(max_size=12))
def test_any_bytes_in_the_yaml_give_a_data_set_or_one_sentence(whole, cut, new):
    content = yaml.safe_dump(FIELDS).encode()
    cut = min(cut, len(content))
    (whole / "dataset.yaml").write_bytes(content[:cut] + new + content[cut + len(new) :])
    read(whole)


@FUZZ
@given(
    row=st.integers(0, 30),
    new=st.one_of(st.text(string.printable, max_size=12), st.binary(max_size=8)),
    where=st.integers(0, 60),
)
def test_any_bytes_in_a_csv_give_a_data_set_or_one_sentence(whole, row, new, where):
    lines = make_table(0).to_csv(index=False).encode().split(b"\n")
    new = new if isinstance(new, bytes) else new.encode()
    lines[row] = lines[row][:where] + new + lines[row][where:]
    (whole / "a.csv").write_bytes(b"\n".join(lines))
    read(whole)


@FUZZ
@given(where=st.integers(0, 6000), new=st.binary(min_size=1, max_size=6))
def test_any_bytes_in_a_parquet_give_a_data_set_or_one_sentence(whole, where, new):
    make_table(1).to_parquet(whole / "b.parquet", index=False, write_page_checksum=True)
    content = (whole / "b.parquet").read_bytes()
    where = where % len(content)
    (whole / "b.parquet").write_bytes(content[:where] + new + content[where + len(new) :])
    read(whole)


KINDS = st.sampled_from(
    [
        lambda x: x.astype(str),
        lambda x: x.astype("float32"),
        lambda x: (1000 * x).astype("int32"),
        lambda x: x > 0,
        lambda x: [[v] for v in x],
        lambda x: [{"v": v} for v in x],
        lambda x: [None] * len(x),
        lambda x: pd.Categorical(np.round(x, 1)),
        lambda x: pd.to_datetime(np.arange(len(x)), unit="s"),
        lambda x: x.astype(complex).astype(object).map(str) if hasattr(x, "map") else x,
        lambda x: x * 1e300,
        lambda x: x * np.inf,
    ]
)


@FUZZ
@given(column=st.sampled_from(["t", "q_j", "tau_j", "qd_j", "temp_j"]), kind=KINDS)
def test_any_kind_of_column_gives_a_data_set_or_one_sentence(whole, column, kind):
    table = make_table(1)
    source = table[column] if column in table else table["q_j"]
    table[column] = kind(source)
    table.to_parquet(whole / "b.parquet", index=False)
    read(whole)


def make_deep(folder):
    (folder / "dataset.yaml").write_text("name: d\nrobot: " + "[" * 5000 + "]" * 5000)


def make_long_number(folder):
    (folder / "dataset.yaml").write_text("sample_rate: " + "1" * 6000)


def make_bomb(folder):
    rows = ["a0: &a0 [x, x]"] + [f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]" for k in range(1, 25)]
    (folder / "dataset.yaml").write_text("\n".join(rows))


def make_tag(folder):
    (folder / "dataset.yaml").write_text("name: !!python/object/apply:os.system ['touch x']")


def make_self(folder):
    (folder / "dataset.yaml").write_text("&a\nname: *a\n")


def name_outside(key):
    def change(folder):
        fields = yaml.safe_load(yaml.safe_dump(FIELDS))
        (folder.parent / "outside.csv").write_text((folder / "a.csv").read_text())
        (folder.parent / "outside.urdf").write_text(URDF)
        if key == "link":
            (folder / "linked.csv").symlink_to(folder.parent / "outside.csv")
            fields["runs"][0]["file"] = "linked.csv"
        elif key == "urdf":
            fields["robot"]["urdf"] = "../outside.urdf"
        elif key == "effects":
            fields["effects"] = ["../evil.py"]
        else:
            fields["runs"][0]["file"] = key
        (folder / "dataset.yaml").write_text(yaml.safe_dump(fields))

    return change


def replace_by_pipe(name):
    def change(folder):
        (folder / name).unlink()
        os.mkfifo(folder / name)

    return change


REFUSED = {
    "nested_deeply": (make_deep, "nested too deeply"),
    "long_number": (make_long_number, "not readable as YAML"),
    "alias_bomb": (make_bomb, "more than 120000 values"),
    "python_tag": (make_tag, "not readable as YAML"),
    "holds_itself": (make_self, "not readable as YAML"),
    "parent": (name_outside("../outside.csv"), "does not lie in the data set's folder"),
    "absolute": (name_outside("/etc/passwd"), "does not lie in the data set's folder"),
    "windows": (name_outside("C:\\x.csv"), "does not lie in the data set's folder"),
    "link": (name_outside("link"), "a link that leads out of the data set's folder"),
    "urdf": (name_outside("urdf"), "does not lie in the data set's folder"),
    "effect": (name_outside("effects"), "does not lie in the data set's folder"),
    "pipe_yaml": (replace_by_pipe("dataset.yaml"), "is no ordinary file"),
    "pipe_run": (replace_by_pipe("a.csv"), "is no ordinary file"),
    "pipe_urdf": (replace_by_pipe("robot.urdf"), "is no ordinary file"),
    "folder_as_run": (lambda f: ((f / "a.csv").unlink(), (f / "a.csv").mkdir()), "is no ordinary file"),
    "header_only": (lambda f: (f / "a.csv").write_text("t,q_j,tau_j\n"), "holds 0 rows"),
    "empty": (lambda f: (f / "a.csv").write_text(""), "cannot be read whole"),
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
    np.testing.assert_allclose(run.q[:, 0], make_table(0)["q_j"], rtol=1e-12)


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


@FUZZ
@given(name=st.text(max_size=40))
def test_no_path_leads_outside(folder, name):
    try:
        path = find_inside(folder, name, "dataset.yaml: runs[].file")
    except InputError:
        return
    assert path.resolve().is_relative_to(folder.resolve())


def test_channels_sessions_and_own_effects_are_read(whole):
    fields = yaml.safe_load(yaml.safe_dump(FIELDS))
    fields |= {"channels": {"current_j": "A"}, "effects": ["mine.py"], "reference": ["2024-05-01", "after"]}
    fields["declared_effects"] = ["rigid_body", "mine.py"]
    text = yaml.safe_dump(fields).replace("use: train", "use: train\n  session: 2024-05-01")
    text = text.replace("'2024-05-01'", "2024-05-01").replace("use: test", "use: test\n  session: after")
    (whole / "dataset.yaml").write_text(text)
    (whole / "mine.py").write_text("raise SystemExit('a data set must not run code')\n")
    assert not read(whole)
    for seed, file in enumerate(("a.csv", "b.parquet")):
        table = make_table(seed).assign(current_j=np.arange(200.0))
        table.to_csv(whole / file, index=False) if seed == 0 else table.to_parquet(whole / file, index=False)
    dataset = read_dataset(whole, find_prismatic)
    assert [run.session for run in dataset.runs] == ["2024-05-01", "after"]
    assert dataset.fields.reference == ["2024-05-01", "after"]
    np.testing.assert_array_equal(dataset.runs[0].load().channels["current_j"], np.arange(200.0))
