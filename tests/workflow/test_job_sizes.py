"""Jobs as long as a cluster likes them: how they are cut shows in no table and no recording."""

import re

import clones
import pandas as pd
import pytest
from changed_fields import changed_fields

from wearscope.integrity import find_damage, main

#: 14 points a simulation job, 9 a job of test quantities: no chunk of one ends with one of the other.
CUT = {"keep_recordings": True, "job_seconds": 1.4, "point_seconds": 0.1, "quantity_seconds": 0.155}


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """A tree with one study, uncut and cut."""
    tree = clones.copy_tree(tmp_path_factory.mktemp("job-sizes"))
    for name, simulation in (("uncut", {"chunk": 400, "keep_recordings": True}), ("cut", CUT)):
        clones.write_study(tree, name, simulation=simulation)
    return tree


def test_test_quantities_are_cut_as_simulations_are(clone):
    """15, 15, 19, 7, 20 and 20 points: four sets, direct Monte Carlo, and that with a mismatch."""
    uncut, cut = (clones.count_jobs(clone, f"{name}.yaml", "direct") for name in ("uncut", "cut"))
    assert "compute_quantity_chunk" not in uncut
    assert cut["compute_quantity_chunk"] == 2 + 2 + 3 + 1 + 3 + 3
    assert cut["simulate_points"] == 2 + 2 + 2 + 1 + 2 + 1 + 2 + 1  # and the nominal runs
    assert cut["compute_test_quantities"] == uncut["compute_test_quantities"] == 1


@pytest.mark.slow
def test_a_cut_study_is_the_uncut_one_to_the_byte(clone):
    direct = "parts/direct_quantities/medium/short_moves.parquet"
    for name in ("uncut", "cut"):
        targets = ["test_quantities", f"results/{name}/{direct}"]
        clones.run_well(clone, *targets, study=f"{name}.yaml")
        assert not clones.stale(clone, *targets, study=f"{name}.yaml")
    whole, found = (clones.read_tables(clone / "results" / name) for name in ("uncut", "cut"))
    chunks = [name for name in found if "quantity_chunks" in name]
    assert {name: found[name] for name in found if name not in chunks} == whole
    assert {direct, "test_quantities.parquet"} <= whole.keys()
    sets = {re.search(r"/(\w+)-\d+\.parquet", name)[1] for name in chunks if "failed" not in name}
    assert sets == {"identification", "validation", "filling", "checking", "direct"}


@pytest.mark.slow
def test_recordings_go_once_their_test_quantities_are_there_and_come_back_where_they_are_needed(clone):
    """Equal tables; a later stage alone needs none; a changed detector has the points simulated again."""
    clones.write_study(clone, "dropped", simulation={"chunk": 14})
    results = clone / "results/dropped"
    clones.run_well(clone, "test_quantities", study="dropped.yaml")
    left = {path.parent.parent.name for path in results.rglob("recording.parquet")}
    assert left == {"nominal"} and not list(results.rglob("_chunk-*.tar"))
    clones.run_well(clone, "test_quantities", study="uncut.yaml")
    kept = pd.read_parquet(clone / "results/uncut/test_quantities.parquet")
    pd.testing.assert_frame_equal(pd.read_parquet(results / "test_quantities.parquet"), kept)
    assert not clones.stale(clone, "test_quantities", study="dropped.yaml")
    assert not any("simulate" in rule for rule in clones.stale(clone, "snr", study="dropped.yaml"))
    assert main([str(results)]) == 0
    with changed_fields(clone / "dropped.yaml") as study:
        first = next(iter(study["detectors"]))
        study["detectors"] = {first: study["detectors"][first]}
    clones.run_well(clone, "test_quantities", study="dropped.yaml")
    again = pd.read_parquet(results / "test_quantities.parquet")
    pd.testing.assert_frame_equal(again, kept[kept["fda"] == first].reset_index(drop=True))


@pytest.mark.slow
def test_packed_recordings_are_those_of_files_a_point(clone):
    """A file a chunk, checked and made again as any other: the same tables and recordings."""
    clones.write_study(clone, "packed", simulation=CUT | {"packed": True})
    results = clone / "results/packed"
    clones.run_well(clone, "test_quantities", study="packed.yaml")
    assert not list(results.rglob("recording.parquet")) and not list(results.rglob("point=*"))
    assert not clones.stale(clone, "test_quantities", study="packed.yaml")
    assert not list(find_damage(results))
    pack = next(results.rglob("filling/_chunk-0.tar"))
    content = pack.read_bytes()
    pack.write_bytes(content[:3000] + bytes([content[3000] ^ 1]) + content[3001:])
    assert [error.path for error in find_damage(results)] == [pack]
    for table in results.rglob("*.parquet"):
        if "quantities" in str(table):
            table.unlink()
    assert "set aside" in clones.run(clone, "test_quantities", study="packed.yaml").stderr
    clones.run_well(clone, "test_quantities", study="packed.yaml")
    assert pack.read_bytes() == content
    kept = clones.read_carried(results)
    whole = clones.read_tables(clone / "results/cut")
    assert kept == {name: whole[name] for name in whole if "direct" not in name}
