"""The smallest study where jobs share no file system: Snakemake's `fs` storage carries what they declare."""

import importlib.util
import shutil
import tarfile
from pathlib import Path

import pytest

_SPEC = importlib.util.spec_from_file_location("workflow_clones", Path(__file__).with_name("clones.py"))
clones = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(clones)


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
    """What a job leaves beside its outputs is lost with its local copies, twice in the study."""
    options, store, local = storage
    here, there = (clones.copy_tree(tmp_path / name) for name in ("here", "there"))
    clones.run_well(here)
    for target in ("simulate", "test_quantities", "all"):
        clones.run_well(there, target, *options)
        shutil.rmtree(local, ignore_errors=True)
    assert not list((there / "results").rglob("*.parquet"))
    results = store / "results" / "tiny"
    for pack in results.rglob("_chunk-*.tar"):
        with tarfile.open(pack) as tar:
            tar.extractall(pack.parent, filter="data")
    carried = {path.relative_to(results).as_posix(): path.read_bytes() for path in results.rglob("*.parquet")}
    assert carried == clones.digests(here)
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
