"""Columns of a recording that are taken, by kind: those that the user names, else those that are found."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from wearscope.errors import InputError
from wearscope.starters.columns import KINDS, Group, find_groups, is_commanded, match_pattern
from wearscope.starters.mapped import Mapped
from wearscope.starters.servos import choose_servo_groups

#: Pattern of a kind whose columns are left out.
NONE = "none"


def choose_groups(
    file: Path, columns: Sequence[str], joints: Sequence[str], mapped: Mapped
) -> dict[str, Group]:
    """Columns by kind: position, and torque or current, or what a servo's law needs; others where they are.

    Raises
    ------
    InputError
        Where there are no positions, or nothing that tells the torque.
    """
    groups: dict[str, Group] = {}
    for kind in KINDS:
        if mapped.patterns.get(kind) == NONE:
            continue
        if kind in mapped.patterns:
            groups[kind] = match_pattern(mapped.patterns[kind], columns, joints, kind, mapped.movable)
            continue
        found = find_groups(columns, joints, kind, mapped.movable)
        if found and not (kind != "position" and is_commanded(found[0])):
            groups[kind] = found[0]
    told = f"the columns are {', '.join(columns[:30])}"
    if "position" not in groups:
        if len(joints) > 1 and find_groups(columns, joints[:1], "position"):
            raise InputError(
                f"{file}: has the columns of one joint, and the URDF moves {', '.join(joints)}; put joints "
                f"that move together side by side in one file, as q_{joints[0]}, q_{joints[1]}, or give "
                f"--joints with the one that this file is of; {told}."
            )
        raise InputError(
            f"{file}: no column of positions is found for each of {', '.join(joints)}; name them with "
            f"--position 'NAME_*' or a list, or fewer joints with --joints; {told}."
        )
    if mapped.servo is not None:
        groups.pop("torque", None)
        groups.pop("current", None)
        return groups | choose_servo_groups(
            file, columns, joints, mapped.servo, mapped.patterns, mapped.movable
        )
    if mapped.patterns.get("current", NONE) != NONE:
        groups.pop("torque", None)
    if "torque" in groups:
        groups.pop("current", None)
    elif "current" not in groups:
        raise InputError(
            f"{file}: no column of torques or currents is found for each of {', '.join(joints)}; name "
            f"them with --torque 'NAME_*' or --current 'NAME_*'; {told}."
        )
    return groups


def describe_groups(groups: Mapping[str, Group]) -> list[str]:
    """A note on each kind's columns."""
    return [
        f"{kind}: {group.columns[0]}"
        + (f" to {group.columns[-1]}" if len(group.columns) > 1 else "")
        + (", commanded ones, as none is measured." if is_commanded(group) else ".")
        for kind, group in groups.items()
    ]
