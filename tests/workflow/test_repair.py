"""What is missing or damaged is found before it is used, named, and made again by the same command."""

import json
import os
import re
import shlex
import shutil
from pathlib import Path

import clones
import pytest
import yaml
from calls import call_python
from changed_fields import changed_fields

from wearscope.archive.comparison import Content, compare_contents

pytestmark = pytest.mark.slow

RESULTS = Path("results/tiny")
RECORDING = RESULTS / "traces/medium/short_moves/identification/point=7/recording.parquet"


@pytest.fixture
def study(finished, tmp_path):
    """A copy of the finished study, with its results and without an archive that another test made."""
    shutil.copytree(finished, tmp_path / "study", symlinks=True)
    shutil.rmtree(tmp_path / "study" / "results" / "archive", ignore_errors=True)
    return tmp_path / "study"


def flip(path, offset=None):
    """Flip a bit, the time stamp kept."""
    stat, content = path.stat(), bytearray(path.read_bytes())
    content[len(content) // 2 if offset is None else offset] ^= 4
    path.write_bytes(content)
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def fail_naming(study, path, *arguments):
    told = clones.run_ill(study, *arguments)
    said = next(line for line in told.splitlines() if "it was set aside" in line)
    assert str(path) in said and "run the same command again" in said
    return said


def module(study, *arguments):
    return call_python("-m", *arguments, folder=study, env={**os.environ, "PYTHONPATH": str(study / "src")})


def test_recording_that_is_gone_or_damaged_is_made_again(finished, study):
    """Nothing is stuck, whether or not the simulations are taken for done."""
    flipped = study / RECORDING.parent.parent / "point=3" / "recording.parquet"
    for damage in ("gone", "flipped"):
        path = study / RECORDING if damage == "gone" else flipped
        path.unlink() if damage == "gone" else flip(path)
        for used in study.glob("results/tiny/**/test_quantities*/**/*.parquet"):
            used.unlink()
        (study / RESULTS / "test_quantities.parquet").unlink()
        assert "Nothing to be done" in clones.run_well(study, "simulate")
        fail_naming(study, path.relative_to(study), "test_quantities")
        text = clones.run_well(study, "test_quantities")
        assert "Simulate medium, short_moves, identification" in text
        assert path.read_bytes() == (finished / path.relative_to(study)).read_bytes()
    clones.run_well(study)
    assert clones.digests(study) == clones.digests(finished)
    assert not [path for path in (study / RESULTS).rglob("*") if path.name.endswith((".damaged", ".part"))]


@pytest.mark.parametrize(
    ("damaged", "consumer"),
    [
        ("surrogates.parquet", "snr.parquet"),
        (
            "traces/medium/short_moves/validation/_chunk-1.json",
            "parts/test_quantities/medium/short_moves.parquet",
        ),
    ],
)
def test_flipped_bit_of_an_intermediate_is_found_before_it_is_used(finished, study, damaged, consumer):
    flip(study / RESULTS / damaged)
    (study / RESULTS / consumer).unlink()
    target = str(RESULTS / consumer)
    said = fail_naming(study, RESULTS / damaged, target)
    assert "is not what was written (its checksum differs)" in said
    clones.run_well(study, target)
    for name in (damaged, consumer):
        assert (study / RESULTS / name).read_bytes() == (finished / RESULTS / name).read_bytes()


def test_finished_study_is_checked_and_repaired_by_stated_commands(finished, study):
    done = module(study, "wearscope.integrity", str(RESULTS))
    assert done.returncode == 0 and "every checksum holds" in done.stdout, done.stderr
    flip(study / RESULTS / "snr.parquet")
    flip(study / RESULTS / "figures/snr.svg")
    (study / RECORDING).unlink()
    left = study / RESULTS / "figures" / ".snr.svg.4m4pxayd.part"
    left.write_text("of a killed job")
    done = clones.run(study, "archive")
    assert done.returncode == 1 and "it was set aside" in done.stderr
    shutil.copy2(finished / RESULTS / "snr.parquet", study / RESULTS / "snr.parquet")
    flip(study / RESULTS / "snr.parquet")
    done = module(study, "wearscope.integrity", str(RESULTS), "--set-aside")
    assert done.returncode == 1 and not left.exists()
    for name in (RESULTS / "snr.parquet", RESULTS / "figures/snr.svg", RECORDING):
        assert str(name) in done.stderr, done.stderr
    stated = shlex.split(re.search(r"make it again: snakemake (.*)", done.stderr)[1])
    assert str(RESULTS / "snr.parquet") in stated and str(RECORDING) not in stated
    assert call_python("-m", "snakemake", *stated, folder=study).returncode == 0
    clones.run_well(study)
    assert clones.digests(study) == clones.digests(finished)
    assert module(study, "wearscope.integrity", str(RESULTS)).returncode == 0


def test_restored_archive_runs_a_single_stage_to_the_same_bytes(finished, study, tmp_path):
    clones.run_well(study, "archive")
    archive = study / "results" / "archive" / "tiny.tar"
    clone = tmp_path / "clone"
    shutil.copytree(finished, clone, ignore=shutil.ignore_patterns("results", ".snakemake"))
    done = module(clone, "wearscope.archive", "restore", str(archive), "--allow-code")
    assert done.returncode == 0 and "not as they were" not in done.stdout, done.stdout + done.stderr
    config = str(RESULTS / "config.yaml")
    assert clones.stale(clone, study=config) == set()
    wanted = (clone / RESULTS / "snr.parquet").read_bytes()
    (clone / RESULTS / "snr.parquet").write_bytes(b"")
    assert clones.stale(clone, "snr", "-R", "compute_snr", study=config) == {"compute_snr", "snr"}
    clones.run_well(clone, "snr", "-R", "compute_snr", study=config)
    assert (clone / RESULTS / "snr.parquet").read_bytes() == wanted
    assert yaml.safe_load((clone / config).read_text())["study"] == "tiny"
    assert module(clone, "wearscope.integrity", str(RESULTS)).returncode == 0
    rows = compare_contents(Content(archive), Content(clone / RESULTS))
    assert "conclusion" not in set(rows["what"])
    inputs = json.loads((clone / RESULTS / "MANIFEST.json").read_text())["inputs"]
    assert {"config/robots/medium/robot.urdf", "tests/workflow/tiny/torque_change.py"} <= inputs.keys()


def test_hanging_detector_is_a_failed_point_of_the_study(study):
    own = study / clones.TINY / "torque_change.py"
    text = own.read_text()
    hang = "        while not hasattr(self, 'never'):\n            pass\n"
    place = "    def test_quantity(self, batch):\n"
    own.write_text(text.replace(place, place + hang))
    clones.write_study(study, "limited", study="tiny", time_limit=40)
    # It hangs at each question: soon more points are lost than the study allows.
    told = clones.run_ill(study, "test_quantities", study="limited.yaml")
    assert "fda 'own', robot medium, cycle short_moves, axis 1: took longer than 40 s" in told


def test_robot_s_code_does_not_run_unless_it_is_allowed(study):
    shutil.copytree(study / "config/robots/medium", study / "theirs")
    (study / "theirs" / "bait.py").write_text("open('ran', 'w')\nraise SystemExit\n")
    with changed_fields(study / "theirs" / "model.yaml") as model:
        model["effects"][0]["effect"] = "bait.py"
    clones.write_study(study, "bad", robots=["theirs"])

    told = "the effect 'bait.py' is code that would run; read it, and allow it"
    for allowed in ("false", "[other.py]"):
        assert told in clones.run_ill(study, "check", "--config", f"allow_code={allowed}", study="bad.yaml")
        assert not (study / "ran").exists()
    assert clones.run(study, "check", "--config", "allow_code=[bait.py]", study="bad.yaml").returncode == 1
    assert (study / "ran").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [", "is not readable YAML"),
        ("urdf: robot.urdf\neffects: [{joint: axis_1}]", r"effects[0].effect: is missing or no text"),
        ("urdf: robot.urdf\neffects: 3", "effects: is no list"),
        ("urdf: nowhere.urdf", "'theirs/nowhere.urdf' is no file"),
        ("- 1", "holds no mapping"),
    ],
)
def test_malformed_robot_ends_in_one_sentence_before_anything_is_planned(clone, text, words):
    (clone / "theirs").mkdir(exist_ok=True)
    (clone / "theirs" / "model.yaml").write_text(text)
    assert words in clones.run_ill(clone, "-n", study=clones.write_study(clone, "bad", robots=["theirs"]))
