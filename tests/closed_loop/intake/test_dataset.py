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
from urdf_texts import Joint, describe_robot

from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.posing import find_prismatic
from wearscope.closed_loop.run import close_loop
from wearscope.errors import InputError

ROWS, RATE = 400, 100.0


def make_urdf(kinds=("revolute", "revolute")):
    return describe_robot(Joint("j1", mass=2, kind=kinds[0]), Joint("j2", mass=2, kind=kinds[1]))


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
    """Refuse in one sentence with these parts, which is returned; the folder's path leads to the file."""
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
    return text.replace(str(folder.path), "FOLDER")


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


@pytest.mark.parametrize(("name", "told"), [(2024, "2024"), (date(2024, 5, 1), "2024-05-01")])
def test_numbers_and_dates_serve_as_names(folder, name, told):
    folder.document["name"] = name
    assert folder.write().read().name == told


FIELDS = {
    "name_missing": lambda d: d.pop("name"),
    "runs_missing": lambda d: d.pop("runs"),
    "runs_empty": lambda d: d.update(runs=[]),
    "field_misspelt": lambda d: d.update(samplerate=d.pop("sample_rate")),
    "optional_misspelt": lambda d: d.update(unit={"q": "rad"}),
    "robot_misspelt": lambda d: d["robot"].update(gear_ratios=[1, 1]),
    "urdf_misspelt": lambda d: d["robot"].update(udrf=d["robot"].pop("urdf")),
    "run_misspelt": lambda d: d["runs"][0].update(payloads={}),
    "payload_misspelt": lambda d: d["runs"][0].update(payload={"mass": 1.0, "comm": [0, 0, 0]}),
    "use_odd": lambda d: d["runs"][0].update(use="training"),
    "no_train": lambda d: d["runs"][0].update(use="test"),
    "no_test": lambda d: d["runs"][1].update(use="train"),
    "file_twice": lambda d: d["runs"][1].update(file="runs/a.parquet"),
    "rate_text": lambda d: d.update(sample_rate="fast"),
    "rate_zero": lambda d: d.update(sample_rate=0),
    "rate_nan": lambda d: d.update(sample_rate=float("nan")),
    "rate_bool": lambda d: d.update(sample_rate=True),
    "rate_wrong": lambda d: d.update(sample_rate=250.0),
    "unknown_joint": lambda d: d["robot"].update(joints=["j1", "elbow"]),
    "joint_twice": lambda d: d["robot"].update(joints=["j1", "j1"]),
    "joints_text": lambda d: d["robot"].update(joints="j1"),
    "unknown_effect": lambda d: d["declared_effects"].append("viscus"),
    "effect_twice": lambda d: d["declared_effects"].append("coulomb"),
    "list_short": lambda d: d["robot"].update(rotor_inertia=[1.0]),
    "list_long": lambda d: d["robot"].update(gear_ratio=[1.0, 2, 3]),
    "inertia_negative": lambda d: d["robot"].update(rotor_inertia=[1.0, -1]),
    "limit_zero": lambda d: d["robot"].update(torque_limit=[0.0, 1]),
    "ratio_zero": lambda d: d["robot"].update(gear_ratio=[0.0, 1]),
    "list_infinite": lambda d: d["robot"].update(rotor_inertia=[1.0, float("inf")]),
    "gravity_short": lambda d: d["robot"].update(gravity=[0, -9.81]),
    "gravity_in_mm": lambda d: d["robot"].update(gravity=[0, 0, -9810]),
    "inertials_odd": lambda d: d["robot"].update(inertials="good"),
    "payload_bare": lambda d: d["runs"][0].update(payload=3),
    "payload_negative": lambda d: d["runs"][0].update(payload={"mass": -1}),
    "payload_no_mass": lambda d: d["runs"][0].update(payload={"com": [0, 0, 0]}),
    "unit_odd": lambda d: d.update(units={"q": "deg", "tau": "N m"}),
    "unit_misfit": lambda d: d.update(units={"q": "m", "tau": "N"}),
    "unit_list_short": lambda d: d.update(units={"q": ["rad"], "tau": "N m"}),
    "file_missing": lambda d: d["runs"][1].update(file="runs/c.parquet"),
    "file_odd": lambda d: d["runs"][1].update(file="robot.urdf"),
    "urdf_missing": lambda d: d["robot"].update(urdf="r.urdf"),
}


@pytest.mark.parametrize("case", FIELDS)
def test_breach_in_a_field_is_named(folder, case, says):
    folder.document = copy.deepcopy(folder.document)
    FIELDS[case](folder.document)
    says(case, refuse(folder))


def test_an_effect_that_is_like_none_is_answered_with_the_vocabulary(folder):
    folder.document["declared_effects"] = ["gremlins"]
    refuse(folder, "'gremlins'", "choose from backlash")


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
    "column_missing": lambda t: t.drop(columns="tau_j2"),
    "column_misspelt": lambda t: t.rename(columns={"q_j1": "q_J1"}),
    "time_missing": lambda t: t.drop(columns="t"),
    "one_nan": set_cell(123, "tau_j1", np.nan),
    "one_infinity": set_cell(7, "q_j2", np.inf),
    "nan_in_time": set_cell(9, "t", np.nan),
    "time_backwards": reverse_times,
    "time_reversed": lambda t: t.iloc[::-1].reset_index(drop=True),
    "row_repeated": lambda t: pd.concat([t[:50], t[49:50], t[50:]], ignore_index=True),
    "time_jumps_too_often": jump_often,
    "time_in_ms": lambda t: t.assign(t=1000 * t["t"]),
    "time_in_ns": lambda t: t.assign(t=(1e9 * t["t"]).astype("int64")),
    "text": lambda t: t.assign(tau_j1=t["tau_j1"].map("{:.2f} Nm".format)),
    "flags": lambda t: t.assign(q_j1=t["q_j1"] > 0),
    "dates": lambda t: t.assign(t=pd.to_datetime(t["t"], unit="s")),
    "durations": lambda t: t.assign(t=pd.to_timedelta(t["t"], unit="s")),
    "epoch_in_32_bits": lambda t: t.assign(t=(t["t"] + 1.7e9).astype("float32")),
    "time_in_hundredths": lambda t: t.assign(t=np.round(0.7 * t["t"], 2)),
    "rows_twice": lambda t: t.loc[t.index.repeat(2)].reset_index(drop=True),
    "units_in_names": lambda t: t.rename(columns={"t": "t [s]", "q_j1": "q_j1 (rad)"}),
    "no_rows": lambda t: t[:0],
    "few_rows": lambda t: t[:20],
    "too_short": lambda t: t[:60],
    "dead_torque": lambda t: t.assign(tau_j2=3.5),
    "kelvin": lambda t: t.assign(temp_j1=300.0),
}


@pytest.mark.parametrize("case", TABLES)
def test_breach_in_a_run_is_named(folder, case, says):
    folder.tables["runs/a.parquet"] = TABLES[case](folder.train)
    says(case, refuse(folder, "runs/a.parquet"))


def test_breach_in_a_csv_is_named(folder):
    folder.document["runs"][0]["file"] = "runs/a.csv"
    folder.tables["runs/a.csv"] = folder.tables.pop("runs/a.parquet").drop(columns="q_j1")
    refuse(folder, "runs/a.csv: column 'q_j1' is missing")


NO_CSV = {
    "parquet": lambda t: t.to_parquet(),
    "gzip": lambda t: gzip.compress(t.to_csv(index=False).encode()),
    "spreadsheet": lambda t: b"PK\x03\x04rest",
    "utf16": lambda t: t.to_csv(index=False).encode("utf-16"),
    "title": lambda t: b"# of today\n" + t.to_csv(index=False).encode(),
}


@pytest.mark.parametrize("case", NO_CSV)
def test_what_is_no_csv_is_told_with_its_own_remedy(folder, case, says):
    folder.document["runs"][0]["file"] = "runs/a.csv"
    folder.write()
    (folder.path / "runs/a.csv").write_bytes(NO_CSV[case](folder.train))
    with pytest.raises(InputError) as caught:
        folder.read()
    says(case, str(caught.value).replace(str(folder.path), "FOLDER"))


def test_a_mark_of_utf_8_and_a_decimal_comma_are_read(folder):
    folder.document["runs"][0]["file"] = "runs/a.csv"
    folder.write()
    (folder.path / "runs/a.csv").write_text(
        folder.train.to_csv(index=False, sep=";", decimal=","), "utf-8-sig"
    )
    run = folder.read().runs[0].load()
    assert run.q == pytest.approx(folder.train[["q_j1", "q_j2"]].to_numpy(), rel=1e-12)


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


@pytest.mark.parametrize(
    ("file", "content", "told"),
    [
        ("runs/a.parquet", make_table(1).to_parquet()[:900],
         r"a\.parquet: cannot be read whole .*copy the file again, or make it again\.$"),
        ("dataset.yaml", b"name: [unclosed", r"dataset\.yaml: not readable as YAML .*line"),
        ("dataset.yaml", b"- just\n- a list\n", "holds no fields"),
        ("dataset.yaml", b"runs: []\nruns: []\n",
         r"dataset\.yaml: not readable as YAML \(line \d+, .*'runs' stands twice"),
        ("robot.urdf", make_urdf()[:200].encode(), r"robot\.urdf.*not well-formed XML"),
    ],
    ids=["truncated", "unclosed", "a list", "a field twice", "half a URDF"],
)  # fmt: skip
def test_broken_files_are_refused(folder, file, content, told):
    folder.write()
    (folder.path / file).write_bytes(content)
    with pytest.raises(InputError, match=told):
        folder.read()


def test_a_file_of_another_name_and_a_missing_folder_are_refused(folder):
    folder.write()
    (folder.path / "dataset.yaml").rename(folder.path / "dataset.yml")
    with pytest.raises(InputError, match=r"rename dataset\.yml to dataset\.yaml"):
        folder.read()
    shutil.rmtree(folder.path)
    with pytest.raises(InputError, match=re.escape(str(folder.path / "dataset.yaml"))):
        folder.read()


@pytest.mark.parametrize(
    ("kinds", "units", "told"),
    [
        (["prismatic"] * 2, {}, "units say q: rad, tau: N m, but joint 'j1' is prismatic; .*m and N"),
        (["prismatic", "revolute"], {"q": ["rad", "m"], "tau": ["N m", "N"]}, "joint 'j1' is prismatic"),
    ],
)
def test_prismatic_joints_need_their_units(folder, kinds, units, told):
    folder.urdf = make_urdf(kinds)
    folder.document |= {"units": units} if units else {}
    assert re.search(told, refuse(folder))


def test_mixed_joints_take_units_by_joint(folder):
    folder.urdf = make_urdf(("prismatic", "revolute"))
    folder.document["units"] = {"q": ["m", "rad"], "tau": ["N", "N m"]}
    assert folder.write().read().position_unit == ["m", "rad"]


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
