"""What a verdict got right, missed and invented."""

from dataclasses import dataclass, field

from benchmarks.outside.planted import ROBOT_WIDE


@dataclass
class Score:
    """Outcome of a case.

    Attributes
    ----------
    found, by_set, missed, extra, unknown : list of str
        By name; in a set of names only; not at all; false names; false `unknown`.
    silent : list of str
        Joints with an outsider that are answered neither `unknown` nor `unexplained`.
    unexplained : list of str
        Joints said to be unexplained where nothing is.
    worse : list of str
        Joints whose held-out error grew by more than 3 %.
    refuted : list of str
    plain : tuple of int
        Joints with undeclared friction: all right, and all.
    """

    found: list = field(default_factory=list)
    by_set: list = field(default_factory=list)
    missed: list = field(default_factory=list)
    extra: list = field(default_factory=list)
    unknown: list = field(default_factory=list)
    silent: list = field(default_factory=list)
    unexplained: list = field(default_factory=list)
    worse: list = field(default_factory=list)
    refuted: list = field(default_factory=list)
    plain: tuple = (0, 0)

    @property
    def exact(self):
        """All and only what is there; a planted name in the set of names counts."""
        return not (self.missed or self.extra or self.unknown or self.silent)


def score_verdict(verdict, truth, joints):
    """Compare ``verdict.json`` with a `Truth`.

    Parameters
    ----------
    verdict : dict
    truth : Truth
    joints : list of str
    """
    score = Score()
    entries = [(joints.index(e["joint"]), e) for e in verdict["verdict"]]
    free = dict(enumerate(entries))
    for stage in ("name", "set"):
        for j, effect in sorted(truth.must):
            label = f"{effect}@{j + 1}"
            if label in score.found or label in score.by_set:
                continue
            for k, (at, entry) in list(free.items()):
                names = [entry["effect"]] if stage == "name" else entry["equivalent"]
                if effect in names and (at == j or effect in ROBOT_WIDE):
                    (score.found if stage == "name" else score.by_set).append(label)
                    del free[k]
                    break
    known = {*score.found, *score.by_set}
    score.missed = [f"{e}@{j + 1}" for j, e in sorted(truth.must) if f"{e}@{j + 1}" not in known]
    for at, entry in free.values():
        names = {entry["effect"], *entry["equivalent"]}
        # A further harmonic, or the second form of one thing, has the same name once more.
        there = truth.may | {(at, name) for _, name in truth.may if name in ROBOT_WIDE}
        if any((at, name) in there for name in names) or (at, entry["effect"]) in truth.must:
            continue
        if entry["effect"] == "unknown":
            if at not in truth.outside:
                score.unknown.append(f"unknown@{at + 1}")
            continue
        score.extra.append(f"{entry['effect']}@{at + 1}" + "".join(f"/{n}" for n in entry["equivalent"]))
    answered = {at for at, entry in entries if entry["effect"] == "unknown"}
    state = [verdict["joints"][name] for name in joints]
    for j in sorted(truth.outside):
        if j not in answered and state[j]["state"] != "unexplained":
            score.silent.append(f"joint {j + 1}")
    for j, s in enumerate(state):
        if s["state"] == "unexplained" and j not in truth.outside:
            score.unexplained.append(f"{j + 1}: {s['unexplained_reason']}")
        before, after = s["rms_before"], s["rms_after"]
        if before is not None and after is not None and after > 1.03 * before:
            score.worse.append(f"{j + 1}: {before:.3g} -> {after:.3g}")
    score.refuted = [f"{e['effect']}@{at + 1}" for at, e in entries if e["status"] == "refuted"]
    score.plain = _count_plain(entries, truth, len(joints))
    return score


def _count_plain(entries, truth, n):
    friction = ("coulomb", "viscous")
    asked = [j for j in range(n) if any((j, e) in truth.must for e in friction)]
    right = 0
    for j in asked:
        must = {e for i, e in truth.must if i == j}
        may = must | {e for i, e in truth.may if i == j}
        named = {e["effect"] for at, e in entries if at == j}
        right += must <= named <= may
    return right, len(asked)


def summarise(rows):
    """Counts over rows of `scores.jsonl`, as text."""
    asked = [row for row in rows if "crash" not in row]
    nulls = [row for row in asked if not row["regime"]["plants"]]
    planted = [row for row in asked if row["must"] and row["regime"]["plants"]]
    outside = [row for row in asked if row["outside"]]
    found = sum(len(row["found"]) for row in planted)
    by_set = sum(len(row["by_set"]) for row in planted)
    missed = sum(len(row["missed"]) for row in planted)
    plain = [sum(row["plain"][k] for row in asked) for k in (0, 1)]
    lines = [
        f"cases {len(rows)}, crashed or refused {len(rows) - len(asked)}, "
        f"exact {sum(r['exact'] for r in asked)}",
        f"nulls {len(nulls)}, with a false name {sum(bool(r['extra'] or r['unknown']) for r in nulls)}, "
        f"said to be unexplained {sum(bool(r['unexplained']) for r in nulls)}",
        f"planted {len(planted)}, exact {sum(r['exact'] for r in planted)}, "
        f"with an extra name {sum(bool(r['extra']) for r in planted)}, an extra unknown "
        f"{sum(bool(r['unknown']) for r in planted)}",
        f"effects: by name {found}, in a set of names {by_set}, missed {missed}",
        f"outsiders {len(outside)}, answered {sum(not r['silent'] for r in outside)}",
        f"joints without declared friction: all and only its terms {plain[0]} of {plain[1]}",
        f"cases with a joint 3 % worse {sum(bool(r['worse']) for r in asked)}, with a refuted name "
        f"{sum(bool(r['refuted']) for r in asked)}",
        f"processor seconds: median {sorted(r['seconds'] for r in rows)[len(rows) // 2]:.0f}, "
        f"most {max(r['seconds'] for r in rows):.0f}",
    ]
    return "\n".join(lines)
