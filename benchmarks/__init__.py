"""Benchmark against named peers: ``make bench``, or ``python -m benchmarks.run`` from the root of the project."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]

if str(ROOT / "tests") not in sys.path:
    sys.path.insert(0, str(ROOT / "tests"))  # peers and plain_hull, which the tests use as well
