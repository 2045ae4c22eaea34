"""Cases of a machine over its sessions: what happens to it, when, and how it is recorded."""

import hashlib
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.board.draw_machines import FAMILIES, draw_machine
from benchmarks.board.recipe import Recipe, RunPlan, make_stream
from wearscope.demonstration.machine import Machine

KINDS = {
    "nothing": 3.0,
    "wear_step": 5.0,
    "wear_growth": 1.5,
    "swing": 3.0,
    "swing_with_wear": 1.0,
    "swing_against_wear": 1.0,
    "load": 3.0,
    "drive": 2.0,
}
"""What happens, with the weight of each."""
THERMOMETERS = {"seen": 6.0, "unseen": 1.0, "absent": 1.0}
"""Temperatures: recorded and shown by the reference, recorded but not shown, not recorded."""
MACHINES = {name: {"serial": 8.0, "slide": 2.0}.get(name, 0.15) for name in FAMILIES}
"""Families of machines; those of few joints more often, since identifying seven takes minutes."""
SWING = 20.0
"""Swing of temperature [K] where there is one."""
WEAR_FORMS = ("whole", "coulomb", "bump")
"""What worn friction looks like: all of it larger, the Coulomb level alone, a low-speed bump and a slope."""
STEP = 0.1
"""A step of wear, as a share of the joint's friction."""


@dataclass(frozen=True)
class Day:
    """One session.

    Attributes
    ----------
    name : str
    healthy : bool
    temperature : float
        At its start [deg C].
    wear : float
        Additional friction of the worn joint, as a share of its friction.
    load : float
        Undeclared mass, as a share of that which is drawn for the machine.
    gain : float
        Relative error of the replaced drive's torque.
    runs : tuple of RunPlan
    """

    name: str
    healthy: bool
    temperature: float
    wear: float
    load: float
    gain: float
    runs: tuple[RunPlan, ...]


@dataclass(frozen=True)
class SessionCase:
    """One machine over its sessions.

    Attributes
    ----------
    number, seed : int
    kind, thermometer, form : str
    machine : Machine
    joint : int
        Where wear or a new drive is.
    onset : int
        Number of the first session, counted among the later ones, in which something is changed.
    thermal : float
        How strongly friction depends on temperature; 0 not at all.
    scatter : float
        Standard deviation of a healthy session's friction, as a share of it.
    recipe : Recipe
    days : tuple of Day
    """

    number: int
    seed: int
    kind: str
    thermometer: str
    form: str
    machine: Machine
    joint: int
    onset: int
    thermal: float
    scatter: float
    recipe: Recipe
    days: tuple[Day, ...]

    @property
    def name(self) -> str:
        """Name of the data set: a digest that tells nothing of the truth."""
        return "s" + hashlib.sha256(repr(self).encode()).hexdigest()[:12]

    @property
    def worn(self) -> bool:
        """Whether a joint wears."""
        return any(day.wear for day in self.days)

    def tell(self) -> str:
        """The case in a few words."""
        return (
            f"{self.machine.name}{len(self.machine.joints)} {self.kind}, temperature {self.thermometer}, "
            f"{sum(d.healthy for d in self.days)}+{sum(not d.healthy for d in self.days)} sessions"
        )


def _pick(levels: dict[str, float], rng: np.random.Generator) -> str:
    weights = np.array(list(levels.values()))
    return str(rng.choice(list(levels), p=weights / weights.sum()))


def draw_case(number: int, seed: int, kind: str | None = None) -> SessionCase:
    """One case; the same for the same number and seed.

    Parameters
    ----------
    number, seed : int
    kind : str, optional
        One of `KINDS`; drawn where None.
    """
    rng = make_stream(seed, "sessions", str(number))
    drawn = _pick(KINDS, rng)
    kind = kind or drawn
    family = _pick(MACHINES, rng)
    most = int(rng.integers(1, 4))
    machine = draw_machine(family, rng, most if family == "serial" else None)
    if not any(machine.payload_com):
        x, y, z = (float(c) for c in 0.06 * rng.normal(size=3))
        machine = replace(machine, payload_com=(x, y, z))
    n = len(machine.joints)
    thermometer = _pick(THERMOMETERS, rng)
    if "wear" in kind and thermometer != "seen":
        # Only what the reference shows of temperature lets wear be told; without it nothing may swing.
        thermometer = "seen" if kind.startswith("swing") else "unseen"
    if kind == "swing" and thermometer == "seen" and rng.uniform() < 0.2:
        thermometer = "unseen"
    healthy, later = int(rng.integers(3, 7)), int(rng.integers(4, 8))
    onset = int(rng.integers(1, later - 1))
    sessions = _draw_days(kind, thermometer, healthy, later, onset, rng)
    recipe = Recipe(
        noise=str(rng.choice(["plain", "coloured", "coloured", "drift", "hum"])),
        noise_level=float(np.exp(rng.uniform(np.log(0.003), np.log(0.03)))),
        duration=float(rng.uniform(8.0, 14.0)),
        rate=float(rng.choice([100.0, 125.0, 200.0])),
        temperatures=thermometer != "absent",
        memory=float(rng.uniform(0.02, 0.1)),
        encoder_step=float(np.exp(rng.uniform(np.log(1e-6), np.log(1e-4)))),
        reversal=float(np.exp(rng.uniform(np.log(2e-4), np.log(1e-2)))),
        declared=("rigid_body", "rotor_inertia", "coulomb", "viscous")
        if rng.uniform() < 0.7
        else ("rigid_body", "rotor_inertia"),
        plans=tuple(plan for day in sessions for plan in day.runs),
    )
    return SessionCase(
        number,
        int(rng.integers(2**31)),
        kind,
        thermometer,
        str(rng.choice(WEAR_FORMS)),
        machine,
        int(rng.integers(n)),
        onset,
        float(rng.uniform(0.1, 0.6)) if kind.startswith("swing") or rng.uniform() < 0.7 else 0.0,
        float(rng.uniform(0.0, 0.012)),
        recipe,
        sessions,
    )


def _draw_days(
    kind: str, thermometer: str, healthy: int, later: int, onset: int, rng: np.random.Generator
) -> tuple[Day, ...]:
    middle = float(rng.uniform(28.0, 40.0))
    swings = kind.startswith("swing")
    warmth = middle + _draw_warmth(kind, thermometer, healthy, later, onset, rng)
    wear = np.zeros(later)
    if kind.endswith("wear") or kind == "wear_step":
        wear[onset:] = STEP if not swings else 2.0 * STEP
    elif kind == "wear_growth":
        wear[onset:] = float(rng.uniform(0.03, 0.06)) * np.arange(1, later - onset + 1)
    loads = np.zeros(later)
    if kind == "load":
        some = rng.uniform(size=later) < 0.6
        some[:onset], some[onset] = False, True
        loads[some] = 1.0
    gain = np.zeros(later)
    if kind == "drive":
        gain[onset:] = float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.05, 0.12))
    count = int(rng.integers(1, 4))
    repeated = bool(rng.uniform() < 0.5)
    kinds = [str(rng.choice(["fourier", "points", "sweep", "cycle"])) for _ in range(count)]
    pace = float(rng.choice([0.7, 1.0]))
    days = []
    for k in range(healthy + later):
        runs = []
        for r in range(count):
            trajectory = r if repeated else k * count + r
            # What later runs are for must not matter.
            train = k < healthy and not (k == healthy - 1 and r == count - 1)
            use = "train" if train or (k >= healthy and rng.uniform() < 0.3) else "test"
            runs.append(RunPlan(use, kinds[r], trajectory, float(warmth[k]), pace))
        s = k - healthy
        changed = [float(x[s]) if s >= 0 else 0.0 for x in (wear, loads, gain)]
        name = f"2026-03-{k + 1:02d}T08:00:00"
        days.append(Day(name, s < 0, float(warmth[k]), changed[0], changed[1], changed[2], tuple(runs)))
    return tuple(days)


def _draw_warmth(
    kind: str, thermometer: str, healthy: int, later: int, onset: int, rng: np.random.Generator
) -> np.ndarray:
    """Start temperatures (healthy + later,) about their middle [K]."""
    half = 0.5 * SWING
    if thermometer == "seen":
        seen = rng.uniform(-half, half, healthy)
        seen[:2] = -half, half
        before = rng.permutation(seen)
        after = rng.uniform(-half, half, later)
    else:
        before, after = rng.uniform(-1.0, 1.0, healthy), rng.uniform(-1.0, 1.0, later)
    if kind == "swing":
        up = rng.uniform(size=later) < 0.5
        up[0], up[-1] = True, False
        far = half if thermometer == "seen" else SWING
        after = np.where(up, far, -half if thermometer == "seen" else after)
    elif kind == "swing_with_wear":  # cold makes friction rise, as wear does
        after = np.where(np.arange(later) < onset, half, -half)
    elif kind == "swing_against_wear":
        after = np.where(np.arange(later) < onset, -half, half)
    return np.asarray(np.concatenate([before, after]))
