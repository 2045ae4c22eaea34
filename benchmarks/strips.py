"""What people read on top of finished pages, in a browser, against the tables next to each page.

    python -m benchmarks.strips results/paper results/closed_loop/arm ...

Each folder holds ``report.html`` of a study, its re-evaluation, a diagnosis, a tracked machine or detectors
on recordings. The answer's names and numbers must be those of the tables. It needs Playwright and Chromium.
"""

import json
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wearscope.evaluation.certain_changes import SURE
from wearscope.storage import tables

#: Verdicts of a detector that has decided.
_DECIDED = ("alarm", "no alarm")

_READ = """() => ({
    answer: document.querySelector(".strip .answer").innerText,
    rest: [...document.querySelectorAll(".strip dd")].map((one) => one.innerText).join(" "),
    high: document.querySelector(".strip").getBoundingClientRect().bottom,
})"""


def read_tops(folders: list[Path]) -> Iterator[tuple[Path, dict[str, Any]]]:
    """What each page shows on top: ``answer``, ``rest``, and how far down it reaches [pixels]."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for folder in folders:
            page = browser.new_page(viewport={"width": 1280, "height": 860})
            page.goto((folder / "report.html").absolute().as_uri())
            page.wait_for_selector("html[data-ready=yes]", timeout=60_000)
            yield folder, page.evaluate(_READ)
            page.close()


def numbers_in(text: str) -> set[float]:
    """Numbers that a text states."""
    return {float(one.replace(",", "").rstrip(".")) for one in re.findall(r"\d[\d,]*\.?\d*", text)}


def state_study(folder: Path) -> tuple[list[str], list[float]]:
    """Names and numbers that a study's answer must have."""
    one = json.loads((folder / "conclusion.json").read_text(encoding="utf-8"))[0]
    if not one["detector"]:
        return ["No detector can be recommended"], []
    if one["wear"] is None:
        return [f"({one['detector']})", "no change of wear"], []
    numbers = [float(f"{one['wear']:.2g}"), 100 * one["p_f"], 100 * one["p_d"]]
    numbers += [float(f"{1.96 * bound['sigma']:.2g}") for bound in one["bounds"]]
    return [f"({one['detector']})"], numbers


def state_loop(folder: Path) -> tuple[list[str], list[float]]:
    """Names and numbers that a diagnosis' answer must have."""
    verdict = json.loads((folder / "verdict.json").read_text(encoding="utf-8"))
    held = [one for one in verdict["verdict"] if one["status"] != "refuted"]
    names = [one["effect"].replace("_", " ") for one in held if one["effect"] != "unknown"]
    residual = tables.read_table(folder / "residual.parquet")
    rows = residual[(residual["use"] == "test") & residual["counts"].astype(bool)]
    squares = (rows[["residual_before", "residual_after"]] ** 2).groupby(rows["joint"]).mean() ** 0.5
    ratio = (squares["residual_after"] / squares["residual_before"]).min()
    confirmed = sum(one["status"] == "confirmed" for one in verdict["verdict"])
    if not names:
        return [], []
    return names, [float(f"{100 * (1 - ratio):.0f}"), confirmed, len(verdict["verdict"])]


def state_tracking(folder: Path) -> tuple[list[str], list[float]]:
    """Names and numbers that a tracked machine's answer must have."""
    outcome = json.loads((folder / "tracking.json").read_text(encoding="utf-8"))
    last = outcome["sessions"][-1]
    changes = [one["effect"].replace("_", " ") for one in last["changes"]]
    changes += [f"at {one['joint']}" for one in last["changes"]]
    unknown = [text.partition(":")[0] for text in last["cannot_tell"] if " changed by " in text]
    quiet = "No change is sure" if last["cannot_tell"] else "Nothing changed"
    quiet = unknown[0] if unknown else quiet
    return [last["session"], *(changes or [quiet])], [100 * outcome["false_alarm_rate"]]


def state_detection(folder: Path) -> tuple[list[str], list[float]]:
    """Names and numbers that detectors' answer on recordings must have."""
    table = tables.read_table(folder / "detection.parquet")
    judged = table[table["kind"] == "judged"]
    alarms = judged[judged["verdict"] == "alarm"]
    runs, decided = (one["run"].nunique() for one in (judged, judged[judged["verdict"].isin(_DECIDED)]))
    if len(alarms):
        return sorted(alarms["joint"].astype(str).unique()), [alarms["run"].nunique(), runs]
    if not decided:
        return ["None of"], [runs]
    return ["No alarm in"], [decided] + ([runs - decided] if decided < runs else [])


def state_reevaluation(folder: Path) -> tuple[list[str], list[float]]:
    """Detectors, with their axes, whose SNR the correction surely changes."""
    table = tables.read_table(folder.parent / "reevaluation.parquet")
    told = table[(table["question"] == "snr") & ~table["withheld"] & (table["p_changed"] >= SURE)]
    names = {f"({row.fda})" for row in told.itertuples()} | {f"axis {row.axis}" for row in told.itertuples()}
    return sorted(names) or ["changes for none"], []


STATES = {
    "conclusion.json": state_study, "verdict.json": state_loop, "tracking.json": state_tracking,
    "detection.json": state_detection, "../reevaluation.parquet": state_reevaluation,
}  # fmt: skip


def check_top(folder: Path, top: dict[str, Any]) -> list[str]:
    """What the top of a page lacks of what its tables say."""
    state = next((ask for file, ask in STATES.items() if (folder / file).is_file()), None)
    if state is None:
        return [f"has none of {', '.join(STATES)}; give the folder of a page that answers"]
    names, numbers = state(folder)
    text = re.sub(r"\s+", " ", f"{top['answer']} {top['rest']}")
    wrong = [f"does not name {name}" for name in names if name.lower() not in text.lower()]
    stated = numbers_in(text)
    wrong += [
        f"does not state {n:g}" for n in numbers if not any(abs(n - s) <= 1e-9 + 0.005 * n for s in stated)
    ]
    return wrong + (["is below the first screen"] if top["high"] > 860 else [])


if __name__ == "__main__":
    found = {folder: check_top(folder, top) for folder, top in read_tops([Path(one) for one in sys.argv[1:]])}
    for folder, wrong in found.items():
        print(f"{folder}: {'; '.join(wrong) or 'as its tables'}")
    sys.exit(any(found.values()))
