from pathlib import Path

import pytest
import yaml

from wearscope.closed_loop.inference.policy import Policy
from wearscope.config import SimulationSettings, StudyConfig, label, load_config, make_schema
from wearscope.designs.factors import PAPER_FACTORS, Factor
from wearscope.designs.kinds import make_design

CONFIG = Path(__file__).parents[2] / "config"


@pytest.fixture
def paper() -> dict:
    return yaml.safe_load((CONFIG / "config.yaml").read_text())


def test_default_study_is_the_paper(paper):
    study = load_config(paper)
    assert study.study == "paper"
    assert (len(study.robots), len(study.cycles), study.axes) == (2, 6, [1, 2, 3])
    assert study.detectors.keys() == set("ABCDE")
    made = [Factor(**one) for one in study.factor_table()]
    for ours, papers in zip(made, PAPER_FACTORS, strict=True):
        assert (ours.name, ours.kind, ours.role) == (papers.name, papers.kind, papers.role)
        assert (ours.low, ours.high) == (papers.low, papers.high)
        assert ours.validation_range == papers.validation_range
        assert ours.nominal_coded == papers.nominal_coded
    # (20) and Sec. 6.4
    assert (study.snr.f0, study.snr.delta, study.snr.sigma, study.snr.runs) == (-0.5, 1, 0.25, 100_000)
    scope = study.scope
    assert (scope.f0, scope.delta, scope.sigma, scope.grid) == (-2, (0, 4), (0.01, 1), (30, 30))
    assert (scope.factors, scope.p_f, scope.p_d, scope.runs) == (["w3", "w5"], 0.01, 0.99, 100_000)


def test_schema_file_is_the_model():
    assert (CONFIG / "schema.json").read_text() == make_schema(), (
        "write make_schema() of wearscope.config to config/schema.json"
    )


def test_every_setting_is_described():
    def check(schema: dict, where: str) -> None:
        for name, field in schema.get("properties", {}).items():
            assert field.get("description"), f"{where}.{name} has no text"

    schema = StudyConfig.model_json_schema()
    check(schema, "study")
    for name, section in schema["$defs"].items():
        check(section, name)


def test_a_validated_configuration_is_its_own_default(paper):
    once = load_config(paper).model_dump(mode="json")
    assert load_config(once).model_dump(mode="json") == once


def test_numbers_as_text_are_numbers(paper):
    paper["simulation"] = {"step": "1e-3"}
    paper["seed"] = "0"
    study = load_config(paper)
    assert study.simulation.step == 0.001
    assert study.seed == 0


def test_detector_shorthand(paper):
    paper["detectors"] = {"mine": "some/file.py", "A": {"use": "residual_energy", "options": {"x": 1}}}
    detectors = load_config(paper).detectors
    assert detectors["mine"].use == "some/file.py"
    assert detectors["A"].options == {"x": 1}


def test_bad_setting_is_named(paper, refuses):
    for change in (
        {"sede": 1},
        {"snr": {"sigmaa": 1}},
        {"detectors": {"A": {"use": "x", "option": {}}}},
        {"snr": {"sigma": -1}},
        {"snr": {"sigma": "small"}},
        {"scope": {"factors": ["f"]}},
        {"scope": {"p_d": 1.0}},
        {"surrogates": {"models": ["main"]}},
        {"robots": []},
        {"robots": ["medium", "medium"]},
        {"robots": ["medium", "other/medium"]},
        {"axes": [0]},
        {"axes": [1, 2, 3, 4]},
        {"axes": [1, 1]},
        {"study": "my study"},
        {"factors": {"1": {}}},
        {"study": "archive"},
        {"design": {"kind": "cube"}},
        {"max_failed_share": 2},
        {"scope": {"p_f": 0.9, "p_d": 0.8}},
        {"detect": {"p_f": 0.5, "p_d": 0.5}},
    ):
        refuses(load_config, paper | change)


def test_missing_setting_or_factor_is_named(paper, refuses):
    refuses(load_config, {name: one for name, one in paper.items() if name != "robots"})
    for gone in ("w2", "f"):
        factors = {name: one for name, one in paper["factors"].items() if name != gone}
        refuses(load_config, paper | {"factors": factors})


@pytest.mark.parametrize(
    "design",
    [
        {"kind": "central_composite"},
        {"kind": "central_composite", "generators": ["w5 = f w1 w2 w3 w4"], "centre_points": 3},
        {"kind": "face_centred", "generators": ["w5 = f w1 w2 w3 w4"]},
        {"kind": "circumscribed", "alpha": 1.8},
        {"kind": "inscribed", "centre_points": 0},
        {"kind": "full_factorial", "levels": 2},
        {"kind": "fractional_factorial", "generators": ["w4 = f w1 w2", "w5 = w1 w2 w3"]},
        {"kind": "latin_hypercube"},
        {"kind": "latin_hypercube", "points": 17},
    ],
)
def test_number_of_points_is_known_before_the_design_is_made(paper, design):
    paper["design"] = design
    study = load_config(paper)
    factors = [Factor(**one) for one in study.factor_table()]
    made = make_design(study.design.kind, factors, study.design.options(), study.seed)
    assert study.design.count_points(study.factors) == len(made)


def test_labels():
    assert label("medium") == "medium"
    assert label("path/to/arm/") == "arm"
    assert label("path/to/arm/model.yaml") == "arm"
    assert label("results/closed_loop/x/model_after.yaml") == "model_after"
    assert label("my/slow.py") == "slow"


def test_numbers_of_the_rule_are_a_section_with_its_own_defaults(paper, refuses):
    settings = load_config(paper).closed_loop
    assert settings.policy == Policy()
    paper["closed_loop"] = {"policy": {"form_error": "1e-3", "seed": 0}, "effects": ["my/hose_drag.py"]}
    changed = load_config(paper).closed_loop
    assert changed.policy == Policy(form_error=0.001, seed=0)
    assert changed.effects == ["my/hose_drag.py"] and not changed.allow_code
    for wrong in ({"policy": {"form_eror": 0.1}}, {"policy": {"flips": 5}}, {"effects": ["hose_drag"]}):
        refuses(load_config, {**paper, "closed_loop": wrong})


@pytest.mark.parametrize(
    ("change", "allowed"),
    [
        ({}, False),
        ({"allow_code": True}, True),
        ({"closed_loop": {"allow_code": True}}, True),
        # Those are the paths that a robot's model may name.
        ({"allow_code": ["mine.py"]}, False),
    ],
)
def test_code_of_a_data_set_runs_only_where_it_is_allowed(paper, change, allowed):
    assert load_config(paper | change).may_run_code() is allowed


def test_a_robot_may_borrow_wear_in_one_word_or_in_full(paper, refuses):
    paper["carry_over"] = {"medium": "large"}
    assert load_config(paper).carry_over["medium"].effects == ["wear", "temperature"]
    paper["carry_over"] = {"medium": {"source": "large", "effects": ["wear"], "reference": 40}}
    assert load_config(paper).carry_over["medium"].reference == 40.0
    for wrong in ({"arm": "large"}, {"medium": {"source": "large", "effects": ["rust"]}}):
        refuses(load_config, {**paper, "carry_over": wrong})


def test_both_sides_of_a_reevaluation_are_given_or_none(paper, refuses):
    for wrong in ({"before": ["medium"]}, {"local_points": 3, "replicates": 4}, {"cycles": ["dance"]}):
        refuses(load_config, {**paper, "reevaluate": wrong})
    study = load_config({**paper, "reevaluate": {"before": ["medium"], "after": ["large"]}})
    assert study.reevaluate.before == ["medium"]


def test_the_wear_of_a_tested_axis_is_a_fault(paper):
    assert load_config(paper).tested_factors() == ["f", "w1", "w2"]
    assert load_config({**paper, "axes": [2]}).tested_factors() == ["w1"]
    assert load_config({**paper, "axes": [2]}).worn_axes() == [1, 2, 3]
    wrist = load_config({**paper, "axes": [5, 2]})
    assert wrist.worn_axes() == [1, 2, 5] and wrist.tested_factors() == ["w2", "w1"]


@pytest.mark.parametrize(
    ("settings", "points", "quantities"),
    [
        ({"chunk": 8}, 8, None),
        ({"chunk": 8, "job_seconds": 600, "point_seconds": 0.5}, 1200, 15000),
        ({"job_seconds": 600, "point_seconds": 6, "quantity_seconds": 0.5}, 100, 1200),
        ({"job_seconds": 1, "point_seconds": 7, "quantity_seconds": 7}, 1, 1),
    ],
)
def test_a_job_s_seconds_replace_its_points(settings, points, quantities):
    made = SimulationSettings(**settings)
    assert (made.points_per_job(), made.quantities_per_job()) == (points, quantities)


def test_a_study_is_divided_only_above_its_number_of_robots():
    study = load_config(
        yaml.safe_load((CONFIG / "quick.yaml").read_text())
        | {
            "robots": ["a/r1", "a/r2", "a/r3", "a/r4", "a/r5"],
            "carry_over": {"r2": "medium"},
            "partitions": {"above": 4, "robots": 2},
        }
    )
    parts = study.divide()
    assert [part.robots for part in parts] == [["a/r1", "a/r2"], ["a/r3", "a/r4"], ["a/r5"]]
    assert [list(part.carry_over) for part in parts] == [["r2"], [], []]
    assert [part.partitions.number for part in parts] == [0, 1, 2]
    # A job reads a partition's configuration as any other, and divides it no further.
    for part in parts:
        assert load_config(part.model_dump(mode="json")) == part
        assert part.divide() == []
        assert not part.closed_loop.demonstration and part.dataset is None
    assert study.closed_loop.demonstration
    assert study.model_copy(update={"robots": study.robots[:4]}).divide() == []


def test_a_factor_may_be_a_number_by_its_path(paper, refuses):
    noise = {"description": "noise", "kind": "sensors.torque_noise", "range": [-50, 50], "unit": "%"}
    study = load_config({**paper, "factors": {**paper["factors"], "w3": noise}})
    assert study.factor_kinds()["w3"] == "sensors.torque_noise %"
    assert study.factor_ranges()["w3"] == ["sensors.torque_noise %", -50.0, 50.0]
    for kind in ("sound", "wear.axis_1", "detectors.Z.bins"):
        refuses(load_config, {**paper, "factors": {**paper["factors"], "w3": {**noise, "kind": kind}}})
    rated = {
        **paper["factors"],
        "w3": {**noise, "kind": "sensors.sample_rate", "range": [50, 250], "unit": "Hz"},
    }
    assert load_config({**paper, "factors": rated}).factor_kinds()["w3"] == "sensors.sample_rate"
    paper["simulation"] = {**paper.get("simulation", {}), "sample_rate": 125}
    refuses(load_config, {**paper, "factors": rated})


def test_a_factor_that_cannot_be_is_refused(paper, refuses):
    for name, changes in (
        ("w3", {"unit": "degF"}),
        ("w4", {"unit": "s"}),
        ("w5", {"unit": "kg"}),
        ("f", {"unit": "mm"}),
        ("w3", {"range": [86, 158]}),
        ("w3", {"range": [70, 30]}),
        ("w1", {"range": [0, 40], "validation": [5, 35]}),
        ("point", {}),
    ):
        factors = paper["factors"]
        factor = {**factors.get(name, factors["w4"]), **changes}
        refuses(load_config, paper | {"factors": factors | {name: factor}})
