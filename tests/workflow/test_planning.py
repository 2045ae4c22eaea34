"""How a study is cut into jobs, without Snakemake."""

import re
import shutil
from itertools import chain
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from calls import call_python

from wearscope.config import load_config
from wearscope.jobs.planning import Plan, needs
from wearscope.jobs.study_files import StudyFiles, find_script_sources, list_tracked, refuse_without_dataset
from wearscope.storage.files import LIST, show_answer
from wearscope.storage.tables import write_table

ROOT = Path(__file__).parents[2]


def read_quick(**settings):
    return load_config(yaml.safe_load((ROOT / "config" / "quick.yaml").read_text()) | settings)


def make_plan(packs=False, drops=False, **simulation):
    return Plan(read_quick(simulation={"chunk": 7, **simulation}), "results/quick", packs, drops)


def count_points(plan, name):
    """Points of all chunks of a set, the last of which may be short."""
    return sum(
        min(plan.points_per_job, plan.points[name] - chunk * plan.points_per_job)
        for chunk in plan.chunks(name)
    )


def test_chunks_hold_each_point_once():
    plan = make_plan()
    for name in plan.study_sets:
        assert count_points(plan, name) == plan.points[name] > 0
        files = plan.traces("medium", "moves", name)
        assert len(set(files)) == len(plan.chunks(name))
        assert all(file.startswith(f"results/quick/traces/medium/moves/{name}/") for file in files)


def test_recordings_are_files_only_where_they_are_packed():
    assert make_plan().packed("medium", "moves", "identification") == []
    plan = make_plan(packs=True)
    asked = ("medium", "moves", "identification", "nominal")
    assert [file.replace(".tar", ".json") for file in plan.packed(*asked)] == plan.traces(*asked)


def test_recordings_that_are_dropped_are_packed_until_then_but_for_nominal_ones():
    plan = make_plan(drops=True)
    for name in plan.points:
        packed = plan.packed("medium", "moves", name)
        assert bool(packed) != ("nominal" in name), name
    assert plan.packed_sets("filling", "nominal", "mismatch_nominal", "audit") == ["filling", "audit"]


@pytest.mark.parametrize(("point", "quantity"), [(1.0, 0.25), (0.3, 2.0), (2.0, 2.0)])
def test_a_chunk_of_test_quantities_takes_the_traces_that_its_points_lie_in(point, quantity):
    """Each point's trace, counted by itself, is among them, and none that holds no point of the chunk."""
    plan = make_plan(job_seconds=8, point_seconds=point, quantity_seconds=quantity)
    size = plan.study.simulation.quantities_per_job()
    cut = plan.quantity_chunks(*plan.run_sets)
    assert cut and [name for name, _ in cut] == sorted(name for name, _ in cut)
    for name, chunk in cut:
        points = range(chunk * size, min((chunk + 1) * size, plan.points[name]))
        needed = sorted({point // plan.points_per_job for point in points})
        expected = [plan.traces("r", "c", name)[k] for k in needed] + plan.traces("r", "c", "nominal")
        w = SimpleNamespace(robot="r", cycle="c", set=name, chunk=str(chunk))
        assert plan.quantity_traces(plan.traces, w) == expected
    covered = chain(
        *(range(c * size, min((c + 1) * size, plan.points[n])) for n, c in cut if n == "validation")
    )
    assert list(covered) == list(range(plan.points["validation"]))


def test_test_quantities_come_from_traces_or_from_their_chunks():
    w = SimpleNamespace(robot="r", cycle="c")
    whole = make_plan().quantity_inputs("identification")
    assert whole["parts"] == [] and len(whole["traces"](w)) > 0
    cut = make_plan(job_seconds=8, point_seconds=1.0, quantity_seconds=1.0).quantity_inputs("identification")
    assert len(cut["parts"]) == len(cut["failed"]) > 1 and cut["traces"](w) == []


def test_tables_are_named_by_robot_and_cycle_or_by_partition():
    plan = Plan(read_quick(robots=["medium", "large"]), "results/quick", False)
    assert plan.parts("screening", "screening", "{robot}") == [
        "results/quick/screening/medium.parquet", "results/quick/screening/large.parquet",
    ]  # fmt: skip
    each = plan.parts("snr", "snr", "{robot}", "{cycle}")
    assert len(set(each)) == len(each) == 2 * len(plan.study.cycles)
    assert plan.whole("snr") == ["results/quick/snr.parquet"]
    study = read_quick(robots=["medium", "large"], partitions={"robots": 1, "above": 1})
    divided = Plan(study, "results/quick", False)
    wanted = [f"results/quick/partitions/{number:05d}/snr.parquet" for number in (0, 1)]
    assert divided.parts("snr", "snr", "{robot}") == divided.whole("snr") == wanted


def test_inputs_of_a_section_are_those_of_its_surrogates():
    plan = make_plan()
    assert plan.asked_of("full")(None) == {"surrogates": "results/quick/surrogates.parquet"}
    chosen = plan.asked_of("chosen", plan.whole)(None)
    assert set(chosen) == {"surrogates", "chosen", "test_quantities"}
    assert chosen["chosen"] == ["results/quick/chosen_surrogates.parquet"]
    figures = plan.figure_files(
        plan.scope_figures, "made", lambda file, **about: (file, about.get("caption"))
    )
    assert len(figures) == 2 * len(plan.scope_figures)
    svg = next(iter(figures.values()))
    assert svg == (f"made/figures/{plan.scope_figures[0]}.svg", "../report/scope.rst")
    drawn = plan.drawn_files("loop", "before", "after")
    assert len(set(drawn)) == 2 * plan.study.reevaluate.draws and drawn[0].startswith("loop/drawn/before-01")


def test_a_second_look_is_asked_for_only_where_its_design_has_points(tmp_path):
    plan, design = make_plan(drops=True), tmp_path / "recheck.parquet"
    for points, files in (([], 0), ([1], len(plan.audited) * len(plan.study.robots))):
        write_table(design, {"point": np.array(points, dtype=int)})
        assert len(set(plan.rechecked(str(design)))) == files
    folder = "results/quick/traces/{robot}/{cycle}"
    assert plan.recordings_of(["nominal", "audit"]) == [f"{folder}/audit/_chunk-0.tar"]


def test_a_job_that_is_tried_again_asks_for_more():
    asked = needs(1000, 20)
    assert [asked[key](None, attempt) for key in ("mem_mb", "runtime") for attempt in (1, 3)] == [
        1000, 3000, 20, 60,
    ]  # fmt: skip


def test_files_of_a_study_are_its_own_and_what_its_jobs_run(tmp_path):
    robot = tmp_path / "theirs"
    shutil.copytree(ROOT / "config" / "robots" / "medium", robot)
    (tmp_path / "own.py").write_text("DETECTOR = None")
    study = read_quick(
        robots=["medium", str(robot)], detectors={"C": "friction_fit", "X": str(tmp_path / "own.py")}
    )
    flagged = []
    files = StudyFiles(study, "results/q", str(ROOT), lambda found: flagged.extend(found) or found)
    own = {Path(file).resolve() for file in files.own_files()}
    assert own >= {tmp_path / "own.py", robot / "model.yaml", robot / "robot.urdf"}
    assert not any("src" in file.parts for file in own)
    assert {Path(one).name for one in files.code("compute_snr")} >= {"compute_snr.py", "job.py", "snr.py"}
    assert set(files.code("compute_snr")) <= set(flagged)
    assert files.installed("detectors", "robots") == {} and files.dataset_inputs == {}
    assert any(str(one).endswith("page.html") for one in files.report_files)
    code = files.list_partition_code()
    assert len(set(code)) == len(code) and set(files.code("compute_snr")) <= set(code)


def test_a_robot_that_a_rule_makes_has_the_effects_of_its_sources():
    carried = {"large": {"source": "medium"}}
    files = StudyFiles(read_quick(robots=["large"], carry_over=carried), "results/q", str(ROOT))
    made = "results/q/robots/large.yaml"
    assert files.robots == {"large": made} and files.robot_files(made) == [made, made[:-4] + "urdf"]
    assert set(files.robot_effects(made)) > set(files.robot_effects("medium"))


def test_models_of_a_reevaluation_are_files_of_a_loop_or_of_robots():
    lent = {"carry_over": {"source": "large"}}
    files = StudyFiles(read_quick(reevaluate=lent), "results/q", str(ROOT))
    found = files.reevaluated_models(["loop/model_after.yaml", "medium"], "loop")
    parents = [Path(file).parent.name for file in found]
    assert sorted(parents) == ["large", "large", "loop", "medium", "medium"]


def test_tracking_without_sessions_ends_in_a_sentence():
    with pytest.raises(SystemExit, match="dataset is missing; say which machine"):
        list_tracked(None, "")
    with pytest.raises(SystemExit, match="why"):
        list_tracked(SimpleNamespace(refusal="why"), "results/tracking/m")
    assert "results/tracking/m/report.html" in list_tracked(SimpleNamespace(refusal=""), "results/tracking/m")
    with pytest.raises(SystemExit, match="dataset is missing; name a data set"):
        refuse_without_dataset(None)


@pytest.mark.parametrize("plans", [True, False])
def test_answer_that_lost_a_file_is_shown_again_by_the_process_that_plans(tmp_path, plans):
    folder, made = tmp_path / "answer", tmp_path / ".made" / "answer"
    made.mkdir(parents=True)
    (made / "report.html").write_text("page")
    show_answer(made, folder)
    files = StudyFiles(read_quick(), "results/q", str(ROOT), plans=plans)
    assert files.made_in(str(folder)) == str(made)
    assert files.shown(str(folder)) == [str(made / LIST)] and (made / LIST).is_file()
    (folder / "report.html").unlink()
    assert files.shown(str(folder)) == [str(made / LIST)] and (made / LIST).is_file() != plans


def test_answer_in_a_storage_is_made_in_its_final_folder():
    files = StudyFiles(read_quick(), "results/q", str(ROOT), carried=True)
    assert files.made_in("results/closed_loop/m") == "results/closed_loop/m"
    assert files.shown("results/closed_loop/m") == []


def test_a_refused_robot_ends_the_run_in_its_sentence():
    files = StudyFiles(read_quick(), "results/q", str(ROOT))
    with pytest.raises(SystemExit, match="config: robots: "):
        files.robot_files("nowhere")


def test_each_figure_has_its_category():
    plan = make_plan()
    assert set(plan.figures) <= plan.categories.keys()
    assert {f"scope_{factor}" for factor in plan.study.scope.factors} <= set(plan.figures)


def test_sources_of_a_script_include_scripts_that_it_imports_and_plugins_that_are_there(tmp_path):
    (tmp_path / "run.py").write_text("from shared import x\nfrom wearscope.errors import InputError\n")
    (tmp_path / "shared.py").write_text("from deeper import y\n")
    (tmp_path / "deeper.py").write_text("y = 1\n")
    (tmp_path / "other.py").write_text("")
    (tmp_path / "own.py").write_text("from wearscope.limits import *\n")
    found = find_script_sources(tmp_path / "run.py", tmp_path / "own.py", tmp_path / "missing.py")
    assert {one.stem for one in found if one.parent == tmp_path} == {"run", "shared", "deeper", "own"}
    assert {"errors.py", "limits.py"} <= {one.name for one in found}


def test_what_plans_imports_nothing_heavy():
    """The modules that rules import, each time that anything is run."""
    text = "\n".join(file.read_text() for file in (ROOT / "workflow" / "rules").glob("*.smk"))
    modules = sorted(set(re.findall(r"^ *(?:from|import) (wearscope[.\w]*)", text, re.MULTILINE)))
    assert len(modules) > 5
    heavy = "numpy pyarrow pandas scipy pinocchio pybullet numba matplotlib jinja2".split()
    code = f"""
import importlib, sys
for name in {modules}:
    importlib.import_module(name)
print([name for name in {heavy} if name in sys.modules])"""
    assert call_python("-c", code).stdout == "[]\n"
