"""Experimental designs (4): composites, factorials, fractions, Latin hypercubes; nominal, validation runs.

The platform adds to the paper's design space-filling runs, runs near the points that scope and SNR use, and
checking runs.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from wearscope.designs.factors import (
    CODED_HIGH,
    CODED_LOW,
    FAULT,
    Factor,
    check_factors,
    nominal_levels,
    worn_factor,
)
from wearscope.errors import InputError


def seed_for(root: int, *identity: object) -> np.random.SeedSequence:
    """Return a seed sequence that depends on the root seed and on the given names alone.

    Parameters
    ----------
    root : int
        Root seed of the study, non-negative; 0 is a seed like any other.
    *identity : objects with a stable ``str``
        Names, e.g. ``"snr", robot, cycle, axis, fda``. Equal names give equal random numbers, whatever else
        is drawn.

    Returns
    -------
    numpy.random.SeedSequence
    """
    text = "\x1f".join(str(part) for part in identity)
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return np.random.SeedSequence([int(root), *np.frombuffer(digest[:16], dtype="<u4").tolist()])


def generator_for(root: int, *identity: object) -> np.random.Generator:
    """Return a PCG64 generator that depends on the root seed and the given names; see `seed_for`."""
    return np.random.Generator(np.random.PCG64(seed_for(root, *identity)))


MAX_POINTS = 100_000
Array = NDArray[np.float64]


def read_generators(
    generators: Mapping[str, str] | Sequence[str] | None, names: Sequence[str]
) -> dict[str, tuple[int, tuple[str, ...]]]:
    """Read generators such as ``"w5 = f w1 w2 w3 w4"`` or ``{"w5": "-f*w1"}``.

    Parameters
    ----------
    generators : mapping or sequence of str, optional
    names : sequence of str
        Factor names.

    Returns
    -------
    dict
        Sign and base factors, by generated factor.

    Raises
    ------
    InputError
        Where a generator cannot be read, or a factor is generated from a generated one.
    """
    if generators is None:
        return {}
    if isinstance(generators, Mapping):
        pairs = [(str(left).strip(), str(right)) for left, right in generators.items()]
    else:
        for text in generators:
            if str(text).count("=") != 1:
                raise InputError(f"generator '{text}': write it as 'w5 = f w1 w2 w3 w4'.")
        pairs = [(text.split("=")[0].strip(), text.split("=")[1]) for text in map(str, generators)]
    result: dict[str, tuple[int, tuple[str, ...]]] = {}
    for left, right in pairs:
        sign = -1 if right.strip().startswith("-") else 1
        letters = tuple(right.strip().lstrip("+-").replace("*", " ").replace(":", " ").split())
        unknown = [name for name in (left, *letters) if name not in names]
        if unknown:
            raise InputError(
                f"generator of '{left}': there is no factor '{unknown[0]}'; use {', '.join(names)}."
            )
        if not letters or len(set(letters)) != len(letters):
            raise InputError(f"generator of '{left}': name each base factor once.")
        if left in result:
            raise InputError(f"generator of '{left}': it is given twice; keep one.")
        result[left] = (sign, letters)
    for left, (_, letters) in result.items():
        for name in letters:
            if name in result:
                raise InputError(
                    f"generator of '{left}': '{name}' is itself generated; use base factors only."
                )
    return result


def fractional_factorial(
    names: Sequence[str], generators: Mapping[str, str] | Sequence[str] | None = None
) -> Array:
    """Make a two-level full or fractional factorial at -1 and +1.

    The rows run over the base factors in standard order, the last factor fastest, as in Table 2.

    Parameters
    ----------
    names : sequence of str, (n,)
    generators : optional
        See `read_generators`; p generators give the fraction 2^(n-p).

    Returns
    -------
    array (2^(n-p), n)
    """
    rules = read_generators(generators, names)
    base = [name for name in names if name not in rules]
    _refuse_many(2 ** len(base))
    columns = dict(zip(base, np.array(list(product((-1.0, 1.0), repeat=len(base)))).T, strict=True))
    for name, (sign, letters) in rules.items():
        columns[name] = sign * np.prod([columns[letter] for letter in letters], axis=0)
    return np.column_stack([columns[name] for name in names])


def composite(cube: Array, star_level: float, centre_points: int = 1) -> Array:
    """Make a composite design: the cube, then 2n star points at -+`star_level`, then the centre.

    Parameters
    ----------
    cube : array (N_c, n)
    star_level : float
        Coded distance of the star points from the centre.
    centre_points : int

    Returns
    -------
    array (N_c + 2 n + centre_points, n)
    """
    n = cube.shape[1]
    star = np.zeros((2 * n, n))
    star[0::2] = -star_level * np.eye(n)
    star[1::2] = star_level * np.eye(n)
    return np.vstack([cube, star, np.zeros((centre_points, n))])


def _refuse_many(points: int) -> None:
    """Refuse a design with too many points."""
    if points > MAX_POINTS:
        raise InputError(
            f"design: {points} points are more than {MAX_POINTS}; use a fraction, fewer levels or a Latin "
            "hypercube."
        )


def _composite(kind: str, factors: Sequence[Factor], options: dict[str, Any], seed: int) -> Array:
    """Make the composite design of a kind, which sets the levels of its cube and its star points."""
    cube = fractional_factorial([f.name for f in factors], options.get("generators"))
    level, alpha = float(options.get("cube_level", 1.0)), _alpha(cube, options)
    cube_level, star_level = {
        "central_composite": (level, float(options.get("star_level", 2.0))),
        "face_centred": (CODED_HIGH, CODED_HIGH),
        "circumscribed": (level, level * alpha),
        "inscribed": (CODED_HIGH / alpha, CODED_HIGH),
    }[kind]
    return composite(cube * cube_level, star_level, _centre_points(options))


def _alpha(cube: Array, options: dict[str, Any]) -> float:
    """Return the star distance in units of the cube; by default that of a rotatable design, N_c^(1/4)."""
    alpha = options.get("alpha")
    value = float(cube.shape[0] ** 0.25 if alpha is None else alpha)
    if value <= 0:
        raise InputError(f"design: alpha is {value}; give a positive star distance in cube units.")
    return value


def _centre_points(options: dict[str, Any]) -> int:
    """Read the number of centre points; refuse a negative one."""
    number = int(options.get("centre_points", 1))
    if number < 0:
        raise InputError(f"design: centre_points is {number}; give 0 or more.")
    return number


def _full_factorial(factors: Sequence[Factor], options: dict[str, Any], seed: int) -> Array:
    """Make a full factorial with equally spaced levels."""
    levels = [int(options.get("levels", factor.levels)) for factor in factors]
    if min(levels) < 2:
        raise InputError(f"design: levels is {min(levels)}; give at least 2.")
    _refuse_many(int(np.prod(np.array(levels, dtype=float))))
    return np.array(list(product(*[np.linspace(CODED_LOW, CODED_HIGH, m) for m in levels])))


def _fractional_factorial(factors: Sequence[Factor], options: dict[str, Any], seed: int) -> Array:
    """Make a two-level factorial, or a fraction of it, at the levels -+`cube_level`."""
    cube = fractional_factorial([f.name for f in factors], options.get("generators"))
    return cube * float(options.get("cube_level", CODED_HIGH))


def _latin_hypercube(factors: Sequence[Factor], options: dict[str, Any], seed: int) -> Array:
    """Draw a Latin hypercube over the whole range of the factors."""
    points = int(options.get("points", 45))
    if points < 2:
        raise InputError(f"design: points is {points}; give at least 2.")
    _refuse_many(points)
    rng = generator_for(seed, "latin_hypercube", options.get("stream", "identification"))
    sampler = scipy.stats.qmc.LatinHypercube(
        d=len(factors), scramble=not options.get("centred", False), rng=rng
    )
    return np.round(CODED_LOW + (CODED_HIGH - CODED_LOW) * sampler.random(points), 12)


#: Options that all composite designs have; then function and options by kind of design.
_OPTIONS = {"generators", "centre_points"}
KINDS: dict[str, tuple[Callable[[Sequence[Factor], dict[str, Any], int], Array], set[str]]] = {
    "central_composite": (partial(_composite, "central_composite"), _OPTIONS | {"cube_level", "star_level"}),
    "face_centred": (partial(_composite, "face_centred"), _OPTIONS),
    "circumscribed": (partial(_composite, "circumscribed"), _OPTIONS | {"alpha", "cube_level"}),
    "inscribed": (partial(_composite, "inscribed"), _OPTIONS | {"alpha"}),
    "full_factorial": (_full_factorial, {"levels"}),
    "fractional_factorial": (_fractional_factorial, {"generators", "cube_level"}),
    "latin_hypercube": (_latin_hypercube, {"points", "centred", "stream"}),
}


def _coded_matrix(
    kind: str, factors: Sequence[Factor], options: Mapping[str, Any] | None, seed: int
) -> Array:
    """Make the coded matrix (N, n) of a kind of design; refuse unknown options and levels beyond -2..2."""
    check_factors(factors)
    if kind not in KINDS:
        raise InputError(f"design: there is no kind '{kind}'; choose among {', '.join(KINDS)}.")
    make, known = KINDS[kind]
    chosen = {key: value for key, value in (options or {}).items() if value is not None}
    unknown = sorted(set(chosen) - known)
    if unknown:
        raise InputError(
            f"design: kind '{kind}' has no option '{unknown[0]}'; it has {', '.join(sorted(known))}."
        )
    matrix = make(factors, chosen, seed) + 0.0
    outside = np.abs(matrix).max(axis=0) > CODED_HIGH + 1e-9
    if outside.any():
        name = factors[int(np.argmax(outside))].name
        raise InputError(
            f"design: kind '{kind}' needs the level {np.abs(matrix).max():.3g} of '{name}', beyond its range "
            "-2..2; use the inscribed composite, or a smaller alpha, star_level or cube_level."
        )
    return matrix


def design_table(coded: Array, factors: Sequence[Factor]) -> pd.DataFrame:
    """Return the table of a coded matrix: ``point`` from 1, coded columns, then natural columns.

    Parameters
    ----------
    coded : array (N, n)
        Levels in the coding of the identification design.
    factors : sequence of Factor, (n,)

    Returns
    -------
    DataFrame
    """
    pairs = list(zip(factors, coded.T, strict=True))
    return pd.DataFrame(
        {
            "point": np.arange(1, coded.shape[0] + 1, dtype=np.int64),
            **{factor.name: levels.astype(float) for factor, levels in pairs},
            **{f"{factor.name}_natural": factor.to_natural(levels) for factor, levels in pairs},
        }
    )


def make_design(
    kind: str, factors: Sequence[Factor], options: Mapping[str, Any] | None = None, seed: int = 0
) -> pd.DataFrame:
    """Make an identification design.

    Parameters
    ----------
    kind : str
        One of `KINDS`: ``central_composite`` (cube at +-1, star at +-2; the paper's design with
        ``generators={"w5": "f w1 w2 w3 w4"}``), ``face_centred`` (cube and star at +-2), ``circumscribed``
        (cube at +-1, star at ``alpha``, by default N_c^(1/4), which is rotatable), ``inscribed`` (the same,
        scaled into -2..2), ``full_factorial`` (``levels``, or each factor's own), ``fractional_factorial``,
        ``latin_hypercube`` (``points``, ``centred``).
    factors : sequence of Factor
    options : mapping, optional
        Options of the kind; unknown ones are refused.
    seed : int
        Root seed, used by the Latin hypercube only.

    Returns
    -------
    DataFrame
        ``point`` (from 1), each factor coded, then each factor natural (``f_natural``, ...).

    Raises
    ------
    InputError
        Where kind or option is unknown, a generator cannot be read, a level lies beyond -2..2, or there are
        too many points.
    """
    return design_table(_coded_matrix(kind, factors, options, seed), factors)


def validation_design(
    kind: str, factors: Sequence[Factor], options: Mapping[str, Any] | None = None, seed: int = 0
) -> pd.DataFrame:
    """Make the validation design: the same matrix as the identification design, at other natural levels.

    The natural levels are those of Table 3. The coded columns have the coding of the identification design,
    in which surrogates are evaluated. A Latin hypercube is drawn with other random numbers. Parameters,
    columns and errors are those of `make_design`.
    """
    options = dict(options or {})
    if kind == "latin_hypercube":
        options["stream"] = "validation"
    levels = _coded_matrix(kind, factors, options, seed)
    coded = np.column_stack([f.validation_to_coded(levels[:, k]) for k, f in enumerate(factors)])
    return design_table(coded, factors)


def nominal_design(factors: Sequence[Factor], batches: int = 1) -> pd.DataFrame:
    """Make the nominal design: `batches` runs without wear at z0, eq. (18). Columns as in `make_design`."""
    check_factors(factors)
    if batches < 1:
        raise InputError(f"nominal: batches is {batches}; give at least 1.")
    return design_table(np.tile([f.nominal_coded for f in factors], (batches, 1)), factors)


def filling_design(
    factors: Sequence[Factor],
    points: int = 36,
    question_points: int = 8,
    replicates: int = 6,
    questions: Sequence[str] = ("w3", "w5"),
    axes: Sequence[int] = (1, 2, 3),
    seed: int = 0,
) -> pd.DataFrame:
    """Make the points that chosen surrogates learn from in addition to those of the paper's design.

    There are three groups. A Latin hypercube covers the whole region; every second of its points is moved
    towards nominal, where SNR and scope are computed. Further points lie on the lines of the scope (see
    `question_lines`). Replicates of some points of the hypercube differ in sensor noise only.

    Parameters
    ----------
    factors : sequence of Factor
    points : int
        Number of points of the Latin hypercube.
    question_points : int
        Number of points on the lines of the scope, for each axis.
    replicates : int
        Number of replicated points, at most `points`.
    questions : sequence of str
        Nuisances that the scope varies.
    axes : sequence of int
    seed : int
        Root seed of the study; these points have random numbers of their own.

    Returns
    -------
    DataFrame
        ``point`` (from 1), coded and natural columns, as in `wearscope.designs.kinds.make_design`.

    Raises
    ------
    InputError
        Where there are fewer than 2 points or more replicates than points, or a factor is unknown.
    """
    if replicates > points:
        raise InputError(f"filling: {replicates} replicates of {points} points; give at most as many.")
    cube = _hypercube(factors, points, "filling", seed)
    nominal = np.array([factor.nominal_coded for factor in factors])
    near = cube[1::2]  # a view of `cube`: every second point is moved towards nominal
    end = np.where(near < nominal, CODED_LOW, CODED_HIGH)
    reach = np.abs(end - nominal)
    share = np.divide(np.abs(near - nominal), reach, out=np.zeros_like(near), where=reach > 0)
    near[:] = nominal + (end - nominal) * share**2
    for k, factor in enumerate(factors):
        if factor.is_costly:
            levels = np.linspace(CODED_LOW, CODED_HIGH, factor.levels)
            cube[:, k] = levels[np.argmin(np.abs(cube[:, k, None] - levels), axis=1)]
    asked = question_lines(factors, question_points, questions, axes, "filling", seed)
    return design_table(np.vstack([cube, asked, cube[:replicates]]), factors)


def checking_design(
    factors: Sequence[Factor],
    points: int = 24,
    question_points: int = 2,
    questions: Sequence[str] = ("w3", "w5"),
    axes: Sequence[int] = (1, 2, 3),
    seed: int = 0,
) -> pd.DataFrame:
    """Make the points on which a chosen surrogate's fit is computed; no fit and no choice uses them.

    They are a Latin hypercube, uniform over the whole region, and points on the lines of the scope, including
    z0 (18). Parameters, columns and errors are those of `filling_design`.
    """
    cube = _hypercube(factors, points, "checking", seed)
    asked = question_lines(factors, question_points, questions, axes, "checking", seed)
    return design_table(np.vstack([cube, asked]), factors)


def local_design(
    factors: Sequence[Factor], points: int, replicates: int, reach: float, seed: int = 0
) -> pd.DataFrame:
    """Make points around the centre of the design, where the SNR (11) is computed; some are replicated.

    Parameters
    ----------
    factors : sequence of Factor
    points : int
        Number of points of a Latin hypercube.
    replicates : int
        Number of replicated points, at most `points`.
    reach : float
        Largest coded level.
    seed : int

    Returns
    -------
    DataFrame
        As `filling_design`.

    Raises
    ------
    InputError
        Where there are fewer than 2 points, or more replicates than points.
    """
    if replicates > points:
        raise InputError(f"local design: {replicates} replicates of {points} points; give at most as many.")
    cube = _hypercube(factors, points, "local", seed) * (reach / CODED_HIGH)
    return design_table(np.vstack([cube, cube[:replicates]]), factors)


def question_lines(
    factors: Sequence[Factor],
    points: int,
    questions: Sequence[str],
    axes: Sequence[int],
    stream: str,
    seed: int,
) -> np.ndarray:
    """Return coded points (M, n) on the scope's lines: one axis worn, one nuisance varied, others nominal.

    The first point is z0, eq. (18). Then come `points` for each axis (one fewer for the first axis), which
    vary the nuisances in turn; every fourth of them has no wear.
    """
    names = [factor.name for factor in factors]
    nuisances = [name for name in names if name != FAULT]
    if not questions or not set(questions) <= set(nuisances):
        raise InputError(
            f"filling: questions {list(questions)}; name nuisances among {', '.join(nuisances)}."
        )
    nominal = nominal_levels(factors)
    z0 = np.array([nominal[name] for name in names])
    rows = [z0] if points else []
    for axis in axes if points else ():
        spread = _hypercube(factors, max(points, 2), f"{stream} questions {axis}", seed)
        worn = names.index(worn_factor(factors, axis))
        for k in range(points):
            if axis == axes[0] and k == 0:
                continue  # z0 is that point
            row = z0.copy()
            varied = names.index(questions[k % len(questions)])
            row[varied] = spread[k, varied]
            if k % 4 != 3:
                row[worn] = spread[k, worn]
            rows.append(row)
    return np.array(rows).reshape(-1, len(names))


def _hypercube(factors: Sequence[Factor], points: int, stream: str, seed: int) -> np.ndarray:
    """Draw the coded points (points, n) of a Latin hypercube with the random numbers of a named stream."""
    check_factors(factors)
    names = [factor.name for factor in factors]
    table = make_design("latin_hypercube", factors, {"points": points, "stream": stream}, seed)
    return table[names].to_numpy(dtype=float, copy=True)
