"""Which sessions there are, and what is refused."""

from changed_fields import write_fields

from wearscope.tracking.session_names import file_name, name_sessions, read_sessions, sort_sessions


def test_dates_are_sorted_and_labels_keep_their_order():
    assert sort_sessions(["2026-03-02", "2026-03-01T23:00:00+02:00", "2026-03-01"]) == [
        "2026-03-01", "2026-03-01T23:00:00+02:00", "2026-03-02",
    ]  # fmt: skip
    assert sort_sessions(["b", "2026-03-01", "a"]) == ["b", "2026-03-01", "a"]


def write(folder, runs, reference):
    entries = [
        {"file": f"r{k}.parquet", "use": use, **({"session": s} if s else {})}
        for k, (use, s) in enumerate(runs)
    ]
    return write_fields(folder, ["a"], 100, entries, ["rigid_body"], reference=reference)


def test_reference_and_later_sessions(tmp_path):
    write(tmp_path, [("train", "2026-02-01"), ("test", "2026-03-01"), ("test", "2026-01-01"), ("test", None)],
          ["2026-02-01"])  # fmt: skip
    sessions = read_sessions(tmp_path)
    assert sessions.reference == ("2026-02-01",) and sessions.later == ("2026-01-01", "2026-03-01")
    assert sessions.notes == ("r3.parquet: has no session and was not used.",)
    assert dict(name_sessions(tmp_path).named) == {"2026-01-01": "2026-01-01", "2026-03-01": "2026-03-01"}


def test_what_cannot_be_tracked_is_refused_in_one_sentence(tmp_path, refuses):
    for runs, reference in (
        ([("train", "a"), ("test", "b")], []),
        ([("train", "a"), ("test", "b")], ["c"]),
        ([("train", "a"), ("test", "b")], ["b"]),
        ([("train", "a"), ("test", "a")], ["a"]),
    ):
        refuses(read_sessions, write(tmp_path, runs, reference))


def test_file_names_are_plain_and_differ():
    assert file_name("monday") == "monday"
    names = [file_name(label) for label in ("a/b", "a:b", "../../x", "2026-03-01T08:00:00", "é", "..")]
    assert len(set(names)) == len(names)
    assert all(set(name) <= set("abcdefghijklmnopqrstuvwxyzT0123456789-_.") for name in names)
    assert not any(name.startswith(".") for name in names)
