"""What a workflow script says and how it ends."""

import errno
import importlib.util
from pathlib import Path
from types import SimpleNamespace

import pytest

from wearscope.errors import InputError

_SPEC = importlib.util.spec_from_file_location(
    "workflow_job", Path(__file__).parents[2] / "workflow" / "scripts" / "job.py"
)
job = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(job)


@pytest.fixture
def snakemake(tmp_path):
    return SimpleNamespace(rule="compute_it", wildcards=["medium"], log=[str(tmp_path / "it.log")])


def test_progress_and_end_are_logged_and_said(snakemake, capsys):
    Path(snakemake.log[0]).write_text("of an earlier run")
    with job.run_job(snakemake) as say:
        report = job.count_progress(say, 3, "points")
        for done in (1, 2, 3):
            report(done)
    lines = Path(snakemake.log[0]).read_text().splitlines()
    assert [line.split("] ")[1] for line in lines] == ["3/3 points", "done"]
    assert capsys.readouterr().err == "compute_it medium: 3/3 points\n"


@pytest.mark.parametrize("log", [None, "/dev/full"])
@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (InputError("row 3: no such thing; correct it."), "row 3: no such thing; correct it."),
        (
            OSError(errno.ENOSPC, "No space left on device", "models/x.urdf"),
            "models/x.urdf cannot be written (No space left on device); free disk space.",
        ),
        (
            OSError(errno.ENOSPC, "No space left"),
            "a file cannot be written (No space left); free disk space.",
        ),
    ],
)
def test_bad_input_and_full_disk_end_in_one_sentence(snakemake, capsys, error, sentence, log):
    snakemake.log = [log or snakemake.log[0]]
    with pytest.raises(SystemExit) as end, job.run_job(snakemake):
        raise error
    assert end.value.code == 1
    assert capsys.readouterr().err == f"compute_it medium: {sentence}\n"
    if log is None:
        assert sentence in Path(snakemake.log[0]).read_text()


@pytest.mark.parametrize("error", [TypeError("a defect"), OSError(errno.EACCES, "Permission denied")])
def test_a_defect_is_raised_with_its_traceback_in_the_log(snakemake, error):
    with pytest.raises(type(error)), job.run_job(snakemake):
        raise error
    assert "Traceback" in Path(snakemake.log[0]).read_text()
