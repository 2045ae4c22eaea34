"""Which reading of the columns is best: traits added one by one, each with the best machine for it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from wearscope.closed_loop.intake.traits.hypotheses import NOTE, TRAITS, Trait, tell
from wearscope.closed_loop.intake.traits.reading import Reading
from wearscope.closed_loop.intake.traits.rows import Rows
from wearscope.closed_loop.intake.traits.score import GAINS, PAYLOAD, Model, Weighing

#: Odds against a trait, 100 to 1, and further odds that a refusal needs [nats].
ODDS, REFUSE = float(np.log(100.0)), 10.0
#: Rows of a first look; numbers of readings that are scored with all rows, and to which traits are added.
_FEW, _BEAM, _FRONT = 160, 4, 3
#: Rounds of further traits; unexplained share of a torque's variance above which a run is doubted.
_ROUNDS, MUCH = 2, 0.1
#: A torque is explained up to the first unexplained share of its variance, or up to the second number times
#: the share that the stated reading leaves. From the third share on it counts as noise. A reading must
#: explain the fourth share of the torques.
LITTLE, _LESS, HOPELESS, _TOLD = 0.05, 0.33, 0.8, 0.75
#: Readings this many nats behind the likeliest one at a first look are not weighed with all rows.
_APART = 30.0
#: All runs carry the same load where none deviates from the mean by this many standard errors.
_DIFFER = 4.0


@dataclass(frozen=True)
class Weighed:
    """Result of comparing the readings of the columns.

    Attributes
    ----------
    stated : Model
        The stated reading with the best machine.
    best : Model
        The best reading; the stated one where none is better by `NOTE`.
    ties : list of Model
        Readings that explain the torques as well, with as many traits as the best one (at least one).
    """

    stated: Model
    best: Model
    ties: list[Model]

    @property
    def is_answer(self) -> bool:
        """Whether the best reading explains most torques that it changes, apart from those that are noise.

        One torque of many may hold an effect in addition, which no reading explains.
        """
        held, own = self.best.held, self.best.reading.claims[self.best.fit.joint]
        asked = (own | ~own.any()) & (held < HOPELESS)
        told = held[asked] <= np.maximum(LITTLE, _LESS * self.stated.held)[asked]
        return bool(asked.any() and told.mean() >= _TOLD)

    def list_rivals(self, rows: Rows) -> dict[str, list[str]]:
        """Refusals by the ties that could replace the best reading's: codes by sentence."""
        named = {code for _, some in tell(self.best.reading, rows)[0] for code in some}
        found: dict[str, list[str]] = {}
        for tie in self.ties:
            told = tell(tie.reading, rows)[0]
            other = [(text.rstrip("."), some) for text, some in told if not set(some) <= named]
            # A rival names something in the place of the best reading, not in addition to it.
            if other and not named <= {code for _, some in told for code in some}:
                codes = [code for _, some in other for code in some]
                found["; ".join(text for text, _ in other)] = codes
        return found


def weigh(rows: Rows, accepted: frozenset[str] = frozenset()) -> Weighed:
    """Compare readings of the columns, each with the best machine for it.

    Parameters
    ----------
    rows : Rows
    accepted : frozenset of str
        Codes that the data set accepts; readings with them are not tried.
    """
    stated = Weighing(rows).fit(Reading.stated(rows.n)).climb()
    if (loaded := _find_loaded(stated)) is not None:
        other = Weighing(replace(rows, loaded=loaded)).fit(stated.reading).climb()
        stated = other if other.over(stated) > NOTE else stated
    rows = stated.fit.rows
    whole, few = Weighing(rows), look_at_few(rows)
    best, pool = stated, list[Model]()
    front = [stated.reading]
    for _ in range(1 + _ROUNDS):
        if best.need < NOTE:
            break
        found = [
            one for start in front for trait in TRAITS for one in _list_readings(few, trait, start, accepted)
        ]
        likeliest = sorted(dict.fromkeys(found), key=lambda one: round(few.look(one)))[:_BEAM]
        ranked = [one for one in likeliest if few.look(one) < few.look(likeliest[0]) + _APART]
        models = [whole.fit(one).climb() for one in ranked]
        pool += models
        # Readings are compared with each other, as the number of independent rows differs by pair. Of equally
        # good ones, the one that is proposed first is taken.
        further = reduce(lambda one, other: other if other.over(one) > GAINS else one, models or [best])
        gains = further.over(best) > (0.0 if best is stated else NOTE)
        best = further if gains else best
        much = bool(best.held.max() >= MUCH)
        if not (gains or much):
            break
        # Two traits may improve the fit only together. Where much is unexplained, the likeliest readings are
        # followed although they do not improve it. A further trait is added to each of equally good readings.
        equal = [best.reading, *(tie.reading for tie in _list_ties(best, pool))]
        front = (likeliest if much else equal)[:_FRONT]
    return Weighed(stated, best, _list_ties(best, pool))


def _list_ties(best: Model, pool: list[Model]) -> list[Model]:
    """Readings that explain the torques as well as the best one, with as many traits (at least one)."""
    traits = max(1, len(best.reading.traits))
    alike = (one for one in pool if one is not best and len(one.reading.traits) == traits)
    return [one for one in alike if best.over(one) < NOTE]


def _find_loaded(model: Model) -> np.ndarray | None:
    """Mask (N,) of rows in runs that carry a payload while others do not; None where all runs are alike."""
    numbers, number = np.unique(model.fit.rows.run, return_inverse=True)
    if len(numbers) < 2:
        return None
    values, covariance = model.find_by_run(model.fit.groups[PAYLOAD])
    # A load that all runs carry may as well belong to the links.
    centred = np.eye(len(numbers)) - 1.0 / len(numbers)
    spread = np.einsum("ar,rmsm,as->am", centred, covariance, centred)
    away = np.abs(centred @ values) / np.sqrt(spread)
    k = int(np.argmax(away.max(axis=0)))
    if away[:, k].max() < _DIFFER:
        return None
    own = np.abs(values[:, k])
    return np.asarray((own > 0.5 * (own.min() + own.max()))[number])


def _list_readings(
    few: Weighing, trait: Trait, start: Reading, accepted: frozenset[str]
) -> Iterator[Reading]:
    """Readings with one more trait, then with that trait at further joints while the first score improves."""
    one: Reading | None = start
    while one is not None:
        before = few.look(one)
        some = _propose(few, trait, one, accepted, ODDS if one is start else 0.0)
        yield from some if one is start else ()
        one = min(some, key=few.look, default=None)
        if one is None or few.look(one) > before - NOTE:
            return
        yield one


def _propose(
    few: Weighing, trait: Trait, start: Reading, accepted: frozenset[str], odds: float
) -> list[Reading]:
    """Readings with a trait added to `start`, each with the odds against it."""
    every = list(trait.propose(few, start))
    taken = [one for one in every if not accepted.intersection(_list_codes(one, few.rows))]
    # Traits that are only noted have odds of their own.
    nats = odds + float(np.log(max(len(every), 1)))
    return [
        one if trait.notes and trait.notes(one, few.rows) else one.has(one.traits[-1], nats) for one in taken
    ]


def _list_codes(reading: Reading, rows: Rows) -> list[str]:
    refused, noted = tell(reading, rows)
    return [code for _, codes in (*refused, *noted) for code in codes]


def look_at_few(rows: Rows) -> Weighing:
    """Fits for a first look."""
    return Weighing(rows.thin(_FEW), coarse=True)


def look_at(rows: Rows, reading: Reading) -> float:
    """Evidence [nats] for a reading over the stated one, by their first scores."""
    few = look_at_few(rows)
    return few.look(Reading.stated(rows.n)) - few.look(reading)
