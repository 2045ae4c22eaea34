"""Refusals of data that merely look wrong (refusals by inference), and how a data set overrules them.

What cannot be right in any reading (a NaN, a missing column, time that runs backwards) is refused for good.
What merely looks wrong (units, signs, exchanged channels, gains, copies) is refused with a short code, and
the code in the field `accept` of `dataset.yaml` says that the data are right as they are.
"""

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import yaml

from wearscope.errors import InputError

#: Codes about one column: what looks wrong, and the column's name without the joint.
_BY_COLUMN = (
    "degrees q",
    "mm q",
    "limits q",
    "frozen q",
    "spikes q",
    "step q",
    "sign q",
    "zero q",
    "scale q",
    "sign tau",
    "gain tau",
    "clipped tau",
    "frozen tau",
    "speed qd",
)
#: Codes that concern the whole data set.
_OVERALL = (
    "degrees q",
    "mm q",
    "sign tau",
    "backwards t",
    "sign gravity",
    "size gravity",
    "unrelated tau",
    "unsigned tau",
    "without_gravity tau",
    "late tau",
    "clock tau",
    "clock t",
)


def list_codes(joints: Sequence[str], files: Sequence[str]) -> Iterator[str]:
    """Every code that a data set with these joints and runs may accept."""
    yield from _OVERALL
    for kind in _BY_COLUMN:
        yield from (f"{kind}_{joint}" for joint in joints)
    yield from (f"sign q_{joint} tau_{joint}" for joint in joints)
    yield from (f"exchanged q_{joint} tau_{joint}" for joint in joints)
    for one, other in combinations(joints, 2):
        for kind in ("tau", "q"):
            yield f"exchanged {kind}_{one} {kind}_{other}"
        yield f"exchanged q_{one} q_{other} tau_{one} tau_{other}"
    yield from (f"copy {file}" for file in files)


def exchange_code(joints: Sequence[str], kinds: Sequence[str], i: int, j: int) -> str:
    """Code for exchanged columns of joints i and j; their order does not matter."""
    one, other = joints[min(i, j)], joints[max(i, j)]
    return "exchanged " + " ".join(f"{kind}_{joint}" for kind in kinds for joint in (one, other))


def _normalise(entry: str) -> str:
    return " ".join(entry.replace("'", "").split())


@dataclass
class Acceptance:
    """The refusals by inference that a data set overrules.

    Attributes
    ----------
    entries : tuple of str
        Codes, as `list_codes` words them.
    used : set of str
        Entries that have overruled a refusal.
    """

    entries: tuple[str, ...] = ()
    used: set[str] = field(default_factory=set)

    @classmethod
    def read(
        cls, where: str, entries: Sequence[str], joints: Sequence[str], files: Sequence[str]
    ) -> "Acceptance":
        """Check the entries of the field `accept`.

        Raises
        ------
        InputError
            Where an entry is no refusal's code.
        """
        codes = list(list_codes(joints, files))
        taken = tuple(dict.fromkeys(map(_normalise, entries)))
        for entry in taken:
            if entry not in codes:
                near = difflib.get_close_matches(entry, codes, n=1)
                hint = f"did you mean '{near[0]}'? " if near else ""
                joint = joints[0]
                shown = sorted({code.replace(f"_{joint}", "_<joint>") for code in list_codes([joint], [])})
                shown += ["exchanged tau_<joint> tau_<joint>", "copy <file>"]
                raise InputError(
                    f"{where}: accept: '{entry}' is no refusal; {hint}each refusal says its own, and they "
                    f"are {', '.join(shown)}."
                )
        return cls(taken)

    def refuse(self, where: str, told: str, *codes: str) -> str:
        """Refuse by inference, unless every code is accepted; return then a note that says so.

        Parameters
        ----------
        where : str
            File or field that the sentence is about.
        told : str
            What the data look like, and the remedy: the sentence that continues `where`.
        *codes : str

        Raises
        ------
        InputError
            With the `accept` line that overrules it.
        """
        if self.accepts(*codes):
            self.used.update(codes)
            return f"{where}: taken as it is, since 'accept' says so, although {told}"
        line = yaml.safe_dump([*self.entries, *codes], default_flow_style=True, width=10**6).strip()
        verb, place = ("write", "in") if self.entries else ("add", "to")
        told = told.rstrip(".")
        raise InputError(
            f'{where}: {told}; if it is right as it is, {verb} "accept: {line}" {place} dataset.yaml.'
        )

    def accepts(self, *codes: str) -> bool:
        """Whether every code is accepted."""
        return set(codes) <= set(self.entries)

    def list_unused(self) -> list[str]:
        """Notes on entries that have overruled nothing."""
        return [
            f"accept: '{entry}' overrules nothing in these data and can be left out."
            for entry in self.entries
            if entry not in self.used
        ]
