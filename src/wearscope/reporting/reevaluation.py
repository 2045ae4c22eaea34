"""What the correction changes, in words: which detector, what SNR and rank, what scope, and what is truer."""

from wearscope.evaluation.certain_changes import (
    SURE,
    Reevaluation,
    best_detectors,
    judge_detector,
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


def count_truth(one: Reevaluation) -> str:
    """For how many detectors and axes after is nearer to the truth, or that nobody can say."""
    if not one.has_truth:
        return "Which side is nearer to the truth cannot be said: the real machine's cannot be simulated."
    verdicts = [judge_detector(rows)[1] for _, rows in one.told.groupby(["axis", "fda"], sort=True)]
    cells = count_text(len(verdicts), "detector and axis", "detectors and axes")
    nearer, farther = (verdicts.count(verdict) for verdict in ("nearer", "farther"))
    text = f"The corrected model is nearer to the truth for {nearer or 'none'} of {cells}"
    return f"{text}, farther for {farther or 'none'}."


def tell_headline(one: Reevaluation) -> str:
    """Whether the best detector and the SNR change, in two short sentences."""
    changed = _compare_best(one)
    best = f"changes {'; '.join(changed)}" if changed else "stays the same"
    rows = one.told[(one.told["question"] == "snr") & (one.told["p_changed"] >= SURE)]
    cells = [
        f"{join_words([one.names.get(fda, fda) for fda in own['fda'].unique()])} on axis {axis}"
        for axis, own in rows.groupby("axis")
    ]
    return f"The best detector {best}. The signal-to-noise ratio changes for {join_words(cells) or 'none'}."


def _compare_best(one: Reevaluation) -> list[str]:
    """Where the best detectors change, with both sides."""
    before, after = (best_detectors(one, side) for side in ("before", "after"))
    parts = []
    for (cycle, axis), names in after.items():
        was, names = ([one.names.get(fda, fda) for fda in side] for side in (before[cycle, axis], names))
        if set(was) != set(names):
            parts.append(
                f"on axis {axis} ({words(cycle)}): {join_words(was, 'or') or 'none'} before, "
                f"{join_words(names, 'or') or 'none'} after"
            )
    return parts
