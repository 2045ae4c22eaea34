"""Failed points read back from the chunks' markers, counted and refused."""

import json

import pytest

from wearscope.simulation.chunk import check_failures, failure_table, read_markers

POINTS = {"identification": [1, 2, 3, 4], "validation": [1, 2, 3, 4], "nominal": [1]}
WHERE = "robot medium, cycle sweep"


def write_marker(folder, set_name, number, failed):
    path = folder / set_name / f"_chunk-{number}.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps({"fingerprints": {"1": "a"}, "failed": failed}))
    return path


def test_failures_of_all_chunks_are_read(tmp_path):
    markers = [
        write_marker(tmp_path, "validation", 0, {}),
        write_marker(tmp_path, "identification", 0, {"2": "lost"}),
        write_marker(tmp_path, "identification", 1, {"4": "fell"}),
    ]
    failures = read_markers(markers)[1]
    assert failures == {("identification", 2): "lost", ("identification", 4): "fell"}
    table = failure_table(failures, POINTS, "medium", "sweep")
    assert list(table.itertuples(index=False, name=None)) == [
        ("medium", "sweep", "identification", 2, "lost"),
        ("medium", "sweep", "identification", 4, "fell"),
    ]
    empty = failure_table({("audit", 1): "of a set not asked for"}, POINTS, "medium", "sweep")
    assert empty.empty and (empty.dtypes == table.dtypes).all()


@pytest.mark.parametrize("text", ["", "{}", '{"1": "print"}'])
def test_marker_of_another_kind_is_told(tmp_path, text, refuses):
    path = tmp_path / "_chunk-0.json"
    path.write_text(text)
    refuses(read_markers, [path])


def test_too_many_failed_simulations_are_refused(refuses):
    one = {("validation", 3): "lost", ("identification", 2): "stuck"}
    check_failures(one, POINTS, WHERE, 0.25)
    refuses(check_failures, one | {("validation", 4): "fell"}, POINTS, WHERE, 0.25)


def test_a_nominal_run_is_not_made_up_for_by_other_points(refuses):
    nominal = {("nominal", 1): "lost"}
    refuses(check_failures, nominal, POINTS, WHERE, 0.5)
    check_failures(nominal, {**POINTS, "nominal": [1, 2]}, WHERE, 0.5)


def test_the_share_of_a_chunk_is_of_the_whole_set(refuses):
    chunk, failed = {"identification": [7, 8]}, {("identification", 7): "fell", ("identification", 8): "fell"}
    check_failures(failed, chunk, WHERE, 0.05, {"identification": 40})
    refuses(check_failures, failed, chunk, WHERE, 0.05, {"identification": 39})
