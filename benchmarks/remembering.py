"""Searches of one problem under many numbers of the rule, what they have in common worked out once.

`remember` puts memories in front of the pure functions that a search spends its time in: normal equations,
the evidence on a candidate, its shape, drifts, reversals, generic terms. Outcomes are kept by the very
objects that they depend on, and a function that meets the same objects again gives the outcome itself: a
search takes the same steps and ends with the same bits as without. What the rule says is tested again every
time; what is remembered of evidence reads the signs and `informing`, which are part of what the outcomes are
kept by.
"""

import os
import weakref
from collections import deque
from collections.abc import Callable, Hashable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

from wearscope.closed_loop.selection import evidence, generic, revision, search, stepwise, whitening
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import Evidence, weigh
from wearscope.closed_loop.selection.generic import GenericTerms, try_generic
from wearscope.closed_loop.selection.offers import list_candidates
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.problem import Problem
from wearscope.closed_loop.selection.reversal import refine_reversals
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.shape_fit import refine
from wearscope.closed_loop.selection.stepwise import _scale_of
from wearscope.closed_loop.selection.sums import Added, Sums
from wearscope.closed_loop.selection.whitening import drift_p_value

#: Assemblies whose arrays are kept; bytes of the process from which all is forgotten.
_KEPT, _MOST = 16, 4 * 2**30


class Memory:
    """Outcomes by what they depend on."""

    def __init__(self) -> None:
        self.known: dict[Hashable, Any] = {}
        self.made: deque[LateAssembly] = deque()

    def take(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """The outcome that is known, or what `make` gives."""
        if key not in self.known:
            self.known[key] = make()
        return self.known[key]

    def limit(self) -> None:
        """Forget all where the process has grown too large."""
        if int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") > _MOST:
            self.known.clear()
            self.made.clear()


def tell_chosen(chosen: Any) -> tuple:
    """What a model's terms are, in order: candidates represent themselves."""
    return tuple((c.candidate, c.subset) for c in chosen)


def tell_read(policy: Policy) -> tuple:
    """What evidence reads of the rule's numbers."""
    return policy.flips, policy.seed, policy.informing


class LateSums:
    """A candidate's block sums with a model, made when they are asked for."""

    def __init__(
        self, assembly: "LateAssembly", candidate: Any, subset: tuple[int, ...] | None = None
    ) -> None:
        self.assembly, self.candidate, self.subset = assembly, candidate, subset
        self._whole: Sums | None = None
        self._from: LateSums | None = None

    def select(self, subset: tuple[int, ...]) -> "LateSums":
        """The same with a subset of the columns."""
        assert self.subset is None
        part = LateSums(self.assembly, self.candidate, subset)
        part._from = self
        return part

    def make(self) -> Sums:
        """The sums."""
        if self._whole is None:
            if self._from is None:
                self._whole = Assembly.sum_products(self.assembly, self.candidate)
            else:
                assert self.subset is not None
                self._whole = self._from.make().select(self.subset)
        return self._whole

    def __getattr__(self, name: str) -> Any:
        return getattr(self.make(), name)


class LateAssembly(Assembly):
    """Normal equations that are made when they are asked for, and again where there was no room for them."""

    def __init__(
        self, memory: Memory, layout: Any, target: Any, chosen: Any, sigma: Any, joints: Any
    ) -> None:
        self._memory, self._asked = memory, (layout, target, chosen, sigma, joints)
        self._added: weakref.WeakKeyDictionary[Any, dict] = weakref.WeakKeyDictionary()
        self._losses: dict[str, Any] = {}
        self.forget()

    def forget(self) -> None:
        """Keep what it is of, and small outcomes."""
        layout, target, chosen, sigma, joints = self._asked
        stays = {name: self.__dict__[name] for name in ("_memory", "_asked", "_added", "_losses")}
        self.__dict__.clear()
        self.__dict__.update(stays)
        if joints is not None:
            chosen = tuple(c for c in chosen if set(c.candidate.joints) & set(joints))
        self.layout, self.target, self.chosen, self.sigma = layout, target, chosen, sigma

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or "gram" in self.__dict__:
            raise AttributeError(name)
        Assembly.__init__(self, *self._asked)
        made = self._memory.made
        made.append(self)
        if len(made) > _KEPT:
            made.popleft().forget()
        return getattr(self, name)

    def _remember_loss(self, name: str) -> Any:
        if name not in self._losses:
            self._losses[name] = getattr(Assembly, name).func(self)
        return self._losses[name]

    @property
    def joint_losses(self) -> Any:
        """As of any."""
        return self._remember_loss("joint_losses")

    @property
    def sample_losses(self) -> Any:
        """As of any."""
        return self._remember_loss("sample_losses")

    def sum_products(self, candidate: Any) -> Any:
        """As of any, made when it is asked for."""
        return LateSums(self, candidate)

    def add(self, sums: Any) -> Added:
        """As of any."""
        if not isinstance(sums, LateSums):
            return Assembly.add(self, sums)
        known = self._added.setdefault(sums.candidate, {})
        if sums.subset not in known:
            known[sums.subset] = Assembly.add(self, sums.make())
        return known[sums.subset]


@contextmanager
def remember() -> Iterator[Memory]:
    """Searches within work nothing out twice. All that it puts in place is taken back at the end."""
    memory = Memory()
    take = memory.take

    def assemble(layout: Any, target: Any, chosen: Any, sigma: Any, joints: Any = None) -> Assembly:
        asked = None if joints is None else frozenset(joints)
        # Rows that count and what is held out are a layout's own; all else of it is its data set's.
        rows = ("assembly", id(layout.prepared), layout.keep.tobytes(), id(layout.folds), id(target))
        key = (*rows, tell_chosen(chosen), sigma.tobytes(), asked)
        return take(key, lambda: LateAssembly(memory, layout, target, tuple(chosen), sigma, joints))

    def weigh_once(
        assembly: Any, candidate: Any, subset: Any, policy: Policy, sums: Any = None, by_fifths: bool = False
    ) -> Evidence:
        key = ("weigh", assembly, candidate, subset, by_fifths, *tell_read(policy))
        return take(key, lambda: weigh(assembly, candidate, subset, policy, sums, by_fifths))

    def refine_once(problem: Any, assembly: Any, e: Evidence, policy: Policy) -> Evidence:
        key = ("refine", problem, assembly, e.chosen.candidate, e.chosen.subset, e.gain, *tell_read(policy))
        first, finer = take(key, lambda: (e, refine(problem, assembly, e, policy)))
        if finer is first:
            return e
        return replace(finer, p_value=e.p_value, tried=e.tried, refusal=e.refusal, whole=e.whole)

    def drift_once(assembly: Any, chosen: Chosen, joint: int, flips: Any, always: bool = False) -> float:
        key = ("drift", assembly, tell_chosen([chosen]), joint, len(flips), always)
        return take(key, lambda: drift_p_value(assembly, chosen, joint, flips, always))

    def reverse_once(prepared: Any, assembly: Any, forms: bool = True) -> Any:
        return take(("reverse", assembly, forms), lambda: refine_reversals(prepared, assembly, forms))

    def list_once(problem: Problem, assembly: Any, joints: Any, asks: Any) -> Any:
        key = ("list", problem, assembly, tuple(joints))
        every = take(key, lambda: list_candidates(problem, assembly, joints))
        return [c for c in every if asks(c.effect, c.joint)]

    def generic_once(terms: Any, assembly: Any, joints: Any, policy: Policy) -> Any:
        key = ("generic", terms, assembly, tuple(joints), policy.large_share, *tell_read(policy))
        return take(key, lambda: try_generic(terms, assembly, joints, policy))

    def terms_once(prepared: Any, joined: Any) -> GenericTerms:
        return take(("terms", id(prepared)), lambda: GenericTerms(prepared, joined))

    def scale_standard_once(problem: Problem, chosen: Any, sigma: Any) -> Any:
        key = ("standard", problem, tell_chosen(chosen), sigma.tobytes())
        return take(key, lambda: _scale_of(problem, chosen, sigma))

    scale, reverse_over, remake = Search.scale, Problem.reverse_over, Problem.remake

    def scale_once(own: Search, found: Any) -> Any:
        key = ("scale", own.problem, tell_chosen(f.chosen for f in found))
        return take(key, lambda: scale(own, found))

    def reverse_over_once(problem: Problem, reversals: Any) -> Problem:
        key = ("over", problem, reversals.width.tobytes(), reversals.form.tobytes())
        return take(key, lambda: reverse_over(problem, reversals))

    def remake_once(problem: Problem, chosen: Chosen) -> Chosen:
        return take(("remake", problem, *tell_chosen([chosen])), lambda: remake(problem, chosen))

    instead = [
        (search, "Assembly", assemble), (stepwise, "Assembly", assemble), (evidence, "Assembly", assemble),
        (search, "weigh", weigh_once), (stepwise, "weigh", weigh_once), (revision, "weigh", weigh_once),
        (search, "refine", refine_once), (whitening, "drift_p_value", drift_once),
        (whitening, "Assembly", assemble), (whitening, "weigh", weigh_once),
        (search, "refine_reversals", reverse_once), (search, "list_candidates", list_once),
        (generic, "try_generic", generic_once),
        (stepwise, "_scale_of", scale_standard_once), (Search, "scale", scale_once),
        (Problem, "reverse_over", reverse_over_once),
        (Problem, "remake", remake_once),
    ]  # fmt: skip
    with ExitStack() as stack:
        for place, name, new in instead:
            stack.enter_context(patch.object(place, name, new))
        stack.enter_context(patch("wearscope.closed_loop.selection.answer.GenericTerms", terms_once))
        yield memory
