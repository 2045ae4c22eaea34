"""What the benchmark of the rule's numbers works out once for all of them changes no verdict."""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.policy import diagnose_variants, list_variants
from wearscope.closed_loop.diagnosis import diagnose

#: Numbers of each kind: of the policy, of the rule, what stands elsewhere, what evidence is made of.
TRIED = (
    "as it is",
    "material_share doubled",
    "_POSSIBLE doubled",
    "generic._DOUBTED doubled",
    "flips halved",
)


def keep(verdict):
    return {name: value for name, value in verdict.items() if name != "rule"}


def test_verdicts_of_searches_that_remember_are_those_of_searches_that_do_not(record):
    def spring(t, q, v, a, rng):
        return 9.0 * q + np.sign(v) * 1.5 * q**2

    folder = record(extra_torque=spring, seed=3, runs=4, duration=8.0)
    variants = {name: list_variants()[name] for name in TRIED}
    found = {name: kept for name, kept, _ in diagnose_variants(folder / "dataset.yaml", variants, keep)}
    assert list(found) == list(TRIED)
    for name, variant in variants.items():
        with variant.put() as policy:
            assert found[name] == keep(diagnose(folder, policy).verdict), name
    assert any(found[name] != found["as it is"] for name in TRIED)


def test_every_number_of_the_rule_is_changed_and_put_back():
    variants = list_variants()
    for name, variant in variants.items():
        if variant.module is None:
            assert (variant.policy == variants["as it is"].policy) == (name == "as it is")
            continue
        before = getattr(variant.module, variant.constant)
        with variant.put():
            assert getattr(variant.module, variant.constant) == variant.value != before
        assert getattr(variant.module, variant.constant) == before
