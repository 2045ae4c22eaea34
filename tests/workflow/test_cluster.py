"""The smallest study through the cluster profiles: same bytes as on this machine alone."""

import re

import clones
import pytest
import yaml
from calls import call_python
from one_node_slurm import NoSlurm, start_slurm
from slurm_ways import WAYS, WORKS, build_command, read_results, run

#: Profiles, with the executor of each.
PROFILES = {"slurm": "slurm", "srun": "cluster-sync", "kubernetes": "kubernetes"}


def read_profile(name: str) -> dict:
    return yaml.safe_load((clones.ROOT / "profiles" / name / "config.yaml").read_text())


def dry_run(*arguments: str) -> str:
    words = ("-m", "snakemake", "-n", "--configfile", f"{clones.TINY}/config.yaml", *arguments)
    done = call_python(*words, folder=clones.ROOT)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout + done.stderr


@pytest.mark.parametrize("name", PROFILES)
def test_profile_only_sets_what_snakemake_and_its_plugin_know(name):
    executor = PROFILES[name]
    pytest.importorskip(
        f"snakemake_executor_plugin_{executor.replace('-', '_')}", reason="make cluster installs it"
    )
    assert read_profile(name)["executor"] == executor
    known = set(re.findall(r"--([a-z][a-z-]+)", call_python("-m", "snakemake", "--help").stdout))
    assert read_profile(name).keys() <= known


def test_what_every_job_asks_for_grows_when_it_is_tried_anew():
    defaults = dict(text.split("=", 1) for text in read_profile("default")["default-resources"])
    assert defaults.keys() == {"mem_mb", "runtime"}
    assert all("attempt" in text for text in defaults.values())
    assert all(read_profile(name)["retries"] > 0 for name in PROFILES)


def count_jobs(text: str, rule: str) -> int:
    """Jobs of a rule in a dry run's table."""
    found = re.search(rf"^{rule} +(\d+)$", text, re.MULTILINE)
    return int(found[1]) if found else 0


def test_jobs_are_longer_on_a_cluster():
    """There a robot and test-cycle's study fits into one job; audit and direct Monte Carlo follow it."""
    pytest.importorskip("snakemake_executor_plugin_slurm", reason="make cluster installs it")
    here, there = dry_run("--cores", "1"), dry_run("--profile", "profiles/slurm")
    assert count_jobs(here, "simulate_points") > 7 and count_jobs(here, "simulate_study") == 0
    assert count_jobs(there, "simulate_points") == 2 and count_jobs(there, "simulate_study") == 1


def test_kubernetes_plans_the_study_on_its_volume():
    for plugin in ("executor_plugin_kubernetes", "storage_plugin_fs"):
        pytest.importorskip(f"snakemake_{plugin}", reason="make cluster installs it")
    text = dry_run("--profile", "profiles/kubernetes", "--default-storage-prefix", str(clones.ROOT))
    assert count_jobs(text, "simulate_points") == 2 and count_jobs(text, "simulate_study") == 1


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    """Environment in which the commands of a one-node SLURM find it."""
    pytest.importorskip("snakemake_executor_plugin_slurm", reason="make cluster installs it")
    try:
        with start_slurm(tmp_path_factory.mktemp("node") / "slurm") as environment:
            yield environment
    except NoSlurm as reason:
        pytest.skip(str(reason))


@pytest.mark.long
@pytest.mark.parametrize("name", ["tiny", "track"])
def test_one_node_slurm_writes_the_same_bytes(name, slurm, tmp_path):
    """Snakemake started on the node, and the work sent as one job; the first costs nothing to speak of."""
    work = WORKS[name]
    arguments = work.arguments(tmp_path)
    runs, results = {}, {}
    for way in ("local", *WAYS):
        tree = clones.copy_tree(tmp_path / way)
        runs[way] = run(tree, [*build_command(way, work, 1), *arguments], slurm)
        results[way] = read_results(tree)
        print(f"{name}, {way}: {runs[way].wall:.0f} s, {runs[way].within:.0f} s of them at work")
    assert results["local"] and all(one == results["local"] for one in results.values())
    assert runs["srun"].added_to(runs["local"]) < 0.2 * runs["local"].wall


@pytest.mark.long
def test_jobs_of_the_rules_write_the_same_bytes(slurm, tmp_path):
    trees = {name: clones.copy_tree(tmp_path / name) for name in ("local", "by_rules")}
    clones.run_well(trees["local"])
    # A one-node SLURM answers at once, without accounting.
    options = ["--slurm-status-command=squeue", "--slurm-init-seconds-before-status-checks=1"]
    options += ["--seconds-between-status-checks=1", "--jobs=10", "--slurm-keep-successful-logs"]
    words = ["-m", "snakemake", "--profile", "profiles/slurm", *options]
    there = trees["by_rules"]
    done = call_python(*words, "--configfile", f"{clones.TINY}/config.yaml", folder=there, env=slurm)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    assert len(list((there / ".snakemake" / "slurm_logs").rglob("*.log"))) > 5
    assert clones.digests(there) == clones.digests(trees["local"])
    markers = [len(list(tree.rglob("_chunk-*.json"))) for tree in trees.values()]
    assert markers[1] < markers[0], "the cluster's jobs are no longer than the local ones"
