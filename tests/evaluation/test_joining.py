"""Many robots are joined one at a time: the same answers as of all at once, never more than one held."""

import gc
import weakref

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from planted_study import planted_test_quantities

from wearscope.designs.factors import PAPER_FACTORS, nominal_levels
from wearscope.evaluation.conclusion import conclude_study, overview_table, threshold_tables
from wearscope.evaluation.sampled_scope import scope_table
from wearscope.evaluation.scope import (
    add_counts,
    count_scope,
    group_scope,
)
from wearscope.evaluation.sensitivity import sensitivity_of
from wearscope.evaluation.snr import snr_table
from wearscope.storage import tables
from wearscope.surrogates.fitting import fit_surrogates, surrogates_of

ROBOTS = ("r1", "r2", "r3")


class Watched:
    """Parts of a table, each made when it is asked for, and how many of them are alive at once."""

    def __init__(self, table):
        self.table, self.alive, self.most, self.rounds = table, weakref.WeakSet(), 0, 0

    def __iter__(self):
        self.rounds += 1
        for robot in self.table["robot"].unique():
            yield self.make(robot)

    def make(self, robot):
        part = Part(self.table[self.table["robot"] == robot].reset_index(drop=True))
        self.alive.add(part)
        gc.collect()
        self.most = max(self.most, len(self.alive))
        return part


class Part(pd.DataFrame):
    """A data frame that can be told apart from what is made of it."""

    __hash__ = object.__hash__

    @property
    def _constructor(self):
        return pd.DataFrame


@pytest.fixture(scope="module")
def study():
    """Planted test quantities of some robots, their surrogates, SNR and scope."""
    quantities, _ = planted_test_quantities(ROBOTS, ("c1",), (1, 2), ("A", "B"))
    surrogates = fit_surrogates(quantities, ["full"])
    grid = {"deltas": [0.0, 1.0, 2.0, 4.0], "sigmas": [0.05, 0.2, 0.5], "runs": 200, "draws": 20}
    scope = scope_table(surrogates_of(surrogates, "full"), **grid)
    return surrogates, snr_table(surrogates_of(surrogates, "full"), runs=100, draws=50), scope


@pytest.fixture(scope="module")
def whole(study):
    """Conclusions of all robots at once."""
    _, snr, scope = study
    return conclude_study([scope], snr, PAPER_FACTORS, 0.01, 0.99)


def test_a_part_that_stays_is_seen(study):
    watched = Watched(study[2])
    held = list(watched)
    assert watched.most == len(held) == len(ROBOTS)


def test_conclusions_of_parts_are_those_of_the_whole(study, whole):
    _, snr, scope = study
    watched = Watched(scope)
    found, rankings = conclude_study(watched, snr, PAPER_FACTORS, 0.01, 0.99)
    assert [one.to_mapping() for one in found] == [one.to_mapping() for one in whole[0]]
    pd.testing.assert_frame_equal(rankings, whole[1])
    # The loop's own name keeps a part while the next one is made.
    assert watched.most <= 2 and watched.rounds == 4
    assert {one.robot for one in found} == {"", *ROBOTS} and any(np.isfinite(one.wear) for one in found)


def test_counts_add_over_parts(study):
    scope = study[2]
    for by in (("fda",), ("robot", "fda"), ()):
        watched = Watched(scope)
        counts = add_counts(count_scope(part, by) for part in watched)
        pd.testing.assert_frame_equal(counts, count_scope(scope, by))
        assert watched.most <= 2
    groups = add_counts([group_scope(part) for part in Watched(scope)])
    pd.testing.assert_frame_equal(groups, group_scope(scope))


def test_counts_are_what_they_say(study):
    scope = study[2]
    counts = count_scope(scope, ("fda",))
    row = counts[counts["method"] == "exact"].iloc[-1]
    point = ("fda", "factor", "delta", "sigma")
    same = scope[np.logical_and.reduce([scope[name] == row[name] for name in point])]
    exact, kde = (same[same["method"] == method] for method in ("exact", "kde"))
    keys = ["robot", "cycle", "axis"]
    both = exact.merge(kde, on=keys, suffixes=("", "_kde"))
    assert row["cells"] == len(exact) == len(both)
    assert row["passes"] == exact["passes"].sum() and row["sure"] == (exact["confidence"] >= 0.95).sum()
    assert row["differ"] == (both["passes"] != both["passes_kde"]).sum()


def test_sensitivity_of_parts_is_that_of_the_whole(study):
    surrogates = study[0]
    for by in (("fda",), ("robot",), ()):
        watched = Watched(surrogates)
        table = sensitivity_of(watched, "full", by)
        pd.testing.assert_frame_equal(table, sensitivity_of([surrogates], "full", by))
        assert watched.most <= 2


def test_a_term_that_was_dropped_from_a_robot_is_missing_there_not_zero(study):
    surrogates = study[0]
    kept = surrogates[(surrogates["robot"] != "r2") | (surrogates["term"] != "w3")]
    table = sensitivity_of(Watched(kept), "full").set_index(["fda", "term"])
    cells = surrogates[(surrogates["term"] == "w3")].groupby(["fda", "robot"]).size()
    for fda in surrogates["fda"].unique():
        assert table.loc[(fda, "w3"), "n_nan"] == cells[fda, "r2"]
    pd.testing.assert_frame_equal(table.reset_index(), sensitivity_of([kept], "full"), check_like=True)


def test_thresholds_are_of_the_robots_that_a_conclusion_is_about(study, whole):
    surrogates, conclusions = study[0], whole[0]
    cells = [(key[:4], one) for key, one in surrogates_of(surrogates, "full")]
    parts = [[(key, one) for key, one in cells if key[0] == robot] for robot in ROBOTS]
    given = conclusions, PAPER_FACTORS, nominal_levels(PAPER_FACTORS), -2.0
    table = threshold_tables([cells], *given)
    pd.testing.assert_frame_equal(threshold_tables(parts, *given), table)
    own = table[table["asked"] != ""]
    assert (own["robot"] == own["asked"]).all() and set(own["robot"]) <= set(ROBOTS)


def test_tables_are_joined_one_part_at_a_time(study, tmp_path):
    scope = study[2]
    watched, file = Watched(scope), tmp_path / "joined.parquet"
    assert tables.join_tables(file, watched, {"delta": "1"}) == len(scope)
    assert watched.most <= 2
    pd.testing.assert_frame_equal(tables.read_table(file), scope, check_dtype=False)
    assert tables.read_units(file) == {"delta": "1"}
    # A robot's rows are a row group, which can be read alone.
    groups = pq.ParquetFile(file)
    assert groups.metadata.num_row_groups == len(ROBOTS)
    assert set(groups.read_row_group(2).to_pandas()["robot"]) == {"r3"}


def test_one_part_gives_the_bytes_of_a_table(study, tmp_path):
    scope = study[2]
    tables.join_tables(tmp_path / "joined.parquet", [scope])
    tables.write_table(tmp_path / "whole.parquet", scope)
    assert (tmp_path / "joined.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()


def test_a_join_that_fails_leaves_nothing(study, tmp_path):
    scope = study[2]
    other = scope.rename(columns={"delta": "other"})
    for parts in ([], [scope, other]):
        with pytest.raises(ValueError):
            tables.join_tables(tmp_path / "joined.parquet", parts)
    assert not list(tmp_path.iterdir())


def test_rows_of_a_robot_come_together_from_several_parts(tmp_path):
    rows = pd.DataFrame({"robot": ["a", "a", "b", "c", "c"], "x": range(5)})
    files = [tmp_path / "1.parquet", tmp_path / "2.parquet", tmp_path / "3.parquet"]
    for file, part in zip(files, (rows[:1], rows[1:4], rows[4:]), strict=True):
        tables.write_table(file, part)
    found = [part["x"].tolist() for part in tables.Parts(files).by("robot")]
    assert found == [[0, 1], [2], [3, 4]]
    doubled = tables.Parts(files, ["robot", "x"]).by("robot", lambda part: part.assign(x=2 * part["x"]))
    assert [part["x"].tolist() for part in doubled] == [[0, 2], [4], [6, 8]]


def test_the_overview_has_the_worst_first(study):
    _, snr, scope = study
    # On r3 nothing passes, on r2 only the largest change does.
    lost, late = scope["robot"] == "r3", (scope["robot"] == "r2") & (scope["delta"] < 4.0)
    scope = scope.assign(
        passes=scope["passes"] & ~lost & ~late, confidence=scope["confidence"].where(~lost & ~late, 0.0)
    )
    conclusions, _ = conclude_study([scope], snr, PAPER_FACTORS, 0.01, 0.99)
    fits = snr[["robot", "cycle", "axis", "fda"]].assign(fit=np.arange(len(snr), dtype=float))
    failed = pd.DataFrame({"robot": ["r1", "r1"], "cycle": [snr["cycle"].iloc[0]] * 2})
    table = overview_table(scope, snr, fits, failed, conclusions, PAPER_FACTORS)
    assert len(table) == len(snr[["robot", "cycle"]].drop_duplicates())
    found = table["wear"].fillna(np.inf).to_numpy()
    assert (found[:-1] >= found[1:]).all() and set(table["robot"][np.isinf(found)]) == {"r3"}
    assert table[table["robot"] == "r1"]["failed_simulations"].sum() == 2
    assert table[table["robot"] == "r3"]["cells_sure"].sum() == 0
    by_robot = {one.robot: one for one in conclusions}
    for row in table.itertuples():
        assert row.detector == by_robot[row.robot].detector
        own = (fits["robot"] == row.robot) & (fits["cycle"] == row.cycle) & (fits["fda"] == row.detector)
        assert row.fit == fits.loc[own, "fit"].min() and row.cells == own.sum()
