import os
import re
import subprocess
import sys
import tomllib
from itertools import chain
from pathlib import Path

import pytest
import yaml
from calls import call, call_python

ROOT = Path(__file__).parents[2]
ENVS = ROOT / "envs"
#: Locked by themselves, in addition to what every study needs.
BESIDE = ("cluster", "mutants")


def read_lock(name: str) -> dict[str, tuple[str, int]]:
    """Version and number of hashes by package."""
    packages: dict[str, tuple[str, int]] = {}
    last = ""
    for line in (ENVS / name).read_text().splitlines():
        if match := re.match(r"([a-z0-9-]+)==(\S+)( ; |)", line):
            last = match[1]
            packages[last] = (match[2], 0)
        elif "--hash=sha256:" in line:
            packages[last] = (packages[last][0], packages[last][1] + 1)
        else:
            assert not line.strip() or line.startswith("#"), f"{name}: {line}"
    return packages


def name_packages(requirements: list[str]) -> list[str]:
    return [re.match(r"[A-Za-z0-9-]+", one)[0].lower() for one in requirements]


def read_project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_base_lock_holds_what_a_study_needs_and_no_extra():
    project = read_project()["project"]
    packages = read_lock("requirements.lock")
    assert set(name_packages(project["dependencies"])) <= packages.keys()
    assert all(hashes > 0 for _, hashes in packages.values())
    extras = project["optional-dependencies"]
    assert not set(name_packages([*chain(*extras.values())])) & packages.keys()


def test_development_lock_adds_the_extras_and_changes_nothing():
    base, packages = read_lock("requirements.lock"), read_lock("development.lock")
    assert base.items() <= packages.items()
    assert all(hashes > 0 for _, hashes in packages.values())
    extras = read_project()["project"]["optional-dependencies"]
    named = chain(*(listed for name, listed in extras.items() if name not in BESIDE))
    assert set(name_packages([*named])) <= packages.keys() - base.keys()


def test_each_python_gets_one_bullet():
    text = (ENVS / "requirements.lock").read_text()
    markers = dict(re.findall(r"^(pybullet[a-z0-9-]*)==\S+ ; (.*?) \\$", text, re.MULTILINE))
    assert markers == {
        "pybullet": "python_full_version < '3.12'",
        "pybullet-arm64": "python_full_version >= '3.12'",
    }


def test_lock_names_no_index():
    for file in ENVS.iterdir():
        assert not re.search(r"https?:|--index|--find-links", file.read_text()), file.name


def test_build_lock_is_part_of_the_lock():
    build = read_lock("build.lock")
    assert {"setuptools", "hatchling"} <= build.keys()
    assert build.items() <= read_lock("development.lock").items()


@pytest.mark.parametrize("name", BESIDE)
def test_lock_beside_it_adds_to_the_lock_and_changes_nothing(name):
    packages, beside = read_lock("development.lock"), read_lock(f"{name}.lock")
    text = re.sub(r"#.*", "", (ENVS / f"{name}.in").read_text())
    assert set(re.findall(r"^[a-z0-9-]+", text, re.MULTILINE)) <= beside.keys() - packages.keys()
    assert all(hashes > 0 for _, hashes in beside.values())
    assert all(beside[one][0] == packages[one][0] for one in beside.keys() & packages.keys())


def test_conda_environment_is_the_lock_of_what_rules_need():
    packages = read_lock("development.lock")
    environment = yaml.safe_load((ENVS / "wearscope.yaml").read_text())
    python, pip, through_pip = environment["dependencies"]
    assert (python, pip) == ("python=3.11", "pip")
    project = read_project()["project"]
    named = name_packages([*project["dependencies"], *project["optional-dependencies"]["export"]])
    named.remove("pybullet-arm64")
    assert through_pip["pip"] == [f"{name}=={packages[name][0]}" for name in named]


def set_up(tmp_path: Path, python: str, venv: Path) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))}
    return call("make", "-s", f"PYTHON={python}", f"VENV={venv}", "setup", folder=ROOT, env=environment)


def write_program(path: Path, text: str) -> str:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def test_wrong_python_gets_one_sentence_with_the_command(tmp_path):
    venv = tmp_path / "venv"
    run = set_up(tmp_path, write_program(tmp_path / "python3.10", "exit 1"), venv)
    assert run.returncode != 0
    (first, *rest) = run.stderr.splitlines()
    assert "needs Python 3.11, 3.12 or 3.13" in first and "make PYTHON=" in first
    assert re.search(r"get one with '(uv|sudo apt install|pipx install) \S+", first)
    assert all(line.startswith("make") for line in rest)
    assert not venv.exists()


def test_python_too_old_too_new_or_without_venv_is_refused():
    (good,) = re.findall(r"^GOOD := (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for version, fits in {(3, 10, 9): 0, (3, 11): 1, (3, 12, 1): 1, (3, 13, 9): 1, (3, 14): 0}.items():
        code = f"import sys; sys.version_info = {version!r}; {good}"
        assert (call_python("-c", code).returncode == 0) == bool(fits)
    code = f"import sys; sys.modules['ensurepip'] = None; {good}"
    assert call_python("-c", code).returncode != 0


def test_environment_behind_a_symbolic_link_is_not_cleared(tmp_path):
    """It may be another clone's."""
    other = tmp_path / "other"
    other.mkdir()
    (other / "kept").write_text("")
    venv = tmp_path / "venv"
    venv.symlink_to(other)
    run = set_up(tmp_path, sys.executable, venv)
    assert run.returncode != 0
    assert "is a symbolic link" in run.stderr.splitlines()[0] and f"rm {venv}" in run.stderr
    assert (other / "kept").exists() and venv.is_symlink()


def test_ci_runs_make_test():
    script = ROOT / ".ci" / "run"
    assert script.stat().st_mode & 0o111
    assert "make --no-print-directory test " in script.read_text()
    script = ROOT / ".ci" / "run-long"
    assert script.stat().st_mode & 0o111
    assert "make --no-print-directory test-slow" in script.read_text()
    assert "make --no-print-directory test-kills" in script.read_text()
    assert "make --no-print-directory test-how-to" in script.read_text()
    assert "make --no-print-directory mutants" in script.read_text()


@pytest.mark.parametrize("name", BESIDE)
def test_package_declares_what_the_lock_is_made_from(name):
    listed = re.sub(r"#.*", "", (ENVS / f"{name}.in").read_text())
    assert sorted(read_project()["project"]["optional-dependencies"][name]) == sorted(listed.split())
