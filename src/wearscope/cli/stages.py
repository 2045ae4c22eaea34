"""The commands that run targets of Snakemake, and the command `demo`."""

import sys
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click

from wearscope.cli.progress import format_seconds, say, shorten, show_progress, show_result
from wearscope.cli.study import (
    StudyPlace,
    check_code_named,
    count_cores,
    find_last_study,
    find_study,
    find_study_or_default,
    read_name,
    read_yaml,
    remember_study,
)
from wearscope.cli.workflow import (
    build_command,
    call_snakemake,
    explain_failure,
    keep_settings,
    merge,
    read_setting,
    wait_turn,
)
from wearscope.errors import InputError
from wearscope.storage.files import check_folder, read_json

#: Options of all commands that call Snakemake.
_SHARED = (
    click.option("--cores", type=click.IntRange(1), help="Number of cores; by default all."),
    click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="KEY=VALUE",
        help="Change a setting for this run only, e.g. seed=2 or snr.runs=1000.",
    ),
    click.option("--dry-run", "-n", is_flag=True, help="Only list the jobs that would run."),
    click.option(
        "--snakefile",
        type=click.Path(exists=True, dir_okay=False, path_type=Path),
        help="Workflow to use instead of the platform's; its code runs.",
    ),
    click.option("--verbose", "-v", is_flag=True, help="Show all output of Snakemake."),
)
study_argument = click.argument("study", required=False)


def workflow_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of the commands that call Snakemake."""
    for option in reversed(_SHARED):
        command = option(command)
    return command


def run_targets(
    targets: tuple[str, ...],
    place: StudyPlace,
    changes: Mapping[str, Any],
    cores: int | None,
    settings: tuple[str, ...],
    dry_run: bool,
    verbose: bool,
    snakefile: Path | None = None,
) -> None:
    """Run targets with Snakemake and show the progress.

    Parameters
    ----------
    targets : tuple of str
    place : StudyPlace
    changes : mapping
        Changes of the study's configuration that the command itself makes.
    settings : tuple of str
        Further changes, as the option ``--set`` takes them.
    cores, dry_run, verbose, snakefile
        As the command's options.

    Raises
    ------
    InputError
        Where a setting or the configuration cannot be read, or Snakemake fails; the sentence tells why.
    """
    folder, config = place.folder, read_yaml(place.config)
    check_folder(folder / "results")
    check_code_named(place, config)
    for change in (changes, *map(read_setting, settings)):
        config = merge(config, change)
    read_name(place.config, config)
    if snakefile is not None:
        say(f"Runs the workflow of {snakefile}, not the platform's.", err=True)
    log = folder / "results" / f"wearscope-{targets[0] if targets else 'all'}.log"
    seconds = [0.0]
    alone = nullcontext() if dry_run else wait_turn(folder, lambda told: say(told, err=True))
    with alone, keep_settings(folder, config) as file, show_progress(verbose) as watch:

        def keep_time(done, elapsed, line):  # type: ignore[no-untyped-def]
            seconds[0] = elapsed
            watch(done, elapsed, line)

        options = ("--dry-run",) if dry_run else ()
        command = build_command(targets, folder, cores or count_cores(), file, options, snakefile)
        try:
            code, progress = call_snakemake(command, folder, log, keep_time)
        except KeyboardInterrupt:
            say("Interrupted; the same command goes on from here.", err=True)
            sys.exit(130)
    if code:
        say(f"The log is {shorten(log)}.", err=True)
        raise InputError(explain_failure(progress, targets, folder))
    if dry_run:
        say(f"{progress.total} jobs to do." if progress.total else "Nothing to be done.")
    elif progress.total:
        say(
            f"{progress.total} jobs done in {format_seconds(seconds[0])}; the log is {shorten(log)}.",
            err=True,
        )
    else:
        say("Nothing to be done.", err=True)


@click.command()
@study_argument
@click.option("--stage", "-s", help="Stop after this target: design, simulate, snr, scope, audit, ...")
@click.option("--open", "opened", is_flag=True, help="Open the report in the browser.")
@workflow_options
def run(study, stage, opened, **options):  # type: ignore[no-untyped-def]
    """Run STUDY: a folder, a configuration file, or one of the included studies 'quick' and 'paper'.

    \b
    Examples:
      wearscope run quick
      wearscope run my-study --cores 4 --open
      wearscope run config/quick.yaml --stage snr
    """
    place = find_study(study)
    run_targets((stage,) if stage else (), place, {}, **options)
    if not options["dry_run"]:
        remember_study(place)
    if not stage and not options["dry_run"]:
        show_result(place.results / "report.html", opened)


@click.command()
@study_argument
@click.option("--open", "opened", is_flag=True, help="Open it in the browser.")
@workflow_options
def report(study, opened, **options):  # type: ignore[no-untyped-def]
    """Update the report of STUDY and print its path.

    STUDY may also be a folder of results with a report; this is shown without an update. The default is the
    study that was run here last.

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
    run_targets(("report",), place, {}, **options)
    if not options["dry_run"]:
        show_result(place.results / "report.html", opened)


def _read_named(dataset: str) -> tuple[Path, str]:
    """Return the folder of a data set, and the name of the folder of its results."""
    from wearscope.closed_loop.intake.dataset_fields import folder_name, load_fields

    path = Path(dataset)
    file = path / "dataset.yaml" if path.is_dir() else path
    return file.parent.resolve(), folder_name(load_fields(file).get("name"), str(file))


def _check_asked(answer: Path, dataset: Path) -> None:
    """Refuse an answer about another data set, or about an earlier state of this one.

    Raises
    ------
    InputError
        Where the digest in the answer is not that of the data set.
    """
    from wearscope.closed_loop.intake.data_folder import digest_dataset
    from wearscope.closed_loop.intake.dataset_fields import load_fields

    asked = digest_dataset(dataset, load_fields(dataset / "dataset.yaml"))
    if read_json(answer).get("dataset_digest") != asked:
        raise InputError(
            f"{answer}: is about other files than those of {dataset} (digest {asked[:12]}); remove it and "
            "run the same command again."
        )


def _run_on_dataset(target, dataset, study, allow_code, results, answer, opened, **options):  # type: ignore[no-untyped-def]
    """Run a target on a data set, check that the answer is about it, and show the page."""
    path, name = _read_named(dataset)
    changes = {"dataset": str(path), **({"allow_code": True} if allow_code else {})}
    if allow_code:
        say(f"Effect files that {path} names run.", err=True)
    place = find_study_or_default(study)
    run_targets((target,), place, changes, **options)
    made = place.folder / "results" / results / name
    if options["dry_run"]:
        return
    _check_asked(made / answer, path)
    show_result(made / "report.html", opened)


_study_option = click.option(
    "--study", help="Study whose settings are used; by default the one in this folder, or the included one."
)
_dataset_options = (
    _study_option,
    click.option("--allow-code", is_flag=True, help="Let effect files that the data set names run."),
    click.option("--open", "opened", is_flag=True, help="Open the page in the browser."),
)


def _dataset_command(command):  # type: ignore[no-untyped-def]
    """Add the argument and the options of a command on a data set."""
    for option in reversed(_dataset_options):
        command = option(command)
    return click.argument("dataset")(command)


@click.command()
@_dataset_command
@workflow_options
def diagnose(dataset, **options):  # type: ignore[no-untyped-def]
    """Find the effects that the model of the machine in DATASET lacks, and add them to the model.

    \b
    Examples:
      wearscope diagnose kr300 --open
      wearscope diagnose arm-data/dataset.yaml --cores 2
    """
    _run_on_dataset("closed_loop", dataset, results="closed_loop", answer="verdict.json", **options)


@click.command()
@_dataset_command
@workflow_options
def track(dataset, **options):  # type: ignore[no-untyped-def]
    """Find what changed on the machine in DATASET since its reference sessions.

    \b
    Example:
      wearscope track arm-data --open
    """
    _run_on_dataset("track", dataset, results="tracking", answer="tracking.json", **options)


@click.command()
@_dataset_command
@workflow_options
def detect(dataset, **options):  # type: ignore[no-untyped-def]
    """Apply the study's detectors to the recordings of DATASET.

    \b
    Example:
      wearscope detect arm-data --study my-study
    """
    from wearscope.detection.run import check_recordings

    check_recordings(dataset)  # before the diagnosis, which takes minutes
    _run_on_dataset("detect", dataset, results="detection", answer="detection.json", **options)


@click.command()
@study_argument
@click.option(
    "--dataset", type=click.Path(path_type=Path), help="Data set whose diagnosis gives the two models."
)
@click.option("--before", multiple=True, metavar="MODEL", help="Instead, the model before; may be repeated.")
@click.option("--after", multiple=True, metavar="MODEL", help="The model after; may be repeated.")
@click.option("--open", "opened", is_flag=True, help="Open the page in the browser.")
@workflow_options
def reevaluate(study, dataset, before, after, opened, **options):  # type: ignore[no-untyped-def]
    """Answer the questions of STUDY for a model before and after its correction.

    \b
    Examples:
      wearscope reevaluate my-study --dataset arm-data --open
      wearscope reevaluate my-study --before arm --after results/closed_loop/arm/model_after.yaml
    """
    place = find_study(study)
    changes: dict[str, Any] = {}
    named = None if dataset is None else _read_named(str(dataset))
    if named is not None:
        changes["dataset"] = str(named[0])
        if not before and not _has_payload(named[0]):
            say(f"{dataset} states no payload: its error is no factor of this comparison.", err=True)
            changes["screening"] = "drop"
    if before or after:
        changes["reevaluate"] = {
            "before": [_locate(one) for one in before],
            "after": [_locate(one) for one in after],
        }
    run_targets(("reevaluate",), place, changes, **options)
    if options["dry_run"]:
        return
    if named is not None and not before:
        _check_asked(place.folder / "results" / "closed_loop" / named[1] / "verdict.json", named[0])
    show_result(place.results / "reevaluation" / "report.html", opened)


def _has_payload(dataset: Path) -> bool:
    """Return whether any run of a data set, given by its folder, declares a payload."""
    from wearscope.closed_loop.intake.dataset_fields import load_fields

    runs = load_fields(dataset / "dataset.yaml").get("runs")
    known = runs if isinstance(runs, list) else []
    return any(isinstance(run, dict) and bool(run.get("payload")) for run in known)


def _locate(robot: str) -> str:
    """Return the absolute path of a robot that is given by a path; a name stays as it is."""
    return str(Path(robot).resolve()) if Path(robot).exists() else robot


@click.command()
@click.argument("model")
@_study_option
@workflow_options
def export(model, study, **options):  # type: ignore[no-untyped-def]
    """Write MODEL, a robot or a corrected model, in formats of other simulators: URDF, MJCF, a table.

    \b
    Examples:
      wearscope export results/closed_loop/arm/model_after.yaml
      wearscope export medium --set export.temperature=40
    """
    from wearscope.config import label

    place = find_study_or_default(study)
    run_targets(("export",), place, {"export": {"model": _locate(model)}}, **options)
    if options["dry_run"]:
        return
    from wearscope.export.run import FILES, tell_export

    made = place.folder / "results" / "export" / label(model)
    say(*tell_export(read_json(made / "export.json")), *(shorten(made / name) for name in FILES))


@click.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("results/demo"),
    show_default=True,
    help="Folder of the page and the models.",
)
@click.option("--open", "opened", is_flag=True, help="Open the page in the browser.")
def demo(out, opened):  # type: ignore[no-untyped-def]
    """Diagnose the included recordings of an arm: what its model lacks, and the error after correction.

    \b
    Example:
      wearscope demo --open
    """
    from wearscope.closed_loop.run import close_loop
    from wearscope.home import example_dataset
    from wearscope.reporting.closed_loop_page import write_closed_loop_page

    check_folder(out)
    say("Comparing four recordings of an arm with its model ...", err=True)
    close_loop(example_dataset(), out, light=True)
    write_closed_loop_page(out, example_dataset() / "robot.urdf")
    show_result(out / "report.html", opened)
