"""Plug-ins of an installed package: known by name as if built in, and not imported before they are named."""

import importlib
import json
import os
import re
import shutil
import sys
from pathlib import Path

import pytest
from calls import call_python
from own_effects import HOSE

import wearscope
from wearscope import plugins
from wearscope.config import load_config
from wearscope.cycles.base import load_cycle
from wearscope.detectors.base import load_detector
from wearscope.effects.base import load_effect
from wearscope.effects.own_effect import load_installed_effect
from wearscope.errors import InputError
from wearscope.jobs.study_files import plugin_file
from wearscope.robots.model import load_model

ROOT = Path(__file__).parents[2]
DETECTOR = """
class Peak:
    def fit(self, nominal, axis, model):
        self.axis = axis
        self.nominal = abs(nominal[0].tau[:, axis]).max()

    def test_quantity(self, batch):
        return abs(batch.tau[:, self.axis]).max() - self.nominal


DETECTOR = Peak
"""
CYCLE = """
from wearscope.cycles import axis_sweeps
from wearscope.cycles.base import Cycle

CYCLE = Cycle("there_and_back", "The sweeps under another name.", axis_sweeps.CYCLE.build)
"""
POINTS = """
[wearscope.detectors]
peak_torque = dummy_plugins.peak_torque
residual_energy = dummy_plugins.peak_torque
broken = dummy_plugins.broken
lost = dummy_plugins.nowhere
named = dummy_plugins.peak_torque:Peak

[wearscope.cycles]
there_and_back = dummy_plugins.there_and_back

[wearscope.effects]
hose_drag = dummy_plugins.hose_drag
other_name = dummy_plugins.hose_drag

[wearscope.robots]
my_arm = dummy_plugins.arm
"""


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A folder on the path with a package and what pip would have written of it."""
    package, told = tmp_path / "dummy_plugins", tmp_path / "dummy_plugins-1.0.dist-info"
    (package / "arm").mkdir(parents=True)
    told.mkdir()
    files = {
        "__init__.py": "",
        "peak_torque.py": f"print('peak_torque imported')\n{DETECTOR}",
        "broken.py": "raise RuntimeError('no licence')\n",
        "there_and_back.py": CYCLE,
        "hose_drag.py": HOSE,
        "arm/__init__.py": "",
    }
    for name, text in files.items():
        (package / name).write_text(text)
    for name in ("model.yaml", "robot.urdf"):
        shutil.copyfile(ROOT / "config" / "robots" / "medium" / name, package / "arm" / name)
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: dummy-plugins\nVersion: 1.0\n")
    (told / "entry_points.txt").write_text(POINTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(ROOT / "src")]))
    importlib.invalidate_caches()
    yield tmp_path
    for name in [name for name in sys.modules if name.startswith("dummy_plugins")]:
        del sys.modules[name]
    plugins._import_installed.cache_clear()
    load_installed_effect.cache_clear()


def test_each_kind_is_known_by_name(installed):
    assert type(load_detector("peak_torque")).__name__ == "Peak"
    assert type(load_detector("named")).__name__ == "Peak"
    assert load_cycle("there_and_back").name == "there_and_back"
    assert load_effect("hose_drag") is load_effect("hose_drag")
    assert load_effect("hose_drag").reference == "hose_drag"
    assert load_model("my_arm").n == load_model("medium").n


def test_nothing_is_imported_before_it_is_named(installed, capsys):
    assert plugins.list_installed("detectors") == [
        "broken", "lost", "named", "peak_torque", "residual_energy",
    ]  # fmt: skip
    plugins.list_names("detectors", "DETECTOR")
    load_detector("residual_energy")
    assert plugin_file("peak_torque", "detectors") == installed / "dummy_plugins" / "peak_torque.py"
    assert "imported" not in capsys.readouterr().out
    load_detector("peak_torque")
    assert "imported" in capsys.readouterr().out


def test_what_is_built_in_keeps_its_name(installed):
    assert load_detector("residual_energy").__class__.__module__.startswith("wearscope.")
    assert plugin_file("residual_energy", "detectors").parent.name == "detectors"


def test_model_with_an_installed_effect_is_simulated(installed):
    from wearscope.notebook.one_run import simulate

    model = load_model("my_arm")
    entries = [entry.model_dump() for entry in model.effects]
    added = {"joint": model.joints[1], "effect": "hose_drag", "parameters": {"level": 90.0}}
    with_hose = model.replace(effects=[*entries, added])
    plain, dragged = (simulate(one, "axis_sweeps", step=0.004) for one in (model, with_hose))
    moved = (plain["tau"] - dragged["tau"]).abs().groupby(plain["joint"]).max()
    assert moved.idxmax() == model.joints[1] and moved.max() > 1.0


@pytest.mark.parametrize(
    ("reference", "told"),
    [
        ("broken", "importing 'broken' of package dummy-plugins raised RuntimeError: no licence"),
        ("lost", "importing 'lost' of package dummy-plugins raised ModuleNotFoundError"),
        ("nothing", "there is no 'nothing'; choose one of .*residual_energy.*peak_torque"),
    ],
)
def test_what_cannot_be_loaded_gets_one_sentence(installed, reference, told):
    with pytest.raises(InputError, match=told):
        load_detector(reference)


def test_an_effect_goes_by_its_own_name(installed, refuses):
    refuses(load_effect, "other_name")


def test_two_packages_that_offer_one_name_are_refused(installed, refuses):
    other = installed / "rival-1.0.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: rival\nVersion: 1.0\n")
    (other / "entry_points.txt").write_text("[wearscope.detectors]\npeak_torque = rival.detector\n")
    importlib.invalidate_caches()
    refuses(load_detector, "peak_torque")


def test_the_loop_tries_an_installed_effect_that_is_named(installed, refuses):
    base = {
        "study": "s", "robots": ["my_arm"], "cycles": ["there_and_back"], "axes": [1],
        "detectors": {"P": "peak_torque"},
        "factors": {
            "f": {"description": "wear", "kind": "wear", "range": [0, 50], "unit": "1"},
            "w3": {"description": "heat", "kind": "temperature", "range": [30, 70], "unit": "degC"},
        },
        "scope": {"factors": ["w3"]},
    }  # fmt: skip
    config = load_config({**base, "closed_loop": {"effects": ["hose_drag"]}})
    assert config.closed_loop.effects == ["hose_drag"]
    refuses(load_config, {**base, "closed_loop": {"effects": ["hose_dragg"]}})


def rewrite(path, old, new):
    """Another content, with the dates of before: as a package manager may leave them."""
    dates = path.stat()
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    os.utime(path, ns=(dates.st_atime_ns, dates.st_mtime_ns))


def test_identity_tells_version_and_content_of_the_whole_package(installed):
    def identify():
        importlib.invalidate_caches()
        return plugins.identify_installed("peak_torque", "detectors")

    package, told = installed / "dummy_plugins", installed / "dummy_plugins-1.0.dist-info"
    first = identify()
    assert first.startswith("dummy-plugins 1.0, sha256 ") and identify() == first
    rewrite(package / "peak_torque.py", "abs(", "abs(0 + ")
    second = identify()
    rewrite(package / "broken.py", "licence", "license")
    third = identify()
    rewrite(told / "METADATA", "1.0", "1.1")
    fourth = identify()
    assert len({first, second, third, fourth}) == 4 and fourth.startswith("dummy-plugins 1.1, ")
    assert fourth.partition(",")[2] == third.partition(",")[2]
    assert plugins.identify_installed("friction_fit", "detectors") is None


@pytest.fixture
def run(tmp_path):
    """The command wearscope in an empty folder, in a process of its own; what it says, stripped."""

    def call(*command):
        done = call_python("-m", "wearscope", *command, folder=tmp_path, timeout=900)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
        return done.stdout.strip()

    return call


@pytest.mark.slow
def test_study_names_what_is_installed(installed, run, tmp_path):
    """The workflow's own checks, in processes of their own; another package makes them stale."""

    def stale():
        return run("run", "mine", "--stage", "check", *options, "--dry-run")

    options = ["--set", "closed_loop.effects=[hose_drag]"]
    run("new", "study", "mine", "--robot", "my_arm", "--cycle", "there_and_back", "--detector",
        "P=peak_torque")  # fmt: skip
    run("run", "mine", "--stage", "check", *options)
    results = tmp_path / "mine" / "results" / "mine"
    assert json.loads((results / "check" / "detectors.json").read_text()) == {"P": "Peak"}
    assert (results / "check" / "my_arm" / "there_and_back.json").is_file()
    assert stale() == "Nothing to be done."
    rewrite(installed / "dummy_plugins" / "peak_torque.py", "abs(", "abs(0 + ")
    assert re.fullmatch(r"\d jobs to do\.", stale())
    run("run", "mine", "--stage", "check", *options)
    assert stale() == "Nothing to be done."
    rewrite(installed / "dummy_plugins-1.0.dist-info" / "METADATA", "1.0", "1.1")
    assert re.fullmatch(r"\d jobs to do\.", stale())


@pytest.mark.slow
def test_a_loop_is_stale_once_an_effect_s_package_changed(installed, run):
    data = Path(wearscope.__file__).parent / "example_data"
    loop = ["diagnose", str(data), "--cores", "1", "--set", "closed_loop.effects=[hose_drag]"]
    run(*loop)
    assert run(*loop, "--dry-run") == "Nothing to be done."
    rewrite(installed / "dummy_plugins" / "hose_drag.py", "np.sin(", "np.cos(")
    # Closing, reporting and showing the loop, and the target of all three.
    assert run(*loop, "--dry-run") == "4 jobs to do."
