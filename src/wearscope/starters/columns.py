"""Finds the column of each signal and joint in a recording by the columns' names.

A name is split into words. Words tell the kind of the signal, the joint (by its name or number), the unit,
and whether the values were measured or commanded.
"""

import fnmatch
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wearscope.errors import InputError
from wearscope.robots.spatial import Array

#: Units of a torque or current that is stated relative to the rated one.
SHARES = ("%", "‰", "permille", "percent", "pct")
#: Kinds of signal that are looked for in every recording.
KINDS = ("position", "velocity", "torque", "current", "temperature")
#: Words in columns' names, English and others, that tell the kind of the signal.
_WORDS = {
    "position": "q pos position positions angle angles ang theta phi winkel qpos encoder "
    "encoders enc pulse pulses lage posicion posizione jp th weg verfahrweg hub stroke travel displacement",
    "velocity": "qd dq qp jv dtheta thd vel velo velocity velocities speed speeds spd omega qvel "
    "geschwindigkeit drehzahl vitesse velocidad velocita",
    "acceleration": "qdd ddq acc accel acceleration accelerations",
    "torque": "tau torque torques torq tor trq tq frc effort efforts eff moment moments momenten mom "
    "drehmoment couple force forces qfrc kraft par coppia fuerza forza",
    "current": "i iq current currents curr cur amp amps ampere strom courant corriente corrente",
    "temperature": "temp temperature temperatures temperatur",
}
#: Words that occur only in the columns of servos, by kind.
_SERVO = {
    "duty": set("duty pwm load".split()),
    "volts": set("volt volts voltage voltages".split()),
    "on": set("enable enabled".split()),
}
#: Kind by word.
_KIND = {word: kind for kind, words in _WORDS.items() for word in words.split()}
#: Words long enough to be found at the end of a compound word, the longest first.
_LONG = sorted((word for word in _KIND if len(word) >= 5), key=len, reverse=True)
#: Words that are written together with a kind: before it, as in jointpos; or after it, as in lageistwert.
#: Those after it are mapped to the German word for actual (ist) or target (soll).
_BEFORE, _AFTER = ("joint", "jnt", "axis", "motor", "actuator"), {"istwert": "ist", "sollwert": "soll"}
#: Words of measured values, of commanded values, and of signals that are something else than a joint's.
_ACTUAL = set("actual act measured meas msr fbk fdb fb feedback real ist ai".split())
_TARGET = set(
    "target desired des d cmd command commanded ref reference setpoint set goal plan planned soll consigne "
    "action computed calculated predicted".split()
)
_OTHER = set(
    "tcp tool pose cartesian error err diff disturbance dist limit max min std window raw ext external est "
    "estimated model simulated ff feedforward".split()
)
#: A column whose words are all among these names a joint but no kind; it is taken for the position.
_BARE = (
    _ACTUAL
    | _TARGET
    | set("joint joints axis axes rax jnt j egm state states observation robot value".split())
)
_TIME = set(
    "t ts time timestamp stamp clock utc datetime date epoch elapsed duration zeit zeitstempel temps tiempo "
    "ipoc".split()
)
#: Units of time, which may be all of a clock's name.
_CLOCKS = set("sec secs second seconds sekunden ms millis milliseconds us micros microseconds ns".split())
#: Revolutions per minute, as makers of drives write them.
_TURNS_A_MINUTE = re.compile(r"(1|u|r|rev|turns?)/min|min-1|min\^-1")
#: Factor from a unit in a column's name to rad or m, rad/s, N m or N, and A. A share of a rated value has the
#: factor 1, as its unit depends on the drive.
_FACTORS = {
    "rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295, "degree": 0.017453292519943295,
    "degrees": 0.017453292519943295, "grad": 0.017453292519943295,
    "turn": 6.283185307179586, "turns": 6.283185307179586, "rev": 6.283185307179586, "mm": 1e-3, "m": 1.0,
    "nm": 1.0, "mnm": 1e-3, "knm": 1e3, "danm": 10.0, "ncm": 1e-2, "cnm": 1e-2, "kgfcm": 0.0980665,
    "kgcm": 0.0980665, "kgfm": 9.80665, "ozin": 0.00706155, "lbin": 0.112985, "lbfin": 0.112985,
    "inlb": 0.112985, "lbft": 1.35582, "lbfft": 1.35582, "ftlb": 1.35582, "ftlbf": 1.35582, "n": 1.0,
    "kn": 1e3, "ma": 1e-3, "a": 1.0, "rpm": 0.10471975511965977, **dict.fromkeys(SHARES, 1.0),
}  # fmt: skip
_UNITS_OF = {
    "position": {"rad", "mrad", "deg", "degree", "degrees", "grad", "turn", "turns", "rev", "mm", "m"},
    "velocity": {"rad", "mrad", "deg", "degree", "degrees", "mm", "m", "rpm"},
    "torque": set(
        "nm mnm knm danm ncm cnm kgfcm kgcm kgfm ozin lbin lbfin inlb lbft lbfft ftlb ftlbf n kn".split()
    )
    | {*SHARES},
    "current": {"ma", "a", *SHARES},
    "temperature": set(),
}
#: A bare column names no kind and is taken for the position.
_UNITS_OF["bare"] = _UNITS_OF["position"]
#: Patterns of a unit at the end of a column's name, as in q1_deg, and of a unit in brackets.
_SUFFIX = re.compile(r"_([A-Za-z]+(?:/[A-Za-z]+)?)$")
_BRACKETS = re.compile(r"[\[(]([^\])]*)[\])]")


#: Columns in sets: those that differ only in the joint's name or number share the other words, which are the
#: key. Within a set, column by joint index or number.
_Taken = dict[tuple[str, ...], dict[int, str]]


@dataclass(frozen=True)
class Group:
    """Columns of one kind, one for each joint.

    Attributes
    ----------
    kind : str
        One of `KINDS`, or a kind of a servo's columns.
    columns : tuple of str
        Columns in the order of the joints.
    words : tuple of str
        Words of the columns' names, apart from the joints' names and numbers.
    """

    kind: str
    columns: tuple[str, ...]
    words: tuple[str, ...] = ()

    @property
    def is_commanded(self) -> bool:
        """Return whether the names say that the values were commanded, not measured."""
        return bool(set(self.words) & _TARGET)

    @property
    def units(self) -> list[str]:
        """Units that the names state, each once."""
        return [unit for unit in dict.fromkeys(find_unit(one, self.kind) for one in self.columns) if unit]

    @property
    def unknown(self) -> str:
        """Text in brackets that all names share and that is no known unit; empty where there is none."""
        texts = {text for one in self.columns for text in _BRACKETS.findall(one)}
        text = min(texts, default="")
        return text if len(texts) == 1 and not self.units and re.fullmatch(r"\D*[^\W\d]\D*", text) else ""

    @property
    def factors(self) -> Array:
        """Factors (n,) from the named units to rad, m, rad/s, m/s, N m, N or A; 1 without a unit."""
        units = [find_unit(one, self.kind) for one in self.columns]
        by_minute = np.array([60.0 if unit.endswith("/min") else 1.0 for unit in units])
        return np.array([_FACTORS.get(unit.removesuffix("/min"), 1.0) for unit in units]) / by_minute


def split_name(name: str) -> list[str]:
    """Split a column's name into words and numbers in small letters, without accents: ``Velocità_0``."""
    plain = "".join(one for one in unicodedata.normalize("NFD", name) if not unicodedata.combining(one))
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", plain)
    words = re.findall(r"[a-zµ]+|\d+|%", spaced.lower())
    return [part for word in words for part in _split_compound(word)]


def _split_compound(word: str) -> list[str]:
    """Split a compound word that ends with a word of a kind: istposition -> ist, position."""
    if word in _KIND:
        return [word]
    for end, mark in _AFTER.items():
        if word.endswith(end) and word != end:
            return [*_split_compound(word.removesuffix(end)), mark]
    for begin in _BEFORE:
        parts = _split_compound(word.removeprefix(begin)) if word.startswith(begin) else []
        if parts and parts[-1] in _KIND:
            return [begin, *parts]
    end = next((one for one in _LONG if word.endswith(one)), "")
    return [word.removesuffix(end), end] if end else [word]


def find_unit(name: str, kind: str) -> str:
    """Find the unit in a column's name: in brackets, at its end, or as a word; empty where there is none."""
    name = name.replace("_per_", "/")
    # A single letter within a name more often names a joint or an axis than a unit.
    inner = [word for word in re.split(r"[^A-Za-z]+", name) if len(word) > 1]
    for text in [*_BRACKETS.findall(name), *_SUFFIX.findall(name), *inner]:
        if kind == "velocity" and _TURNS_A_MINUTE.fullmatch(text.lower().strip()):
            return "rpm"
        word, time = _split_unit(text)
        if word in _UNITS_OF.get(kind, set()):
            return f"{word}/min" if kind == "velocity" and time == "min" else word
    return ""


def _split_unit(text: str) -> tuple[str, str]:
    """Split a unit at the slash into the unit and its time: ``deg/s`` -> deg, s."""
    one, _, time = text.lower().replace("°", "deg").partition("/")
    unit = re.sub(r"[^a-z%‰]", "", one)
    return unit[:1] if unit.startswith(("%", "‰")) else unit, time.strip()


def _kind_by_unit(name: str) -> str | None:
    """Tell a column's kind by the unit in brackets or at its end; None unless exactly one kind fits."""
    for text in [*_BRACKETS.findall(name), *(one for one in _SUFFIX.findall(name) if len(one) > 1)]:
        word, time = _split_unit(text)
        kinds = ("velocity",) if time in ("s", "sec", "min") else ("position", "torque", "current")
        found = [kind for kind in kinds if word in _UNITS_OF[kind]]
        if len(found) == 1 and time in ("", "s", "sec", "min"):
            return found[0]
    return None


def _without_unit(name: str, kind: str) -> str:
    """Return a column's name without the unit in brackets or at its end."""
    name = re.sub(r"[\[(][^\])\d]*[\])]", " ", name)
    suffix = _SUFFIX.findall(name)
    return _SUFFIX.sub(" ", name) if suffix and suffix[0].lower() in _UNITS_OF.get(kind, set()) else name


def tell_kind(words: Sequence[str]) -> str | None:
    """Return the kind of signal that a column's words indicate; None if no word does."""
    kinds = [_KIND[word] for word in words if word in _KIND]
    if not kinds:
        return None
    kind = next((one for one in kinds if one != "position"), kinds[0])
    if kind == "position" and "ddot" in words:
        return "acceleration"
    return "velocity" if kind == "position" and "dot" in words else kind


def _is_kind(words: Sequence[str], kind: str, column: str) -> bool:
    """Return whether a column holds a kind of signal; `words` are its name's words without the joint's."""
    told = tell_kind(words)
    if kind == "bare":
        return (
            set(words) - {"a"} <= _BARE
            and list(words) != ["a"]
            and _kind_by_unit(column) in (None, "position")
        )
    if kind in _SERVO:
        return bool(_SERVO[kind] & set(words)) and (kind == "on" or told is None)
    if told is None and not any(_SERVO[one] & set(words) for one in _SERVO):
        told = _kind_by_unit(column)
    return told == kind and not _SERVO["on"] & set(words)


def _take_out(words: Sequence[str], part: Sequence[str]) -> list[str] | None:
    """Remove successive words from a list of words; None where the list does not contain them."""
    places = range(len(words) - len(part) + 1)
    k = next((k for k in places if list(words[k : k + len(part)]) == list(part)), None)
    return None if k is None else [*words[:k], *words[k + len(part) :]]


def find_groups(
    columns: Sequence[str], joints: Sequence[str], kind: str, movable: Sequence[str] = ()
) -> list[Group]:
    """Find sets of columns with one column of a kind of signal for each joint, the likeliest set first.

    Parameters
    ----------
    columns, joints : sequence of str
    kind : str
        One of `KINDS`, or a servo's duty, volts or on.
    movable : sequence of str
        All movable joints of the robot. Where `joints` are only some of them, the columns may be numbered
        over all.

    Returns
    -------
    list of Group
        Measured values come first, then values whose names do not tell, then commanded values.
    """
    names = _own_words(joints)
    by_name: _Taken = {}
    by_number = _find_numbered(columns, kind)
    for column in columns:
        words = split_name(_without_unit(column, kind))
        matches = [
            (len(name), k, without)
            for k, own in enumerate(names)
            for name in own
            if (without := _take_out(words, name)) is not None
        ]
        if matches:
            _, best, without = max(matches, key=lambda one: one[0])
            if _is_kind(without, kind, column):
                by_name.setdefault(tuple(without), {})[best] = column
        numbers = [word for word in words if word.isdigit()]
        alone = not matches and not numbers and len(joints) == 1 and kind != "bare"
        if alone and _is_kind(words, kind, column):
            by_name.setdefault(tuple(words), {})[0] = column
    found = _complete(by_number, by_name, len(joints))
    if not found:
        # A set may mix words of a kind: the torque of a prismatic joint is named a force.
        found = _complete(_merge(by_number), _merge(by_name), len(joints))
    if not found and set(joints) < set(movable):
        return [_pick(one, joints, movable) for one in find_groups(columns, movable, kind)]
    if kind == "position" and not found:
        return [replace(one, kind=kind) for one in find_groups(columns, joints, "bare")]
    ranked = sorted(found, key=lambda chosen: _rank(found[chosen], kind))
    return [Group(kind, chosen, found[chosen]) for chosen in ranked]


def _pick(whole: Group, joints: Sequence[str], movable: Sequence[str]) -> Group:
    """Pick the columns of some joints from those of all movable joints."""
    return replace(whole, columns=tuple(whole.columns[movable.index(joint)] for joint in joints))


def _merge(taken: _Taken) -> _Taken:
    """Merge sets whose words differ only by words of the kind; the first column of a joint is kept.

    A name may have none, as its unit tells the kind: ``Boom angle (deg)`` and ``Extension (m)``.
    """
    merged: _Taken = {}
    for words, own in taken.items():
        other = merged.setdefault(tuple(word for word in words if word not in _KIND), {})
        other |= {joint: column for joint, column in own.items() if joint not in other}
    return merged


def _complete(by_number: _Taken, by_name: _Taken, n: int) -> dict[tuple[str, ...], tuple[str, ...]]:
    """Return the words of each set that has a column for each of the n joints, by the set's columns."""
    found: dict[tuple[str, ...], tuple[str, ...]] = {}
    for rest, taken in by_number.items():
        first = 0 if 0 in taken else 1
        if all(first + k in taken for k in range(n)) and len(taken) == n:
            chosen = tuple(taken[first + k] for k in range(n))
            found[chosen] = rest
    for named, taken in by_name.items():
        if len(taken) == n:
            chosen = tuple(taken[k] for k in range(n))
            # Columns may count from 0 while the joints' names count from 1. Matched by name, every column
            # would belong to the wrong joint and column 0 to none. So the numbers decide.
            if not any(0 in one and set(chosen) < set(one.values()) for one in by_number.values()):
                found[chosen] = named
    return found


def _find_numbered(columns: Sequence[str], kind: str) -> _Taken:
    """Return the numbered columns of a kind of signal: by their other words, the column of each number."""
    by_number: _Taken = {}
    for column in columns:
        words = split_name(_without_unit(column, kind))
        numbers = [word for word in words if word.isdigit()]
        if numbers and _is_kind([w for w in words if kind != "bare" or w.isalpha()], kind, column):
            left = tuple(word for word in words if not word.isdigit())
            by_number.setdefault(left, {})[int(numbers[-1])] = column
    return by_number


def count_numbered(columns: Sequence[str]) -> int:
    """Count the columns of the likeliest set of positions that is numbered without a gap; 0 without a set."""
    counts = {
        rest: len(taken)
        for rest, taken in _find_numbered(columns, "position").items()
        if set(taken) in ({*range(len(taken))}, {*range(1, len(taken) + 1)})
    }
    return counts[min(counts, key=lambda rest: _rank(rest, "position"))] if counts else 0


def _own_words(joints: Sequence[str]) -> list[list[list[str]]]:
    """Return for each joint the lists of words by which a column may name it.

    The first has all words of the joint's name, the second those that not all joints share. The third is the
    second without numbers, if these lists still differ between the joints.
    """
    names = [split_name(joint) for joint in joints]
    common = set.intersection(*map(set, names)) if len(names) > 1 else set()
    short = [[word for word in name if word not in common] for name in names]
    if not common or any(not one or all(word.isdigit() for word in one) for one in short):
        return [[name] for name in names]
    words = [[word for word in one if not word.isdigit()] for one in short]
    differ = all(words) and len(set(map(tuple, words))) == len(words)
    forms = [names, short, words] if differ else [names, short]
    return [list(one) for one in zip(*forms, strict=True)]


def name_joints(columns: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Return the joints that a position column names."""
    words = {column: split_name(_without_unit(column, "position")) for column in columns}
    own = {joint: split_name(joint) for joint in joints}
    return [
        joint
        for joint, name in own.items()
        if any(
            (without := _take_out(one, name)) is not None and _is_kind(without, "position", column)
            for column, one in words.items()
        )
    ]


def guess_positions(columns: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Guess a column of positions for each joint, where some joints have another name in the columns.

    Joints without columns take the columns that name no joint, in order. Empty where their numbers differ.
    """
    words = {column: split_name(_without_unit(column, "position")) for column in columns}
    some = [
        c for c, one in words.items() if _is_kind(one, "position", c) and not set(one) & (_TARGET | _OTHER)
    ]
    other = iter([column for column in some if not name_joints([column], joints)])
    own = [next((column for column in some if name_joints([column], [joint])), "") for joint in joints]
    guessed = [column or next(other, "") for column in own]
    return guessed if all(guessed) and next(other, None) is None else []


def _rank(words: Sequence[str], kind: str) -> int:
    """Rank a set of columns by its words; the likeliest measured signal has the lowest rank."""
    marks = set(words)
    # Where both sides of the gear have an encoder, the one at the output gives the joint's motion.
    before_gear = kind in ("position", "velocity") and "motor" in marks
    # Next to columns dq (speed), columns qd are the desired position.
    worse = 2 * bool(marks & _TARGET or before_gear) + (kind == "velocity" and "qd" in marks)
    return 4 * bool(marks & _OTHER) + worse - bool(marks & _ACTUAL)


def match_pattern(
    pattern: str, columns: Sequence[str], joints: Sequence[str], kind: str, movable: Sequence[str] = ()
) -> Group:
    """Find the columns that a user's pattern names, or a list of columns separated by commas.

    In a pattern ``*`` is the joint's name or its number, counted from 0 or 1. The numbers count all movable
    joints where such columns exist, else `joints`.

    Raises
    ------
    InputError
        Where the pattern does not name one column for each joint.
    """
    if "*" not in pattern:
        listed = tuple([pattern] if pattern in columns else [one.strip() for one in pattern.split(",")])
        if len(listed) == len(joints) and set(listed) <= set(columns):
            return Group(kind, listed, tuple(split_name(listed[0])))
        raise InputError(
            f"--{kind} {pattern}: is neither a pattern with '*' for the joint's name or number, as "
            f"'actual_q_*', nor a column for each of {', '.join(joints)}, with commas between them; the "
            f"columns are {', '.join(columns[:30])}."
        )
    for some in (movable, joints) if set(joints) < set(movable) else (joints,):
        for parts in (some, [str(k) for k in range(len(some))], [str(k + 1) for k in range(len(some))]):
            named = tuple(pattern.replace("*", part) for part in parts)
            chosen = Group(kind, named, tuple(split_name(pattern)))
            if set(chosen.columns) <= set(columns):
                return _pick(chosen, joints, some)
    literal = pattern.replace("[", "[[]")
    near = [column for column in columns if fnmatch.fnmatchcase(column, literal)]
    told = f"it fits {', '.join(near[:8])}" if near else f"the columns are {', '.join(columns[:30])}"
    raise InputError(
        f"--{kind} {pattern}: names no column for each of {', '.join(joints)}, by name or number; {told}."
    )


def find_time(columns: Sequence[str]) -> tuple[str, ...]:
    """Find the column of the time, or the two columns of seconds and nanoseconds; empty without any."""
    words = {column: split_name(re.sub(r"[\[(][^\])]*[\])]", " ", column)) for column in columns}
    parts = {column: "".join(w) for column, w in words.items()}
    # The last words are compared: "ZeitInSec" also ends with the letters of "nsec".
    nanos = [
        c
        for c, w in words.items()
        if "".join(w[-2:]).endswith(("nanosec", "nanosecs")) or set(w[-1:]) & {"nsec", "nsecs"}
    ]
    seconds = [c for c, text in parts.items() if text.endswith(("sec", "secs")) and c not in nanos]
    if seconds and nanos:
        return seconds[0], nanos[0]
    exact = [c for c, w in words.items() if w and (w[0] in _TIME or w[0] in _CLOCKS) and len(w) <= 2]
    loose = [c for c, w in words.items() if set(w) & (_TIME - {"t"})]
    last = [c for c, w in words.items() if w[-1:] == ["t"]]
    ticks = [c for c, w in words.items() if set(w) & {"tick", "ticks"}]
    return tuple([*exact, *loose, *last, *ticks][:1])


def says_time(name: str) -> bool:
    """Return whether a column's name has a word for time."""
    return bool(set(split_name(name)) & _TIME)
