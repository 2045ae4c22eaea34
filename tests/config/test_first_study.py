"""The study that `benchmarks.workflow --first` times is the default study as it stood at first."""

import yaml

from benchmarks.workflow import write_first_study
from wearscope.config import load_config


def test_the_first_study_asks_for_1128_simulations_and_the_full_model(tmp_path):
    write_first_study(tmp_path / "first.yaml")
    study = load_config(yaml.safe_load((tmp_path / "first.yaml").read_text()))
    points = study.design.count_points(study.factors)
    cells = len(study.robots) * len(study.cycles)
    audited = len(study.robots) * study.audit.cycles * study.count_audit_points()
    assert cells * (2 * points + study.simulation.nominal_runs) + audited == 1128
    assert list(study.detectors) == ["A", "B", "C", "D"]
    assert not study.surrogates.filling.enabled and not study.direct.enabled and not study.reevaluate.enabled
    assert study.audit.enabled and study.closed_loop.demonstration
    assert {study.snr.model, study.scope.model} == {"full"}
