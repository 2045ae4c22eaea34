"""Benchmarks; some of their machines, and copies of the tree, are the tests'."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path += [str(ROOT / "tests"), str(ROOT / "tests" / "detection")]
