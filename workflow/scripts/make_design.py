"""Makes the design matrices and checks, before the simulation, what they can estimate."""

from job import run_job
from wearscope.designs.checks import check_design, describe_design
from wearscope.designs.factors import Factor
from wearscope.designs.kinds import (
    checking_design,
    filling_design,
    make_design,
    nominal_design,
    validation_design,
)
from wearscope.storage import tables

with run_job(snakemake) as say:
    params = snakemake.params
    factors = [Factor(**one) for one in params.factors]
    units = {f"{factor.name}_natural": factor.unit for factor in factors}

    identification = make_design(params.kind, factors, params.options, params.seed)
    check_design(identification, factors, params.models, params.axes)
    checks = describe_design(identification, factors, params.models)
    for row in checks.itertuples():
        say(
            f"{row.model}: {row.terms} terms on {row.points} points, condition number {row.condition:.3g}, "
            f"{row.dof} residual degrees of freedom, resolution {row.resolution or 'full'}"
        )
    tables.write_table(snakemake.output.identification, identification, units)
    validation = validation_design(params.kind, factors, params.options, params.seed)
    tables.write_table(snakemake.output.validation, validation, units)
    if params.filling:
        asked = params.filling
        common = {"questions": params.questions, "axes": params.axes, "seed": params.seed}
        filling = filling_design(
            factors, asked["points"], asked["question_points"], asked["replicates"], **common
        )
        checking = checking_design(
            factors, asked["checking_points"], asked["checking_question_points"], **common
        )
        tables.write_table(snakemake.output.filling, filling, units)
        tables.write_table(snakemake.output.checking, checking, units)
    tables.write_table(snakemake.output.nominal, nominal_design(factors, params.nominal_runs), units)
    tables.write_table(snakemake.output.checks, checks)
