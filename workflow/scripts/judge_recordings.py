"""Applies the study's detectors to the recordings of a data set."""

from pathlib import Path

from job import clear_answer, run_job
from wearscope.designs.factors import Factor
from wearscope.detection.judgement import judge_recordings
from wearscope.detection.run import Setting, ask_recordings
from wearscope.detectors.questions import DetectorSpec

with run_job(snakemake) as say:
    params, folder = snakemake.params, Path(snakemake.output[0]).parent
    clear_answer(folder)
    setting = Setting(**params.setting)
    tested = ask_recordings(
        snakemake.input.dataset,
        next(iter(snakemake.input.robot)),
        [DetectorSpec(name, one["use"], one["options"]) for name, one in params.detectors.items()],
        [Factor(**one) for one in params.factors],
        setting,
        say,
        params.allow_code,
    )
    judge_recordings(tested, setting).write(folder)
