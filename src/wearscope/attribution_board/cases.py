"""Which cases a board has: planted effects x sizes x machines, pairs, outside effects and nulls."""

import hashlib
from dataclasses import dataclass

from wearscope.attribution_board.outside import OUTSIDE
from wearscope.attribution_board.recipe import Planted, Recipe
from wearscope.errors import InputError

SIZES = (1.0, 2.0, 4.0, 8.0)

PLACES: dict[str, dict[str, tuple[str, ...]]] = {
    "stribeck": {"arm6": ("j1", "j2", "j5"), "arm3": ("waist", "elbow", "shoulder"), "stage": ("slide",)},
    "coulomb_asymmetry": {"arm6": ("j1", "j3", "j4"), "arm3": ("waist", "elbow"), "stage": ("slide",)},
    "viscous_asymmetry": {"arm6": ("j2", "j3", "j4"), "arm3": ("shoulder", "waist"), "stage": ("slide",)},
    "quadratic_viscous": {"arm6": ("j1", "j3", "j6"), "arm3": ("waist", "shoulder"), "stage": ("slide",)},
    "concave_viscous": {"arm6": ("j1", "j2", "j4"), "arm3": ("waist", "elbow"), "stage": ("slide",)},
    "load_dependent_friction": {"arm6": ("j2", "j3"), "arm3": ("shoulder", "elbow")},
    "temperature_dependent_friction": {
        "arm6": ("j1", "j2", "j5"),
        "arm3": ("elbow", "waist"),
        "stage": ("slide",),
    },
    "warm_up_drift": {"arm6": ("j2", "j3", "j4"), "arm3": ("shoulder", "waist"), "stage": ("slide",)},
    "presliding_hysteresis": {"arm6": ("j1", "j2", "j4"), "arm3": ("waist", "shoulder"), "stage": ("slide",)},
    "backlash": {"arm6": ("j1", "j4"), "arm3": ("waist", "elbow"), "stage": ("slide",)},
    "joint_elasticity": {"arm6": ("j1", "j2", "j3"), "arm3": ("waist", "shoulder"), "stage": ("slide",)},
    "torque_ripple": {"arm6": ("j1", "j2", "j4"), "arm3": ("waist", "elbow"), "stage": ("slide",)},
    "joint_spring": {"arm6": ("j1", "j4", "j5"), "arm3": ("waist", "elbow"), "stage": ("slide",)},
    "gravity_counterbalance": {"arm6": ("j2", "j3"), "arm3": ("shoulder", "elbow")},
    "payload_error": {"arm6": ("j6",), "arm3": ("elbow",)},
    "rotor_inertia_error": {"arm6": ("j1", "j3"), "arm3": ("waist", "elbow"), "stage": ("slide",)},
    "torque_constant_error": {"arm6": ("j2", "j3", "j5"), "arm3": ("shoulder", "elbow")},
    "time_delay": {"arm6": ("j1", "j2", "j5"), "arm3": ("waist", "shoulder"), "stage": ("slide",)},
    "cross_coupling": {"arm6": ("j5", "j6"), "arm3": ("elbow", "shoulder")},
    "torque_offset": {"arm6": ("j1", "j4", "j6"), "arm3": ("waist", "elbow"), "stage": ("slide",)},
    "coulomb": {"arm6": ("j3", "j5"), "arm3": ("waist", "shoulder"), "stage": ("slide",)},
    "viscous": {"arm6": ("j2", "j4"), "arm3": ("elbow", "waist"), "stage": ("slide",)},
}
"""Joints on which an effect is planted, by machine: where it could be and the motion excites it."""

OUTSIDE_PLACES: dict[str, tuple[str, ...]] = {
    "arm6": ("j1", "j2", "j4"),
    "arm3": ("waist", "elbow"),
    "stage": ("slide",),
}

PAIRS: tuple[tuple[str, tuple[tuple[str, str], ...]], ...] = (
    ("arm3", (("stribeck", "waist"), ("torque_offset", "elbow"))),
    ("arm3", (("viscous_asymmetry", "elbow"), ("coulomb_asymmetry", "elbow"))),
    ("arm3", (("gravity_counterbalance", "shoulder"), ("load_dependent_friction", "elbow"))),
    ("arm3", (("torque_ripple", "waist"), ("warm_up_drift", "waist"))),
    ("arm3", (("time_delay", "shoulder"), ("payload_error", "elbow"))),
    ("arm6", (("gravity_counterbalance", "j2"), ("stribeck", "j2"))),
    ("arm6", (("load_dependent_friction", "j2"), ("torque_offset", "j4"))),
    ("arm6", (("cross_coupling", "j5"), ("temperature_dependent_friction", "j3"))),
    ("stage", (("torque_ripple", "slide"), ("coulomb_asymmetry", "slide"))),
    ("stage", (("stribeck", "slide"), ("viscous_asymmetry", "slide"))),
)

# every sixth null has a URDF that misses the masses by 5 % and says so
NULL_NOISES = ("plain", "coloured", "drift", "jitter", "heavy")


@dataclass(frozen=True)
class Case:
    """One data set of the board."""

    robot: str
    planted: tuple[Planted, ...]
    recipe: Recipe
    seed: int

    @property
    def name(self) -> str:
        """Name of the data set: a digest that tells nothing of the truth."""
        return "d" + hashlib.sha256(repr(self).encode()).hexdigest()[:12]

    def tell(self) -> str:
        """What is planted, in a few words."""
        what = " + ".join(f"{p.effect}@{p.joint} x{p.size:g}" for p in self.planted) or "null"
        return f"{self.robot} {what} ({self.recipe.noise})"


@dataclass(frozen=True)
class Extent:
    """How large a board is.

    `effects` None means all; `replicas` is the number of seeds by machine; `nulls` their number by machine.
    """

    effects: tuple[str, ...] | None
    sizes: tuple[float, ...]
    replicas: dict[str, int]
    outside_sizes: tuple[float, ...]
    nulls: dict[str, int]
    pairs: int
    duration: float


EXTENTS: dict[str, Extent] = {
    "small": Extent(
        ("stribeck", "torque_offset", "joint_spring", "viscous_asymmetry", "torque_ripple"),
        (8.0,), {"arm3": 1, "stage": 1}, (8.0,), {"stage": 4, "arm3": 1}, 1, 10.0,
    ),
    "medium": Extent(
        None, (2.0, 8.0), {"arm3": 1, "stage": 1}, (4.0, 8.0), {"stage": 30, "arm3": 30, "arm6": 5}, 5, 16.0
    ),
    "full": Extent(
        None, SIZES, {"arm3": 2, "stage": 1, "arm6": 1}, (2.0, 4.0, 8.0),
        {"stage": 125, "arm3": 125, "arm6": 60}, 10, 16.0,
    ),
}  # fmt: skip


def list_cases(size: str = "small", seed: int = 0, nulls: int | None = None) -> list[Case]:
    """Cases of a board, in a fixed order.

    Parameters
    ----------
    size : str
        ``small``, ``medium`` or ``full``.
    seed : int
        Root of all seeds.
    nulls : int, optional
        Another number of nulls altogether, shared out as the board has them.

    Raises
    ------
    InputError
        For an unknown size.
    """
    if size not in EXTENTS:
        raise InputError(f"attribution board: there is no size '{size}'; choose one of {', '.join(EXTENTS)}.")
    extent = EXTENTS[size]
    cases: list[Case] = []

    def add(
        robot: str, planted: tuple[Planted, ...], noise: str, number: int, inertia_error: float = 0.0
    ) -> None:
        recipe = Recipe(noise=noise, duration=extent.duration, inertia_error=inertia_error)
        cases.append(Case(robot, planted, recipe, 1_000_003 * seed + number))

    for e, (effect, places) in enumerate(PLACES.items()):
        if extent.effects is not None and effect not in extent.effects:
            continue
        for robot, replicas in extent.replicas.items():
            for replica in range(replicas if robot in places else 0):
                for s, level in enumerate(extent.sizes):
                    joint = places[robot][(s + replica) % len(places[robot])]
                    noise = ("plain", "coloured")[(e + s + replica) % 2]
                    add(robot, (Planted(effect, joint, level),), noise, 1000 * (replica + 1) + 10 * e + s)
    for e, effect in enumerate(OUTSIDE):
        if size == "small" and e > 0:
            continue
        for robot, replicas in extent.replicas.items():
            if effect == "other_position" and robot == "stage":
                continue
            for replica in range(replicas):
                for s, level in enumerate(extent.outside_sizes):
                    place = OUTSIDE_PLACES[robot]
                    joint = place[(s + replica + e) % len(place)]
                    noise = ("plain", "coloured")[(e + s + replica) % 2]
                    add(robot, (Planted(effect, joint, level),), noise, 20000 + 1000 * replica + 10 * e + s)
    for number, (robot, pair) in enumerate(PAIRS[: extent.pairs]):
        for s, level in enumerate((8.0,) if size == "small" else (4.0, 8.0)):
            plants = tuple(Planted(effect, joint, level) for effect, joint in pair)
            add(robot, plants, "plain", 40000 + 10 * number + s)
    whole = sum(extent.nulls.values())
    for robot, count in extent.nulls.items():
        wanted = count if nulls is None else round(nulls * count / whole)
        for number in range(wanted):
            noise = NULL_NOISES[number % len(NULL_NOISES)]
            add(robot, (), noise, 60000 + number, 0.05 if number % 6 == 5 else 0.0)
    return cases
