"""The strip on top of each page: the answer, how sure it is, what limits it most, what to do next."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from wearscope.evaluation.conclusion import Conclusion
from wearscope.reporting import trust
from wearscope.reporting.closed_loop import ClosedLoop
from wearscope.reporting.closed_loop_outcome import conclude_loop
from wearscope.reporting.conclusion import certainty, conclude, tell_sure
from wearscope.reporting.labels import UNKNOWN, count_text, join_words
from wearscope.reporting.page import Strip
from wearscope.reporting.study import Study


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
    return Strip(conclude(study, one), certainty(one), tell_sure(one), caveat, action)


def _study_caveat(study: Study, one: Conclusion) -> str:
    """What would change the answer most, the first that applies."""
    assumed = [robot for robot, texts in study.sources.items() if any("assumed" in text for text in texts)]
    if doubts := [text for text in trust.doubts(study) if f" of {one.detector}:" in text and one.detector]:
        return doubts[0]
    if contradicted := trust.contradicted(study, one.detector):
        return contradicted
    if one.tied_with:
        others = join_words([study.detector_name(name) for name in one.tied_with], "or")
        return f"Its signal-to-noise ratio is not told apart from that of {others}."
    if assumed:
        what = "numbers are assumed, not given" if len(assumed) == len(study.sources) else "assumed numbers"
        if len(assumed) == len(study.sources):
            return f"Some {what}: the answer is about a robot like {join_words(assumed)}, not about yours."
        return f"{join_words(assumed)} {'has' if len(assumed) == 1 else 'have'} {what}."
    return "Everything is simulated; recordings of the robot say how well (wearscope diagnose)."


def _study_action(one: Conclusion) -> Markup:
    if not one.detector or np.isnan(one.wear):
        return Markup('See <a href="#q2">which detector comes closest</a>, or let the factors vary less.')
    return Markup(
        'Take the <a href="#thresholds">alarm threshold of each cell</a>, then judge recordings: '
        "<code>wearscope detect DATA</code>."
    )


def loop_strip(loop: ClosedLoop) -> Strip:
    """What the model lacks, and whether it got better."""
    kind, text = conclude_loop(loop)
    return Strip(text, kind, _loop_sure(loop), _loop_caveat(loop), _loop_action(loop))


def _loop_sure(loop: ClosedLoop) -> str:
    entries = loop.verdict["verdict"]
    if not entries:
        return "Every effect of the vocabulary was tried at every joint that moves."
    held = sum(one["status"] == "confirmed" for one in entries)
    refuted = sum(one["status"] == "refuted" for one in entries)
    more = f"; {refuted} refuted" if refuted else ""
    return f"{held} of {count_text(len(entries), 'name')} confirmed by test runs that no fit used{more}."


def _loop_caveat(loop: ClosedLoop) -> str:
    """What limits the verdict most, the first that applies."""
    if loop.verdict.get("not_judged"):
        return f"Not judged: {_names(loop.verdict['not_judged'])}."
    left = [joint for joint in loop.joints if loop.verdict["joints"][joint]["state"] == "unexplained"]
    if left:
        return f"Something repeatable is left without a name at {join_words(left)}."
    open_names = [one for one in loop.verdict["verdict"] if one["equivalent"]]
    if open_names:
        told = [
            f"{join_words([one['effect'], *one['equivalent']], 'or')} at {one['joint']}" for one in open_names
        ]
        return f"These runs do not separate {'; '.join(told)}.".replace("_", " ")
    if any(one["effect"] == UNKNOWN for one in loop.verdict["verdict"]):
        return "Part of the correction is a curve without a name."
    runs = loop.residual.loc[loop.residual["use"] == "train", "run"].nunique()
    if runs < 3:
        return f"Only {count_text(int(runs), 'training run')}: what repeats from run to run is not known."
    return "Names say which formula fits and carries over, not which part of the machine causes it."


def _names(not_judged: Iterable[Any]) -> str:
    """Joints or questions of the verdict's list, whatever its form."""
    told = [
        str(one.get("joint", one.get("what", ""))) if isinstance(one, Mapping) else str(one)
        for one in not_judged
    ]
    return join_words([one for one in dict.fromkeys(told) if one])


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
