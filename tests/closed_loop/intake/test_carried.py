"""An error of the declared payload is one of what is carried: none where nothing is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from changed_fields import changed_fields
from folders import read_prepared

from wearscope.closed_loop.intake.dataset_fields import PayloadFields
from wearscope.closed_loop.intake.sources import is_carried
from wearscope.effects.base import load_effect

LOAD, NOTHING = PayloadFields(mass=2.0, com=[0.0, 0.0, 0.1]), PayloadFields(mass=0.0, com=[0.0, 0.0, 0.0])


def runs(*payloads):
    return SimpleNamespace(runs=[SimpleNamespace(payload=payload) for payload in payloads])


@pytest.mark.parametrize(
    ("declared", "own", "carried"),
    [
        ((LOAD, None), LOAD, True),
        ((LOAD, None), None, False),
        ((LOAD, NOTHING), NOTHING, False),
        ((None, None), None, True),
        ((NOTHING,), NOTHING, True),
    ],
)
def test_what_is_carried(declared, own, carried):
    assert is_carried(runs(*declared), own) is carried


def test_columns_vanish_in_runs_that_carry_nothing_while_others_do(record):
    folder = record(runs=3, duration=4.0)
    with changed_fields(folder / "dataset.yaml") as fields:
        del fields["runs"][1]["payload"]
    prepared = read_prepared(folder)
    effect, last = load_effect("payload_error"), prepared.n - 1
    sizes = [float(np.abs(effect.columns(run.signals, last, np.zeros(0))).max()) for run in prepared.runs]
    assert sizes[1] == 0.0 and min(sizes[0], sizes[2]) > 0.0
    signals = replace(prepared.runs[1].signals, carries=True)
    assert np.abs(effect.columns(signals, last, np.zeros(0))).max() > 0.0
