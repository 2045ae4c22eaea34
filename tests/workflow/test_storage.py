"""The smallest study where jobs share no file system: Snakemake's `fs` storage carries what they declare."""

import importlib.util
import shutil
import tarfile
from pathlib import Path

import pytest

_SPEC = importlib.util.spec_from_file_location("workflow_clones", Path(__file__).with_name("clones.py"))
clones = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(clones)


@pytest.mark.long
def test_what_jobs_declare_is_all_that_later_ones_need(tmp_path):
    """What a job leaves beside its outputs is lost with its local copies, twice in the study."""
    pytest.importorskip("snakemake_storage_plugin_fs", reason="make cluster installs it")
    if shutil.which("rsync") is None:
        pytest.skip("not installed: rsync, by which the storage plugin copies")
    here, there = (clones.copy_tree(tmp_path / name) for name in ("here", "there"))
    clones.run_well(here)
    store, local = tmp_path / "store", tmp_path / "local"
    options = ["--default-storage-provider", "fs", "--default-storage-prefix", str(store)]
    options += ["--local-storage-prefix", str(local), "--shared-fs-usage", "none"]
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
