"""What the page says of chosen surrogates, withheld answers and direct runs."""

import pandas as pd
import pytest

from wearscope.reporting import answers, trust
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.study_page import render_study


@pytest.fixture
def chosen(study, change):
    cells = study.snr[["robot", "cycle", "axis", "fda"]].drop_duplicates()
    fit = {"A": 97.0, "B": 91.0, "C": 88.0}
    state = {"A": "reached", "B": "at ceiling", "C": "short"}
    table = cells.assign(
        kind="gaussian_process",
        fit=cells["fda"].map(fit),
        state=cells["fda"].map(state),
        ceiling=99.0,
        n_points=155,
    )
    config = {**study.config, "scope": {**study.config["scope"], "model": "chosen"}}
    return change(chosen=table, config=config)


def answer_table(**answer):
    return pd.DataFrame(
        [{"fda": fda, "model": "chosen", "share_inside": 0.5, "answer": one} for fda, one in answer.items()]
    )


def test_fits_and_states_are_counted(chosen):
    text = trust.surrogate_quality(chosen)
    assert "Median fit of the chosen surrogate on the checking runs" in text
    assert (
        "Residual energy (A) 97 %, Distribution distance (B) 91 %, Friction fit (C) 88 %" in text
        and "The lowest fit is 88 %." in text
    )
    assert "95 % or more in 8 of 24 cells, in 8 more as far as the noise" in text
    assert "In 8 cells the points did not suffice." in text


def test_a_withheld_answer_is_shown_as_withheld_and_not_given(chosen, change):
    best = str(chosen.ranking["fda"].iloc[0])
    given = dict.fromkeys(("A", "B", "C"), "given")
    full = chosen.detector_name(best)
    open_study = change(chosen=chosen.chosen, config=chosen.config, audit_answers=answer_table(**given))
    shut = change(
        chosen=chosen.chosen,
        config=chosen.config,
        audit_answers=answer_table(**{**given, best: "withheld"}),
    )
    assert answers.best_detector(open_study)[0].split(" has the highest")[0].endswith(f"({best})")
    said = answers.best_detector(shut)
    assert not any(full in one for one in [*said, *answers.effective_scope(shut)])
    groups = [{one.group for one in answers.tolerances(each, "w3")} for each in (shut, open_study)]
    assert full not in groups[0] and full in groups[1]
    assert any(
        one.startswith(f"Withheld are signal-to-noise ratio and scope of {full}:")
        for one in trust.doubts(shut)
    )
    assert not any("Withheld" in one for one in trust.doubts(open_study))


def test_all_may_be_withheld(chosen, change):
    none = change(config=chosen.config, audit_answers=answer_table(A="withheld", B="withheld", C="withheld"))
    assert answers.best_detector(none)[-1] == "Unknown: no group has a median SNR."
    assert len(answers.effective_scope(none)) == 1


def test_direct_runs_stand_beside_the_surrogate(chosen, change):
    direct = pd.DataFrame(
        {
            "robot": "medium", "cycle": "a", "axis": 1, "fda": ["A", "B"], "runs": 60, "n_failed": 0,
            "snr_direct": [2.0, 5.0], "direct_low": [1.5, 4.0], "direct_high": [2.5, 6.0],
            "snr_surrogate": [2.2, 9.0], "surrogate_low": [2.1, 8.0], "surrogate_high": [2.3, 10.0],
            "agrees": [True, False],
        }
    )  # fmt: skip
    study = change(chosen=chosen.chosen, config=chosen.config, direct=direct)
    said = trust.direct_outcome(study)[0]
    assert "60 simulations with and without wear" in said and "for 1 of 2 detectors" in said
    assert trust.direct_outcome(chosen) == []
    page = render_study(study, compare_with_paper(study))
    assert "2 (1.5 to 2.5)" in page and "2.2 (2.1 to 2.3)" in page
    assert "runs that no choice saw" in page and "8 gaussian process" in page


def test_few_cells_are_said_to_rest_on_their_own_intervals(study, change):
    ranking = study.ranking.assign(interval_from="each cell")
    said = answers.best_detector(change(ranking=ranking))
    assert "from each cell's own interval" in said[0]
    assert not any("whatever cells are drawn" in one for one in said)


def test_noise_free_cells_are_told(study, change):
    snr = study.snr.assign(status="noise-free")
    assert any("no noise, so there is no SNR" in one for one in answers.best_detector(change(snr=snr)))
