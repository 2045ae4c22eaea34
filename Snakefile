# The study of a fault detector, from its design to the report; see docs/architecture.md.
#
#   snakemake --cores 2                                     the paper's study, config/config.yaml
#   snakemake --cores 2 --configfile config/quick.yaml      a small one
#   snakemake --cores 2 snr                                 up to one stage
#
# `wearscope run` and its sisters call these targets; `wearscope new study` makes a folder that includes this file.
from snakemake.utils import min_version

min_version("9.27")


report: "workflow/report/workflow.rst"


include: "workflow/rules/common.smk"
include: "workflow/rules/scheduler.smk"
include: "workflow/rules/design.smk"
include: "workflow/rules/partitions.smk"
include: "workflow/rules/simulate.smk"
include: "workflow/rules/test_quantities.smk"
include: "workflow/rules/surrogates.smk"
include: "workflow/rules/direct.smk"
include: "workflow/rules/audit.smk"
include: "workflow/rules/evaluation.smk"
include: "workflow/rules/closed_loop.smk"
include: "workflow/rules/detect.smk"
include: "workflow/rules/export.smk"
include: "workflow/rules/track.smk"
include: "workflow/rules/reevaluate.smk"
include: "workflow/rules/report.smk"
include: "workflow/rules/overview.smk"
include: "workflow/rules/archive.smk"
include: "workflow/rules/ending.smk"


rule all:
    default_target: True
    input:
        rules.report.input,
