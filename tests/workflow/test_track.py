"""The target `track` in a copy of the tree: files, what a new session costs, and what is refused."""

import json
import shutil
from pathlib import Path

import clones
import pandas as pd
import pytest
from changed_fields import changed_fields
from session_machine import write_machine

from wearscope.robots.model import load_model
from wearscope.storage import tables

pytestmark = pytest.mark.slow
DAYS = [{"temperature": x} for x in (28.0, 42.0, 35.0)] + [{"temperature": 40.0}, {"wear": 0.2}]


@pytest.fixture(scope="module")
def tracked(tmp_path_factory) -> tuple[Path, Path]:
    """A copy in which a machine was tracked, and the machine's folder."""
    place = tmp_path_factory.mktemp("track")
    machine = write_machine(place / "machine", DAYS, 3)
    clone = clones.copy_tree(place / "clone")
    clones.run_well(clone, "track", "--config", f"dataset={machine}")
    return clone, machine


def test_files_are_those_of_the_contract(tracked):
    folder = tracked[0] / "results" / "tracking" / "duo"
    told = json.loads((folder / "tracking.json").read_text())
    assert told["dataset"] == "duo" and told["reference"] == ["s0", "s1", "s2"]
    assert told["false_alarm_rate"] == 0.01
    assert (told["friction_limit"], told["friction_limit_assumed"]) == (0.3, True)
    assert [one["session"] for one in told["sessions"]] == ["s3", "s4"]
    quiet, worn = told["sessions"]
    assert quiet["changes"] == [] and quiet["cannot_tell"] == []
    for entry in worn["changes"]:
        assert list(entry) == [
            "joint", "effect", "parameter", "change", "ci95", "unit", "since", "equivalent",
        ]  # fmt: skip
        assert entry["joint"] == "a" and entry["since"] == "s4"
        assert entry["ci95"][0] < entry["change"] < entry["ci95"][1]
    assert {entry["effect"] for entry in worn["changes"]} <= {"coulomb", "viscous", "wear"}
    table = tables.read_table(folder / "changes.parquet")
    assert {"session", "joint", "effect", "parameter", "value", "change", "unit", "p"} <= set(table.columns)
    assert set(table["session"]) == {"s0", "s1", "s2", "s3", "s4"}
    assert set(table.loc[table["named"], "session"]) == {"s4"}
    (entry,) = [e for e in load_model(folder / "model_tracked.yaml").effects if e.effect == "wear"]
    assert entry.joint == "a" and entry.identified and set(entry.intervals) == {"eta7", "eta8", "eta9"}
    assert "Tracked: duo" in (folder / "report.html").read_text()
    friction = table[(table["effect"] == "friction") & (table["joint"] == "a")].set_index("session")
    assert friction.loc["s4", "change_low"] > 0 and friction.loc["s3", "change_high"] > 0


def test_the_history_keeps_the_answer_of_the_target(tracked):
    (line,) = (tracked[0] / "results" / "history.jsonl").read_text().splitlines()
    told = json.loads(line)
    assert (told["kind"], told["name"]) == ("tracking", "tracking/duo") and told["strip"]["answer"]


def test_nothing_is_left_to_do(tracked):
    clone, machine = tracked
    assert clones.stale(clone, "track", "--config", f"dataset={machine}") == set()


@pytest.fixture
def plan(tracked):
    """What a dry run says of the machine with other fields; both are put back."""
    clone, machine = tracked
    kept = (machine / "dataset.yaml").read_text()

    def dry_run(change):
        with changed_fields(machine / "dataset.yaml") as content:
            change(content)
        return clones.run_well(clone, "-n", "track", "--config", f"dataset={machine}")

    yield dry_run
    (machine / "dataset.yaml").write_text(kept)
    (machine / "runs" / "new.parquet").unlink(missing_ok=True)


def test_new_session_costs_itself_alone(tracked, plan):
    def record(content):
        table = pd.read_parquet(tracked[1] / content["runs"][-1]["file"])
        table["tau_a"] += 0.01
        table.to_parquet(tracked[1] / "runs" / "new.parquet")
        content["runs"].append({"file": "runs/new.parquet", "use": "test", "session": "s5"})

    said = plan(record)
    assert "Compare session s5" in said and "Compare session s3" not in said
    assert "Identify the healthy machine" not in said
    assert "Say what changed" in said


def test_changed_reference_makes_all_anew(plan):
    said = plan(lambda content: content["reference"].append("s3"))
    assert "Identify the healthy machine" in said and "Compare session s4" in said


def test_what_cannot_be_tracked_is_told_in_one_sentence(tracked, tmp_path):
    clone, machine = tracked
    other = tmp_path / "machine"
    shutil.copytree(machine, other)
    with changed_fields(other / "dataset.yaml") as content:
        del content["reference"]
    for options, sentence in (
        (("--config", f"dataset={other}"), "reference is missing; list the sessions"),
        (("--config", "seed=1"), "config: dataset is missing; say which machine to track"),
    ):
        assert sentence in clones.run_ill(clone, "-n", "track", *options)
    # The loop can be closed all the same.
    assert "Close the loop" in clones.run_well(clone, "-n", "closed_loop", "--config", f"dataset={other}")
