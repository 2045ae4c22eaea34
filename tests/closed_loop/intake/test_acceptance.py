"""Each refusal by inference says the line that overrules it, and that line does."""

import shutil

import numpy as np
import pytest
import yaml
from changed_fields import changed_fields
from folders import change_runs, check, scale

from wearscope.closed_loop.intake.acceptance import Acceptance, list_codes
from wearscope.errors import InputError


@pytest.fixture(scope="module")
def arm(record_at, tmp_path_factory):
    """Two joints: with each more, there are many more readings that an accepted one may be next to."""
    return record_at(tmp_path_factory.mktemp("arm") / "d", runs=3, duration=8.0, seed=3, rate=100.0)


@pytest.fixture
def folder(arm, tmp_path):
    return shutil.copytree(arm, tmp_path / "d")


def edit(folder, change=None, **fields):
    if change:
        change_runs(folder, change)
    with changed_fields(folder / "dataset.yaml") as document:
        document.update(fields)


def exchange(a, b):
    return lambda table: table.rename(columns={a: b, b: a})


def step(table):
    moved = np.where(np.arange(len(table)) > len(table) // 2, 0.3, 0.0)
    return table.assign(q_b=table["q_b"] + moved)


def spike(table):
    jumps = np.where(np.arange(len(table)) % 250 < 3, 0.5, 0.0)
    return table.assign(q_b=table["q_b"] + jumps)


def clip(table):
    limit = 0.8 * table["tau_b"].abs().max()
    return table.assign(tau_b=table["tau_b"].clip(-limit, limit))


def given_in_degrees(table):
    return table.assign(qd_b=np.gradient(table["q_b"], table["t"]) * 180 / np.pi)


FAULTS = {
    "sign tau_b": scale("tau_b", -1.0),
    "exchanged tau_a tau_b": exchange("tau_a", "tau_b"),
    "gain tau_b": scale("tau_b", 1 / 80),
    "scale q_b": scale("q_b", 0.5),
    "speed qd_b": given_in_degrees,
    "step q_b": step,
    "spikes q_b": spike,
    "clipped tau_b": clip,
}


def take_line(text):
    """The field that the refusal says to write where the data are right."""
    return yaml.safe_load(text.split('"')[-2])


@pytest.mark.parametrize("code", FAULTS)
def test_the_line_that_a_refusal_says_is_enough(folder, code):
    edit(folder, FAULTS[code])
    said = []
    for _ in range(6):
        try:
            prepared = check(folder)
            break
        except InputError as error:
            line = take_line(str(error))
            assert str(error).startswith(str(folder)) and str(error).endswith("dataset.yaml.")
            said.append(line["accept"])
            edit(folder, **line)
    else:
        pytest.fail(f"still refused with {said}")
    assert code in said[0]
    assert any("since 'accept' says so" in note for note in prepared.notes)
    assert not any("overrules nothing" in note for note in prepared.notes)


@pytest.mark.parametrize(
    ("factor", "code"), [(1 / 64, "gain"), pytest.param(-1.0, "sign", marks=pytest.mark.slow)]
)
def test_accepted_data_are_taken_as_they_are(arm, folder, factor, code):
    edit(folder, scale("tau_b", factor), accept=[f"{code} tau_b"])
    as_it_is, scaled = check(arm), check(folder)
    for run, other in zip(as_it_is.runs, scaled.runs, strict=True):
        # But for what stands in for rests, where the rigid body's factor is held about one.
        off = np.abs(other.measured[:, 1] / factor - run.measured[:, 1])
        assert off.max() < 1e-3 * np.abs(run.measured[:, 1]).max()
        assert np.median(off) < 1e-9 * np.abs(run.measured[:, 1]).max()
        np.testing.assert_array_equal(other.measured[:, 0], run.measured[:, 0])


def test_what_is_accepted_in_vain_is_noted_and_what_is_no_refusal_is_refused(folder):
    edit(folder, accept=["degrees q_a"])
    assert any("'degrees q_a' overrules nothing" in note for note in check(folder).notes)
    edit(folder, accept=["degres q_a"])
    with pytest.raises(InputError, match=r"did you mean 'degrees q_a'\? .*they are .*gain tau_<joint>"):
        check(folder)


def test_what_cannot_be_right_is_refused_whatever_is_accepted(folder):
    edit(folder, accept=list(list_codes(["a", "b"], [])))

    def break_row(table):
        table.loc[100, "tau_b"] = np.nan
        return table

    edit(folder, break_row)
    with pytest.raises(InputError, match="no finite number at row 100"):
        check(folder)


def test_copy_may_be_accepted(folder):
    runs = yaml.safe_load((folder / "dataset.yaml").read_text())["runs"]
    shutil.copyfile(folder / runs[0]["file"], folder / runs[2]["file"])
    with pytest.raises(InputError) as caught:
        check(folder)
    edit(folder, **take_line(str(caught.value)))
    assert any("repeats the train run" in note for note in check(folder).notes)


def test_the_line_keeps_what_was_accepted_before_and_any_name():
    accepted = Acceptance.read("d", ["sign tau_a"], ["a", "b, c"], [])
    with pytest.raises(InputError) as caught:
        accepted.refuse("f", "it looks odd.", "gain tau_b, c")
    assert take_line(str(caught.value)) == {"accept": ["sign tau_a", "gain tau_b, c"]}
    assert "f: it looks odd; if it is right as it is, write " in str(caught.value)


@pytest.mark.parametrize(("size", "reach"), [(0.02, 3.0), (0.3, 1.0)])
def test_joints_full_of_friction_under_an_overstated_body_are_believed(folder, size, reach):
    """Any smaller rigid body explains such a joint, not just that of positions in degrees or turned axes."""

    def rub(table):
        for joint in "ab":
            v = np.gradient(table[f"q_{joint}"], table["t"])
            noise = np.random.default_rng(0).normal(size=len(v))
            friction = np.sign(v) + 0.5 * v / v.std() + 0.02 * noise
            table[f"tau_{joint}"] = size * table[f"tau_{joint}"].std() * friction
            table[f"q_{joint}"] = reach * table[f"q_{joint}"]
        return table

    edit(folder, rub)
    check(folder)
