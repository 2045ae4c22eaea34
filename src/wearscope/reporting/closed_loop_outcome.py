"""First section of a closed loop's page: what was named, what the test runs say of it, what is left."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.closed_loop.selection.policy import Policy
from wearscope.reporting.closed_loop import ClosedLoop, number
from wearscope.reporting.closed_loop_details import MOST_SHOWN, write_value
from wearscope.reporting.joint_cards import list_shared, render_joint_cards
from wearscope.reporting.labels import UNKNOWN, count_text, join_words, unit_text
from wearscope.reporting.loop import STATUSES, say_share, tell_status
from wearscope.reporting.page import badge, render_table, unbreak

#: Colour of a status.
_KINDS = {"refuted": "bad", "confirmed": "good", "not_confirmed": "unsure"}
#: Growth of the error on the test runs from which a joint is said to have become worse.
_WORSE = 1.03


def describe_outcome(loop: ClosedLoop) -> Markup:
    """What is refuted, alarms, the other effects by status, states of the joints, parameters, the rule."""
    effects = {status: _effects(loop, status) for status in STATUSES}
    parts = [effects.pop("refuted"), _alarms(loop), *effects.values()]
    parts.append(_explain_statuses(loop))
    return Markup("").join([*parts, render_joint_cards(loop), _parameters(loop), _rule(loop)])


def conclude_loop(loop: ClosedLoop) -> tuple[str, str]:
    """The outcome in one plain sentence, and its colour: good, unsure or bad."""
    entries = [one for one in loop.verdict["verdict"] if one["effect"] != UNKNOWN]
    held = [one for one in entries if one["status"] != "refuted"]
    left = [joint for joint in loop.joints if loop.verdict["joints"][joint]["state"] == "unexplained"]
    unjudged = [joint for joint in loop.joints if loop.verdict["joints"][joint]["state"] == "not_judged"]
    said = (
        [f"{join_words(left)} {'keeps' if len(left) == 1 else 'keep'} something unexplained"] if left else []
    )
    if unjudged:
        said.append(f"{join_words(unjudged)} {'is' if len(unjudged) == 1 else 'are'} not judged")
    rest = join_words(said)
    if not held:
        if not said:
            return "good", "The declared model suffices: nothing that it lacks is seen on these runs."
        return "bad" if left else "unsure", f"No effect that the test runs bear out was named, and {rest}."
    marks = {"confirmed": "", "not_confirmed": " (not confirmed)"}
    named = [
        f"{join_words([one['effect'], *one['equivalent']], 'or').replace('_', ' ')} {_where(one)}"
        f"{marks[one['status']]}"
        for one in held
    ]
    text = f"The declared model lacks {'; '.join(named)}. {_tell_gain(loop)}"
    grown = _tell_growth(loop)
    sure = all(one["status"] == "confirmed" and not one["equivalent"] for one in held) and not grown
    return ("good" if sure and not said else "unsure"), f"{text}{grown}{f'; {rest}' if said else ''}."


def _where(entry: Mapping[str, Any]) -> str:
    return "of the robot" if entry["effect"] in list_shared() else f"at {entry['joint']}"


def _changes(loop: ClosedLoop) -> list[tuple[float, str, float, float, str]]:
    """Error after over before, joint, before, after, unit; of the joints that move on the test runs."""
    found = []
    for joint, one in loop.verdict["joints"].items():
        before, after = number(one.get("rms_before")), number(one.get("rms_after"))
        if np.isfinite([before, after]).all() and before > 0:
            found.append((after / before, joint, before, after, one["unit"]))
    return found


def _tell_growth(loop: ClosedLoop) -> str:
    """Where the error on the test runs grows; empty where it does not."""
    worse = [one for one in _changes(loop) if one[0] > _WORSE]
    if not worse:
        return ""
    ratio, joint, *_ = max(worse)
    others = len(worse) - 1
    also = f" (and at {count_text(others, 'other joint')} by less)" if others else ""
    return f", but grows by {100 * (ratio - 1):.0f} % at {joint}{also}"


def _tell_gain(loop: ClosedLoop) -> str:
    """Where the error on the test runs falls most."""
    found = _changes(loop)
    if not found:
        return "No joint moves on the test runs, so the correction is not judged"
    ratio, joint, before, after, unit = min(found)
    if ratio > 0.995:
        return "On the test runs no joint's error falls by more than half a percent"
    return (
        f"With it the error on the test runs falls by up to {100 * (1 - ratio):.0f} %, at {joint} from "
        f"{write_value(before)} to {write_value(after)} {unit}"
    )


def _alarms(loop: ClosedLoop) -> Markup:
    """Simulations that failed, searches that stopped, and an empty verdict."""
    said = []
    for stage in ("before", "after"):
        outcomes = {one[stage]["outcome"] for one in loop.verdict.get("forward", {}).values()} - {"ok"}
        said += [("alarm", f"Simulated forward, model {stage}: {text}") for text in sorted(outcomes)]
    said += [("notice", f"Stopped. {text}.") for text in loop.verdict["stopped"]]
    if not loop.verdict["verdict"]:
        states = {j: loop.verdict["joints"][j]["state"] for j in loop.joints}
        left = [j for j, state in states.items() if state == "unexplained"]
        unjudged = [j for j, state in states.items() if state == "not_judged"]
        if left:
            text = (
                f"Nothing was named, and the declared model does not suffice: {join_words(left)} "
                f"{'is' if len(left) == 1 else 'are'} left unexplained."
            )
        elif unjudged:
            text = (
                f"Nothing was named; that says nothing of {join_words(unjudged)}, which "
                f"{'is' if len(unjudged) == 1 else 'are'} not judged."
            )
        else:
            text = (
                "None: the declared model suffices. No candidate beat it outside the noise, and no further "
                "structure was found; the model after is the model before."
            )
        said.append(("alarm" if left or unjudged else "notice", text))
    return Markup("").join(
        Markup('<div class="{}">{}</div>').format(kind, unbreak(text)) for kind, text in said
    )


def _effects(loop: ClosedLoop, status: str) -> Markup:
    """Cards of the effects of a status, under its heading; nothing where there is none."""
    own = [entry for joint in loop.joints for entry in loop.entries_at(joint) if entry["status"] == status]
    own.sort(key=lambda entry: entry["effect"] == UNKNOWN)
    if not own:
        return Markup("")
    cards = Markup("").join(_card(entry) for entry in own)
    return Markup('<h3>{} ({})</h3><div class="cards">{}</div>').format(
        STATUSES[status].heading, len(own), cards
    )


def _explain_statuses(loop: ClosedLoop) -> Markup:
    if not loop.verdict["verdict"]:
        return Markup("")
    text = (
        "Names and parameters come from the training runs alone; the test runs mark them afterwards and "
        "change nothing. Each share is what leaving out this effect alone would cost on the test runs, all "
        "others refitted: shares do not add up, and where two effects explain much the same, either may be "
        "refuted although the error as a whole falls. Confirmed: the whole 95 % interval (resampled blocks "
        "of the test runs) lies above zero; refuted: below it."
    )
    return Markup('<p class="note">{}</p>').format(unbreak(text))


def _card(entry: Mapping[str, Any]) -> Markup:
    kind = _KINDS[entry["status"]]
    where = "all joints together" if entry["effect"] in list_shared() else entry["joint"]
    lines: list[Any] = [f"{tell_status(entry)}: {say_share(entry)} at {where}."]
    if entry["effect"] == UNKNOWN:
        lines.append("Structure that no named effect explains.")
    if entry["depends_on"]:
        lines.append(f"Depends on {join_words(entry['depends_on'])}.")
    if entry["equivalent"]:
        lines.append(
            Markup("{} {} on these runs.").format(
                badge("cannot be told from", "unsure"), join_words(entry["equivalent"], "or")
            )
        )
    body = Markup("").join(
        Markup("<p>{}</p>").format(line if isinstance(line, Markup) else unbreak(line)) for line in lines
    )
    return Markup('<div class="card {}"><h3>{}: {}</h3>{}</div>').format(
        kind, entry["joint"], badge(entry["effect"], kind), body
    )


def _parameters(loop: ClosedLoop) -> Markup:
    records = [record for entry in loop.verdict["verdict"] for record in _tell_parameters(entry)]
    if not records:
        return Markup("")
    text = (
        "Parameters of what was added; the models hold them all. The interval of one parameter may hold zero "
        "where those of its effect together do not."
    )
    return Markup("<details{}><summary>{}</summary>{}</details>").format(
        Markup(" open") if len(records) <= MOST_SHOWN else "",
        f"{count_text(len(records), 'parameter')} with 95 % intervals",
        render_table(pd.DataFrame(records), text, filter_by={"joint": "joint"}),
    )


def _tell_parameters(entry: Mapping[str, Any]) -> list[dict[str, str]]:
    """Rows of the table: fitted parameters, a spline's heights as one, fixed ones."""
    where = {"joint": entry["joint"], "effect": entry["effect"]}
    parameters = entry["parameters"]
    heights = [one["value"] for name, one in parameters.items() if name.startswith("height")]
    if entry["effect"] == UNKNOWN and heights:
        told = f"{write_value(min(heights))} to {write_value(max(heights))}"
        row = {"parameter": f"{len(heights)} heights of a spline", "value": told, "95 % interval": "n/a"}
        return [where | row | {"unit": unit_text(next(iter(parameters.values()))["unit"])}]
    rows = []
    for name, one in parameters.items():
        low, high = (write_value(number(v)) for v in one["ci95"])
        row = {
            "parameter": name,
            "value": write_value(number(one["value"])),
            "95 % interval": f"{low} to {high}",
        }
        rows.append(where | row | {"unit": unit_text(one["unit"])})
    for name, value in entry["fixed"].items():
        row = {"parameter": name, "value": write_value(number(value)), "95 % interval": "fixed", "unit": ""}
        rows.append(where | row)
    return rows


def _rule(loop: ClosedLoop) -> Markup:
    """Numbers of the rule, folded, with what each means and whether it is the usual one."""
    known = Policy.model_fields
    records = []
    for name, value in loop.verdict["rule"].items():
        meaning, usual = "n/a", "n/a"
        if name in known:
            meaning = " ".join((known[name].description or "").replace("`", "").split())
            usual = "yes" if known[name].default == value else f"no, {write_value(known[name].default)}"
        # As text: a number of the rule is written as it is, not rounded.
        records.append({"name": name, "value": f"{value:g}", "default": usual, "meaning": meaning})
    table = render_table(pd.DataFrame(records), "The setting closed_loop.policy of the configuration.")
    return Markup(
        "<details><summary>Numbers of the rule that accepts, ties and names</summary>{}</details>"
    ).format(table)


def tell_version(loop: ClosedLoop) -> str:
    """Line for the page's end."""
    return f"Made from the tables of a loop closed by wearscope {loop.verdict['version']}."


def tell_size(loop: ClosedLoop) -> str:
    """Line under the page's title."""
    runs = loop.residual.groupby("use")["run"].nunique()
    return (
        f"{count_text(len(loop.joints), 'joint')}, {count_text(int(runs.get('train', 0)), 'training run')}, "
        f"{count_text(int(runs.get('test', 0)), 'test run')}. Parameters and choices come from the training "
        "runs, errors from the test runs."
    )
