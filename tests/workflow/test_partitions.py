"""A study of many robots, run by partitions: the same tables, planned in a moment."""

import re
import shutil

import clones
import pytest
import yaml
from calls import call, start, wait_until
from changed_fields import changed_fields

from wearscope.integrity import find_damage
from wearscope.storage import tables

TABLES = (
    "test_quantities", "failures", "failed_simulations", "surrogates", "validation", "snr",
    "ranking", "sensitivity", "thresholds", "rankings",
)  # fmt: skip
SCOPES = ("scope", "group_scope")
#: What has a row for each point, coefficient or grid cell of each robot.
LARGE = ("test_quantities", "surrogates", "scope")


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """A tree with one study of two robots, whole and divided."""
    tree = clones.copy_tree(tmp_path_factory.mktemp("partitions"))
    factors = yaml.safe_load((tree / clones.TINY / "config.yaml").read_text())["factors"]
    study = {
        "robots": ["medium", "large"],
        "factors": {name: factors[name] for name in ("f", "w3")},
        "surrogates": {"filling": {"enabled": False}},
        "snr": {"runs": 1000, "model": "full"},
        "scope": {"model": "full", "factors": ["w3"], "grid": [5, 4], "runs": 1000},
        "audit": {"enabled": False},
        "direct": {"enabled": False},
        "reevaluate": {"enabled": False},
    }
    for name, above in (("whole", 2), ("divided", 1)):
        clones.write_study(tree, name, **study, partitions={"above": above})
    return tree


def test_a_job_a_partition_takes_the_place_of_all_that_is_done_for_its_robots(clone):
    whole, divided = (clones.count_jobs(clone, f"{name}.yaml", "scope") for name in ("whole", "divided"))
    assert divided["run_partition"] == 2
    assert {"simulate_points", "check_cycles", "compute_test_quantities"} <= whole.keys() - divided.keys()
    assert "run_partition" not in whole


def test_what_is_said_of_all_robots_reads_no_table_of_all_robots(clone):
    """Only the parts of the large tables, which are gone through one at a time."""
    settings = ("--config", "study=fresh", "audit={enabled: true}")
    text = clones.run_well(clone, "-n", "report", *settings, study="divided.yaml")
    # Nothing is there yet, so that each job's reason names all of its inputs that are results.
    pattern = r"^Job \d+: (.*)\nReason: .*Input files updated by another job: (.*)$"
    inputs = {told: set(files.split(", ")) for told, files in re.findall(pattern, text, re.MULTILINE)}
    asking = {
        "Compare the factors (Q-1)",
        "Conclude which detector to use, what it finds and what it bears",
        "Draw where the detectors work",
        "Join the audits of the partitions",
        "Write the report: robots and test-cycles at a glance",
    }
    assert asking <= inputs.keys() and "Choose the points of the audit" not in inputs
    joined = {f"results/fresh/{table}.parquet" for table in LARGE}
    assert all(table in text for table in joined)  # they are made, for who reads them
    for told in asking:
        assert not joined & inputs[told], told
    parts = {f"results/fresh/partitions/0000{k}/scope.parquet" for k in (0, 1)}
    assert parts <= inputs["Conclude which detector to use, what it finds and what it bears"]


@pytest.mark.slow
def test_tables_of_a_divided_study_are_those_of_the_whole(clone):
    asked = ("test_quantities", "surrogates", "validate", "scope", "snr", "sensitivity", "conclusion")
    for name in ("whole", "divided"):
        clones.run_well(clone, *asked, study=f"{name}.yaml")
    conclusions = [(clone / f"results/{name}/conclusion.json").read_text() for name in ("whole", "divided")]
    assert conclusions[0] == conclusions[1]
    for table in (*TABLES, *SCOPES):
        one, other = (clone / f"results/{name}/{table}.parquet" for name in ("whole", "divided"))
        assert one.read_bytes() == other.read_bytes(), table
    assert not clones.stale(clone, "scope", study="divided.yaml")
    traces = list((clone / "results/divided").glob("partitions/*/traces/*"))
    assert sorted(path.name for path in traces) == ["large", "medium"]
    assert not list(find_damage(clone / "results/divided"))
    recording = next(traces[0].glob("*/validation/point=1/recording.parquet"))
    recording.unlink()
    assert [error.path for error in find_damage(clone / "results/divided")] == [recording]


@pytest.mark.slow
def test_the_report_of_a_divided_study_leads_to_those_of_its_robots(clone):
    clones.run_well(clone, "report", study="divided.yaml")
    page = (clone / "results/divided/report.html").read_text()
    links = dict(re.findall(r'<a href="(partitions/\d+/report.html)">(\w+)</a>', page))
    assert sorted(links.values()) == ["large", "medium"]
    for link, robot in links.items():
        assert "1 robot" in (own := (clone / "results/divided" / link).read_text()) and robot in own
    overview = tables.read_table(clone / "results/divided/overview.parquet")
    assert sorted(overview["robot"]) == ["large", "medium"]
    assert page.index(f">{overview['robot'].iloc[0]}</a>") < page.index(f">{overview['robot'].iloc[1]}</a>")
    assert not clones.stale(clone, "report", study="divided.yaml")


@pytest.mark.slow
def test_a_study_as_one_job_is_the_study(clone):
    """Planned anew by its job, which does what is missing and no more."""
    study = yaml.safe_load((clone / "whole.yaml").read_text()) | {"robots": ["medium"]}
    for name in ("here", "as_one"):
        (clone / f"{name}.yaml").write_text(yaml.safe_dump(study | {"study": name}))
    clones.run_well(clone, "conclusion", study="here.yaml")
    clones.run_well(clone, "in_one_job", study="as_one.yaml")
    for table in ("test_quantities", "scope", "snr", "thresholds"):
        one, other = (clone / f"results/{name}/{table}.parquet" for name in ("here", "as_one"))
        assert one.read_bytes() == other.read_bytes(), table
    assert clones.stale(clone, "all", study="as_one.yaml") <= {"all"}
    report = clone / "results/as_one/report.html"
    written = report.stat().st_mtime_ns
    clones.run_well(clone, "in_one_job", study="as_one.yaml")
    assert report.stat().st_mtime_ns == written


@pytest.mark.slow
def test_the_snakemake_of_a_job_ends_with_it(clone):
    words = clones.command("scope", study="divided.yaml")
    process = start(*words, "--config", "study=killed", folder=clone)

    def count() -> int:
        pattern = f"{clone}/results/killed|results/killed/partitions"
        return int(call("pgrep", "--full", "--count", pattern).stdout)

    assert wait_until(count, 120.0), "no partition began"
    process.kill()
    process.wait()
    assert wait_until(lambda: not count(), 30.0)


@pytest.mark.slow
def test_a_partition_that_fails_is_named_with_where_it_says_why(clone):
    (clone / "broken.py").write_text("raise ValueError('no motion')\n")
    shutil.copy(clone / "divided.yaml", clone / "broken.yaml")
    with changed_fields(clone / "broken.yaml") as study:
        study |= {"study": "broken", "cycles": ["broken.py"]}
    done = clones.run(clone, "test_quantities", study="broken.yaml")
    assert done.returncode != 0
    told = re.search(r"(results/broken/logs/partitions/0000\d\.log): it failed", done.stderr)
    assert told and "no motion" in (clone / told[1]).read_text()
