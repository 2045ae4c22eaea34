from wearscope.cli.progress import end_badly, end_well

# Page of each target, shown at the end of a run; a partition shows none, since its study does.
ANSWERED = {
    "all": f"{R}/report.html",
    "report": f"{R}/report.html",
    "closed_loop": f"{LOOP_PAGE}/report.html",
    "reevaluate": f"{RE}/report.html",
    **{
        target: f"results/{folder}/{DATASET.name}/report.html"
        for target, folder in (("track", "tracking"), ("detect", "detection"))
        if DATASET
    },
}


onsuccess:
    if STUDY.partitions.number is None:
        asked = [ANSWERED[one] for one in workflow.dag_settings.targets or ["all"] if one in ANSWERED]
        end_well(list(map(Path, asked)), time.monotonic() - STARTED, json.dumps(config))


onerror:
    end_badly(log, list(workflow.dag_settings.targets))
