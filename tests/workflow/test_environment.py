import os
import re
import subprocess
import tomllib
from itertools import chain
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
ENVS = ROOT / "envs"
#: Locked by themselves, beside what every study needs.
BESIDE = ("cluster", "mutants")


def read_lock(name: str) -> dict[str, tuple[str, int]]:
    """Version and number of hashes by package."""
    packages: dict[str, tuple[str, int]] = {}
    last = ""
    for line in (ENVS / name).read_text().splitlines():
        if match := re.match(r"([a-z0-9-]+)==(\S+)", line):
            last = match[1]
            packages[last] = (match[2], 0)
        elif "--hash=sha256:" in line:
            packages[last] = (packages[last][0], packages[last][1] + 1)
        else:
            assert not line.strip() or line.startswith("#"), f"{name}: {line}"
    return packages


def top_level() -> list[str]:
    text = re.sub(r"#.*", "", (ENVS / "requirements.in").read_text())
    return re.findall(r"^[a-z0-9-]+", text, re.MULTILINE)


def test_lock_pins_everything_by_version_and_hash():
    packages = read_lock("requirements.lock")
    assert set(top_level()) <= packages.keys()
    assert all(hashes > 0 for _, hashes in packages.values())


def test_lock_names_no_index():
    for file in ENVS.iterdir():
        assert not re.search(r"https?:|--index|--find-links", file.read_text()), file.name


def test_build_lock_is_part_of_the_lock():
    packages = read_lock("requirements.lock")
    build = read_lock("build.lock")
    assert build.keys() == {"setuptools"}
    assert build["setuptools"] == packages["setuptools"]


@pytest.mark.parametrize("name", BESIDE)
def test_lock_beside_it_adds_to_the_lock_and_changes_nothing(name):
    packages, beside = read_lock("requirements.lock"), read_lock(f"{name}.lock")
    text = re.sub(r"#.*", "", (ENVS / f"{name}.in").read_text())
    assert set(re.findall(r"^[a-z0-9-]+", text, re.MULTILINE)) <= beside.keys() - packages.keys()
    assert all(hashes > 0 for _, hashes in beside.values())
    assert all(beside[one][0] == packages[one][0] for one in beside.keys() & packages.keys())


def test_conda_environment_is_the_lock():
    packages = read_lock("requirements.lock")
    environment = yaml.safe_load((ENVS / "wearscope.yaml").read_text())
    python, pip, through_pip = environment["dependencies"]
    assert (python, pip) == ("python=3.11", "pip")
    assert through_pip["pip"] == [f"{name}=={packages[name][0]}" for name in top_level()]


def test_wrong_python_gets_one_sentence(tmp_path):
    python = tmp_path / "python3.11"
    python.write_text("#!/bin/sh\nexit 1\n")
    python.chmod(0o755)
    venv = tmp_path / "venv"
    run = subprocess.run(
        ["make", "-s", f"PYTHON={python}", f"VENV={venv}", "setup"],
        cwd=ROOT,
        env={key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode != 0
    first = run.stderr.splitlines()[0]
    assert "needs Python 3.11, because" in first and "pybullet" in first and "make PYTHON=" in first
    assert not venv.exists()


def test_ci_runs_make_test():
    script = ROOT / ".ci" / "run"
    assert script.stat().st_mode & 0o111
    assert "make --no-print-directory test" in script.read_text()
    script = ROOT / ".ci" / "run-long"
    assert script.stat().st_mode & 0o111
    assert "make --no-print-directory test-kills" in script.read_text()
    assert "make --no-print-directory test-how-to" in script.read_text()
    assert "make --no-print-directory mutants" in script.read_text()


def test_package_declares_what_the_lock_is_made_from():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    for name in BESIDE:
        listed = re.sub(r"#.*", "", (ENVS / f"{name}.in").read_text())
        assert sorted(extras.pop(name)) == sorted(listed.split())
    declared = [*project["dependencies"], *chain(*extras.values())]
    text = re.sub(r"#.*", "", (ENVS / "requirements.in").read_text())
    assert sorted(declared) == sorted(text.split())
