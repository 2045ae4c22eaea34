"""The strip on top of each page: the answer, how sure it is, what limits it most, what to do next."""

import numpy as np
from markupsafe import Markup

from wearscope.evaluation.certain_changes import Reevaluation
from wearscope.evaluation.conclusion import Conclusion
from wearscope.reporting import trust
from wearscope.reporting.closed_loop import ClosedLoop, number
from wearscope.reporting.conclusion import certainty, conclude, tell_sure
from wearscope.reporting.detection import Detections
from wearscope.reporting.labels import UNKNOWN, count_text, join_words
from wearscope.reporting.loop_words import (
    conclude_loop,
    list_unexplained,
    size_left,
    tell_left,
    tell_unexplained,
)
from wearscope.reporting.page_strip import Strip
from wearscope.reporting.reevaluation import count_truth, tell_headline, tell_withheld
from wearscope.reporting.study import Study
from wearscope.reporting.tracking import Tracking

#: Where nothing else limits a study's answer more.
SIMULATED = "Everything is simulated; recordings of the robot say how well (wearscope diagnose)."


def study_strip(study: Study, pages: bool = False) -> Strip | None:
    """Which detector to use; None where the study did not come so far.

    Parameters
    ----------
    study : Study
    pages : bool
        Whether each robot has a page of its own, where its thresholds are.
    """
    if not study.conclusions:
        return None
    one = study.conclusions[0]
    action = Markup('See <a href="#robots">each robot\'s own page</a>.') if pages else _study_action(one)
    # A divided study's overview has no tables of single cells, which the doubts are about.
    caveat = "" if pages else _study_caveat(study, one)
    answer = " ".join(filter(None, [conclude(study, one), trust.tell_basis(study)]))
    return Strip(answer, certainty(one), tell_sure(study, one), caveat, action)


def _study_caveat(study: Study, one: Conclusion) -> str:
    """What would change the answer most, the first that applies."""
    assumed = trust.assumed_robots(study)
    if doubts := [text for text in trust.doubts(study) if f" of {one.detector}:" in text and one.detector]:
        return doubts[0]
    if contradicted := trust.contradicted(study, one.detector):
        return contradicted
    if assumed:
        moved = trust.tell_moved(study, one.detector)
        if len(assumed) == len(study.sources):
            return f"The answer is about a robot like {join_words(assumed)}, not about yours. {moved}"
        return f"{join_words(assumed)} {'has' if len(assumed) == 1 else 'have'} assumed numbers. {moved}"
    return SIMULATED


def _study_action(one: Conclusion) -> Markup:
    if not one.detector or np.isnan(one.wear):
        return Markup('See <a href="#q2">which detector comes closest</a>, or let the factors vary less.')
    return Markup(
        'Take the <a href="#thresholds">alarm threshold of each cell</a>, then judge recordings: '
        "<code>wearscope detect DATA</code>."
    )


def loop_strip(loop: ClosedLoop) -> Strip:
    """What the model lacks, and whether it got better."""
    kind, text = conclude_loop(loop.verdict)
    return Strip(text, kind, _loop_sure(loop), _loop_caveat(loop), _loop_action(loop))


def _loop_sure(loop: ClosedLoop) -> str:
    entries = loop.verdict["verdict"]
    if not entries:
        return "Every effect of the vocabulary was tried at every joint that moves."
    held = sum(one["status"] == "confirmed" for one in entries)
    refuted = sum(one["status"] == "refuted" for one in entries)
    more = f"; they refute {refuted}" if refuted else ""
    return f"Test runs that no fit used confirm {held} of {count_text(len(entries), 'effect')}{more}."


def _loop_caveat(loop: ClosedLoop) -> str:
    """What limits the verdict most, the first that applies."""
    states = {joint: loop.verdict["joints"][joint]["state"] for joint in loop.joints}
    unjudged = [joint for joint, state in states.items() if state == "not_judged"]
    if unjudged:
        reason = loop.verdict["joints"][unjudged[0]].get("reason", "")
        return f"Not judged: {join_words(unjudged)}{f', as {reason}' if reason else ''}."
    joints = loop.verdict["joints"]
    left = {joint: joints[joint] for joint in list_unexplained(loop.verdict, small=False)}
    if left:
        worst = max(left, key=lambda joint: number(left[joint].get("left_percent") or 0.0))
        size = size_left(left[worst])
        return f"At {worst}, {f'{size} is left; ' if size else ''}{tell_left(left[worst])}."
    open_names = [
        f"{join_words([one['effect'], *one['equivalent']], 'or').replace('_', ' ')} at {one['joint']}"
        for one in loop.verdict["verdict"]
        if one["equivalent"]
    ]
    if open_names:
        return f"These runs do not separate {'; '.join(open_names)}."
    if any(one["effect"] == UNKNOWN for one in loop.verdict["verdict"]):
        return "Part of the correction is a curve without a name."
    if small := tell_unexplained(loop.verdict, small=True):
        return f"{small[:1].upper()}{small[1:]}."
    runs = loop.residual.loc[loop.residual["use"] == "train", "run"].nunique()
    if runs < 3:
        return f"Only {count_text(int(runs), 'training run')}: what repeats from run to run is not known."
    return "Names say which formula fits and carries over, not which part of the machine causes it."


def _loop_action(loop: ClosedLoop) -> Markup:
    for entry in loop.verdict.get("next_measurement") or []:
        if "table" in entry:
            return Markup('Record <a href="{0}">{0}</a> ({1}), then diagnose again.').format(
                entry["table"], count_text(entry["runs"], "run")
            )
    if any(one["status"] != "refuted" for one in loop.verdict["verdict"]):
        return Markup(
            'Use the corrected model, <a href="model_after.yaml">model_after.yaml</a>: as a robot of a '
            "study, or by <code>wearscope export</code>."
        )
    return Markup("Keep the declared model; record another motion if you doubt it.")


def reevaluation_strip(one: Reevaluation) -> Strip:
    """What the correction changes in a study's answers."""
    withheld = tell_withheld(one)
    own = "It holds for the test-cycles and axes of this study."
    effects = dict.fromkeys(name.partition(" at ")[0].replace("_", " ") for name in one.assumed)
    assumed = f"Assumed on every side, as no recording shows it: {join_words(list(effects))}."
    action = Markup('See <a href="#detectors">detector by detector</a>, then study the corrected model.')
    kind = "unsure" if withheld or not one.has_truth else "good"
    caveat = (withheld or [assumed if one.assumed else own])[0]
    return Strip(tell_headline(one), kind, count_truth(one), caveat, action)


def tracking_strip(tracking: Tracking) -> Strip:
    """What changed on a machine, in its last session."""
    outcome = tracking.outcome
    last = outcome["sessions"][-1]
    changes = [
        f"{one['effect'].replace('_', ' ')} at {one['joint']} since {one['since']}" for one in last["changes"]
    ]
    answer = (
        f"Changed: {join_words(changes)}." if changes else "Nothing changed since the machine was healthy."
    )
    sure = f"At most {100 * outcome['false_alarm_rate']:.3g} % of a healthy machine's sessions give an alarm."
    files = [one["table"] for one in last["next_measurement"] if "table" in one]
    action = Markup("Record the next session, then <code>wearscope track DATA</code>.")
    if files:
        action = Markup('Record <a href="{0}">{0}</a>, and track again.').format(files[0])
    elif changes:
        action = Markup('See <a href="#friction">how it grows</a>, and plan the maintenance.')
    kind = "bad" if changes else "unsure" if last["cannot_tell"] else "good"
    events = count_text(len(last.get("events", [])), "short event")
    caveat = (
        last["cannot_tell"][0] if last["cannot_tell"] else "Only what the recorded motions excite is seen."
    )
    if last.get("events"):
        verb = "is" if events.startswith("1 ") else "are"
        caveat = f"{events} left out; {'it' if verb == 'is' else 'they'} {verb} no change. {caveat}"
    return Strip(f"Session {last['session']}: {answer}", kind, sure, caveat, action)


def detection_strip(found: Detections) -> Strip:
    """Whether any detector alarms on the recordings."""
    judged = found.judged
    counts = {
        verdict: int(judged.loc[judged["verdict"] == verdict, "run"].nunique())
        for verdict in ("alarm", "withheld", "unchecked")
    }
    runs = int(judged["run"].nunique())
    if counts["alarm"]:
        named = join_words(sorted(judged.loc[judged["verdict"] == "alarm", "joint"].astype(str).unique()))
        answer = f"Alarm in {counts['alarm']} of {count_text(runs, 'recording')}, at {named}."
    else:
        answer = f"No alarm in {count_text(runs, 'recording')}."
    rate = found.summary["setting"]["p_f"]
    sure = f"Thresholds for {100 * rate:g} % false alarms, from simulated runs along the same motion."
    caveat = ""
    if counts["withheld"]:
        caveat = (
            f"Withheld in {count_text(counts['withheld'], 'recording')}: the simulator scatters differently."
        )
    elif counts["unchecked"]:
        caveat = "Too few nominal recordings check the threshold; record three or more."
    kind = "bad" if counts["alarm"] else "unsure" if caveat else "good"
    caveat = caveat or "A threshold holds along its own motion only."
    action = Markup('See <a href="#values">every value</a>; <code>wearscope track</code> says what changed.')
    return Strip(answer, kind, sure, caveat, action)
