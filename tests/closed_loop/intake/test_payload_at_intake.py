"""A payload that is not stated is told with its mass at the door, and is no fault of the columns."""

import re

import numpy as np
import pytest
from recorded_chain import Bench, torque_of

from wearscope.checking.dataset import check_dataset


def carry(n, mass, more=0.0):
    """Chain of n links of 1.2 kg with friction and a payload at the end, and springs."""
    plain = torque_of([1.2] * (n - 1) + [1.2 + mass], 0.3, 0.5, noise=0.02)
    return lambda q, *given: plain(q, *given) + more * np.sin(q)


def tell(bench):
    return [note for note in bench.accept() if note.startswith("a payload")]


@pytest.mark.parametrize(("n", "mass"), [(3, 3.0), (4, 8.0)])
def test_a_payload_is_told_with_its_mass(tmp_path, n, mass):
    """The heaviest makes the last joint's torque 7.7 times what the stated bodies need."""
    (told,) = tell(Bench(tmp_path, n, seconds=9.0).record(carry(n, mass)))
    said = re.search(r"a payload about (\S+) kg heavier than stated", told)
    assert said is not None and float(said[1]) == pytest.approx(mass, rel=0.15)


def test_a_stated_payload_that_is_not_there_is_told(tmp_path):
    bench = Bench(tmp_path, 3, seconds=9.0).record(carry(3, 0.0))
    done = bench.take("--payload", "2.0", "--payload-com", "0", "0", "-0.3")
    assert done.exit_code == 0, done.output + str(done.exception)
    notes = " ".join(check_dataset(tmp_path / "d").notes)
    said = re.search(r"a payload about (\S+) kg lighter than stated", notes)
    assert said is not None and float(said[1]) == pytest.approx(2.0, rel=0.15)


@pytest.mark.parametrize(("n", "mass", "more"), [(3, 0.0, 0.0), (3, 0.0, 4.0), (1, 1.0, 0.0)])
def test_nothing_else_is_a_payload(tmp_path, n, mass, more):
    """Springs are none, and one joint tells no mass."""
    assert tell(Bench(tmp_path, n, seconds=9.0).record(carry(n, mass, more))) == []
