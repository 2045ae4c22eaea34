"""A load that is not as declared in some runs only is told as that, with the mass of each run."""

import re
import shutil

import numpy as np
import pytest
from changed_fields import changed_fields
from folders import fit_problem
from recorded_chain import Bench, chain, pivot, rub, torque_of
from urdf_texts import Joint, describe_robot

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.diagnostics.loads import tell_loads
from wearscope.closed_loop.model.prediction import predict_runs
from wearscope.reporting.loop_words import LOAD


def grow_friction(sizes):
    given = iter(sizes)
    return lambda t, q, v, a, rng: next(given) * np.sign(v)


@pytest.fixture
def tell(record, pose):
    def told(**options):
        problem = pose(record(runs=4, duration=8.0, **options))
        model = fit_problem(problem)
        return tell_loads(problem.prepared, predict_runs(problem.prepared, model, model), model)

    return told


def test_each_run_s_load_is_told(tell, carry):
    planted = [0.0, 1.5, 0.0, 1.5]
    (sentence,) = tell(extra_torque=carry(planted), seed=31)
    assert sentence.startswith("The load differs between runs")
    added, low, high, *each = [float(x) for x in re.findall(r"(-?[\d.]+)(?: kg| to|\) more)", sentence)]
    assert low <= 1.5 <= high and added == pytest.approx(1.5, abs=0.05)
    assert each[-4:] == pytest.approx(planted, abs=0.1), sentence


def test_nineteen_of_twenty_intervals_hold_the_load(tell, carry, tmp_path):
    held = 0
    for seed in range(40, 60):
        shutil.rmtree(tmp_path / "duo", ignore_errors=True)
        (sentence,) = tell(extra_torque=carry([0.0, 1.5, 0.0, 1.5]), seed=seed)
        low, high = (float(x) for x in re.search(r"\((-?[\d.]+) to (-?[\d.]+)\) more", sentence).groups())
        held += low <= 1.5 <= high
    assert 17 <= held


@pytest.mark.parametrize("kind", ["none", "all", "friction"])
def test_no_other_difference_is_a_load(tell, carry, kind):
    extra = {"none": None, "all": carry([1.5] * 4), "friction": grow_friction([0.0, 3.0, 0.0, 3.0])}[kind]
    assert tell(extra_torque=extra, seed=32) == []


def test_a_load_that_differs_is_a_note_of_the_verdict(record, carry):
    found = diagnose(record(runs=4, duration=8.0, extra_torque=carry([0.0, 1.5, 0.0, 1.5]), seed=31))
    assert any(note.startswith("The load differs between runs") for note in found.verdict["notes"])


@pytest.mark.parametrize(
    ("more", "inertials"), [(0.5, "approximate"), (4.0, "approximate"), (4.0, "trusted")]
)
def test_friction_by_the_load_is_that_of_the_load_there_is(record, carry, more, inertials):
    """Along the stated load, 4 kg make it 0.43."""
    extra = carry([more] * 4, friction=0.3)
    found = diagnose(
        record(runs=4, duration=8.0, extra_torque=extra, seed=33, robot={"inertials": inertials})
    )
    entry = next(e for e in found.verdict["verdict"] if e["effect"] == "load_dependent_friction")
    low, high = entry["parameters"]["coefficient"]["ci95"]
    assert entry["joint"] == "a"
    assert 0.27 < low < 0.3 < high < 0.33
    notes = found.verdict["notes"]
    assert not [note for note in notes if "load_dependent_friction is fitted" in note]
    told = [note for note in notes if note.startswith(LOAD)]
    # Half a kilogram is within what a URDF's masses are usually wrong by.
    assert bool(told) == (inertials == "approximate" and more > 1.0)
    if told:
        mass, least, most = (float(x) for x in re.findall(r"([+-][\d.]+)", told[0]))
        assert least < more < most
        assert mass == pytest.approx(more, rel=0.05)


@pytest.mark.parametrize(
    ("stated", "more", "told"),
    [
        (True, 0.0, ""),
        (True, -3.0, "a payload of"),
        (False, -1.0, "a payload of"),
        (False, -4.0, "a change of the link that b moves, of"),
    ],
)
def test_a_payload_is_told_where_a_machine_can_carry_it(record, carry, stated, more, told):
    """Without a stated payload, a link that is 1 kg too heavy is no payload of -1 kg."""
    folder = record(
        runs=4, duration=8.0, extra_torque=carry([more] * 4), seed=33, robot={"inertials": "approximate"}
    )
    if not stated:
        with changed_fields(folder / "dataset.yaml") as fields:
            for run in fields["runs"]:
                del run["payload"]
    notes = [note for note in diagnose(folder).verdict["notes"] if note.startswith(LOAD)]
    assert len(notes) == bool(told)
    if told:
        mass = float(re.search(rf"act as {told} (\S+) kg", notes[0])[1])
        assert mass == pytest.approx(more + 3.0 * (not stated), rel=0.05)


def test_a_link_of_which_the_urdf_is_wrong_is_told(record):
    """The URDF's first link is 6 kg too heavy, at 0.2 m along x and 0.02 m along z."""
    folder = record(runs=4, duration=8.0, seed=34, robot={"inertials": "approximate"})
    file = folder / "robot.urdf"
    before, own, after = re.split(r"(?<=<mass)(.*?)(?=</inertial>)", file.read_text(), maxsplit=1, flags=re.S)
    heavy = re.sub(r'="([^"]+)"', lambda found: f'="{1.5 * float(found[1]):.6g}"', own)
    file.write_text(before + heavy + after)
    (note,) = [note for note in diagnose(folder).verdict["notes"] if note.startswith(LOAD)]
    told = re.search(r"the link that a or b moves, .* moments of (\S+), (\S+), (\S+) kg m about .* a:", note)
    assert [float(m) for m in told.groups()] == pytest.approx([-1.2, 0.0, -0.12], abs=0.01)


def test_a_payload_of_unknown_mass_is_told_by_its_moments(tmp_path):
    """A hinge shows a body's moments: 0.6 kg at 0.2 m along x and 0.1 m along z."""

    def torque(q, v, a, rng, t):
        added = 0.6 * (9.81 * (0.2 * np.cos(q) - 0.1 * np.sin(q)) + 0.05 * a)
        return torque_of(1.2, 0.2, 0.05, noise=0.02)(q, v, a, rng, t) + added

    bench = Bench(tmp_path, 1, size=0.8, rate=100.0, seconds=8.0, runs=4, frequencies=(0.2, 0.5, 0.9))
    bench.record(torque).accept()
    (note,) = [note for note in diagnose(tmp_path / "d").verdict["notes"] if note.startswith(LOAD)]
    moments = re.search(r"unknown mass, with moments of (\S+), (\S+), (\S+) kg m about the frame of j1", note)
    assert [float(m) for m in moments.groups()] == pytest.approx([0.12, 0.0, 0.06], abs=0.01)


def test_a_moment_that_only_acts_with_an_unknown_mass_is_unknown_too(tmp_path):
    """A plate turns on a cradle that tilts; a body's height on it acts together with its mass."""
    bodies = [(0, 4.0, (0.0, 0.02, 0.1)), (1, 2.0, (0.02, 0.03, 0.05)), (1, 1.2, (0.12, 0.08, 0.2))]

    def place(q, link, at):
        """Position (N, 3) of a point of a link."""
        c, s = np.cos(q), np.sin(q)
        x, y, z = (np.full(len(q), one) for one in at)
        if link:
            x, y, z = c[:, 1] * x - s[:, 1] * y, s[:, 1] * x + c[:, 1] * y, z + 0.15
        return np.column_stack([x, c[:, 0] * y - s[:, 0] * z, s[:, 0] * y + c[:, 0] * z])

    def torque(q, v, a, rng, t):
        step, tau = 1e-4, rub(v, 0.3, 0.2) + rng.normal(0, 0.01, q.shape)
        for link, mass, at in bodies:
            before, now, after = (place(q + v * s + 0.5 * a * s**2, link, at) for s in (-step, 0.0, step))
            force = mass * ((after - 2.0 * now + before) / step**2 + [0.0, 0.0, 9.81])
            for j, way in enumerate(step * np.eye(2)):
                tau[:, j] += np.sum(force * (place(q + way, link, at) - now) / step, axis=1)
        return tau

    bench = Bench(tmp_path, 2, size=0.8, rate=100.0, seconds=8.0, runs=4, frequencies=(0.2, 0.5, 0.9))
    small = {"moments": "1e-5 1e-5 1e-5", "limits": "-3.1 3.1 900 9"}
    cradle = Joint("j1", "1 0 0", 4.0, com="0 0.02 0.1", at="0 0 0", **small)
    plate = Joint("j2", "0 0 1", 2.0, com="0.02 0.03 0.05", at="0 0 0.15", **small)
    (tmp_path / "arm.urdf").write_text(describe_robot(cradle, plate))
    bench.record(torque).accept()
    (note,) = [note for note in diagnose(tmp_path / "d").verdict["notes"] if note.startswith(LOAD)]
    moments = re.search(r"unknown mass, with moments of (\S+), (\S+), (\S+) kg m about the frame of j2", note)
    assert moments, note
    assert [float(m) for m in moments.groups()[:2]] == pytest.approx([0.144, 0.096], abs=0.01)
    assert moments[3] == "unknown"


def test_friction_by_another_load_than_the_model_s_says_so(record, carry):
    """Friction follows the stated load here, which the torque in whole is not of: no machine has that."""
    planted = [(0, "load_dependent_friction", {"coefficient": 0.3})]
    verdict = diagnose(record(planted, runs=4, duration=8.0, extra_torque=carry([4.0] * 4), seed=33)).verdict
    assert ("a", "load_dependent_friction") in {(e["joint"], e["effect"]) for e in verdict["verdict"]}
    (told,) = [note for note in verdict["notes"] if "load_dependent_friction is fitted" in note]
    assert told.startswith("a: ")


def test_a_resting_joint_whose_mass_is_on_its_axis_tells_no_mass(tmp_path):
    """As of a cobot's wrist: its torque is the sensor's noise, and no limit of the drive."""

    def torque(q, v, a, rng, t):
        one = chain(q[:, :1], v[:, :1], a[:, :1], 1.7, 0.3) + rub(v[:, :1], 0.2, 0.1)
        return np.hstack([one, 0.0 * one]) + 2e-3 * a[:, :1] + rng.normal(0, 0.02, q.shape)

    def rest(q, k):
        return q * [1.0, 0.0] + np.random.default_rng(k).normal(0.0, 2e-5, q.shape)

    bench = Bench(tmp_path, 2, size=0.8, rate=125.0, runs=4, seconds=16.0)
    shape = {"moments": "2e-3 2e-3 2e-3", "limits": "-3.1 3.1 900 9"}
    wrist = Joint("j2", "0 -1 0", 0.5, com="0 0.1 0", at="0 0 -0.3", **shape)
    (tmp_path / "arm.urdf").write_text(describe_robot(pivot("j1", 0, 1.2, -0.3), wrist))
    said = bench.record(torque, position=rest).accept()
    assert any("j2: no motion in the train runs" in line for line in said)
    notes = diagnose(tmp_path / "d").verdict["notes"]
    assert not [note for note in notes if note.startswith(LOAD)], notes


def test_pushes_are_not_told_as_a_body_of_which_nothing_is_known(tmp_path):
    """The joint is moved by hand in two of three training runs."""
    runs = iter(range(4))

    def torque(q, v, a, rng, t):
        push = np.convolve(rng.normal(0.0, 1.0, len(t)), np.exp(-np.arange(400) / 80.0))[: len(t), None]
        return torque_of(1.2, 0.2, 0.05, noise=0.02)(q, v, a, rng, t) + (next(runs) < 2) * 0.2 * push

    bench = Bench(tmp_path, 1, size=0.6, rate=100.0, seconds=20.0, runs=4, frequencies=(0.2, 0.4, 0.7))
    bench.record(torque).accept()
    notes = diagnose(tmp_path / "d").verdict["notes"]
    assert not [note for note in notes if "moments of unknown, +0, unknown" in note], notes


def test_a_balancer_of_a_slide_is_no_mass(tmp_path):
    """A cylinder carries 40 N of a slide's 78 N of weight; the rotor hides what the mass does otherwise."""

    def torque(q, v, a, rng, t):
        return 8.0 * (9.81 + a) + 6.0 * a - 40.0 + rub(v, 9.0, 20.0) + rng.normal(0, 0.8, q.shape)

    bench = Bench(tmp_path, 1, size=0.1, rate=100.0, runs=4, frequencies=(0.2, 0.5, 0.9))
    slide = Joint("j1", "0 0 1", 8.0, kind="prismatic", limits="-1 1 900 9")
    (tmp_path / "arm.urdf").write_text(describe_robot(slide))
    said = bench.record(torque).accept("--position-unit", "m")
    assert any("of the weight that the stated bodies have there" in line for line in said)
    (note,) = [note for note in diagnose(tmp_path / "d").verdict["notes"] if note.startswith(LOAD)]
    assert "no mass or moment of one link is certain" in note and "balancer" in note
