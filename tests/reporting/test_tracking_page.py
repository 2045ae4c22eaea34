"""The page of a tracked machine, from files made by hand; what it says stands in the ``.txt`` file."""

import json

import numpy as np
import pandas as pd
import pytest

from wearscope.reporting.page_strip import read_strip
from wearscope.reporting.tracking_page import (
    Tracking,
    list_panels,
    read_tracking,
    trend_names,
    trend_table,
    write_tracking_page,
)
from wearscope.storage import tables

ENTRY = {
    "joint": "a", "effect": "coulomb", "parameter": "level", "change": 0.6, "ci95": [0.4, 0.8],
    "unit": "N m", "since": "d3", "equivalent": ["viscous"],
}  # fmt: skip
HIDDEN = "The friction of b changed by +9 % (+7 to +11 %), measure <this>."
SEEN = {"a": {"friction": 0.05, "mass": 0.2}, "b": {"friction": 0.3}}
BODY = {
    "joint": "a", "effect": "payload_error", "parameter": "mass", "change": 0.5, "ci95": [0.4, 0.6],
    "unit": "kg", "since": "d4", "equivalent": [], "anywhere": ["b"],
}  # fmt: skip
WORN = {
    "session": "d4", "joint": "a", "effect": "wear", "level": 12.5,
    "parameters": {"eta7": {"value": 0.06, "ci95": [0.03, 0.1], "unit": "N m"}}, "fixed": {"alpha": 1.0},
}  # fmt: skip
OUTCOME = {
    "dataset": "arm", "reference": ["d1", "d2"], "false_alarm_rate": 0.01, "friction_limit": 0.3,
    "reference_scatter": [{"session": "d0", "joint": "b", "rms": 3.1, "others": 0.21}],
    "sessions": [
        {"session": "d3", "changes": [ENTRY], "cannot_tell": [], "smallest_visible": SEEN},
        {"session": "d4", "changes": [ENTRY], "cannot_tell": [HIDDEN], "smallest_visible": SEEN},
    ],
    "wear": [WORN],
    "trends": [{"joint": "a", "effect": "friction", "slope": 0.02, "ci95": [0.01, 0.03], "unit": "1/session",
                "p": 0.01, "sessions_left": [5.2, 3.4, 8.9]}],
    "healthy": {"terms": [{"joint": "a", "effect": "coulomb"}],
                "temperatures": {"a": [20.0, 30.0], "b": None},
                "scatter": {"friction": 0.01, "torque": 0.002, "sessions": 2}},
    "notes": ["r9.parquet: has no session and was not used."], "version": "0.1.0 (abc)",
}  # fmt: skip


def write(folder, outcome=OUTCOME):
    changes = [change for session in outcome["sessions"] for change in session["changes"]]
    joints = dict.fromkeys(["a", "b", *(change["joint"] for change in changes)])
    parameters = [("friction", "torque"), ("coulomb", "level")]
    parameters += [(change["effect"], change["parameter"]) for change in changes]
    rows = [
        {"session": session, "joint": joint, "effect": effect, "parameter": parameter, "value": 6.0 + k,
         "value_low": 5.8 + k, "value_high": 6.2 + k, "change": float(k), "change_low": k - 0.2,
         "change_high": k + 0.2, "unit": "N m", "p": 0.5, "named": False, "healthy": k < 2}
        for k, session in enumerate(["d1", "d2", "d3", "d4"])
        for joint in joints
        for effect, parameter in dict.fromkeys(parameters)
    ]  # fmt: skip
    tables.write_table(folder / "changes.parquet", pd.DataFrame(rows))
    (folder / "tracking.json").write_text(json.dumps(outcome))
    write_tracking_page(folder)
    return (folder / "report.html").read_text()


def last(*changes, **fields):
    """An outcome whose later sessions are one, with these changes."""
    session = {"session": "d4", "changes": list(changes), "cannot_tell": [], "smallest_visible": SEEN}
    return OUTCOME | {"sessions": [session | fields]}


QUIET = [one | {"changes": [], "cannot_tell": []} for one in OUTCOME["sessions"]]
EVENT = {"joint": "a", "run": "r", "t": 1.0, "seconds": 0.2, "size": 9.0}
EVENTS = QUIET[1] | {"events": [EVENT, EVENT | {"t": 2.0}, EVENT | {"t": 3.0}]}
WARM = (
    "The friction of b changed by +30 % (+28 to +32 %), by wear or by its temperature: the reference records "
    "no temp_b. Record it."
)
CASES = {
    "friction changed": OUTCOME,
    "nothing changed": OUTCOME | {"sessions": QUIET, "trends": [], "wear": []},
    "the cause is unknown": OUTCOME | {
        "sessions": [one | {"cannot_tell": [WARM]} for one in QUIET], "trends": [], "wear": [],
    },
    "a body is mounted": last(
        BODY, BODY | {"parameter": "moment_x", "change": 0.1, "ci95": [0.08, 0.12], "unit": "kg m"}
    ),
    "a joint wears": last(ENTRY | {"effect": "wear", "parameter": "eta7"}),
    "five joints changed": last(*(ENTRY | {"joint": joint} for joint in "abcde")),
    "the limit is assumed": OUTCOME | {"friction_limit_assumed": True},
    "no rise is sure": OUTCOME | {"trends": [OUTCOME["trends"][0] | {"sessions_left": [None] * 3}]},
    "the limit is reached": OUTCOME | {
        "trends": [OUTCOME["trends"][0] | {"sessions_left": [-1.5, -2.0, -1.0]}]
    },
    "short events are no change": OUTCOME | {"sessions": [QUIET[0], EVENTS]},
    "changes were seen before": OUTCOME | {"sessions": [OUTCOME["sessions"][0], EVENTS]},
    "a change cannot be told": OUTCOME | {
        "sessions": [QUIET[0], EVENTS | {"cannot_tell": ["The friction of a may have changed. Measure it."]}]
    },
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_page_tells_what_changed_since_when_and_what_cannot_be_told(case, tmp_path, says):
    page = write(tmp_path, CASES[case])
    says(case, read_strip(tmp_path / "report.html").kind, page)


def test_the_trend_has_friction_in_per_cent_and_what_changed_in_its_unit(tmp_path):
    write(tmp_path)
    tracking = read_tracking(tmp_path)
    assert list(trend_names(tracking).values()) == [
        "friction [% of healthy]",
        "Coulomb friction at a, level [N m]",
    ]
    table = trend_table(tracking)
    shares = table[(table["what"] == "friction") & (table["joint"] == "a")]
    # The healthy value is 6, the changes 0 to 3.
    assert shares["value"].to_numpy() == pytest.approx(100 * np.array([6, 7, 8, 9]) / 6)
    assert shares["low"].iloc[0] == pytest.approx(100 * 5.8 / 6)
    assert shares["state"].to_list() == ["healthy, held out"] * 2 + ["change named"] * 2
    level = table[table["what"] == "Coulomb friction at a, level"]
    assert level["value"].to_list() == [6.0, 7.0, 8.0, 9.0] and set(level["joint"]) == {"a"}
    other = table.loc[table["joint"] == "b", "state"].to_list()
    assert other == ["healthy, held out"] * 2 + ["no change named", "changed, cause not told"]


def test_a_change_of_unknown_cause_is_a_state_of_the_trend(tmp_path):
    write(tmp_path, CASES["the cause is unknown"])
    table = trend_table(read_tracking(tmp_path))
    assert set(table.loc[table["joint"] == "b", "state"]) == {"healthy, held out", "changed, cause not told"}
    assert set(table.loc[table["joint"] == "a", "state"]) == {"healthy, held out", "no change named"}
    write(tmp_path, CASES["nothing changed"])
    assert set(trend_names(read_tracking(tmp_path))) == {"friction"}


def test_folder_in_which_nothing_was_tracked_is_refused(tmp_path, refuses):
    refuses(write_tracking_page, tmp_path)


def test_each_joint_that_changed_has_a_panel_with_its_alarm_line(tmp_path):
    html = write(tmp_path)
    tracking = read_tracking(tmp_path)
    panels = list_panels(tracking, trend_table(tracking))
    assert [title for title, *_ in panels.values()] == ["Friction of a", "Friction of b"]
    rows = panels["panel-0"][2]
    assert set(rows["joint"]) == {"a"} and rows["alarm"].to_list()[2:] == [105.0, 105.0]
    assert rows["alarm"].isna().to_list()[:2] == [True, True]
    assert 'id="panel-0-chart"' in html and html.count('data-name="panel-') == 2
    moved = [{"session": "d4", "changes": [BODY], "cannot_tell": [], "smallest_visible": SEEN}]
    table = pd.read_parquet(tmp_path / "changes.parquet")
    body = table[table["effect"] == "coulomb"].assign(effect="payload_error", parameter="mass", unit="kg")
    tracking = Tracking(OUTCOME | {"sessions": moved}, pd.concat([table, body]))
    table = trend_table(tracking)
    # A mass at joint a is no change of its friction.
    state = table.set_index(["what", "joint", "session"])["state"]
    assert state["friction", "a", "d4"] == "no change named"
    assert state["weight on the link of a, mass", "a", "d4"] == "change named"
    (title, axis, rows) = list_panels(tracking, table)["panel-0"]
    assert (title, axis) == ("Weight on the link of a, mass", "mass [kg]") and rows["alarm"].isna().all()
