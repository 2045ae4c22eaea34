"""What a further run would tell: against brute force, and followed on a machine with a planted effect."""

from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from benchmarks.board.advice import list_advice_cases, run_advice_case, summarise_advice
from benchmarks.board.generate import generate_dataset
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.diagnostics.next_measurement import (
    FASTER,
    list_payloads,
    plan_measurements,
    planning_model,
    write_measurements,
)
from wearscope.closed_loop.diagnostics.plan import COLD, list_temperatures, make_planned_run
from wearscope.closed_loop.diagnostics.rivalry import Rivalry, list_names, look_along
from wearscope.cycles.base import Reference
from wearscope.reporting.loop_words import tell_measurement

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def case():
    """A vertical joint whose gain error, mass, payload and counterbalance all look like gravity's share."""
    return list_advice_cases("development", 200, 77)[1]


@pytest.fixture(scope="module")
def diagnosis(tmp_path_factory, case):
    folder = tmp_path_factory.mktemp("advice") / case.name
    generate_dataset(folder, case.machine, case.planted, case.seed, case.recipe)
    return diagnose(folder)


@pytest.fixture(scope="module")
def rivalry(diagnosis):
    number, named = next((k, a) for k, a in enumerate(diagnosis.attributions) if a.equivalent)
    index = len(diagnosis.before.entries) + number
    names = list_names(diagnosis.after, index, named.equivalent, list(diagnosis.problem.effects))
    return Rivalry(diagnosis.after, index, names)


def test_evidence_is_what_least_squares_leaves(rivalry):
    """The contrast from sums is that of a fit of the rival and the model to the other's torque, row
    by row."""
    p = len(rivalry.base)
    x = np.concatenate([part.reshape(-1, part.shape[2]) for _, part in rivalry.recorded.parts])
    for true, model in ((0, 1), (1, 0)):
        torque = x[:, p:] @ rivalry.betas[true]
        left = []
        for span in rivalry.spans[model]:
            columns = np.hstack([x[:, :p], x[:, span]])
            columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
            fit = np.linalg.lstsq(columns, torque, rcond=1e-10)[0]
            left.append(float(np.sum((torque - columns @ fit) ** 2)))
        contrast = rivalry.contrast(rivalry.recorded, true, model)
        assert contrast.evidence == pytest.approx(min(left), rel=0.02, abs=1e-3 * float(torque @ torque))


def test_a_planned_run_has_the_regressors_that_its_recording_has(diagnosis, rivalry):
    prepared = diagnosis.prepared
    run = prepared.runs_for("train")[0]
    s = run.signals
    record = next(one for one in prepared.dataset.runs if one.file == run.file)
    reference = Reference(np.arange(len(s.t)) / prepared.band.rate, s.q, s.v, s.a)
    planned = make_planned_run(prepared, reference, record.payload, float(np.mean(s.temperature)))
    both = planned.keep & run.keep[: len(planned.keep)]
    assert both.mean() > 0.8 * run.keep.mean()
    own = rivalry.recorded.parts[0][1]
    other = rivalry.sum_along([look_along(rivalry.model, planned, [])]).parts[0][1]
    p = len(rivalry.base)
    rows = both.any(axis=1)
    a, b = own[rows][..., :p], other[rows][..., :p]
    assert np.linalg.norm(a - b) < 0.05 * np.linalg.norm(a)


def test_the_advice_widens_the_angle_and_is_written_as_a_cycle(diagnosis, tmp_path):
    (advice,) = plan_measurements(diagnosis)
    assert advice.names[0] == "torque_constant_error" and len(advice.names) > 1
    assert advice.angle_after > 10 * advice.angle_before
    assert advice.evidence_after > 10 * advice.evidence_before + 1.0
    model = planning_model(diagnosis.prepared, diagnosis.models["before"])
    low, high = model.position_limits
    assert (advice.plan.reference.q >= low - 1e-9).all() and (advice.plan.reference.q <= high + 1e-9).all()
    assert advice.plan.payload in list_payloads(diagnosis.prepared)
    (entry,) = write_measurements(tmp_path, [advice], diagnosis.prepared.dataset.joints)
    page = tell_measurement(entry)
    if advice.power >= 0.9:
        assert (tmp_path / "next_measurement_1.csv").is_file() and "Record" in page
    else:
        assert not list(tmp_path.iterdir()) and "None of the" in page


def test_planned_speeds_keep_to_the_urdf(diagnosis, tmp_path):
    """A joint's planned speed is 1.5 times the recorded one, but not above a stated limit that it kept to."""
    prepared, before = diagnosis.prepared, diagnosis.models["before"]
    recorded = np.array(before.drive.speed_limit) / 1.1
    text = prepared.dataset.urdf.read_text(encoding="utf-8")
    for factor, expected in ((1.2, 1.2), (0.5, 1.0), (9.0, FASTER)):
        tree = ElementTree.fromstring(text)
        for joint, speed in zip(before.joints, recorded, strict=True):
            tree.find(f"joint[@name='{joint}']/limit").set("velocity", f"{factor * speed:.17g}")
        (tmp_path / "robot.urdf").write_text(ElementTree.tostring(tree, encoding="unicode"), encoding="utf-8")
        fields = prepared.dataset.fields.robot.model_copy(update={"urdf": "robot.urdf"})
        fields = prepared.dataset.fields.model_copy(update={"robot": fields})
        limited = replace(prepared, dataset=replace(prepared.dataset, folder=tmp_path, fields=fields))
        planned = planning_model(limited, before).drive.speed_limit
        np.testing.assert_allclose(planned, expected * recorded, rtol=1e-9)


def test_following_the_advice_names_the_planted_effect(case, tmp_path):
    row = run_advice_case(case, tmp_path)
    assert (row["error"], row["outcome"]) == ("", "right")
    summary = summarise_advice([row, row | {"outcome": "still open"}, {"outcome": "one name"}])
    assert summary["cases"] == 3 and summary["followed"]["right"]["hits"] == 1
    assert summary["followed"]["still open"] == 1


@pytest.mark.parametrize(
    ("wrist", "found"),
    [((32.0, 40.0), [34.0, 30.0, 38.0, COLD]), ((np.nan, np.nan), [32.0, 28.0, 36.0, COLD])],
)
def test_a_joint_without_temperatures_leaves_those_of_the_others(wrist, found):
    """A recording counts by the mean of what it records; one without any says nothing."""
    warmth = [[28.0, wrist[0]], [36.0, wrist[1]], [np.nan, np.nan]]
    runs = [SimpleNamespace(signals=SimpleNamespace(temperature=np.tile(w, (5, 1)))) for w in warmth]
    assert list_temperatures(SimpleNamespace(runs_for=lambda use: runs)) == found
    assert np.isnan(list_temperatures(SimpleNamespace(runs_for=lambda use: runs[2:]))).all()
