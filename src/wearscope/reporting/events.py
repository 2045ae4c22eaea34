"""Short events of a diagnosis or a tracked session: joints that feel one at the same time are one event."""

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from wearscope.reporting.page import format_number, render_table

Event = Mapping[str, Any]


def join_events(events: Sequence[Event]) -> list[list[Event]]:
    """Entries that overlap in time in a run, as a push at the flange is felt by several joints.

    >>> push = {"run": "r", "joint": "a", "t": 1.0, "seconds": 0.3, "size": 2.0}
    >>> [len(one) for one in join_events([push, push | {"joint": "b", "t": 1.2}, push | {"t": 4.0}])]
    [2, 1]
    """
    joined: list[list[Event]] = []
    for event in sorted(events, key=lambda one: (one["run"], one["t"])):
        last = joined[-1] if joined else []
        if last and last[0]["run"] == event["run"] and event["t"] <= _end(last):
            last.append(event)
        else:
            joined.append([event])
    return joined


def _end(event: Sequence[Event]) -> float:
    return float(max(one["t"] + one["seconds"] for one in event))


def render_event_table(events: Sequence[Event], units: Mapping[str, str]) -> Markup:
    """A row for each event, with the torque at each joint that feels it; units are left out where unknown."""
    rows = [
        {"run": one[0]["run"], "starts at [s]": f"{one[0]['t']:.2f}"}
        | {"lasts [s]": f"{_end(one) - one[0]['t']:.2f}"}
        | {"torque that the model lacks": ", ".join(_tell_size(entry, units) for entry in one)}
        for one in join_events(events)
    ]
    return render_table(rows, filter_by={"run": "run"} if units else None)


def _tell_size(event: Event, units: Mapping[str, str]) -> str:
    return f"{event['joint']} {format_number(event['size'])} {units.get(event['joint'], '')}".rstrip()
