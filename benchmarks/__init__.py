"""Benchmark against named peers: ``make bench``, or ``python -m benchmarks.run`` from the root of the project."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[1]
