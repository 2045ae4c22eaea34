"""The smallest study where jobs share no file system: Snakemake's `fs` storage carries what they declare."""

import shutil

import clones
import pytest


@pytest.fixture
def storage(tmp_path):
    """Snakemake's options for a storage, with its folder and that of the local copies."""
    pytest.importorskip("snakemake_storage_plugin_fs", reason="make cluster installs it")
    if shutil.which("rsync") is None:
        pytest.skip("not installed: rsync, by which the storage plugin copies")
    store, local = tmp_path / "store", tmp_path / "local"
    options = ["--default-storage-provider", "fs", "--default-storage-prefix", str(store)]
    return [*options, "--local-storage-prefix", str(local), "--shared-fs-usage", "none"], store, local


@pytest.mark.long
def test_what_jobs_declare_is_all_that_later_ones_need(storage, tmp_path):
    """What a job leaves next to its outputs is lost with its local copies, twice in the study."""
    options, store, local = storage
    here, there = (clones.copy_tree(tmp_path / name) for name in ("here", "there"))
    clones.run_well(here)
    for target in ("simulate", "test_quantities", "all"):
        clones.run_well(there, target, *options)
        shutil.rmtree(local, ignore_errors=True)
    assert not list((there / "results").rglob("*.parquet"))
    assert clones.read_carried(store / "results" / "tiny") == clones.digests(here)
    assert clones.stale(there, *options) <= {"all"}


@pytest.mark.long
def test_tables_of_a_partition_are_carried(storage, tmp_path):
    options, store, _ = storage
    here, there = (clones.copy_tree(tmp_path / name) for name in ("here", "there"))
    divided = ["test_quantities", "--config", "partitions={above: 0}"]
    clones.run_well(here, *divided)
    clones.run_well(there, *divided, *options)
    tables = list((store / "results/tiny").rglob("*.parquet"))
    assert {"test_quantities.parquet", "screening.parquet"} <= {path.name for path in tables}
    for path in tables:
        assert path.read_bytes() == (here / path.relative_to(store)).read_bytes(), path.name
