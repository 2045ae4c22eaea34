"""The commands that are targets of Snakemake."""

import json
import sys
from pathlib import Path

import click

from wearscope.cli.options import study_argument, workflow_options
from wearscope.cli.progress import format_seconds, show_progress
from wearscope.cli.study import (
    StudyPlace,
    count_cores,
    find_last_study,
    find_study,
    read_name,
    remember_study,
)
from wearscope.cli.workflow import build_command, call_snakemake, explain_failure, nest_setting
from wearscope.errors import InputError


def run_targets(
    targets: tuple[str, ...],
    folder: Path,
    config: Path | None,
    cores: int | None,
    settings: tuple[str, ...],
    dry_run: bool,
    verbose: bool,
) -> None:
    """Call Snakemake and show how far it is.

    Raises
    ------
    InputError
        Where a setting or the configuration cannot be read, or Snakemake fails: one sentence on why.
    """
    settings = tuple(nest_setting(setting) for setting in settings)
    if config is not None:
        read_name(config)
    command = build_command(
        targets, folder, cores or count_cores(), config, settings, ("--dry-run",) if dry_run else ()
    )
    log = folder / "results" / f"wearscope-{targets[0] if targets else 'all'}.log"
    seconds = [0.0]
    with show_progress(verbose) as watch:

        def keep_time(done, elapsed, line):  # type: ignore[no-untyped-def]
            seconds[0] = elapsed
            watch(done, elapsed, line)

        try:
            code, progress = call_snakemake(command, folder, log, keep_time)
        except KeyboardInterrupt:
            click.echo("Interrupted; the same command goes on from here.", err=True)
            sys.exit(130)
    if code:
        click.echo(f"The log is {_shorten(log)}.", err=True)
        raise InputError(explain_failure(progress, targets, folder))
    if dry_run:
        click.echo(f"{progress.total} jobs to do." if progress.total else "Nothing to be done.")
    elif progress.total:
        click.echo(
            f"{progress.total} jobs done in {format_seconds(seconds[0])}; the log is {_shorten(log)}.",
            err=True,
        )
    else:
        click.echo("Nothing to be done.", err=True)


def _shorten(path: Path) -> str:
    """Path from the working directory where it lies below it."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def show_result(path: Path, opened: bool = False) -> None:
    """Say what a page says on top, in five lines, and where it is."""
    if path.is_file():
        from wearscope.reporting.page import read_strip

        strip = read_strip(path)
        if strip is not None:
            click.echo(strip.answer)
            for heading, text in strip.rows():
                click.echo(f"{heading}: {text}")
        click.echo(_shorten(path))
        if opened:
            click.launch(str(path))


@click.command()
@study_argument
@click.option("--stage", "-s", help="Stop after this target: design, simulate, snr, scope, audit, ...")
@click.option("--open", "opened", is_flag=True, help="Open the report in the browser.")
@workflow_options
def run(study, stage, opened, cores, settings, dry_run, verbose):  # type: ignore[no-untyped-def]
    """Run STUDY: a folder, a configuration file, or 'quick' or 'paper', which come along.

    \b
    Examples:
      wearscope run quick
      wearscope run my-study --cores 4 --open
      wearscope run config/quick.yaml --stage snr
    """
    place = find_study(study)
    run_targets((stage,) if stage else (), place.folder, place.config, cores, settings, dry_run, verbose)
    if not dry_run:
        remember_study(place)
    if not stage and not dry_run:
        show_result(place.results / "report.html", opened)


@click.command()
@study_argument
@click.option("--open", "opened", is_flag=True, help="Open it in the browser.")
@workflow_options
def report(study, opened, cores, settings, dry_run, verbose):  # type: ignore[no-untyped-def]
    """Bring the report of STUDY up to date and say where it is.

    STUDY may also be a folder of results with a report in it, which is then shown as it is. Without STUDY it
    is the one that was run here last.

    \b
    Examples:
      wearscope report my-study --open
      wearscope report results/closed_loop/kr300 --open
    """
    made = Path(study or "") / "report.html"
    if study and made.is_file():
        show_result(made, opened)
        return
    place = find_last_study(study)
    run_targets(("report",), place.folder, place.config, cores, settings, dry_run, verbose)
    if not dry_run:
        show_result(place.results / "report.html", opened)


def _name_dataset(dataset: str) -> tuple[Path, str]:
    """Path of a data set's folder, and the name of its results' folder."""
    from wearscope.closed_loop.intake.dataset_fields import folder_name, load_yaml

    path = Path(dataset)
    file = path / "dataset.yaml" if path.is_dir() else path
    content = load_yaml(file)
    if not isinstance(content, dict):
        raise InputError(f"{file}: holds no fields; write them as 'field: value'.")
    return file.parent.resolve(), folder_name(content.get("name"), str(file))


def _study_or_default(study: str | None) -> StudyPlace | None:
    """The study that is named, else the one that is here, else none: Snakemake takes the default one."""
    if study is None and not Path("config/config.yaml").is_file():
        return None
    return find_study(study)


def _run_on_dataset(target, dataset, study, allow_code, cores, settings, dry_run, verbose, results, opened):  # type: ignore[no-untyped-def]
    path, name = _name_dataset(dataset)
    settings = (f"dataset={path}", *(("allow_code=true",) if allow_code else ()), *settings)
    place = _study_or_default(study)
    folder, config = (Path.cwd(), None) if place is None else (place.folder, place.config)
    run_targets((target,), folder, config, cores, settings, dry_run, verbose)
    made = folder / "results" / results / name
    if dry_run:
        return
    show_result(made / "report.html", opened)


_dataset_options = (
    click.option("--study", help="Study whose settings are used; the one that is here, or the default one."),
    click.option("--allow-code", is_flag=True, help="Let effect files that the data set names run."),
    click.option("--open", "opened", is_flag=True, help="Open the page in the browser."),
)


def _dataset_command(command):  # type: ignore[no-untyped-def]
    for option in reversed(_dataset_options):
        command = option(command)
    return click.argument("dataset")(command)


@click.command()
@_dataset_command
@workflow_options
def diagnose(dataset, **options):  # type: ignore[no-untyped-def]
    """Close the loop on DATASET: what the machine does beyond its model, named, added, and the error after.

    \b
    Examples:
      wearscope diagnose kr300 --open
      wearscope diagnose arm-data/dataset.yaml --cores 2
    """
    _run_on_dataset("closed_loop", dataset, results="closed_loop", **options)


@click.command()
@_dataset_command
@workflow_options
def track(dataset, **options):  # type: ignore[no-untyped-def]
    """Say what changed on the machine of DATASET since its reference sessions.

    \b
    Example:
      wearscope track arm-data --open
    """
    _run_on_dataset("track", dataset, results="tracking", **options)


@click.command()
@_dataset_command
@workflow_options
def detect(dataset, **options):  # type: ignore[no-untyped-def]
    """Apply the study's detectors to the recordings of DATASET.

    \b
    Example:
      wearscope detect arm-data --study my-study
    """
    _run_on_dataset("detect", dataset, results="detection", **options)


@click.command()
@study_argument
@click.option(
    "--dataset", type=click.Path(path_type=Path), help="Whose loop gives the models before and after."
)
@click.option("--before", multiple=True, metavar="MODEL", help="Instead: a model before; may be repeated.")
@click.option("--after", multiple=True, metavar="MODEL", help="A model after; may be repeated.")
@click.option("--open", "opened", is_flag=True, help="Open the page in the browser.")
@workflow_options
def reevaluate(study, dataset, before, after, opened, cores, settings, dry_run, verbose):  # type: ignore[no-untyped-def]
    """Ask the questions of STUDY of a model before and after its correction.

    \b
    Examples:
      wearscope reevaluate my-study --dataset arm-data --open
      wearscope reevaluate my-study --before arm --after results/closed_loop/arm/model_after.yaml
    """
    place = find_study(study)
    chosen = []
    if dataset is not None:
        chosen.append(f"dataset={_name_dataset(str(dataset))[0]}")
    if before or after:
        sides = {"before": [_locate(one) for one in before], "after": [_locate(one) for one in after]}
        chosen.append(f"reevaluate={json.dumps(sides)}")
    run_targets(("reevaluate",), place.folder, place.config, cores, (*chosen, *settings), dry_run, verbose)
    if not dry_run:
        show_result(place.results / "reevaluation" / "report.html", opened)


def _locate(robot: str) -> str:
    """Absolute path of a robot given by one; names stay."""
    return str(Path(robot).resolve()) if Path(robot).exists() else robot


@click.command()
@click.argument("model")
@workflow_options
def export(model, cores, settings, dry_run, verbose):  # type: ignore[no-untyped-def]
    """Write MODEL, a robot or a loop's corrected model, as what people simulate in: URDF, MJCF, a table.

    \b
    Example:
      wearscope export results/closed_loop/arm/model_after.yaml
    """
    from wearscope.config import label

    place = _study_or_default(None)
    folder, config = (Path.cwd(), None) if place is None else (place.folder, place.config)
    chosen = f"export={json.dumps({'model': _locate(model)})}"
    run_targets(("export",), folder, config, cores, (chosen, *settings), dry_run, verbose)
    if not dry_run:
        for file in sorted((folder / "results" / "export" / label(model)).glob("*")):
            click.echo(_shorten(file))
