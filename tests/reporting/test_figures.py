import numpy as np

from wearscope.evaluation.scope import count_matrix
from wearscope.reporting.figures import draw_scope, draw_sensitivity, draw_snr, use_symlog
from wearscope.reporting.style import figure_bytes, figure_style, new_figure


def titles(figure):
    return [ax.get_title(loc="left") for ax in figure.axes]


def test_sensitivity_has_a_panel_a_detector_and_says_what_is_odd(study):
    figure = draw_sensitivity(study.surrogates)
    shown = [title for title in titles(figure) if title]
    assert shown[0] == "A  (8 cells)"
    assert shown[1] == "B  (8 cells; y falls with wear in 1)"
    assert shown[2] == "C  (8 cells; no direct effect of wear, hence no box, in 1)"
    ticks = [label.get_text() for label in figure.axes[-1].get_xticklabels()]
    assert len(ticks) == 21 and ticks[:2] == ["f", "w1"] and "w3·w5" in ticks and "w5²" in ticks
    assert figure_bytes(figure, "png").startswith(b"\x89PNG")


def test_sensitivity_of_many_groups_says_that_some_are_left_out(study, monkeypatch):
    monkeypatch.setattr("wearscope.reporting.figures.MOST", 3)
    figure = draw_sensitivity(study.surrogates, by=("robot", "cycle", "axis", "fda"))
    assert figure.get_suptitle() == "First 3 of 24 groups"
    assert len([title for title in titles(figure) if title]) == 3


def test_sensitivity_of_one_group_of_all(study):
    assert titles(draw_sensitivity(study.surrogates, by=()))[0].startswith("all  (24 cells")


def test_far_values_get_a_logarithmic_scale():
    with figure_style():
        ax = new_figure(2, 2).subplots()
    assert not use_symlog(ax, [1.0, -15.0, np.nan])
    assert use_symlog(ax, [1.0, -150.0, np.inf]) and ax.get_yscale() == "symlog"


def test_snr_counts_missing_cells_and_ranks(study):
    figure = draw_snr(study.snr, study.ranking)
    labels = [label.get_text() for label in figure.axes[0].get_xticklabels()]
    assert labels == ["A\n8 cells", "B\n8 cells", "C\n8 cells\n1 n/a"]
    order = [label.get_text() for label in figure.axes[1].get_yticklabels()]
    assert order == list(study.ranking["fda"])
    legend = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert "y falls with wear" in legend


def test_scope_counts_are_those_of_the_table(study):
    rows = study.exact_scope("w3")
    sigma, delta, count = count_matrix(rows, rows["passes"])
    assert count.shape == (5, 4) and count.sum() == rows["passes"].sum()
    one = rows[(rows["delta"] == delta[3]) & (rows["sigma"] == sigma[1])]
    assert count[3, 1] == one["passes"].sum()


def test_scope_has_a_row_a_method_and_a_column_a_detector(study):
    figure = draw_scope(study.scope, "w3", study.factors)
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert [sum(name in label for label in labels) for name in ("closed form", "KDE")] == [1, 1]
    assert len([title for title in titles(figure) if title]) == 3
    only = study.scope[study.scope["method"] == "exact"]
    assert not [ax for ax in draw_scope(only, "w5", study.factors, by=()).axes if "KDE" in ax.get_ylabel()]
