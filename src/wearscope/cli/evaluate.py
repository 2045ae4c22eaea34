"""A model's errors on recordings."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from wearscope.cli.say import say

if TYPE_CHECKING:
    import pandas as pd


@click.command()
@click.argument("model")
@click.argument("dataset")
@click.option("--temperature", type=float, help="Of the joints where it was not recorded [deg C].")
@click.option("--out", type=click.Path(path_type=Path), help="Write the tables into this folder, too.")
@click.option("--allow-code", is_flag=True, help="Let effect files that the model names run.")
def evaluate(model, dataset, temperature, out, allow_code):  # type: ignore[no-untyped-def]
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
    from wearscope.reporting.page import interval_text
    from wearscope.robots.model import load_model

    errors = evaluate_model(
        load_model(model, strict=False, allow_code=allow_code),
        dataset,
        lambda line: say(line, err=True),
        float("nan") if temperature is None else temperature,
    )
    torque, rollouts = errors.torque, errors.rollouts
    columns = ["run", "use", "joint", "torque_rms", "error_rms", "unit", "error_percent", "outcome"]
    print_table(columns, [[format_value(x) for x in row] for row in torque[columns].itertuples(index=False)])
    ends = [rollouts[f"error_median{end}"] for end in ("", "_low", "_high")]
    told = [interval_text(*one) for one in zip(*ends, strict=True)]
    columns = ["run", "joint", "seconds", "count", "failed", "moved_median", "told", "unit"]
    rolled = rollouts.assign(told=told)[columns].itertuples(index=False)
    headers = ["run", "joint", "after [s]", "rollouts", "failed", "moved (median)", "error (median, 95 %)"]
    print_table([*headers, "unit"], [[format_value(x) for x in row] for row in rolled])
    say(tell_errors(torque, rollouts))
    if out is not None:
        errors.write(out)
        say(out)


def tell_errors(torque: "pd.DataFrame", rollouts: "pd.DataFrame") -> str:
    """The smallest and the largest errors in a sentence or two."""
    from wearscope.reporting.page import format_number, interval_text

    known = torque[torque["error_percent"].notna()]
    worst = known.loc[known["error_percent"].idxmax()]
    said = (
        f"Not predicted: {format_number(known['error_percent'].min(), 2)} to "
        f"{format_number(worst['error_percent'], 2)} % of the torque, most at {worst['joint']} in "
        f"{worst['run']}."
    )
    rolled = rollouts[rollouts["error_median"].notna()]
    if rolled.empty:
        return said
    last = rolled[rolled["seconds"] == rolled["seconds"].max()]
    far = last.loc[last["error_median"].idxmax()]
    size = interval_text(*(far[f"error_median{end}"] for end in ("", "_low", "_high")))
    return (
        f"{said} After {far['seconds']:g} s without feedback the position is off by at most {size} "
        f"{far['unit']}, at {far['joint']} in {far['run']}."
    )
