"""Copies of the tree in which the tests run the smallest study."""

import re
import shutil
import sys
import tarfile
from pathlib import Path

import yaml
from calls import call

ROOT = Path(__file__).parents[1]
TINY = "tests/workflow/tiny"


def copy_tree(target: Path, compiled: bool = True) -> Path:
    """Copy what a clone of the working tree would hold, and what was compiled, which would cost a minute."""
    listed = call("git", "ls-files", "--cached", "--others", "--exclude-standard", folder=ROOT)
    caches = ROOT.glob("src/**/__pycache__/*") if compiled else ()
    for name in [*listed.stdout.splitlines(), *(path.relative_to(ROOT).as_posix() for path in caches)]:
        if (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)
    return target


def write_study(folder: Path, name: str, **settings) -> str:
    """The smallest study with other settings, as a file of a copy; returns the file's name."""
    study = yaml.safe_load((folder / TINY / "config.yaml").read_text())
    (folder / f"{name}.yaml").write_text(yaml.safe_dump({**study, "study": name, **settings}))
    return f"{name}.yaml"


def command(*arguments: str, cores: int = 1, study: str = f"{TINY}/config.yaml") -> list[str]:
    return [sys.executable, "-m", "snakemake", *arguments, "--cores", str(cores), "--configfile", study]


def run(folder: Path, *arguments: str, cores: int = 1, study: str = f"{TINY}/config.yaml"):
    return call(*command(*arguments, cores=cores, study=study), folder=folder)


def run_well(folder: Path, *arguments: str, **options) -> str:
    done = run(folder, *arguments, **options)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-5000:]
    return done.stdout + done.stderr


def run_ill(folder: Path, *arguments: str, **options) -> str:
    """What a run says that is refused."""
    done = run(folder, *arguments, **options)
    assert done.returncode == 1 and "Traceback" not in done.stderr, done.stderr[-3000:]
    return done.stderr


def count_jobs(folder: Path, study: str, *arguments: str) -> dict[str, int]:
    """Jobs to do by rule, and their ``total``, by a dry run."""
    text = run_well(folder, "-n", *arguments, study=study)
    return {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", text, re.MULTILINE)}


def stale(folder: Path, *arguments: str, study: str = f"{TINY}/config.yaml") -> set[str]:
    """Rules with jobs to do, by a dry run."""
    return count_jobs(folder, study, *arguments).keys() - {"total"}


def read_tables(results: Path) -> dict[str, bytes]:
    return {path.relative_to(results).as_posix(): path.read_bytes() for path in results.rglob("*.parquet")}


def digests(folder: Path) -> dict[str, bytes]:
    return read_tables(folder / "results" / "tiny")


def read_carried(results: Path) -> dict[str, bytes]:
    """As `digests`, of results that a storage holds: recordings are in one file a chunk, and are unpacked."""
    for pack in results.rglob("_chunk-*.tar"):
        with tarfile.open(pack) as tar:
            tar.extractall(pack.parent, filter="data")
    return read_tables(results)
