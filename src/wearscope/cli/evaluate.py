"""The command `wearscope evaluate`: errors of a model on recordings."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from wearscope.cli.progress import say
from wearscope.storage.files import check_folder

if TYPE_CHECKING:
    from wearscope.notebook.model_errors import ModelErrors


@click.command()
@click.argument("model")
@click.argument("dataset")
@click.option("--temperature", type=float, help="Joint temperature [deg C], if not recorded.")
@click.option("--out", type=click.Path(path_type=Path), help="Also write the tables into this folder.")
@click.option("--allow-code", is_flag=True, help="Allow effect files that the model names.")
def evaluate(model, dataset, temperature, out, allow_code):  # type: ignore[no-untyped-def]
    """Compute the errors of MODEL on the recordings of DATASET; nothing is fitted to them.

    MODEL is a robot, or a model that `diagnose` wrote. Errors are those of the torque along the measured
    motion, and of the position after 0.1, 0.5 and 2 s under the measured torque.

    \b
    Examples:
      wearscope evaluate results/closed_loop/arm/model_after.yaml arm-june
      wearscope evaluate config/robots/medium arm-june --out errors-medium
    """
    from wearscope.cli.show import print_table
    from wearscope.cli.tables import format_value
    from wearscope.notebook.model_errors import evaluate_model
    from wearscope.robots.model import load_model

    if out is not None:
        check_folder(out)
    errors = evaluate_model(
        load_model(model, strict=False, allow_code=allow_code),
        dataset,
        lambda line: say(line, err=True),
        float("nan") if temperature is None else temperature,
    )
    rows = [[format_value(x) for x in row] for row in list_worst(errors)]
    print_table(("joint", "error (RMS)", "not predicted", "in", "then off by (median, 95 %)"), rows)
    say(*errors.judged["refused"], tell_errors(errors))
    if out is None:
        say("--out FOLDER writes every run and time.")
    else:
        errors.write(out)
        say(out)


def list_worst(errors: "ModelErrors") -> list[tuple[str, ...]]:
    """Return a row for each joint with its worst torque error and its worst position error."""
    from wearscope.reporting.page import format_number, interval_text

    rolled = errors.rollouts[errors.rollouts["seconds"] == errors.rollouts["seconds"].max()]
    found: list[tuple[str, ...]] = []
    for joint, own in errors.torque.groupby("joint", sort=False):
        known = own[own["error_percent"].notna()]
        far = rolled[(rolled["joint"] == joint) & rolled["error_median"].notna()]
        if known.empty:
            found.append((str(joint), "n/a", "n/a", str(own["outcome"].iloc[0]), "n/a"))
            continue
        worst = known.loc[known["error_percent"].idxmax()]
        size = f"{format_number(worst['error_rms'])} {worst['unit']}"
        share = f"{format_number(worst['error_percent'], 2)} % of the torque"
        off = "n/a"
        if len(far):
            last = far.loc[far["error_median"].idxmax()]
            ends = (last[f"error_median{end}"] for end in ("", "_low", "_high"))
            off = f"{interval_text(*ends)} {last['unit']} after {last['seconds']:g} s"
        found.append((str(joint), size, share, str(worst["run"]), off))
    return found


def tell_errors(errors: "ModelErrors") -> str:
    """Return sentences on what was judged, and on the smallest and largest errors."""
    from wearscope.reporting.page import format_number, interval_text, say

    known = errors.torque[errors.torque["error_percent"].notna()]
    rolled = errors.rollouts[errors.rollouts["joint"].isin(errors.judged["names"])]
    rolled = rolled[rolled["error_median"].notna()]
    last = rolled[rolled["seconds"] == rolled["seconds"].max()]
    worst = known.loc[known["error_percent"].idxmax()] if len(known) else None
    far = last.loc[last["error_median"].idxmax()] if len(last) else None
    ends = [format_number(x, 2) for x in (known["error_percent"].min(), known["error_percent"].max())]
    off = "" if far is None else interval_text(*(far[f"error_median{end}"] for end in ("", "_low", "_high")))
    told = say("cli/words.html", "errors", errors.judged, [*dict.fromkeys(ends)], worst, far, off)
    return told.striptags()
