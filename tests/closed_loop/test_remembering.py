"""What the benchmark of the rule's numbers works out once for all of them changes no verdict."""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.policy import diagnose_variants, list_variants, print_table
from wearscope.closed_loop.diagnosis import diagnose

#: Numbers that the search, the generic term, the conclusion and the evidence read.
TRIED = (
    "as it is",
    "material_share doubled",
    "zero_level halved",
    "flips halved",
)


def keep(verdict):
    return {name: value for name, value in verdict.items() if name != "rule"}


def test_verdicts_of_searches_that_remember_are_those_of_searches_that_do_not(record):
    def spring(t, q, v, a, rng):
        return 9.0 * q + np.sign(v) * 1.5 * q**2

    folder = record(extra_torque=spring, seed=3, runs=3, duration=6.0)
    variants = {name: list_variants()[name] for name in TRIED}
    found = {name: kept for name, kept, _ in diagnose_variants(folder / "dataset.yaml", variants, keep)}
    assert list(found) == list(TRIED)
    for name, policy in variants.items():
        assert found[name] == keep(diagnose(folder, policy).verdict), name
    assert any(found[name] != found["as it is"] for name in TRIED)


def test_every_number_of_the_rule_is_halved_and_doubled():
    variants = list_variants()
    today = variants.pop("as it is").model_dump()
    for name, policy in variants.items():
        number = name.split()[0]
        assert {key for key, value in policy.model_dump().items() if value != today[key]} == {number}, name
    assert {f"{name} {word}" for name in set(today) - {"seed"} for word in ("halved", "doubled")} <= set(
        variants
    )


def test_a_number_is_asked_alone():
    assert set(list_variants(["cancels"])) == {"as it is", "cancels halved", "cancels doubled"}
    assert list_variants(["cancels"])["cancels doubled"].cancels == 24.0


def test_the_table_counts_by_number_and_lists_those_that_change_nothing(capsys):
    def score(names, exact, null=False):
        return {
            "names": names,
            "null": null,
            "exact": exact,
            "extra": len(names) - 1,
            "required": 1,
            "named": 1,
        }

    one = {"as it is": score([["a", "x"]], True), "p halved": score([["a", "x"]], True)}
    one |= {"p doubled": score([["a", "x"], ["a", "y"]], False), "q halved": one["as it is"]}
    one |= {"q doubled": one["as it is"], "q taken out": one["as it is"]}
    other = dict.fromkeys(one, score([["b", "x"]], True))
    null = dict.fromkeys(one, score([["b", "x"], ["b", "y"]], None, null=True))
    lines = [{"scores": scores, "why": ""} for scores in (one, other, null)]
    print_table([*lines, {"scores": {}, "why": "not made: no"}])
    shown = capsys.readouterr().out
    assert "3 of 4 cases (1 not made)" in shown
    assert (
        "names change in, of 3 | exact, of 2 | required named, of 2 | extra, of 2 | false, of 1 nulls"
        in shown
    )
    assert "| as it is | 0 | 2 | 2 | 0 | 1 |" in shown
    assert "| `p` | 0 / 1 | 2 / 1 | 2 / 2 | 0 / 1 | 1 / 1 |" in shown
    assert "No name changes with `q`." in shown
