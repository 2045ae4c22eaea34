"""What `import wearscope` offers: its examples run, and it costs nothing until it is used."""

import doctest
import importlib
import importlib.metadata
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from calls import call_python

import wearscope
from wearscope.designs.factors import PAPER_FACTORS
from wearscope.errors import EXTRAS, InputError, escape_text, need
from wearscope.reporting.style import figure_bytes, new_figure
from wearscope.storage import tables


@pytest.mark.parametrize(
    ("code", "more"),
    [
        ("import wearscope", "click yaml"),
        ("from wearscope.cli.main import main; main()", ""),
    ],
)
def test_import_and_help_load_nothing_heavy(code, more):
    heavy = f"numpy pyarrow pandas scipy pybullet pinocchio matplotlib numba snakemake pydantic {more}"
    tell = f"print([name for name in {heavy.split()} if name in sys.modules])"
    code = f"import sys; sys.argv[1:] = ['--help']\ntry:\n    {code}\nfinally:\n    {tell}"
    assert call_python("-c", code).stdout.splitlines()[-1] == "[]"


def test_version_is_the_installed_one():
    assert wearscope.__version__ == importlib.metadata.version("wearscope")


def test_nothing_but_an_extra_needs_the_extras():
    """All modules of the package are imported without them, but those that a running export imports."""
    blocked = ["mujoco", "rosbags", "playwright", "pytest"]
    lazily = ("comparison", "formats")
    own = {"wearscope.__main__", *(f"wearscope.export.{name}" for name in lazily)}
    code = f"""
import importlib, pkgutil, sys
sys.modules.update(dict.fromkeys({blocked}))
import wearscope
for one in pkgutil.walk_packages(wearscope.__path__, "wearscope."):
    if one.name not in {own}:
        importlib.import_module(one.name)
"""
    done = call_python("-c", code)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("module", EXTRAS)
def test_a_missing_extra_is_one_sentence_with_its_command(module, monkeypatch):
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    extra, _ = EXTRAS[module]
    assert module in project["optional-dependencies"][extra]
    need(module)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(
        InputError, match=rf"{module}.*{sys.executable} -m pip install 'wearscope\[{extra}\]'"
    ):
        need(module)


def test_every_public_name_is_there():
    for name in wearscope.__all__:
        assert getattr(wearscope, name).__doc__ and name in dir(wearscope)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = wearscope.nothing


@pytest.mark.parametrize(
    "module", ["wearscope", "wearscope.notebook.study", "wearscope.notebook.one_run", "wearscope.home"]
)
def test_examples_run(module, place, monkeypatch):
    monkeypatch.chdir(place)
    failed, tried = doctest.testmod(importlib.import_module(module))
    assert tried > 0 and failed == 0


def test_tables_are_those_on_disk_with_units(place):
    study = wearscope.Study(place / "results" / "paper")
    whole = tables.read_table(place / "results" / "paper" / "snr.parquet")
    rows = study.snr(fda="A", axis=[2])
    expected = whole[(whole["fda"] == "A") & (whole["axis"] == 2)]
    assert len(rows) == 2
    np.testing.assert_array_equal(rows["snr"], expected["snr"])
    assert study.table("validation", model="full").attrs["units"] == {"fit": "%"}
    assert study.names() == [
        "design/identification", "ranking", "scope", "sensitivity", "snr", "surrogates",
        "test_quantities", "validation",
    ]  # fmt: skip


def test_study_is_found_from_its_own_folder(place):
    assert wearscope.Study(place).folder == place / "results" / "paper"


def test_factors_are_those_of_the_design(place):
    found = {one.name: (one.low, one.high, one.unit) for one in wearscope.Study(place).factors()}
    for factor in PAPER_FACTORS:
        low, high, unit = found[factor.name]
        assert (low, high) == pytest.approx((factor.low, factor.high)) and unit == factor.unit


@pytest.mark.parametrize("name", ["scope", "sensitivity", "snr"])
def test_every_figure_is_drawn_and_takes_the_place_of_axes(place, name):
    alone = wearscope.Study(place).plot(name)
    figure = new_figure(10, 8)
    upper, lower = figure.subplots(2, 1)
    part = wearscope.Study(place).plot(name, ax=lower)
    assert len(part.axes) == len(alone.axes) > 0 and figure_bytes(figure, "png")
    assert upper in figure.axes and lower not in figure.axes and set(part.axes) < set(figure.axes)


def test_snr_is_ranked_by_what_is_asked(place):
    study = wearscope.Study(place)
    labels = {text.get_text() for ax in study.plot("snr", by=("fda", "robot")).axes for text in ax.texts}
    ticks = {t.get_text() for ax in study.plot("snr", by=("fda", "robot")).axes for t in ax.get_yticklabels()}
    assert any("medium" in one for one in labels | ticks)


@pytest.mark.parametrize(
    ("ask", "told"),
    [
        (lambda study: study.table("nothing"), "has no table 'nothing'.*snr"),
        (lambda study: study.snr(detector="A"), "no column 'detector'.*fda"),
        (lambda study: study.snr(fda="Z"), "no row has fda 'Z'; there are A, C"),
        (lambda study: study.summary(), "holds no conclusion yet"),
        (lambda study: study.plot("nothing"), "no figure 'nothing'.*snr"),
        (lambda study: study.plot("snr", by=("colour",)), "colour is no grouping"),
        (lambda study: study.plot("scope", factor="w9"), "no 'w9'.*w3"),
        (lambda study: study.plot("snr", ax=new_figure(1, 1).add_axes((0, 0, 1, 1))), "no place in a grid"),
        (lambda study: wearscope.Study(study.folder.parent), "holds no results"),
    ],
)
def test_what_is_not_there_gets_one_sentence(place, ask, told):
    with pytest.raises(wearscope.InputError, match=told):
        ask(wearscope.Study(place))


def test_simulate_repeats_itself_and_feels_wear_of_one_joint():
    def run(wear):
        return wearscope.simulate("medium", "axis_sweeps", wear=wear, step=0.004, seed=5)

    new, again, worn = run(0.0), run((0.0,)), run((40.0,))
    assert new.equals(again)
    assert new.attrs["units"] == {"t": "s", "q": "rad", "qd": "rad/s", "tau": "N m"}
    rise = (worn["tau"].abs() - new["tau"].abs()).groupby(new["joint"], sort=False).mean()
    assert rise.idxmax() == new["joint"].iloc[0] and rise.max() > 0.0


def test_what_steers_a_terminal_is_escaped_and_a_hard_space_is_a_space():
    assert escape_text("1\xa0% of a\x1b[2J\n") == r"1 % of a\x1b[2J\n"
