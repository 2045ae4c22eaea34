"""Small inputs that would grow, and words that would steer: each ends at once in one sentence."""

import errno
import fcntl
import io
import json
import os
import re
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from changed_fields import changed_fields
from click.testing import CliRunner

from wearscope import example_dataset, integrity, limits
from wearscope.checking import dataset
from wearscope.checking.dataset import check_dataset
from wearscope.checking.robot import check_model
from wearscope.checking.study import list_excesses
from wearscope.cli import stages, workflow
from wearscope.cli.main import wearscope
from wearscope.cli.tables import read_frame
from wearscope.cli.workflow import call_snakemake, wait_turn
from wearscope.closed_loop.intake.dataset_fields import list_breaches, load_fields
from wearscope.closed_loop.intake.table_files import read_columns
from wearscope.config import load_config
from wearscope.errors import Findings, InputError
from wearscope.processes import bound_memory
from wearscope.reporting.style import figure_bytes, new_figure
from wearscope.starters.recordings import read_recording
from wearscope.starters.writing import flow
from wearscope.storage.files import (
    SETTINGS,
    DamagedFile,
    check_file,
    find_output,
    load_json,
    record_checksums,
)
from wearscope.storage.plain_yaml import load_plain_yaml

ROOT = Path(__file__).parents[2]
QUICK = yaml.safe_load((ROOT / "config" / "quick.yaml").read_text())
COPIES = ", ".join(["*a{0}"] * 10)
GROWING = {
    "aliases": ["a0: &a0 [x, x]", *(f"a{k}: &a{k} [{COPIES.format(k - 1)}]" for k in range(1, 9))],
    "merges": ["a0: &a0 {x: 1}", *(f"a{k}: &a{k} {{<<: [{COPIES.format(k - 1)}]}}" for k in range(1, 9))],
    "depth": ["[" * 5000],
    "digits": ["a: 0x" + "f" * 5000],
    "timestamp": ['!!timestamp "x"'],
    "truth": ['a: !!bool "maybe"'],
    "itself": ["a: &a [*a]"],
}  # fmt: skip


@pytest.mark.parametrize("kind", GROWING)
def test_yaml_that_grows_is_refused(kind):
    with pytest.raises(yaml.YAMLError):
        load_plain_yaml("\n".join(GROWING[kind]))


def spoil(tmp_path, change):
    shutil.copytree(example_dataset(), tmp_path / "arm")
    file = tmp_path / "arm" / "dataset.yaml"
    with changed_fields(file) as fields:
        change(fields)
    return list_breaches(file)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda f: f.update(runs=f["runs"] * 600), "at most 2000 items"),
        (lambda f: f["robot"].update(joints=[f"j{k}" for k in range(41)]), "at most 40 items"),
        (lambda f: f["runs"][0].update(payload={"mass": 1e300}), "less than or equal to"),
        (lambda f: f["runs"][0].update(payload={"mass": 1.0, "com": [1e20, 0, 0]}), "less than or equal to"),
        (lambda f: f.update(declared_effects=["viscous"] * 3000), "at most 2000 items"),
    ],
)
def test_lists_and_numbers_of_a_data_set_are_bounded(tmp_path, change, told):
    assert told in spoil(tmp_path, change)[0]


@pytest.mark.parametrize("name", limits.DRIVE)
def test_numbers_that_no_joint_has_are_told(tmp_path, name):
    joints = len(load_fields(example_dataset() / "dataset.yaml")["robot"]["joints"])
    assert not spoil(tmp_path, lambda f: f["robot"].update({name: [2.0 * limits.DRIVE[name]] * joints}))
    found = check_dataset(tmp_path / "arm").problems
    assert len(found) == 1 and f"robot.{name} holds a value above" in found[0]


def test_what_a_file_takes_while_it_is_read_is_bounded(monkeypatch):
    """What it says of its own size need not be so."""
    monkeypatch.setattr(limits, "READING_BYTES", 100_000_000)
    before = resource.getrlimit(resource.RLIMIT_DATA)
    with (
        pytest.raises(InputError, match=r"a\.mcap: takes more than 0\.1 GB of memory"),
        bound_memory("a.mcap"),
    ):
        bytearray(300_000_000)
    assert resource.getrlimit(resource.RLIMIT_DATA) == before


def test_a_table_with_a_large_description_is_refused(tmp_path, monkeypatch, refuses):
    pq.write_table(pa.table({"t": [1.0]}).replace_schema_metadata({"x": "y" * 5000}), tmp_path / "a.parquet")
    assert len(read_columns(tmp_path / "a.parquet")) == 1
    monkeypatch.setattr(limits, "FOOTER_BYTES", 3000)
    refuses(read_columns, tmp_path / "a.parquet")


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_recording_of_short_rows_is_bounded_by_its_memory(tmp_path, monkeypatch, kind, refuses):
    """A row of four bytes on disk takes sixteen in memory."""
    table, file = pd.DataFrame({"t": [1] * 1000, "u": [2] * 1000}), tmp_path / f"a.{kind}"
    table.to_csv(file, index=False) if kind == "csv" else table.to_parquet(file)
    monkeypatch.setattr(limits, "UNPACKED_BYTES", 16_000)
    assert len(read_columns(file)) == 1000
    monkeypatch.setattr(limits, "UNPACKED_BYTES", 15_999)
    refuses(read_columns, file)


def test_a_text_of_a_table_that_unpacks_to_much_is_refused(tmp_path, monkeypatch, refuses):
    """A dictionary holds it once on disk, so that no size in the file tells."""
    monkeypatch.setattr(limits, "READING_BYTES", 200_000_000)
    words = pa.DictionaryArray.from_arrays(np.zeros(1000, np.int32), ["x" * 1_000_000])
    pq.write_table(pa.table({"a": words, "b": np.zeros(1000)}), tmp_path / "a.parquet", store_schema=False)
    refuses(read_frame, tmp_path / "a.parquet")


@pytest.mark.parametrize("name", ["a.mcap", "a.bag", "a.db3"])
@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero"), Path.mkdir])
def test_a_bag_that_is_no_plain_file_is_not_opened(tmp_path, make, name):
    make(tmp_path / name)
    with pytest.raises(InputError, match=r"is no plain file|cannot be read as a ROS 2 bag"):
        read_recording(tmp_path / name)


@pytest.mark.parametrize(
    ("described", "told"),
    [
        ("\n".join(GROWING["aliases"]), "values with its aliases"),
        ("rosbag2_bagfile_information: {compression_mode: FILE}", "its files are compressed whole"),
        ("- 1", "cannot be read as a ROS 2 bag"),
    ],
)
def test_a_bag_that_would_grow_is_refused(tmp_path, described, told):
    (tmp_path / "metadata.yaml").write_text(described)
    with pytest.raises(InputError, match=told):
        read_recording(tmp_path)


def test_a_half_of_a_character_is_refused_before_anything_writes_it():
    assert load_json('"\\ud83d\\ude00"') == "\U0001f600"
    with pytest.raises(ValueError, match="surrogates not allowed"):
        load_json('{"a": ["\\uD800"]}')


def test_a_text_of_many_columns_is_refused(tmp_path, refuses):
    row = ",".join(["1"] * 3000)
    (tmp_path / "a.csv").write_text("\n".join([",".join(f"c{k}" for k in range(3000)), row, row, row]))
    refuses(read_recording, tmp_path / "a.csv")


def test_tables_are_bounded_before_they_are_read(tmp_path, refuses):
    wide, long = tmp_path / "wide.csv", tmp_path / "long.parquet"
    wide.write_text(",".join(f"c{k}" for k in range(3000)) + "\n")
    refuses(read_columns, wide)
    with pq.ParquetWriter(long, pa.schema([("t", pa.float64())])) as writer:
        for _ in range(11):
            writer.write_table(pa.table({"t": pa.array(np.zeros(10_000_000))}))
    assert long.stat().st_size < 1_000_000
    refuses(read_columns, long)


COLD = {"description": "d", "kind": "temperature", "range": [-300, 0], "unit": "degC"}


def test_lists_and_numbers_of_a_configuration_are_bounded(refuses):
    for change in (
        {"snr": {"runs": 10**15}},
        {"axes": list(range(1, 99999))},
        {"robots": [f"r{k}" for k in range(20000)]},
        {"robots": ["a{b}"]},
        {"time_limit": 1e300},
        {"seed": 16**5000},
        {"factors": {"w": COLD}},
    ):
        refuses(load_config, {**QUICK, **change})


@pytest.mark.parametrize(
    ("axes", "lines", "told"), [(10_001, 2, "axes: has 10001 entries"), (9999, 202, "and 9699 more;")]
)
def test_a_check_lists_no_more_than_can_be_read(tmp_path, axes, lines, told):
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(QUICK | {"axes": list(range(1, axes + 1))}))
    output = call("check", tmp_path / "study.yaml").output
    assert told in output and len(output.splitlines()) == lines


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"simulation": {"step": 1e-12}}, "simulation: takes about .* years"),
        ({"scope": {"grid": [1_000_000, 1_000_000]}}, "scope.grid: takes about .* TB"),
        ({"scope": {"grid": [1_000_000, 1_000_000]}}, "scope.grid and scope.runs: takes about .* years"),
    ],
)
def test_what_would_take_a_year_or_a_terabyte_is_told(change, told):
    assert not list(list_excesses(load_config(QUICK)))
    assert any(re.search(told, one) for one in list_excesses(load_config({**QUICK, **change})))


def test_no_gravity_is_told(tmp_path, monkeypatch):
    # What the torques say of it is asked elsewhere, and takes long.
    monkeypatch.setattr(dataset, "check_plausibility", lambda prepared: None)
    shutil.copytree(example_dataset(), tmp_path / "arm")
    with changed_fields(tmp_path / "arm" / "dataset.yaml") as fields:
        fields["robot"]["gravity"] = [0, 0, 0]
    assert any("robot.gravity is 0; where" in one for one in check_dataset(tmp_path / "arm").notes)
    shutil.copytree(ROOT / "config" / "robots" / "medium", tmp_path / "robot")
    with changed_fields(tmp_path / "robot" / "model.yaml") as fields:
        fields["gravity"] = [0, 0, 0]
    found = Findings("robot")
    check_model(str(tmp_path / "robot"), found)
    assert any("gravity is 0; where" in one for one in found.notes)


@pytest.mark.parametrize(
    ("section", "change", "told"),
    [
        ("drive", {"gear_ratio": 1e7}, "gear_ratio holds a value above 1e+06"),
        ("drive", {"rotor_inertia": 1e7}, "rotor_inertia holds a value above 1e+06"),
        ("drive", {"torque_limit": 1e10}, "torque_limit holds a value above 1e+09"),
        ("sensors", {"torque_noise": 1e5}, "torque_noise is above drive.torque_limit"),
    ],
)
def test_what_no_joint_has_is_told(tmp_path, section, change, told):
    shutil.copytree(ROOT / "config" / "robots" / "medium", tmp_path / "robot")
    with changed_fields(tmp_path / "robot" / "model.yaml") as fields:
        fields[section].update({name: [value] * len(fields["joints"]) for name, value in change.items()})
    found = Findings("robot")
    check_model(str(tmp_path / "robot"), found)
    assert any(told in one for one in found.problems)


def test_a_joint_that_is_named_twice_is_told_once(tmp_path):
    assert not spoil(tmp_path, lambda f: f["robot"].update(joints=f["robot"]["joints"][:1] * 2))
    found = check_dataset(tmp_path / "arm").problems
    assert sum("robot.joints names a joint twice" in one for one in found) == 1


def test_a_constant_recording_is_told(tmp_path):
    shutil.copytree(example_dataset(), tmp_path / "arm")
    file = tmp_path / "arm" / "runs" / "sweeps.parquet"
    table = pq.read_table(file).to_pandas()
    table.loc[:, [name for name in table if name != "t"]] = 0.0
    table.to_parquet(file)
    found = check_dataset(tmp_path / "arm")
    assert any("sweeps.parquet: is constant, no joint moves in it" in one for one in found.problems)


def test_of_two_commands_in_a_folder_one_waits(tmp_path):
    said = []
    with wait_turn(tmp_path, said.append):
        code = (
            "import sys; from pathlib import Path; from wearscope.cli.workflow import wait_turn\n"
            "with wait_turn(Path(sys.argv[1]), lambda told: print(told, flush=True)): print('in')"
        )
        other = subprocess.Popen(
            [sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True
        )
        assert "this one waits" in other.stdout.readline() and other.poll() is None
    assert other.communicate()[0] == "in\n" and not said


@pytest.mark.parametrize("command", [("run", "quick"), ("report", "quick"), ("diagnose", "arm")])
def test_every_command_that_computes_takes_its_turn(tmp_path, monkeypatch, command):
    """So that a stage and a report at once do not miss files of each other."""
    shutil.copytree(example_dataset(), tmp_path / "arm")
    monkeypatch.chdir(tmp_path)
    held = []

    def compute(*given):
        with (tmp_path / "results" / ".wearscope.lock").open() as file, pytest.raises(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        held.append(True)
        return 1, stages.Progress()

    monkeypatch.setattr(stages, "call_snakemake", compute)
    call(*command)
    assert held


@pytest.mark.parametrize("make", [lambda path: path.symlink_to("../kept"), os.mkfifo])
@pytest.mark.parametrize("name", [".wearscope.lock", "wearscope-report.log"])
def test_links_and_pipes_among_results_are_not_written_to(tmp_path, name, make):
    (tmp_path / "kept").write_text("kept")
    path = tmp_path / "results" / name
    path.parent.mkdir()
    make(path)
    if path.suffix == ".log":
        call_snakemake(["true"], tmp_path, path, lambda *given: None)
        assert path.is_file() and not path.is_symlink()
    elif path.is_symlink():
        with pytest.raises(InputError, match="is no plain file"), wait_turn(tmp_path, print):
            pass
    else:
        with wait_turn(tmp_path, print):
            pass
    assert (tmp_path / "kept").read_text() == "kept"


def test_a_file_where_results_go_is_told(tmp_path, monkeypatch):
    (tmp_path / "results").touch()
    monkeypatch.chdir(tmp_path)
    assert "results: is a file, no folder; move it away" in str(call("run", "quick").exception)


def test_joints_that_yaml_reads_as_something_else_are_quoted():
    names = ["yes", "1", "null", "*a", "a: b", "x #y", "~", "é"]
    assert yaml.safe_load(flow(names)) == names


def test_a_dollar_in_a_description_begins_no_formula():
    figure = new_figure(2, 1)
    figure.text(0.1, 0.5, r"heat $\frac{ $")
    assert figure_bytes(figure).startswith(b"<?xml")


def test_a_full_disk_of_a_log_is_named(tmp_path, monkeypatch):
    """The write of an open file tells no name."""
    log = tmp_path / "a.log"

    class Full(io.StringIO):
        def flush(self):
            raise OSError(errno.ENOSPC, "No space left on device")

        close = flush

        def __del__(self):
            """Python 3.13 tells what closing an object that is no more raises."""

    monkeypatch.setattr(workflow, "open_new", lambda path: Full())
    monkeypatch.setattr(os.path, "ismount", lambda place: Path(place) == tmp_path)
    with pytest.raises(InputError, match=f"a.log: the disk at {tmp_path} is full"):
        call_snakemake(["true"], tmp_path, log, lambda *given: None)


@pytest.mark.parametrize("command", ["example made", "study made", "robot arm.urdf --name made"])
def test_a_copy_on_a_full_disk_names_the_disk_that_is_full(command, tmp_path, monkeypatch):
    """And not that of the file that was copied; nothing is left."""
    shutil.copy(ROOT / "config" / "robots" / "medium" / "robot.urdf", tmp_path / "arm.urdf")
    copied = shutil.copyfile

    def fill(source, target, **how):
        copied(source, target, **how)
        raise OSError(errno.ENOSPC, "No space left on device", str(source), None, str(target))

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(shutil, "copyfile", fill)
    monkeypatch.setattr(os.path, "ismount", lambda place: Path(place) == tmp_path)
    told = str(call("new", *command.split()).exception)
    assert f"the disk at {tmp_path} is full" in told and "example_data" not in told
    assert [one.name for one in tmp_path.iterdir()] == ["arm.urdf"]


def call(*arguments):
    return CliRunner().invoke(wearscope, [str(one) for one in arguments])


def test_what_is_shown_steers_no_terminal(tmp_path):
    steer = "\x1b]0;own\x07\x1b[2J\x9b31m"
    (tmp_path / "a.csv").write_text(f"x{steer}\n{steer}\n")
    (tmp_path / "a.json").write_text(json.dumps({f"k{steer}": steer}))
    pq.write_table(pa.table({f"x{steer}": [steer]}), tmp_path / "a.parquet")
    for name in ("a.csv", "a.json", "a.parquet"):
        outcome = call("show", tmp_path / name)
        assert outcome.exit_code == 0 and outcome.output.replace("\n", "").isprintable(), name
        assert "own" in outcome.output


@pytest.mark.parametrize("name", ["/none", "a**b", "**", "[ab]", "?", "x" * 5000, "", "../a"])
def test_a_name_that_is_shown_is_no_pattern(tmp_path, name):
    """So that what was named is shown, or nothing."""
    (tmp_path / "results").mkdir()
    pq.write_table(pa.table({"x": [1]}), tmp_path / "results" / "a.parquet")
    told = str(call("show", name, "--in", tmp_path / "results").exception)
    assert "there is no table" in told and len(told) < 1000


def test_what_cannot_be_shown_ends_in_one_sentence(tmp_path):
    (tmp_path / "large.json").touch()
    os.truncate(tmp_path / "large.json", limits.JSON_BYTES + 1)
    assert "is larger than 30 MB" in str(call("show", tmp_path / "large.json").exception)
    (tmp_path / "deep.json").write_text("[" * 900 + "]" * 900)
    (tmp_path / "text.json").write_text('"x"')
    (tmp_path / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"x" * 100)
    (tmp_path / "text.parquet").write_text("no table")
    (tmp_path / "text.csv").write_bytes(b"\xff\xfe\x00")
    for file in sorted(tmp_path.iterdir()):
        outcome = call("show", file)
        assert outcome.exit_code == 0 or isinstance(outcome.exception, InputError), (file, outcome.exception)


def test_values_of_a_table_are_cut_and_those_without_order_are_told(tmp_path):
    path = tmp_path / "a.parquet"
    pq.write_table(
        pa.table({"long": ["x" * 100_000] * 2, "list": [[1, 2], [3, 4]], "map": [{"a": 1}] * 2}), path
    )
    assert len(call("show", path).output) < 10_000
    for option in ("--sort=list", "--sort=map"):
        assert "the column has no order" in str(call("show", path, option).exception)


SNAKEFILE = """
rule all:
    input: "results/s/b.txt"

rule a:
    output: "results/s/a 1.txt"
    shell: "echo {config[word]} > '{output}'"

rule b:
    input: "results/s/a 1.txt"
    output: "results/s/b.txt"
    shell: "cp '{input}' {output}"
"""


def test_the_repair_works_as_it_is_printed(tmp_path, monkeypatch, capsys):
    """Also with files after a study's settings, of which Snakemake would take them for more settings."""
    made = tmp_path / "results" / "s" / "a 1.txt"
    made.parent.mkdir(parents=True)
    (tmp_path / "Snakefile").write_text(SNAKEFILE)
    (made.parent / SETTINGS).write_text(json.dumps({"word": "kept"}))
    made.write_text("kept\n")
    shutil.copy(made, made.with_name("b.txt"))
    record_checksums(made.parent, [made])
    made.write_text("kepd\n")
    monkeypatch.chdir(tmp_path)
    assert integrity.main(["results/s", "--set-aside"]) == 1
    command = capsys.readouterr().err.rpartition("make it again: ")[2]
    assert not made.exists()
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(command, shell=True, check=True, capture_output=True, env={**os.environ, "PATH": path})
    assert made.read_text() == "kept\n" and integrity.main(["results/s"]) == 0


def test_a_kept_checksum_without_end_is_not_read(tmp_path):
    made = tmp_path / "a.json"
    made.write_text("{}")
    record_checksums(tmp_path, [made])
    kept = tmp_path / ".checksums" / "a.json.sha256"
    kept.unlink()
    kept.symlink_to("/dev/zero")
    with pytest.raises(DamagedFile, match="is not what was written"):
        check_file(tmp_path, made)
    assert find_output(made) == made


def test_a_file_that_is_no_output_is_made_again_with_its_output(tmp_path):
    table, verdict = tmp_path / "x" / "in_time.parquet", tmp_path / "x" / "verdict.json"
    table.parent.mkdir()
    table.write_text("a"), verdict.write_text("b")
    record_checksums(tmp_path, [table], verdict)
    check_file(tmp_path, table)
    assert find_output(table) == verdict and find_output(verdict) == verdict
    table.write_text("c")
    with pytest.raises(DamagedFile):
        check_file(tmp_path, table)
