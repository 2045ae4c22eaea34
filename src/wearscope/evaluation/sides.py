"""Answers of one side of a comparison: of its model, and of further models that are as likely.

A side is a model and, where its uncertainty is known, further models drawn from it. Each model answers the
study's questions with the study's settings. The distribution of a side combines the answers of its models
with the uncertainty of their surrogates.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.stats import rankdata

from wearscope.designs.factors import FAULT, Factor, nominal_levels
from wearscope.designs.kinds import generator_for
from wearscope.evaluation.detection import sampled_tolerance
from wearscope.evaluation.snr import NOISE_FREE, draw_snr, response_size
from wearscope.surrogates.chosen import read_chosen, read_noise
from wearscope.surrogates.fitting import CELL, IDENTIFICATION, cells_of, fit_surrogate, normalise_coefficients
from wearscope.surrogates.selection import CONSTANT, ChosenSurrogate

Array = NDArray[np.float64]
#: Changes of the fault, coded, at which the scope is stated.
DELTAS = (1.0, 2.0, 4.0)
#: Fewest drawn response functions from which a median is taken as the value.
FEWEST = 100
#: Key of an answer: test-cycle, axis, detector, question, its object, coded change of the fault (0: none).
Key = tuple[str, int, str, str, str, float]


@dataclass(frozen=True)
class Questions:
    """The study's settings for its questions.

    Attributes
    ----------
    factors : sequence of Factor
    model : str
        Quadratic model whose coefficients are compared.
    snr : mapping
        ``f0``, ``delta``, ``sigma`` of (20).
    scope : mapping
        ``factors``, ``f0``, ``sigma`` (first, last), ``grid``, ``p_f``, ``p_d``.
    seed : int
    draws : int
        Of a side, shared by its models.
    """

    factors: Sequence[Factor]
    model: str
    snr: Mapping[str, float]
    scope: Mapping[str, Any]
    seed: int = 0
    draws: int = 240


@dataclass
class Answers:
    """Answers of one side.

    Attributes
    ----------
    value : dict
        Answer of the side's own model by place.
    drawn : dict
        By place, an array (draws,) each; index k belongs to one model and is the same in every place.
    """

    value: dict[Key, float] = field(default_factory=dict)
    drawn: dict[Key, Array] = field(default_factory=dict)


def share_surrogates(chosen: pd.DataFrame) -> pd.DataFrame:
    """Give all sides of a cell the kind and parameters of the one that cross-validates worst.

    Each side is fitted to its own runs still. With parameters of its own, one outlying run would make one
    side's surrogate rougher than the other's, and the answers would differ by that alone.

    Parameters
    ----------
    chosen : DataFrame
        From `wearscope.surrogates.chosen.choose_surrogates`, of all sides (``robot``).
    """
    shared = ["kind", "parameters", "spread", "spread_asked", "nominal"]
    fits = [name for name in chosen.columns if name.startswith("left_out_")]
    made = chosen.copy().reset_index(drop=True)
    varies = made["kind"] != CONSTANT
    best = made[fits].max(axis=1)
    for _, places in made[varies].groupby(["cycle", "axis", "fda"], sort=False).groups.items():
        worst = best.loc[places].idxmin()
        for name in shared:
            made.loc[places, name] = pd.Series([made.at[worst, name]] * len(places), index=places)
    return made


def extend_to_drawn(
    quantities: pd.DataFrame, chosen: pd.DataFrame, drawn: pd.DataFrame, side: str
) -> Iterator[tuple[str, pd.DataFrame, pd.DataFrame]]:
    """Test quantities and surrogates of drawn models at all points of their side's own model.

    A drawn model is simulated at few points. There its difference to the side's own model is fitted by main
    effects, and added to the own model's values everywhere else: an additive bridge between two simulators
    (Forrester, Soebester, Keane, Engineering Design via Surrogate Modelling, 2008, ch. 8).

    Parameters
    ----------
    quantities : DataFrame
        Of the side's own model, ``robot`` = `side`.
    chosen : DataFrame
        Its chosen surrogates.
    drawn : DataFrame
        Of the drawn models, at points that the own model has too (same ``set`` and ``point``).
    side : str

    Yields
    ------
    name : str
        Of the drawn model.
    quantities, chosen : DataFrame
        As those of the side's own model; cells that cannot be bridged are left out.
    """
    keys = ["cycle", "axis", "fda", "set", "point"]
    names = [name for name in quantities.columns if name not in {*CELL, "set", "point", "y", "status"}]
    own = dict(tuple(quantities.groupby(["cycle", "axis", "fda"], sort=True)))
    for robot, rows in drawn.groupby("robot", sort=True):
        parts, kept = [], []
        for cell, few in rows.groupby(["cycle", "axis", "fda"], sort=True):
            whole = own[cell].copy()
            both = few.merge(whole, on=keys, suffixes=("", "_own"))
            gap = both["y"].to_numpy(dtype=float) - both["y_own"].to_numpy(dtype=float)
            good = np.isfinite(gap)
            if good.sum() < len(names) + 1:
                continue
            bridge = fit_surrogate(both.loc[good, names].to_numpy(), gap[good], names, "main")
            whole["y"] = whole["y"] + bridge.predict(whole[names].to_numpy(dtype=float))
            parts.append(whole.assign(robot=robot))
            kept.append(cell)
        if parts:
            same = pd.MultiIndex.from_frame(chosen[["cycle", "axis", "fda"]]).isin(kept)
            yield str(robot), pd.concat(parts, ignore_index=True), chosen[same].assign(robot=robot)


def answer_side(
    side: str,
    quantities: pd.DataFrame,
    chosen: pd.DataFrame,
    drawn: pd.DataFrame | None,
    asked: Questions,
) -> Answers:
    """Answer the study's questions for a side: for its own model, and for models that its uncertainty allows.

    Parameters
    ----------
    side : {"before", "after", "truth"}
        The ``robot`` of its own model in the tables.
    quantities, chosen : DataFrame
        Test quantities and chosen surrogates of its own model.
    drawn : DataFrame or None
        Test quantities of drawn models; None where there are none.
    asked : Questions
    """
    answers = Answers()
    models = [(side, quantities, chosen)]
    if drawn is not None and len(drawn):
        models += extend_to_drawn(quantities, chosen, drawn, side)
    each = -(-asked.draws // len(models))
    collected: dict[Key, list[Array]] = {}
    for name, own, surrogates in models:
        for key, (value, draws) in _answer_model(name, own, surrogates, asked, each).items():
            if name == side:
                answers.value[key] = value
            collected.setdefault(key, []).append(draws)
    full = each * len(models)
    # Where a model could not be bridged in a cell, the other models take its share of the draws.
    answers.drawn = {key: np.resize(np.concatenate(draws), full) for key, draws in collected.items()}
    _add_ranks(answers)
    return answers


def _answer_model(
    name: str, quantities: pd.DataFrame, chosen: pd.DataFrame, asked: Questions, draws: int
) -> dict[Key, tuple[float, Array]]:
    """Value and draws of one model, by key."""
    found: dict[Key, tuple[float, Array]] = {}
    levels = nominal_levels(asked.factors)
    sigmas = np.linspace(asked.scope["sigma"][0], asked.scope["sigma"][1], asked.scope["grid"][1])
    noise = read_noise(chosen)
    for (robot, cycle, axis, fda), surrogate in read_chosen(chosen, quantities):
        rng = generator_for(asked.seed, "reevaluation", name, cycle, axis, fda)
        place = (str(cycle), int(axis), str(fda))
        found[(*place, "snr", "", 0.0)] = _snr(surrogate, noise[robot, cycle, axis, fda], rng, draws, asked)
        for factor in asked.scope["factors"]:
            value, drawn = sampled_tolerance(
                surrogate,
                factor,
                levels,
                np.array(DELTAS),
                sigmas,
                rng,
                draws,
                asked.scope["f0"],
                asked.scope["p_f"],
                asked.scope["p_d"],
            )
            for j, delta in enumerate(DELTAS):
                found[(*place, "scope", factor, delta)] = float(value[j]), drawn[:, j]
    names = [factor.name for factor in asked.factors]
    for key, cell in cells_of(quantities[quantities["set"] == IDENTIFICATION]):
        good = cell[np.isfinite(cell["y"].to_numpy(dtype=float))]
        fitted = fit_surrogate(good[names].to_numpy(dtype=float), good["y"].to_numpy(), names, asked.model)
        rng = generator_for(asked.seed, "reevaluation coefficients", name, *key[1:])
        drawn = fitted.draw_coefficients(rng, draws)
        direct = drawn[:, [fitted.terms.index(FAULT)]]
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = drawn / direct
        values = normalise_coefficients(fitted.theta, fitted.terms)
        for k, term in enumerate(fitted.terms):
            if term not in ("1", FAULT):
                place = (str(key[1]), int(key[2]), str(key[3]))
                found[(*place, "coefficient", term, 0.0)] = float(values[k]), shares[:, k]
    return found


def _snr(
    surrogate: ChosenSurrogate, noise: float, rng: np.random.Generator, draws: int, asked: Questions
) -> tuple[float, Array]:
    """SNR with the noise of single runs; the value is the median over what the runs allow.

    Without that noise, the SNR of a detector that hardly sees the nuisances would be made of its surrogate's
    errors.
    """
    if surrogate.status != "ok" or not noise > NOISE_FREE * response_size(surrogate):
        return np.nan, np.full(draws, np.nan)
    setting = asked.snr["f0"], asked.snr["delta"], asked.snr["sigma"]
    drawn = draw_snr(surrogate, rng, max(draws, FEWEST), *setting, noise)
    return float(np.median(drawn)), drawn[:draws]


def _add_ranks(answers: Answers) -> None:
    """Rank of each detector by its SNR among those of its test-cycle and axis, draw by draw; 1 is best."""
    places: dict[tuple[str, int], list[str]] = {}
    for cycle, axis, fda, question, _, _ in answers.value:
        if question == "snr":
            places.setdefault((cycle, axis), []).append(fda)
    for (cycle, axis), detectors in places.items():
        keys: list[Key] = [(cycle, axis, fda, "snr", "", 0.0) for fda in detectors]
        value = rank_best([answers.value[key] for key in keys])
        drawn = rank_best([answers.drawn[key] for key in keys])
        for k, fda in enumerate(detectors):
            place: Key = (cycle, axis, fda, "rank", "", 0.0)
            answers.value[place], answers.drawn[place] = float(value[k]), drawn[k]


def rank_best(snr: ArrayLike) -> Array:
    """Ranks of SNRs along the first axis, 1 for the largest; equals share the better one, NaN has none."""
    return np.asarray(rankdata(-np.asarray(snr), "min", axis=0, nan_policy="omit"), dtype=float)
