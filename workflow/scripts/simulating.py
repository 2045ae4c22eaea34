"""Simulates a set of design points; shared by several scripts."""

import hashlib
import json
from pathlib import Path

from job import count_progress
from wearscope.simulation.chunk import simulate_chunk


def digest_inputs(installed, files):
    """Return a digest of the files and installed packages that all points of a robot and cycle depend on."""
    common = hashlib.sha256(json.dumps(installed).encode())
    for file in files:
        common.update(Path(file).read_bytes())
    return common.hexdigest()


def simulate(say, folder, set_name, rows, model, cycle, plan, common, time_limit, where=""):
    """Simulate points and return the outcome of each; `where` ends the lines on progress and failures."""
    report = count_progress(say, len(rows), f"points of {set_name}{where}")
    outcome = simulate_chunk(folder, set_name, rows, model, cycle, plan, common, report, time_limit)
    for point, reason in outcome.failed.items():
        say(f"{set_name} point {point}{where} failed: {reason}")
    return outcome
