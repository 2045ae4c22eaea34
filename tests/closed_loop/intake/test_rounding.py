"""The answer is that of the recorded machine, not of the processor: it stands under other rounding."""

import json
import os
import subprocess
import sys

import pytest
from folders import plan

from benchmarks.board.generate import generate_dataset
from benchmarks.board.recipe import Planted, Recipe

PLANS = plan(("fourier", 24.0), ("sweep", 30.0), ("points", 31.0))
CLOSE = "import sys; from wearscope.closed_loop.run import close_loop; close_loop(*sys.argv[1:], light=True)"


def test_a_slide_gets_the_same_answer_whatever_the_kernels_round(tmp_path):
    """Its rigid body and its drive's inertia are the same column, where rounding once chose the reversal."""
    planted = [Planted("viscous_asymmetry", "slide", 4.0)]
    generate_dataset(tmp_path / "d1", "stage", planted, 3, Recipe(duration=8.0, plans=PLANS))
    found = {}
    for kernel in ("Haswell", "Nehalem"):
        # Kernels of a BLAS that chooses them by the processor; elsewhere the same ones are asked twice.
        kernels = os.environ | {"OPENBLAS_CORETYPE": kernel}
        out = tmp_path / kernel
        subprocess.run([sys.executable, "-c", CLOSE, str(tmp_path / "d1"), str(out)], env=kernels, check=True)
        found[kernel] = json.loads((out / "verdict.json").read_text())
    one, other = found.values()
    assert [e["effect"] for e in one["verdict"]] == [e["effect"] for e in other["verdict"]]
    for joint, state in one["joints"].items():
        for name in ("rms_before", "rms_after"):
            assert state[name] == pytest.approx(other["joints"][joint][name], rel=1e-6)
