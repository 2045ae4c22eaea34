import numpy as np
import pandas as pd
import pytest

from wearscope.closed_loop.diagnostics.profiles import bin_quartiles, profile_residuals


def test_medians_of_bins_follow_a_line_and_quartiles_its_scatter():
    rng = np.random.default_rng(1)
    x = np.linspace(-1, 1, 40_000)
    found = bin_quartiles(x, 3.0 * x + rng.standard_normal(x.size))
    assert found["median"] == pytest.approx(3.0 * found["x"], abs=0.12)
    assert (found["high"] - found["low"]).mean() == pytest.approx(2 * 0.6745, rel=0.05)
    assert found["n"].sum() >= 0.99 * x.size


def test_a_signal_that_stands_still_is_one_bin_and_too_few_values_none():
    one = bin_quartiles(np.full(9, 2.0), np.arange(9.0))
    assert [*one["x"], *one["median"], *one["low"], *one["high"], *one["n"]] == [2, 4, 2, 6, 9]
    assert not bin_quartiles(np.arange(4.0), np.arange(4.0))["x"].size
    assert not bin_quartiles(np.arange(9.0), np.full(9, np.nan))["x"].size


def test_rows_that_do_not_count_are_left_out_and_joints_keep_their_signals():
    n = 200
    t = np.arange(n) / 10.0
    residual, signals = [], []
    for joint, slope in (("a", 1.0), ("b", -2.0)):
        x = np.sin(t) * (1 if joint == "a" else 5)
        y = slope * x
        y[:50] = 1e6
        residual.append(
            pd.DataFrame(
                {
                    "t": t + 3.0, "run": "r", "joint": joint, "residual_before": y, "residual_after": 0.0,
                    "counts": np.arange(n) >= 50,
                }
            )
        )  # fmt: skip
        zero = dict.fromkeys(("qd", "qdd", "load"), 0.0)
        signals.append(pd.DataFrame({"t": t, "run": "r", "joint": joint, "q": x, "temp": np.nan, **zero}))
    table = profile_residuals(pd.concat(residual), pd.concat(signals))
    before = table[table["stage"] == "before"]
    own = before[(before["joint"] == "b") & (before["signal"] == "q_b")]
    assert own["median"].to_numpy() == pytest.approx(-2.0 * own["x"].to_numpy(), abs=0.5)
    cross = before[(before["joint"] == "b") & (before["signal"] == "q_a")]
    assert cross["median"].to_numpy() == pytest.approx(-10.0 * cross["x"].to_numpy(), abs=0.5)
    assert (table.loc[table["stage"] == "after", "median"] == 0.0).all()
    assert not (table["signal"] == "temp_a").any() and table["median"].abs().max() < 20
    assert table.loc[table["signal"] == "t", "x"].between(5, 20).all()
