"""The smallest study through `profiles/kubernetes`, on a stand-in for the cluster: same bytes as here."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import clones
import pytest
from calls import call
from kubernetes_stand_in import ENDPOINTS, IMAGE, UNSHARE, NoStandIn, start_cluster

CLAIM = "claim"


@pytest.fixture
def user(tmp_path):
    """A clone that git manages, where the volume is mounted, and a stand-in whose pods see no clone."""
    for plugin in ("executor_plugin_kubernetes", "storage_plugin_fs"):
        pytest.importorskip(f"snakemake_{plugin}", reason="make cluster installs it")
    if missing := [name for name in ("git", "rsync", "unshare") if shutil.which(name) is None]:
        pytest.skip(f"not installed: {', '.join(missing)}")
    tree, volume = clones.copy_tree(tmp_path / "there"), tmp_path / "study"
    volume.mkdir()
    for words in ("init --quiet", "add ."):
        subprocess.run(["git", *words.split()], cwd=tree, check=True)
    try:
        with start_cluster(tmp_path / "cluster", [tree, clones.ROOT / "src"], [CLAIM]) as cluster:
            yield tree, volume, cluster
    except NoStandIn as reason:
        pytest.skip(str(reason))


def run_profile(tree: Path, volume: Path, cluster, *arguments: str):
    """Run Snakemake through the profile, on a machine that mounts the volume where the pods do."""
    command = [sys.executable, "-m", "snakemake", *arguments, "--profile", "profiles/kubernetes"]
    command += ["--container-image", IMAGE, "--kubernetes-persistent-volumes", f"{CLAIM}:{volume}"]
    command += ["--default-storage-prefix", str(volume), "--configfile", f"{clones.TINY}/config.yaml"]
    # A stand-in answers at once.
    command += ["--seconds-between-status-checks=1"]
    mount = f'mount --bind "{cluster.claim(CLAIM)}" "{volume}" && exec "$@"'
    return call(*UNSHARE, "sh", "-ec", mount, "sh", *command, folder=tree, env=cluster.client)


@pytest.mark.long
def test_pods_write_the_same_bytes(user, tmp_path):
    """A pod lost with its node is sent again; one that is killed ends the run, and the next run goes on."""
    tree, volume, cluster = user
    here = clones.copy_tree(tmp_path / "here")
    clones.run_well(here)
    planned = run_profile(tree, volume, cluster, "-n").stdout
    rules = set(re.findall(r"^(\w+) +\d+$", planned, re.MULTILINE)) - {"total", "all"}
    assert {"simulate_study", "write_report"} < rules and not cluster.submitted
    fates = {"screen_robot": "lost", "compute_test_quantities": "killed"}
    cluster.fate = lambda pod: fates.pop(pod.rule, "runs")

    done = run_profile(tree, volume, cluster)
    told = done.stdout + done.stderr
    assert done.returncode != 0 and not fates, told[-6000:]
    # The plugin asks for the log of a container before this one, which there is not.
    assert "previous terminated container" in told
    first = [pod.rule for pod in cluster.submitted]
    screening = [pod for pod in cluster.submitted if pod.rule == "screen_robot"]
    assert [pod.container["resources"]["requests"]["memory"] for pod in screening] == ["1000M", "2000M"]
    assert "--attempt 2" in screening[1].command

    done = run_profile(tree, volume, cluster)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    second = [pod.rule for pod in cluster.submitted[len(first) :]]
    assert rules == {*first, *second}
    assert not {"screen_robot", "check_cycles", "simulate_study"} & {*second}
    assert clones.read_carried(cluster.claim(CLAIM) / "results" / "tiny") == clones.digests(here)
    assert not list((tree / "results").rglob("*.parquet"))

    for pod in cluster.submitted:
        wanted = pod.container["resources"]
        assert wanted["requests"].keys() == {"cpu", "memory", "ephemeral-storage"} and "limits" not in wanted
    # Jobs that were under way when the first run ended stay until someone deletes them.
    assert {pod.rule for pod in cluster.pods.values()} <= {*first} and not cluster.secrets
    assert cluster.calls == set(ENDPOINTS.values())
