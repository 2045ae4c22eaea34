"""A model's errors on recordings."""

from pathlib import Path

import click

from wearscope.cli.say import say


@click.command()
@click.argument("model")
@click.argument("dataset")
@click.option("--out", type=click.Path(path_type=Path), help="Write the tables into this folder, too.")
@click.option("--allow-code", is_flag=True, help="Let effect files that the model names run.")
def evaluate(model, dataset, out, allow_code):  # type: ignore[no-untyped-def]
    """Say how well MODEL predicts the recordings of DATASET, to none of which it is fitted.

    MODEL is a robot, or a model that `diagnose` wrote. Two models on one data set, or one model on two, tell
    which fits better: in torque along the measured motion, and in position after 0.1, 0.5 and 2 s under the
    measured torque.

    \b
    Examples:
      wearscope evaluate results/closed_loop/arm/model_after.yaml arm-june
      wearscope evaluate config/robots/medium arm-june --out errors-medium
    """
    from wearscope.cli.show import print_table
    from wearscope.cli.tables import format_value
    from wearscope.model_errors import evaluate_model
    from wearscope.robots.model import load_model

    errors = evaluate_model(
        load_model(model, strict=False, allow_code=allow_code),
        dataset,
        lambda line: say(line, err=True),
    )
    torque = errors.torque
    columns = ["run", "use", "joint", "torque_rms", "error_rms", "unit", "error_percent", "outcome"]
    print_table(columns, [[format_value(x) for x in row] for row in torque[columns].itertuples(index=False)])
    columns = ["run", "joint", "seconds", "count", "failed", "moved_median", "error_median", "unit"]
    rows = [[format_value(x) for x in row] for row in errors.rollouts[columns].itertuples(index=False)]
    headers = ["run", "joint", "after [s]", "rollouts", "failed", "moved (median)", "error (median)", "unit"]
    print_table(headers, rows)
    if out is not None:
        errors.write(out)
        say(out)
