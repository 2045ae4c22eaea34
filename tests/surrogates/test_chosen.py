import numpy as np
import pandas as pd
import pytest
from planted_study import PAPER_OPTIONS

from wearscope.designs.checks import view_for_axis
from wearscope.designs.factors import PAPER_FACTORS
from wearscope.designs.kinds import checking_design, filling_design, make_design, validation_design
from wearscope.surrogates.chosen import (
    ChosenSurrogate,
    _state,
    choose_surrogates,
    noise_ceiling,
    read_chosen,
    read_noise,
)
from wearscope.surrogates.kinds.linear import fit_quadratic
from wearscope.surrogates.validation import model_fit

NAMES = [factor.name for factor in PAPER_FACTORS]
DESIGNS = {
    "identification": make_design("central_composite", PAPER_FACTORS, PAPER_OPTIONS),
    "validation": validation_design("central_composite", PAPER_FACTORS, PAPER_OPTIONS),
    "filling": filling_design(PAPER_FACTORS, replicates=12),
    "checking": checking_design(PAPER_FACTORS, points=60),
}


def curved(z):
    return 2 + z[:, 0] + 0.5 * np.exp(0.4 * z[:, 3])


CUBE = DESIGNS["checking"][NAMES].to_numpy()


def rough(z):
    return np.sin(12 * z[:, 0]) * np.cos(11 * z[:, 3])


def cells(truths, noise=0.05, seed=0):
    rng = np.random.default_rng(seed)
    parts = []
    for fda, truth in truths.items():
        for name, design in DESIGNS.items():
            part = view_for_axis(design, 1)[["point", *NAMES]].copy()
            part["y"] = truth(part[NAMES].to_numpy()) + noise * rng.standard_normal(len(part))
            parts.append(part.assign(robot="r", cycle="c", axis=1, fda=fda, set=name, status="ok"))
    return pd.concat(parts, ignore_index=True)


@pytest.fixture(scope="module")
def quantities():
    truths = {"curved": curved, "nothing": lambda z: np.zeros(len(z)), "rough": rough}
    table = cells(truths, seed=1)
    return pd.concat([table, cells({"same": lambda z: np.full(len(z), 0.5)}, noise=0.0)], ignore_index=True)


@pytest.fixture(scope="module")
def chosen(quantities):
    return choose_surrogates(quantities, PAPER_FACTORS, ["quadratic", "gaussian_process"])


def test_states_say_how_far_a_cell_came(chosen):
    states = chosen.set_index("fda")["state"]
    assert states["curved"] == "reached"
    assert states["nothing"] == "at ceiling"  # all that scatters is noise
    assert states["rough"] == "short"  # far below what the noise would let it reach
    assert states["same"] == "constant"


def test_the_fit_is_that_of_the_checking_runs_and_no_choice_sees_them(quantities, chosen):
    row = chosen.set_index("fda").loc["curved"]
    surrogate = dict(read_chosen(chosen, quantities))[("r", "c", 1, "curved")]
    new = quantities[(quantities["fda"] == "curved") & (quantities["set"] == "checking")]
    assert row["fit"] == pytest.approx(model_fit(new["y"], surrogate.predict(new[NAMES].to_numpy())))
    other = quantities.copy()
    hidden = (other["set"] == "checking") & (other["fda"] == "curved")
    other.loc[hidden, "y"] = -other.loc[hidden, "y"]
    again = choose_surrogates(
        other[other["fda"] == "curved"], PAPER_FACTORS, ["quadratic", "gaussian_process"]
    ).iloc[0]
    assert again["parameters"] == row["parameters"] and again["spread"] == row["spread"]
    assert again["fit"] < 0 < row["fit"]


@pytest.mark.parametrize(
    ("fit", "lowest", "state"),
    [
        (98.0, 99.0, "reached"), (97.9, 97.0, "at ceiling"), (97.0, 97.0, "at ceiling"),
        (96.9, 97.0, "short"), (97.0, np.nan, "short"),
    ],
)  # fmt: skip
def test_a_goal_and_a_ceiling_are_reached_from_their_values_on(fit, lowest, state):
    surrogate = ChosenSurrogate(fit_quadratic(CUBE, curved(CUBE), NAMES), tuple(NAMES))
    assert _state(surrogate, fit, lowest, 98.0) == state


def test_noise_and_ceiling_come_from_replicates(quantities, chosen):
    rows = chosen.set_index("fda")
    assert rows.loc["curved", "noise"] == pytest.approx(0.05, rel=0.6)
    assert rows.loc["curved", "ceiling_low"] < rows.loc["curved", "ceiling"] < 100
    assert rows.loc["nothing", "ceiling"] < 40
    assert read_noise(chosen)[("r", "c", 1, "same")] == 0.0
    assert np.isnan(noise_ceiling(np.arange(5.0), 0.0, 0)).all()


def test_the_ceiling_is_by_hand():
    """Of 1 and 5, whose deviation is 2, a noise of 0.3 leaves 85 %; 3.9403 is chi-square's 5 % of ten."""
    ceiling, low = noise_ceiling(np.array([1.0, 5.0]), 0.9, 10)
    assert ceiling == pytest.approx(85.0)
    assert low == pytest.approx(100.0 * (1.0 - np.sqrt(0.9 / 3.940299) / 2.0), rel=1e-6)
    assert np.isfinite(noise_ceiling(np.array([1.0, 5.0]), 0.9, 1)).all()
    for y in ([1.0], [2.0, 2.0]):
        assert np.isnan(noise_ceiling(np.array(y), 0.9, 10)).all()


def test_the_ceiling_is_that_of_the_truth_itself():
    rng = np.random.default_rng(2)
    truth = rng.standard_normal(4000)
    y = truth + 0.3 * rng.standard_normal(4000)
    ceiling, low = noise_ceiling(y, 0.3**2 * 1000, 1000)
    assert ceiling == pytest.approx(model_fit(y, truth), abs=0.5)
    assert ceiling - 3 < low < ceiling


def test_bad_tables_get_one_sentence(quantities, chosen, refuses):
    refuses(choose_surrogates, quantities[quantities["set"] != "checking"], PAPER_FACTORS)
    refuses(list, read_chosen(chosen, quantities[quantities["set"] != "filling"]))
    refuses(list, read_chosen(chosen, quantities[quantities["fda"] == "rough"]))
    few = quantities[quantities["set"].isin(["checking"]) | (quantities["point"] < 3)]
    refuses(choose_surrogates, few[few["fda"] == "curved"], PAPER_FACTORS)
