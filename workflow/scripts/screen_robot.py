"""Refuses or drops factors that change no torque of a robot."""

from job import run_job
from wearscope.cycles.base import load_cycle
from wearscope.robots.model import load_model
from wearscope.simulation.feasibility import check_robot, check_screening, screen_factors
from wearscope.storage import tables
from wearscope.supervision import call_supervised


def screen():
    """Return the table of factors."""
    model = load_model(params.robot, allow_code=params.allow_code).wearing(params.worn)
    check_robot(model, params.ranges, params.step, params.sample_rate)
    cycles = {name: load_cycle(reference) for name, reference in params.cycles.items()}
    return screen_factors(model, cycles, params.ranges, params.step)


with run_job(snakemake) as say:
    params, w = snakemake.params, snakemake.wildcards
    table = call_supervised(screen, params.time_limit, f"robot {w.robot}: screening its factors")
    table = check_screening(table, w.robot, params.tested, params.screening)
    for row in table[table["dropped"]].itertuples():
        say(f"factor {row.factor} moves no torque and is dropped")
    tables.write_table(snakemake.output[0], table, {"change": "1"})
