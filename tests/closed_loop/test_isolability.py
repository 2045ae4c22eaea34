"""Which effects the runs separate, which motion would help, and what the runs leave undetermined."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import subspace_angles

from wearscope.closed_loop.diagnostics.isolability import measure_isolability
from wearscope.closed_loop.diagnostics.undetermined import find_undetermined
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.model.declared import fit_declared_model
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.closed_loop.posing import find_prismatic
from wearscope.closed_loop.selection.detection_limits import find_limits
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.problem import Problem
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.stepwise import find_standard
from wearscope.effects.base import Effect, Parameter, load_effect


def pose(folder, own=()):
    prepared = prepare(read_dataset(folder, find_prismatic))
    declared = [load_effect(name) for name in prepared.dataset.fields.declared_effects]
    problem = Problem(prepared, declared, own)
    return problem, fit_declared_model(
        prepared, problem.declared_terms, problem.inertial, problem.layout.blocks
    )


@pytest.fixture
def angles(record):
    problem, model = pose(record(runs=3))
    return problem, model, measure_isolability(problem, model)


def pick(table, joint, a, b):
    pair = table[(table["joint"] == joint) & (table["effect_a"] == a) & (table["effect_b"] == b)]
    assert len(pair) == 1
    return pair.iloc[0]


def test_collinear_candidates_have_no_angle(angles):
    _, _, table = angles
    same = pick(table, "a", "coulomb_asymmetry", "torque_offset")
    # They differ only at rest, and rows at rest do not count.
    assert same["angle_deg"] < 3.0 and same["largest_angle_deg"] < 3.0
    apart = pick(table, "a", "quadratic_viscous", "torque_offset")
    assert apart["angle_deg"] > 60.0


def test_wrong_inertials_and_a_payload_are_one_and_the_same_at_the_last_link(angles):
    _, _, table = angles
    pair = table[table["effect_a"].isin(["inertial_error"]) & (table["effect_b"] == "payload_error")]
    assert len(pair) == 2
    assert (pair["angle_deg"] < 1.0).all()


def test_angle_agrees_with_subspaces_of_explicit_columns(angles):
    problem, model, table = angles

    def stack(name):
        effect = load_effect(name)
        term = ModelTerm(effect, 0, tuple(effect.pack({})[1]), tuple(range(len(effect.coefficients))))
        runs = problem.prepared.runs_for("train")
        return np.concatenate(
            [
                (run.reduce(term.columns(run.signals)) * w[:, :, None])[:, 0]
                for run, w in zip(runs, model.weights, strict=True)
            ]
        )

    declared = np.concatenate(
        [(x * w[:, :, None])[:, 0] for x, w in zip(model.columns, model.weights, strict=True)]
    )
    base = np.linalg.svd(declared, full_matrices=False)
    base = base[0][:, base[1] > 1e-9 * base[1][0]]
    project = lambda x: x - base @ (base.T @ x)  # noqa: E731
    a, b = project(stack("quadratic_viscous")), project(stack("joint_spring"))
    expected = np.degrees(subspace_angles(a, b))
    found = pick(table, "a", "joint_spring", "quadratic_viscous")
    assert found["angle_deg"] == pytest.approx(expected.min(), abs=0.1)
    sine = np.linalg.norm(a) / np.linalg.norm(stack("quadratic_viscous"))
    assert found["sine_b"] == pytest.approx(sine, rel=1e-3)


def test_what_the_runs_leave_undetermined_is_said(angles):
    problem, *_ = angles
    limits = [{}] * problem.prepared.n
    said = find_undetermined(problem, limits)
    assert any("same payload" in one["reason"] for one in said)
    assert not any(one["effect"] == "temperature_dependent_friction" for one in said)
    unknown = np.full_like(problem.joined.temperature, np.nan)
    problem.joined = replace(problem.joined, temperature=unknown)
    said = find_undetermined(problem, limits)
    missing = [one for one in said if one["effect"] == "temperature_dependent_friction"]
    assert [one["joint"] for one in missing] == ["a", "b"]
    assert "temperature" in missing[0]["motion"]


def test_an_effect_of_the_user_takes_part_without_being_listed_anywhere(record):
    """Absorbed by viscous friction, without an excitation of its own: it is told all the same."""
    own = Effect(
        name="churning",
        form="k v",
        coefficients=(Parameter("k", "{torque} s/{position}"),),
        source="test",
        depends_on=("qd_{joint}",),
        regressors=lambda signals, joint, shape: signals.v[:, [joint]],
    )
    problem, model = pose(record(runs=3), own=(own,))
    table = measure_isolability(problem, model)
    assert "churning" in {*table["effect_a"], *table["effect_b"]}
    search = Search(problem, Policy())
    limits = find_limits(search, find_standard(search))
    assert limits[0]["churning"] > 1.0 > limits[0]["quadratic_viscous"]
    told = [one for one in find_undetermined(problem, limits) if one["effect"] == "churning"]
    assert all("below all of the joint's torque" in one["reason"] for one in told) and len(told) == 2


def test_an_effect_at_its_limit_adds_what_a_name_must_remove(angles):
    """By plain least squares: of the torque at the limit the model leaves 6 % of what it leaves anyway."""
    problem, *_ = angles
    search = Search(problem, Policy())
    limit = find_limits(search, ())[0]["quadratic_viscous"]
    model = search.assemble(())
    keep = model.layout.keep[:, 0]
    speed = problem.candidate(load_effect("quadratic_viscous"), 0).rows[0][keep][:, 0]
    torque = np.concatenate([run.measured for run in problem.train])[keep, 0]
    added = speed * limit * np.sqrt(np.mean(torque**2) / np.mean(speed**2))
    columns, target = model.columns[0][keep], model.target[keep, 0]
    left = [y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0] for y in (added, target)]
    assert left[0] @ left[0] == pytest.approx(Policy().material_share * (left[1] @ left[1]), rel=0.02)
