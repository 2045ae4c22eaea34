"""Every breach of the folder format gets one sentence that names the file, the field or the row."""

import copy
import gzip
import re
import shutil
from datetime import date

import numpy as np
import pandas as pd
import pytest
import yaml

from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.posing import find_prismatic
from wearscope.closed_loop.run import close_loop
from wearscope.errors import InputError

JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
    '<axis xyz="0 0 1"/></joint>'
)
LINK = (
    '<link name="{name}"><inertial><mass value="2"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
ROWS, RATE = 400, 100.0


def make_urdf(kinds=("revolute", "revolute")):
    links = "".join(LINK.format(name=name) for name in ("base", "one", "two"))
    joints = JOINT.format(name="j1", kind=kinds[0], parent="base", child="one")
    joints += JOINT.format(name="j2", kind=kinds[1], parent="one", child="two")
    return f'<robot name="r">{links}{joints}</robot>'


def make_table(seed):
    rng = np.random.default_rng(seed)
    t = np.arange(ROWS) / RATE
    table = {"t": t}
    for joint in ("j1", "j2"):
        table[f"q_{joint}"] = np.sin(2 * np.pi * rng.uniform(0.3, 0.9) * t)
        table[f"tau_{joint}"] = rng.normal(size=ROWS)
    return pd.DataFrame(table)


class Folder:
    """A whole data set, to break one thing of."""

    def __init__(self, path):
        self.path = path
        self.document = {
            "name": "my robot 1",
            "robot": {"urdf": "robot.urdf", "joints": ["j1", "j2"]},
            "sample_rate": RATE,
            "declared_effects": ["rigid_body", "coulomb"],
            "runs": [
                {"file": "runs/a.parquet", "use": "train"},
                {"file": "runs/b.parquet", "use": "test"},
            ],
        }
        self.tables = {"runs/a.parquet": make_table(1), "runs/b.parquet": make_table(2)}
        self.urdf = make_urdf()

    def write(self):
        (self.path / "runs").mkdir(parents=True)
        (self.path / "dataset.yaml").write_text(yaml.safe_dump(self.document), encoding="utf-8")
        (self.path / "robot.urdf").write_text(self.urdf, encoding="utf-8")
        for file, table in self.tables.items():
            if file.endswith(".csv"):
                table.to_csv(self.path / file, index=False)
            else:
                table.to_parquet(self.path / file, index=False)
        return self

    def read(self):
        return read_dataset(self.path, find_prismatic)

    @property
    def train(self):
        return self.tables["runs/a.parquet"]


@pytest.fixture
def folder(tmp_path):
    return Folder(tmp_path / "a folder, elsewhere")


def refuse(folder, *parts):
    """One sentence with these parts; the folder's path leads to the file."""
    folder.write()
    before = sorted(folder.path.rglob("*"))
    with pytest.raises(InputError) as caught:
        close_loop(folder.path, folder.path / "out", light=True)
    text = str(caught.value)
    assert text.startswith(str(folder.path)), text
    assert "\n" not in text and text.endswith((".", "?")), text
    for part in parts:
        assert part in text, (part, text)
    assert sorted(folder.path.rglob("*")) == before, "something was written"


def test_whole_folder_is_read(folder):
    data = folder.write().read()
    assert data.name == "my robot 1"
    assert data.joints == ["j1", "j2"] and data.position_unit == ["rad", "rad"]
    assert [run.use for run in data.runs] == ["train", "test"]
    first, second = (run.load() for run in data.runs)
    np.testing.assert_array_equal(first.q[:, 1], folder.train["q_j2"])
    np.testing.assert_array_equal(second.tau[:, 0], folder.tables["runs/b.parquet"]["tau_j1"])
    assert first.qd is None and first.temperature is None and data.notes == []


def test_csv_holds_the_same_columns(folder):
    folder.document["runs"][0]["file"] = "runs/a.csv"
    folder.tables["runs/a.csv"] = folder.tables.pop("runs/a.parquet")
    data = folder.write().read()
    np.testing.assert_allclose(
        data.runs[0].load().tau[:, 0], folder.tables["runs/a.csv"]["tau_j1"], rtol=1e-12
    )


def test_optional_columns_may_be_there_for_some_joints(folder):
    folder.train["qd_j2"] = 1.0 + np.arange(ROWS)
    folder.train["temp_j1"] = 30.0
    folder.train["comment"] = "kept out"
    run = folder.write().read().runs[0].load()
    assert np.isnan(run.qd[:, 0]).all() and run.qd[0, 1] == 1.0
    assert (run.temperature[:, 0] == 30.0).all() and np.isnan(run.temperature[:, 1]).all()


def test_fields_of_other_makers_are_kept_out_and_said(folder):
    folder.document["recorded_by"] = "me"
    folder.document["runs"][0]["operator"] = "you"
    notes = folder.write().read().notes
    assert any("'recorded_by' is not known" in note for note in notes)
    assert any("runs[0]: field 'operator'" in note for note in notes)


def test_numbers_serve_as_names(folder):
    folder.document["name"] = 2024
    assert folder.write().read().name == "2024"


FIELDS = {
    "name_missing": (lambda d: d.pop("name"), ["dataset.yaml", "'name' is missing"]),
    "runs_missing": (lambda d: d.pop("runs"), ["'runs' is missing"]),
    "runs_empty": (lambda d: d.update(runs=[]), ["'runs'", "at least 1 item"]),
    "field_misspelt": (
        lambda d: d.update(samplerate=d.pop("sample_rate")),
        ["'samplerate'", "'sample_rate'?"],
    ),
    "optional_misspelt": (lambda d: d.update(unit={"q": "rad"}), ["'unit'", "did you mean 'units'?"]),
    "robot_misspelt": (
        lambda d: d["robot"].update(gear_ratios=[1, 1]),
        ["robot: there is no field 'gear_ratios'", "'gear_ratio'?"],
    ),
    "urdf_misspelt": (
        lambda d: d["robot"].update(udrf=d["robot"].pop("urdf")),
        ["robot: there is no field 'udrf'"],
    ),
    "run_misspelt": (lambda d: d["runs"][0].update(payloads={}), ["runs[0]", "'payloads'", "'payload'?"]),
    "payload_misspelt": (
        lambda d: d["runs"][0].update(payload={"mass": 1.0, "comm": [0, 0, 0]}),
        ["runs[0].payload", "'comm'", "'com'?"],
    ),
    "use_odd": (
        lambda d: d["runs"][0].update(use="training"),
        ["'runs[0].use'", "'train' or 'test'", "'training'"],
    ),
    "no_train": (lambda d: d["runs"][0].update(use="test"), ["no run has 'use: train'"]),
    "no_test": (lambda d: d["runs"][1].update(use="train"), ["no run has 'use: test'"]),
    "file_twice": (lambda d: d["runs"][1].update(file="runs/a.parquet"), ["runs/a.parquet more than once"]),
    "rate_text": (lambda d: d.update(sample_rate="fast"), ["'sample_rate'", "'fast'"]),
    "rate_zero": (lambda d: d.update(sample_rate=0), ["'sample_rate'", "greater than or equal to 1"]),
    "rate_nan": (lambda d: d.update(sample_rate=float("nan")), ["'sample_rate'"]),
    "rate_bool": (lambda d: d.update(sample_rate=True), ["'sample_rate' should be a number"]),
    "rate_wrong": (
        lambda d: d.update(sample_rate=250.0),
        ["runs/a.parquet", "which is 100 Hz", "says 250 Hz"],
    ),
    "unknown_joint": (
        lambda d: d["robot"].update(joints=["j1", "elbow"]),
        ["robot.urdf", "no joint 'elbow'", "j1, j2"],
    ),
    "joint_twice": (lambda d: d["robot"].update(joints=["j1", "j1"]), ["names a joint twice"]),
    "joints_text": (lambda d: d["robot"].update(joints="j1"), ["'robot.joints'", "valid list"]),
    "unknown_effect": (
        lambda d: d["declared_effects"].append("viscus"),
        ["declared_effects", "no effect 'viscus'", "did you mean 'viscous'?"],
    ),
    "strange_effect": (
        lambda d: d["declared_effects"].append("gremlins"),
        ["'gremlins'", "choose from backlash"],
    ),
    "effect_twice": (lambda d: d["declared_effects"].append("coulomb"), ["names an effect twice"]),
    "list_short": (
        lambda d: d["robot"].update(rotor_inertia=[1.0]),
        ["robot.rotor_inertia has 1 values for 2 joints"],
    ),
    "list_long": (lambda d: d["robot"].update(gear_ratio=[1.0, 2, 3]), ["robot.gear_ratio has 3 values"]),
    "inertia_negative": (
        lambda d: d["robot"].update(rotor_inertia=[1.0, -1]),
        ["rotor_inertia holds a negative"],
    ),
    "limit_zero": (lambda d: d["robot"].update(torque_limit=[0.0, 1]), ["torque_limit must be positive"]),
    "ratio_zero": (lambda d: d["robot"].update(gear_ratio=[0.0, 1]), ["gear_ratio holds a 0"]),
    "list_infinite": (
        lambda d: d["robot"].update(rotor_inertia=[1.0, float("inf")]),
        ["'robot.rotor_inertia[1]'", "finite"],
    ),
    "gravity_short": (
        lambda d: d["robot"].update(gravity=[0, -9.81]),
        ["'robot.gravity'", "at least 3 items"],
    ),
    "gravity_in_mm": (lambda d: d["robot"].update(gravity=[0, 0, -9810]), ["robot.gravity is 9810 m/s^2"]),
    "inertials_odd": (lambda d: d["robot"].update(inertials="good"), ["'robot.inertials'", "'approximate'"]),
    "payload_bare": (
        lambda d: d["runs"][0].update(payload=3),
        ["'runs[0].payload' should hold fields of its own", "but is '3'"],
    ),
    "payload_negative": (lambda d: d["runs"][0].update(payload={"mass": -1}), ["'runs[0].payload.mass'"]),
    "payload_no_mass": (
        lambda d: d["runs"][0].update(payload={"com": [0, 0, 0]}),
        ["'runs[0].payload.mass' is missing"],
    ),
    "unit_odd": (
        lambda d: d.update(units={"q": "deg", "tau": "N m"}),
        ["'units.q'", "'rad' or 'm'", "'deg'"],
    ),
    "unit_misfit": (
        lambda d: d.update(units={"q": "m", "tau": "N"}),
        ["units say q: m, tau: N, but joint 'j1' is revolute"],
    ),
    "unit_list_short": (
        lambda d: d.update(units={"q": ["rad"], "tau": "N m"}),
        ["units.q has 1 values for 2"],
    ),
    "file_missing": (lambda d: d["runs"][1].update(file="runs/c.parquet"), ["runs/c.parquet: no such file"]),
    "file_odd": (
        lambda d: d["runs"][1].update(file="robot.urdf"),
        ["robot.urdf", "neither .parquet nor .csv"],
    ),
    "urdf_missing": (lambda d: d["robot"].update(urdf="r.urdf"), ["r.urdf: no such file", "robot.urdf in"]),
}


@pytest.mark.parametrize("case", FIELDS)
def test_breach_in_a_field_is_named(folder, case):
    change, parts = FIELDS[case]
    folder.document = copy.deepcopy(folder.document)
    change(folder.document)
    refuse(folder, *parts)


def set_cell(row, column, value):
    def change(table):
        table.loc[row, column] = value
        return table

    return change


def reverse_times(table):
    t = table["t"].to_numpy().copy()
    t[200:203] = t[200:203][::-1]
    return table.assign(t=t)


def jump_often(table):
    return table.assign(t=table["t"] + 0.2 * (np.arange(ROWS) // 40))


TABLES = {
    "column_missing": (lambda t: t.drop(columns="tau_j2"), ["column 'tau_j2' is missing"]),
    "column_misspelt": (lambda t: t.rename(columns={"q_j1": "q_J1"}), ["'q_j1' is missing; rename 'q_J1'"]),
    "time_missing": (lambda t: t.drop(columns="t"), ["column 't' is missing"]),
    "one_nan": (set_cell(123, "tau_j1", np.nan), ["'tau_j1' is no finite number at row 123 (1 in all)"]),
    "one_infinity": (set_cell(7, "q_j2", np.inf), ["'q_j2' is no finite number at row 7"]),
    "nan_in_time": (set_cell(9, "t", np.nan), ["'t' is no finite number at row 9"]),
    "time_backwards": (reverse_times, ["'t' does not increase at row 201", "sort the rows"]),
    "time_reversed": (lambda t: t.iloc[::-1].reset_index(drop=True), ["'t' does not increase at row 1"]),
    "row_repeated": (
        lambda t: pd.concat([t[:50], t[49:50], t[50:]], ignore_index=True),
        ["'t' does not increase at row 50", "drop repeated ones"],
    ),
    "time_jumps_too_often": (jump_often, ["'t' jumps so often that no second of it is whole"]),
    "time_in_ms": (lambda t: t.assign(t=1000 * t["t"]), ["steps by 10, as in milliseconds", "divide it by"]),
    "time_in_ns": (lambda t: t.assign(t=(1e9 * t["t"]).astype("int64")), ["as in nanoseconds"]),
    "text": (
        lambda t: t.assign(tau_j1=t["tau_j1"].map("{:.2f} Nm".format)),
        ["'tau_j1' holds text", "row 0"],
    ),
    "flags": (lambda t: t.assign(q_j1=t["q_j1"] > 0), ["'q_j1' holds text", "plain numbers"]),
    "dates": (
        lambda t: t.assign(t=pd.to_datetime(t["t"], unit="s")),
        ["'t' holds text or dates", "give seconds"],
    ),
    "durations": (
        lambda t: t.assign(t=pd.to_timedelta(t["t"], unit="s")),
        ["'t' holds text", "give seconds"],
    ),
    "epoch_in_32_bits": (
        lambda t: t.assign(t=(t["t"] + 1.7e9).astype("float32")),
        ["'t' stands still in 399 of 399 steps, so", "write all its digits"],
    ),
    "time_in_hundredths": (
        lambda t: t.assign(t=np.round(0.7 * t["t"], 2)),
        ["'t' stands still in", "moves by 0.01 s or more", "write all its digits"],
    ),
    "rows_twice": (
        lambda t: t.loc[t.index.repeat(2)].reset_index(drop=True),
        ["'t' stands still", "drop repeated"],
    ),
    "units_in_names": (
        lambda t: t.rename(columns={"t": "t [s]", "q_j1": "q_j1 (rad)"}),
        ["'t' is missing; rename 't [s]'"],
    ),
    "no_rows": (lambda t: t[:0], ["0 rows"]),
    "few_rows": (lambda t: t[:20], ["20 rows", "at least 50"]),
    "too_short": (lambda t: t[:60], ["lasts 0.59 s"]),
    "dead_torque": (lambda t: t.assign(tau_j2=3.5), ["'tau_j2' is constant (3.5)"]),
    "kelvin": (lambda t: t.assign(temp_j1=300.0), ["temperature", "-60..250 deg C"]),
}


@pytest.mark.parametrize("case", TABLES)
def test_breach_in_a_run_is_named(folder, case):
    change, parts = TABLES[case]
    folder.tables["runs/a.parquet"] = change(folder.train)
    refuse(folder, "runs/a.parquet", *parts)


def test_breach_in_a_csv_is_named(folder):
    folder.document["runs"][0]["file"] = "runs/a.csv"
    folder.tables["runs/a.csv"] = folder.tables.pop("runs/a.parquet").drop(columns="q_j1")
    refuse(folder, "runs/a.csv: column 'q_j1' is missing")


NO_CSV = {
    "parquet": (lambda t: t.to_parquet(), "is a Parquet file; call it .parquet"),
    "gzip": (lambda t: gzip.compress(t.to_csv(index=False).encode()), "is compressed by gzip; unpack it"),
    "spreadsheet": (lambda t: b"PK\x03\x04rest", "is a zip archive or spreadsheet; save its table as CSV"),
    "utf16": (lambda t: t.to_csv(index=False).encode("utf-16"), "is UTF-16 text; save it as UTF-8"),
    "title": (lambda t: b"# of today\n" + t.to_csv(index=False).encode(), "give it one line of column names"),
}


@pytest.mark.parametrize("case", NO_CSV)
def test_what_is_no_csv_is_told_with_its_own_remedy(folder, case):
    make, told = NO_CSV[case]
    folder.document["runs"][0]["file"] = "runs/a.csv"
    folder.write()
    (folder.path / "runs/a.csv").write_bytes(make(folder.train))
    with pytest.raises(InputError) as caught:
        folder.read()
    assert str(caught.value).startswith(str(folder.path / "runs/a.csv")) and told in str(caught.value)


def test_a_mark_of_utf_8_and_a_decimal_comma_are_read(folder):
    folder.document["runs"][0]["file"] = "runs/a.csv"
    folder.write()
    (folder.path / "runs/a.csv").write_text(
        folder.train.to_csv(index=False, sep=";", decimal=","), "utf-8-sig"
    )
    run = folder.read().runs[0].load()
    assert run.q == pytest.approx(folder.train[["q_j1", "q_j2"]].to_numpy(), rel=1e-12)


def test_a_field_that_stands_twice_is_refused(folder):
    folder.write()
    file = folder.path / "dataset.yaml"
    file.write_text(file.read_text() + "runs:\n- {file: runs/b.parquet, use: train}\n")
    with pytest.raises(
        InputError, match=r"dataset\.yaml: not readable as YAML \(line \d+, .*'runs' stands twice"
    ):
        folder.read()


def test_another_ending_of_the_file_s_name_is_told(folder):
    folder.write()
    (folder.path / "dataset.yaml").rename(folder.path / "dataset.yml")
    with pytest.raises(InputError, match=r"rename dataset\.yml to dataset\.yaml"):
        folder.read()


def test_a_date_is_a_name(folder):
    folder.document["name"] = date(2024, 5, 1)
    assert folder.write().read().name == "2024-05-01"


@pytest.mark.parametrize(
    "copied",
    [
        lambda t: t,
        lambda t: t[60:-60].reset_index(drop=True),
        lambda t: t[80:].assign(t=lambda x: x["t"] - x["t"].iloc[0] + 5.0),
        lambda t: t.assign(**{c: t[c].round(4) for c in t if c != "t"}),
    ],
    ids=["whole", "trimmed", "trimmed_new_time", "rounded"],
)
def test_test_run_that_repeats_a_train_run_is_refused(folder, copied):
    folder.tables["runs/b.parquet"] = copied(folder.train)
    refuse(folder, "the test run runs/b.parquet repeats the train run runs/a.parquet", "recorded apart")


def test_the_same_motion_recorded_twice_is_no_repeat(folder):
    again = folder.train.copy()
    for joint in ("j1", "j2"):
        again[f"tau_{joint}"] += 0.01 * np.random.default_rng(0).normal(size=ROWS)
    folder.tables["runs/b.parquet"] = again
    assert len(folder.write().read().runs) == 2


def test_truncated_parquet_is_refused(folder):
    folder.write()
    file = folder.path / "runs/a.parquet"
    file.write_bytes(file.read_bytes()[:900])
    with pytest.raises(
        InputError, match=r"a\.parquet: cannot be read whole .*copy the file again, or make it again\.$"
    ):
        folder.read()


def test_broken_yaml_and_missing_folder_are_refused(folder):
    folder.write()
    (folder.path / "dataset.yaml").write_text("name: [unclosed", encoding="utf-8")
    with pytest.raises(InputError, match=r"dataset\.yaml: not readable as YAML .*line"):
        folder.read()
    (folder.path / "dataset.yaml").write_text("- just\n- a list\n", encoding="utf-8")
    with pytest.raises(InputError, match="holds no fields"):
        folder.read()
    shutil.rmtree(folder.path)
    with pytest.raises(InputError, match=re.escape(str(folder.path / "dataset.yaml"))):
        folder.read()


def test_broken_urdf_is_refused(folder):
    folder.urdf = folder.urdf[:200]
    refuse(folder, "robot.urdf", "not well-formed XML")


def test_prismatic_joints_need_their_units(folder):
    folder.urdf = make_urdf(("prismatic", "prismatic"))
    refuse(folder, "units say q: rad, tau: N m, but joint 'j1' is prismatic", "m and N")


def test_mixed_joints_take_units_by_joint(folder):
    folder.urdf = make_urdf(("prismatic", "revolute"))
    folder.document["units"] = {"q": ["m", "rad"], "tau": ["N", "N m"]}
    assert folder.write().read().position_unit == ["m", "rad"]


def test_mixed_joints_with_exchanged_units_are_refused(folder):
    folder.urdf = make_urdf(("prismatic", "revolute"))
    folder.document["units"] = {"q": ["rad", "m"], "tau": ["N m", "N"]}
    refuse(folder, "joint 'j1' is prismatic")


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("turned: [tau_J9]", "turned: 'tau_J9' is none of"),
        ("shifted: {tau_J1: 1.0}", "shifted: 'tau_J1' is none of"),
        ("scaled: {tau_J1: 1.0}", "scaled: 'tau_J1' is none of"),
        ("scaled: {q_a: 0}", "scaled: holds a 0"),
        ("torque: {J9: link}", "there is no joint 'J9'"),
    ],
)
def test_columns_that_are_none_are_refused_by_whoever_reads(record, line, told):
    """Not by `check` alone: a correction that names no column would be left out silently."""
    file = record() / "dataset.yaml"
    file.write_text(file.read_text() + f"{line}\n")
    with pytest.raises(InputError, match=told):
        read_dataset(file.parent, find_prismatic)
