"""What the correction changes, in words: which detector, what SNR and rank, what scope, and what is truer."""

from wearscope.evaluation.certain_changes import (
    SURE,
    Reevaluation,
    best_detectors,
    judge_detector,
    settled_orders,
)
from wearscope.reporting.labels import count_text, join_words, words


def tell_withheld(one: Reevaluation) -> list[str]:
    """Detectors whose surrogates miss their checks; [] where there is none."""
    rows = one.table[one.table["withheld"]].drop_duplicates(["cycle", "axis", "fda"])
    if rows.empty:
        return []
    cells = [f"{one.names.get(row.fda, row.fda)} on axis {row.axis}" for row in rows.itertuples()]
    return [
        f"Withheld, as its surrogate misses the points that it was checked on: {join_words(cells)}; it is in "
        "no sentence here."
    ]


def truth_sentences(one: Reevaluation) -> list[str]:
    """Detector by detector, whether after is nearer to the truth than before; or that nobody can say."""
    if not one.has_truth:
        return ["Which side is nearer to the truth cannot be said: the real machine's cannot be simulated."]
    places: dict[str, dict[int, list[str]]] = {}
    for (axis, fda), rows in one.told.groupby(["axis", "fda"], sort=True):
        what, verdict = judge_detector(rows)
        name = one.names.get(fda, fda) + (f": {join_words(what)}" if what else "")
        by_axis = places.setdefault(verdict if verdict in ("nearer", "farther") else "open", {})
        by_axis.setdefault(axis, []).append(name)
    told = {
        "nearer": "After is nearer to the truth than before on",
        "farther": "After is farther from the truth than before on",
        "open": f"Neither is nearer with {100 * SURE:g} % certainty on",
    }
    return [
        f"{told[key]} axis {axis}: {'; '.join(names)}."
        for key in told
        for axis, names in places.get(key, {}).items()
    ]


def count_truth(one: Reevaluation) -> str:
    """For how many detectors and axes after is nearer to the truth, or that nobody can say."""
    if not one.has_truth:
        return truth_sentences(one)[0]
    verdicts = [judge_detector(rows)[1] for _, rows in one.told.groupby(["axis", "fda"], sort=True)]
    cells = count_text(len(verdicts), "detector and axis", "detectors and axes")
    nearer, farther = (verdicts.count(verdict) for verdict in ("nearer", "farther"))
    text = f"The corrected model is nearer to the truth for {nearer or 'none'} of {cells}"
    return f"{text}, farther for {farther or 'none'}."


def tell_headline(one: Reevaluation) -> str:
    """Whether the best detector and the SNR change, in two short sentences."""
    changed = _compare_best(one)[0]
    best = f"changes {'; '.join(changed)}" if changed else "stays the same"
    rows = one.told[(one.told["question"] == "snr") & (one.told["p_changed"] >= SURE)]
    cells = [
        f"{join_words([one.names.get(fda, fda) for fda in own['fda'].unique()])} on axis {axis}"
        for axis, own in rows.groupby("axis")
    ]
    return f"The best detector {best}. The signal-to-noise ratio changes for {join_words(cells) or 'none'}."


def _compare_best(one: Reevaluation) -> tuple[list[str], list[str]]:
    """Where the best detectors change, with both sides, and the axes where they do not."""
    before, after = (best_detectors(one, side) for side in ("before", "after"))
    parts, same = [], []
    for (cycle, axis), names in after.items():
        was, names = ([one.names.get(fda, fda) for fda in side] for side in (before[cycle, axis], names))
        if set(was) == set(names):
            same.append(f"axis {axis}")
        else:
            parts.append(
                f"on axis {axis} ({words(cycle)}): {join_words(was, 'or') or 'none'} before, "
                f"{join_words(names, 'or') or 'none'} after"
            )
    return parts, same


def tell_best(one: Reevaluation) -> str:
    """Whether the best detectors change, and how many orders of two are sure."""
    parts, same = _compare_best(one)
    text = "Which detector is best: "
    text += f"it changes {'; '.join(parts)}" if parts else "the same on both sides"
    if parts and same:
        text += f"; the same on {join_words(same)}"
    first, second = (settled_orders(one, side) for side in ("before", "after"))
    turned = [(c, a, x, y) for c, a, x, y in second if (c, a, y, x) in first]
    text += (
        f". Of the detectors' pairs, {len(first)} are in a sure order before and {len(second)} after; "
        f"{len(turned)} turned round."
    )
    return text
