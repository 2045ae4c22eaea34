"""What to record next, as a closed loop's page says it."""

from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from wearscope.reporting.labels import count_text, join_words
from wearscope.reporting.page import badge, format_number, unbreak

#: Probability from which on an advice is a promise.
PROMISED = 0.9


def describe_measurements(verdict: Mapping[str, Any]) -> Markup:
    """Advised runs of a verdict; nothing where every name is alone."""
    entries = verdict.get("next_measurement") or []
    return Markup("").join(_describe(entry) for entry in entries)


def tell_measurement(entry: Mapping[str, Any]) -> str:
    """Advice of one term in a sentence or two."""
    first, *others = entry["names"]
    if entry["power"] < PROMISED:
        return (
            f"No motion of the {entry['plans_compared']} that were compared tells {first} from "
            f"{join_words(others, 'or')} for sure: the best one does with probability "
            f"{format_number(entry['power'], 2)}, after {count_text(entry['runs'], 'run')} (angle "
            f"{format_number(entry['angle_before_deg'], 2)} to "
            f"{format_number(entry['angle_after_deg'], 2)}°)."
        )
    payload = entry["payload"]
    carried = "without a payload" if payload is None else f"with {format_number(payload['mass'])} kg"
    warm = entry["start_temperature"]
    start = "" if warm is None else f", started at {format_number(warm)} °C"
    where = entry.get("cycle_file") or f"test-cycle {entry['cycle']}"
    return (
        f"Record {where} ({format_number(entry['seconds'])} s, {carried}{start}), "
        f"{count_text(entry['runs'], 'run')}: it tells {first} from {join_words(others, 'or')} with "
        "probability "
        f"{format_number(entry['power'], 2)}; the angle between them grows from "
        f"{format_number(entry['angle_before_deg'], 2)} to {format_number(entry['angle_after_deg'], 2)}°."
    )


def _describe(entry: Mapping[str, Any]) -> Markup:
    kind = "good" if entry["power"] >= PROMISED else "unsure"
    word = "promised" if kind == "good" else "not promised"
    return Markup('<div class="card {}"><h3>{} {}</h3><p>{}</p><p class="note">{}</p></div>').format(
        kind,
        entry["joint"],
        badge(word, kind),
        unbreak(tell_measurement(entry)),
        _link(entry),
    )


def _link(entry: Mapping[str, Any]) -> Markup:
    """Files of an advised run."""
    links = [
        Markup('<a href="{0}">{0}</a> ({1})').format(entry[key], what)
        for key, what in (("table", "for a controller"), ("cycle_file", "for the simulator"))
        if key in entry
    ]
    return Markup(", ").join(links)
