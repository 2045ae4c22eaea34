"""The wheel: what it declares, and a study without a clone from where it is installed."""

import ast
import importlib.metadata
import os
import re
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from calls import call

from wearscope.errors import EXTRAS

ROOT = Path(__file__).parents[2]
#: Distributions by the module that they give, where the names differ.
GIVEN_BY = {
    "vl_convert": "vl-convert-python",
    "yaml": "pyyaml",
    "pinocchio": "pin",
    "PIL": "pillow",
}
#: What others that are declared bring along, and are never without.
BROUGHT = {"pillow": "matplotlib", "markupsafe": "jinja2", "llvmlite": "numba"}


def run(*command, folder=None, timeout=600):
    env = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = call(*command, folder=folder, env=env, timeout=timeout)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
    return done.stdout + done.stderr


def lend_packages(folder):
    """An environment with the packages of the tests' own; returns its Python."""
    run(sys.executable, "-m", "venv", folder)
    (site,) = folder.glob("lib/python*/site-packages")
    lent = Path(importlib.metadata.distribution("snakemake").locate_file("")).resolve()
    (site / "lent.pth").write_text(f"import site; site.addsitedir({str(lent)!r})\n")
    return folder / "bin" / "python"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, folder=ROOT)
    (made,) = folder.glob("*.whl")
    return made


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Commands of an environment: the wheel by pip, what it depends on lent by the tests' own."""
    folder = tmp_path_factory.mktemp("env")
    python = lend_packages(folder)
    options = ["--quiet", "--no-deps", "--no-index", "--ignore-installed"]
    run(python, "-m", "pip", "install", *options, wheel)
    place = run(python, "-c", "import wearscope; print(wearscope.__file__)").strip()
    assert Path(place).is_relative_to(folder)
    return folder / "bin"


def list_imports():
    """Top-level modules that the package and the workflow's scripts import, type checking aside."""
    modules = set()
    for file in [*ROOT.glob("src/**/*.py"), *ROOT.glob("workflow/**/*.py")]:
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                modules |= {name.name.split(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                modules.add(node.module.split(".")[0])
    scripts = {file.stem for file in ROOT.glob("workflow/scripts/*.py")}
    return modules - set(sys.stdlib_module_names) - scripts - {"wearscope"}


def declared(*extras):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    listed = [
        *project["dependencies"],
        *(one for name in extras for one in project["optional-dependencies"][name]),
    ]
    return {re.split(r"[<>=!~\[ ;]", one)[0].lower() for one in listed}


def test_everything_that_is_imported_is_declared():
    needed = {GIVEN_BY.get(name, name).lower() for name in list_imports()}
    needed = {BROUGHT.get(name, name) for name in needed}
    extras = {extra for extra, _ in EXTRAS.values()}
    assert needed - declared() == declared(*extras) - declared()


def test_everything_that_is_declared_is_used():
    needed = {GIVEN_BY.get(name, name).lower() for name in list_imports()}
    # The workflow's engine and the figures' style are called by name; pybullet has two distributions.
    assert declared() - needed <= {"snakemake", "seaborn", "pybullet-arm64"}


def test_wheel_carries_package_workflow_types_and_metadata(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        (place,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = archive.read(place).decode()
    listed = run("git", "ls-files", "workflow", "config", "profiles", "Snakefile", folder=ROOT).split()
    assert {f"wearscope/platform/{name}" for name in listed} <= names
    assert {"wearscope/py.typed", "wearscope/starters/templates/study.yaml.jinja"} <= names
    assert {"wearscope/example_data/dataset.yaml", "wearscope/example_data/runs/sweeps.parquet"} <= names
    assert not any("/__pycache__/" in name or name.startswith(("tests/", "results/")) for name in names)
    for line in (
        "License-Expression: MIT",
        "Requires-Python: <3.14,>=3.11",
        "Provides-Extra: test",
        "Requires-Dist: click",
    ):
        assert line in metadata


@pytest.mark.slow
def test_clone_is_installed_as_make_does_it(tmp_path):
    """By path, with the locked packages only: nothing is built in isolation."""
    python = lend_packages(tmp_path)
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--ignore-installed"]
    run(python, "-m", "pip", "install", *options, "--editable", ROOT)
    assert run(tmp_path / "bin" / "wearscope", "--version").startswith("wearscope, version ")


@pytest.mark.slow
def test_installed_command_makes_a_study_that_snakemake_plans_by_itself(installed, tmp_path):
    run(installed / "wearscope", "new", "study", "mine", "--robot", "medium", folder=tmp_path)
    command = [installed / "wearscope", "run", "mine", "--dry-run"]
    (count,) = re.findall(r"^(\d+) jobs to do", run(*command, folder=tmp_path), re.MULTILINE)
    plan = run(installed / "python", "-m", "snakemake", "-n", "--cores", "1", folder=tmp_path / "mine")
    assert re.findall(r"^total +(\d+)$", plan, re.MULTILINE)[0] == count
    # The environment that lends its packages may stand in the clone.
    assert str(ROOT) not in plan.replace(sys.prefix, "")


@pytest.mark.long
def test_installed_command_runs_its_study(installed, tmp_path):
    run(installed / "wearscope", "new", "study", "mine", folder=tmp_path)
    run(installed / "wearscope", "run", "mine", folder=tmp_path, timeout=1800)
    assert (tmp_path / "mine" / "results" / "mine" / "report.html").is_file()


@pytest.mark.long
def test_wheel_s_own_dependencies_suffice(wheel, tmp_path):
    """With everything else from the package index, as a user's pip would take it."""
    run(sys.executable, "-m", "venv", tmp_path / "env")
    pip = [tmp_path / "env" / "bin" / "python", "-m", "pip"]
    if call(*pip, "download", "--quiet", "--no-deps", "--dest", tmp_path, "click").returncode:
        pytest.skip("no package index can be reached")
    run(*pip, "install", "--quiet", wheel, timeout=1800)
    run(tmp_path / "env" / "bin" / "wearscope", "new", "study", "mine", folder=tmp_path)
    run(tmp_path / "env" / "bin" / "wearscope", "run", "mine", folder=tmp_path, timeout=1800)
