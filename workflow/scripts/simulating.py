"""A set of design points in simulation, as several scripts run it."""

import hashlib
import json
from pathlib import Path

from job import count_progress
from wearscope.simulation.chunk import simulate_chunk


def digest_inputs(installed, files):
    """Digest of what all points of a robot and test-cycle depend on: its files, and installed packages."""
    common = hashlib.sha256(json.dumps(installed).encode())
    for file in files:
        common.update(Path(file).read_bytes())
    return common.hexdigest()


def simulate(say, folder, set_name, rows, model, cycle, plan, common, time_limit, where=""):
    """What became of each point; `where` ends the lines that tell progress and failures."""
    report = count_progress(say, len(rows), f"points of {set_name}{where}")
    outcome = simulate_chunk(folder, set_name, rows, model, cycle, plan, common, report, time_limit)
    for point, reason in outcome.failed.items():
        say(f"{set_name} point {point}{where} failed: {reason}")
    return outcome
