"""Reevaluation: how the correction of a robot's model changes a study's answers.

The sides are the model before and after the correction and, in a simulation, the truth. A side is a model
and, where its uncertainty is known, further models drawn from that. Each model answers the study's questions
(coefficients, SNR, ranks, scope) with the study's settings. The distribution of a side's answers combines its
models and the uncertainty of their surrogates. From these follow the best detectors of each side, and which
side is nearer to the truth.
"""

from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import ArrayLike, NDArray

from wearscope.designs.factors import FAULT, Factor, nominal_levels
from wearscope.designs.kinds import generator_for
from wearscope.evaluation.grouping import central_interval
from wearscope.evaluation.sampled_scope import sampled_tolerance
from wearscope.evaluation.snr import draw_snr, is_noise_free, response_size
from wearscope.surrogates.chosen import CONSTANT, ChosenSurrogate, read_chosen, read_noise
from wearscope.surrogates.fitting import CELL, IDENTIFICATION, cells_of, fit_surrogate, normalise_coefficients

Array = NDArray[np.float64]
#: Coded changes of the fault at which the scope is stated.
DELTAS = (1.0, 2.0, 4.0)
#: Fewest drawn response functions from which a median is computed.
FEWEST = 100
#: Key of an answer: test-cycle, axis, detector, question, term or factor, coded change of the fault (0:
#: none).
Key = tuple[str, int, str, str, str, float]


@dataclass(frozen=True)
class Questions:
    """The study's questions with their settings.

    Attributes
    ----------
    factors : sequence of Factor
    model : str
        Quadratic surrogate whose coefficients are compared.
    snr : mapping
        ``f0``, ``delta``, ``sigma`` of eq. (20).
    scope : mapping
        ``factors``, ``f0``, ``sigma`` (first, last), ``grid``, ``p_f``, ``p_d``.
    seed : int
    draws : int
        Number of draws of a side, divided among its models.
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
        Answer of the side's own model, by key.
    drawn : dict
        Drawn answers (draws,), by key. Draws with the same index belong to the same model.
    """

    value: dict[Key, float] = field(default_factory=dict)
    drawn: dict[Key, Array] = field(default_factory=dict)


def share_surrogates(chosen: pd.DataFrame) -> pd.DataFrame:
    """Give all sides of a cell the kind and parameters of the side whose surrogate cross-validates worst.

    Each side's surrogate is still fitted to its own runs. If each side kept its own parameters, one outlying
    run could make one side's surrogate rougher than the other's, and the answers would differ for that
    reason.

    Parameters
    ----------
    chosen : DataFrame
        From `wearscope.surrogates.chosen.choose_surrogates`, with the rows of all sides (``robot``).
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
    """Estimate test quantities of drawn models at all points at which their side's own model was simulated.

    A drawn model is simulated at few points. There, its difference to the side's own model is fitted by main
    effects. The fitted difference is added to the own model's values at all points. This is an additive
    bridge between two simulators (Forrester, Soebester, Keane, Engineering Design via Surrogate Modelling,
    2008, ch. 8).

    Parameters
    ----------
    quantities : DataFrame
        Test quantities of the side's own model, ``robot`` = `side`.
    chosen : DataFrame
        Chosen surrogates of that model.
    drawn : DataFrame
        Test quantities of the drawn models, at points that the own model has too (same ``set`` and
        ``point``).
    side : str

    Yields
    ------
    name : str
        Name of the drawn model.
    quantities, chosen : DataFrame
        As those of the side's own model; cells with too few points for a fit are left out.
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
    """Answer the study's questions for a side: for its own model, and for the models drawn from it.

    Parameters
    ----------
    side : {"before", "after", "truth"}
        Name of its own model in the column ``robot``.
    quantities, chosen : DataFrame
        Test quantities and chosen surrogates of its own model.
    drawn : DataFrame or None
        Test quantities of the drawn models; None where there are none.
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
    # Where a drawn model has no values in a cell, the draws of the other models are repeated in its place.
    answers.drawn = {key: np.resize(np.concatenate(draws), full) for key, draws in collected.items()}
    _add_ranks(answers)
    return answers


def _answer_model(
    name: str, quantities: pd.DataFrame, chosen: pd.DataFrame, asked: Questions, draws: int
) -> dict[Key, tuple[float, Array]]:
    """Return the value and the draws (draws,) of each answer of one model, by key."""
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
    """Return the SNR with the noise of single runs: the median over drawn response functions, and the draws.

    Without that noise, the SNR of a detector that hardly depends on the nuisances would reflect only the
    errors of its surrogate.
    """
    if surrogate.status != "ok" or is_noise_free(noise, response_size(surrogate)):
        return np.nan, np.full(draws, np.nan)
    setting = asked.snr["f0"], asked.snr["delta"], asked.snr["sigma"]
    drawn = draw_snr(surrogate, rng, max(draws, FEWEST), *setting, noise)
    return float(np.median(drawn)), drawn[:draws]


def _add_ranks(answers: Answers) -> None:
    """Add each detector's rank by SNR within its test-cycle and axis, for each draw; 1 is best."""
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
    """Rank SNRs along the first axis, 1 for the largest; equal values share the better rank, NaN has none."""
    return np.asarray(scipy.stats.rankdata(-np.asarray(snr), "min", axis=0, nan_policy="omit"), dtype=float)


SIDES = ("before", "after", "truth")
QUESTIONS = ("coefficient", "snr", "rank", "scope")
LEVEL = 0.95


def withheld_cells(chosen: pd.DataFrame) -> set[tuple[str, int, str]]:
    """Return the cells (test-cycle, axis, detector) whose surrogates fail at too many checking points.

    A cell is withheld where fewer points lie within their 95 % intervals than chance explains, at a level of
    5 % over all cells and sides together.

    Parameters
    ----------
    chosen : DataFrame
        From `wearscope.surrogates.chosen.choose_surrogates`, of all sides.
    """
    inside = np.round(chosen["inside"] * chosen["n_checking"])
    chance = scipy.stats.binom.cdf(inside, chosen["n_checking"], LEVEL)
    rows = chosen[(chosen["inside"].notna()) & (chance < (1.0 - LEVEL) / len(chosen))]
    return {(str(row.cycle), int(row.axis), str(row.fda)) for row in rows.itertuples()}


def compare_sides(
    answers: Mapping[str, Answers],
    robot: str,
    factors: Sequence[Factor],
    withheld: AbstractSet[tuple[str, int, str]] = frozenset(),
) -> pd.DataFrame:
    """Compare the answers before and after the correction, and with the truth where it is known.

    Parameters
    ----------
    answers : mapping of str to Answers
        ``before``, ``after`` and, where it can be simulated, ``truth``.
    robot : str
        Name of the robot in tables.
    factors : sequence of Factor
    withheld : set
        From `withheld_cells`.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``withheld``, ``question``, ``about`` (the term or the
        factor), ``delta`` (change of the fault, natural; NaN where there is none), ``unit``; ``before``,
        ``after``, ``truth``, each with ``_low`` and ``_high`` (95 %); ``p_changed``, the difference between
        the probabilities of a rise and of a fall, as an absolute value: 0 where the direction is unknown, 1
        where it is certain; ``p_nearer``, the probability that after is nearer to the truth than before (ties
        count half), NaN without a truth. A coefficient is relative to that of the fault (8). An SNR (11)
        includes the noise of single runs. A rank is by SNR among the detectors of the cell's test-cycle and
        axis. A scope is the largest standard deviation that the factor may have, in natural units.
    """
    known = {factor.name: factor for factor in factors}
    shared = [key for key in answers["before"].value if key in answers["after"].value]
    records = []
    for key in shared:
        cycle, axis, fda, question, about, delta = key
        factor = known.get(about) if question == "scope" else None
        scale = factor.step if factor is not None else 1.0
        row: dict[str, Any] = {
            "robot": robot,
            "cycle": cycle,
            "axis": axis,
            "fda": fda,
            "withheld": (cycle, axis, fda) in withheld,
            "question": question,
            "about": about,
            "delta": delta * known[FAULT].step if delta else np.nan,
            "unit": factor.unit if factor is not None else "1",
        }
        for side in SIDES:
            value, drawn = np.nan, np.full(1, np.nan)
            if side in answers and key in answers[side].value:
                value, drawn = answers[side].value[key], answers[side].drawn.get(key, drawn)
            row[side] = scale * value
            row[f"{side}_low"], row[f"{side}_high"] = (scale * end for end in central_interval(drawn))
        before, after = (answers[side].drawn.get(key) for side in SIDES[:2])
        truth = answers["truth"].drawn.get(key) if "truth" in answers else None
        row["p_changed"], row["p_nearer"] = _probabilities(before, after, truth)
        records.append(row)
    order = {name: place for place, name in enumerate(QUESTIONS)}
    table = pd.DataFrame(records)
    table["_order"] = table["question"].map(order)
    table = table.sort_values([*CELL, "_order", "about", "delta"], kind="stable", ignore_index=True)
    return table.drop(columns="_order")


def compare_ranking(answers: Mapping[str, Answers], robot: str) -> pd.DataFrame:
    """Return the probability that one detector has a higher SNR than another, by pair, test-cycle and axis.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``over`` (the other detector), and by side the probability
        that `fda` outranks it; NaN where a side has no SNR of either.
    """
    records = []
    cells = dict.fromkeys(key[:2] for key in answers["before"].value)
    for cycle, axis in cells:
        detectors = [
            key[2] for key in answers["before"].value if key[:2] == (cycle, axis) and key[3] == "snr"
        ]
        for one, other in permutations(detectors, 2):
            row: dict[str, Any] = {"robot": robot, "cycle": cycle, "axis": axis, "fda": one, "over": other}
            for side in SIDES:
                drawn = answers[side].drawn if side in answers else {}
                pair = [drawn.get((cycle, axis, name, "snr", "", 0.0)) for name in (one, other)]
                row[side] = _probability(*pair)
            records.append(row)
    return pd.DataFrame(records, columns=["robot", "cycle", "axis", "fda", "over", *SIDES])


def _probability(first: Array | None, second: Array | None) -> float:
    """Return the probability that the first is larger than the second, draw by draw; ties count half."""
    if first is None or second is None:
        return np.nan
    size = min(len(first), len(second))
    difference = first[:size] - second[:size]
    good = difference[~np.isnan(difference)]
    return float(np.mean((good > 0) + 0.5 * (good == 0))) if good.size else np.nan


def _probabilities(before: Array | None, after: Array | None, truth: Array | None) -> tuple[float, float]:
    """Return how sure the direction of change is, and the probability that after is nearer to the truth."""
    up = _probability(after, before)
    changed = abs(2.0 * up - 1.0)
    if before is None or after is None or truth is None:
        return changed, np.nan
    size = min(len(before), len(after), len(truth))
    # The sides are drawn independently, so any pairing of their draws is valid.
    far, near = (np.abs(side[:size] - truth[:size]) for side in (before, after))
    return changed, _probability(far, near)


#: Probability from which a change, an order or a comparison with the truth counts as sure.
SURE = 0.95


@dataclass(frozen=True)
class Reevaluation:
    """Tables of a reevaluation.

    Attributes
    ----------
    table : DataFrame
        From `wearscope.evaluation.reevaluation.compare_sides`.
    ranking : DataFrame
        From `wearscope.evaluation.reevaluation.compare_ranking`.
    models : DataFrame
        ``side``, ``drawn``, ``left_out``, ``first_reason``.
    assumed : tuple of str
        Dependences that the corrected model took from another robot, e.g. ``wear at axis_1``.
    names : mapping of str to str
        Names of factors and detectors by code, e.g. ``temperature`` for ``w3``; a missing code names itself.
    bounds : tuple of str
        Detectors that know the simulator's friction law; they are never among the best.
    """

    table: pd.DataFrame
    ranking: pd.DataFrame
    models: pd.DataFrame
    assumed: tuple[str, ...] = ()
    names: Mapping[str, str] = field(default_factory=dict)
    bounds: tuple[str, ...] = ()

    @property
    def told(self) -> pd.DataFrame:
        """Rows whose answers are not withheld."""
        return self.table[~self.table["withheld"]]

    @property
    def has_truth(self) -> bool:
        """Whether the truth could be simulated."""
        return bool(np.isfinite(self.table["truth"].to_numpy(dtype=float)).any())

    def cells(self) -> Iterator[tuple[str, int, pd.DataFrame]]:
        """Yield test-cycle, axis and rows of each group in which detectors are compared."""
        for (cycle, axis), rows in self.table.groupby(["cycle", "axis"], sort=True):
            yield str(cycle), int(axis), rows


def judge_detector(rows: pd.DataFrame) -> tuple[list[str], str]:
    """Judge whether a detector's SNR, rank and scope surely moved towards the truth or away from it.

    Returns
    -------
    what : list of str
        Those of ``SNR``, ``rank``, ``scope`` that surely moved.
    verdict : str
        ``nearer`` or ``farther`` where all of these agree, ``mixed`` where they differ, ``not certain`` where
        none surely moved.
    """
    signs: dict[str, set[int]] = {}
    for row in rows[rows["question"] != "coefficient"].itertuples():
        if row.p_nearer >= SURE or row.p_nearer <= 1.0 - SURE:
            name = {"snr": "SNR"}.get(str(row.question), str(row.question))
            signs.setdefault(name, set()).add(1 if row.p_nearer >= SURE else -1)
    found = set().union(*signs.values()) if signs else set()
    verdict = {frozenset({1}): "nearer", frozenset({-1}): "farther", frozenset(): "not certain"}
    return list(signs), verdict.get(frozenset(found), "mixed")


def settled_orders(one: Reevaluation, side: str) -> set[tuple[str, int, str, str]]:
    """Return tuples of test-cycle, axis and two detectors of which the first surely outranks the second."""
    rows = one.ranking[one.ranking[side] >= SURE]
    away = {(row.cycle, row.axis, row.fda) for row in one.table[one.table["withheld"]].itertuples()}
    return {
        (str(row.cycle), int(row.axis), str(row.fda), str(row.over))
        for row in rows.itertuples()
        if away.isdisjoint({(row.cycle, row.axis, row.fda), (row.cycle, row.axis, row.over)})
    }


def best_detectors(one: Reevaluation, side: str) -> dict[tuple[str, int], list[str]]:
    """Return by test-cycle and axis the detectors that no other surely outranks, best first."""
    best = {}
    orders = [order for order in settled_orders(one, side) if order[2] not in one.bounds]
    beaten = {(cycle, axis, over) for cycle, axis, _, over in orders}
    for cycle, axis, rows in one.cells():
        snr = rows[
            ~rows["withheld"] & (rows["question"] == "snr") & np.isfinite(rows[side].to_numpy(dtype=float))
        ]
        order = snr.sort_values(side, ascending=False, kind="stable")["fda"]
        best[cycle, axis] = [
            str(fda) for fda in order if (cycle, axis, fda) not in beaten and fda not in one.bounds
        ]
    return best
