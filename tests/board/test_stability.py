"""Which names count as changed between two verdicts."""

from benchmarks.stability import list_changes


def verdict(**names):
    return {"verdict": [{"effect": e, "joint": j, "equivalent": same} for e, (j, same) in names.items()]}


def test_names_of_a_set_are_kept_and_others_changed_each_way():
    before = verdict(joint_spring=("a1", ["gravity_counterbalance"]), backlash=("a2", []), viscous=("a3", []))
    after = verdict(gravity_counterbalance=("a1", []), backlash=("a1", []), viscous=("a3", []))
    assert list_changes(before, after) == (3, ["lost backlash@a2", "new backlash@a1"])
    assert list_changes(after, before) == (3, ["lost backlash@a1", "new backlash@a2"])
    assert list_changes(before, after, "a2") == (2, ["new backlash@a1"])
