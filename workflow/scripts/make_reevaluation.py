"""Prepares a reevaluation: models before, after, drawn and true, with wear laws; the design of their runs."""

import json
from pathlib import Path

import pandas as pd

from job import run_job
from wearscope.cycles.base import load_cycle
from wearscope.demonstration.simulated_twin.model import make_true_model
from wearscope.designs.factors import Factor
from wearscope.designs.kinds import checking_design, filling_design, local_design, make_design, nominal_design
from wearscope.errors import InputError
from wearscope.robots.friction import carry_over
from wearscope.robots.model import load_model, save_model
from wearscope.simulation.feasibility import check_cycle, check_robot, check_screening, screen_factors
from wearscope.storage import tables


def prepare(name, model):
    """Complete a model, check it, screen the factors on it, and write it."""
    if params.carry_over is not None:
        carried = params.carry_over
        model = carry_over(model, source, carried["effects"], carried["reference"], params.worn)
    worn = model.wearing(params.worn)
    check_robot(worn, params.ranges, params.step, params.sample_rate)
    if name in params.sides:
        for label, cycle in cycles.items():
            check_cycle(worn, cycle, label, params.ranges, params.step)
        table = screen_factors(worn, cycles, params.ranges, params.step)
        screened.append(check_screening(table, name, params.tested, params.screening))
    save_model(model, folder / f"{name}.yaml")
    return model


with run_job(snakemake) as say:
    params, out = snakemake.params, snakemake.output
    folder = Path(out.models).parent / "models"
    cycles = {name: load_cycle(reference) for name, reference in params.cycles.items()}
    if params.carry_over is not None:
        source = load_model(params.carry_over["source"], allow_code=params.allow_code)
    screened, made = [], {}
    for name, reference in params.sources.items():
        try:
            model = load_model(reference, strict=False, allow_code=params.allow_code)
            if name == "truth":
                model = make_true_model(model, json.loads(Path(snakemake.input.truth).read_text()))
            prepare(name, model)
            made[name] = ""
        except InputError as error:
            if name in params.sides:
                raise
            made[name] = str(error)
            say(f"{name} is left out: {error}")
    factors = [Factor(**one) for one in params.factors]
    asked, common = params.settings, {"questions": params.questions, "axes": params.axes, "seed": params.seed}
    bridge = -(-3 * (len(factors) + 1) // 2)
    whole = filling_design(factors, asked["points"], asked["question_points"], 0, **common)
    # Design ranges: the SNR's two wear levels, and three standard deviations of its nuisances.
    reach = max(abs(params.snr["f0"]), abs(params.snr["f0"] + params.snr["delta"]), 3 * params.snr["sigma"])
    near = local_design(factors, asked["local_points"], asked["replicates"], reach, params.seed)
    identification = pd.concat([whole, near], ignore_index=True)
    identification["point"] = range(1, len(identification) + 1)
    designs = {
        "identification": identification,
        "filling": make_design(
            "latin_hypercube", factors, {"points": bridge, "stream": "bridge"}, params.seed
        ),
        "checking": checking_design(factors, asked["checking_points"], 1, **common),
        "nominal": nominal_design(factors, 1),
    }
    units = {f"{factor.name}_natural": factor.unit for factor in factors}
    for name, design in designs.items():
        tables.write_table(out[name], design, units)
    tables.write_table(out.screening, pd.concat(screened, ignore_index=True))
    tables.write_text(out.models, json.dumps(made, indent=1) + "\n")
