"""Adds the wear and temperature laws of another robot to a robot's model."""

from job import run_job
from wearscope.robots.friction import carry_over
from wearscope.robots.model import load_model, save_model

with run_job(snakemake) as say:
    params = snakemake.params
    model, source = (
        load_model(reference, allow_code=params.allow_code)
        for reference in (params.robot, params.settings["source"])
    )
    made = carry_over(model, source, params.settings["effects"], params.settings["reference"], params.worn)
    for entry in made.effects[len(model.effects) :]:
        say(f"{entry.joint}: {entry.effect}, assumed, {entry.source}")
    save_model(made, snakemake.output.model)
