"""Runs of small studies, and what their folders hold."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq

from pymc_ship.experiments import run as engine
from tests.experiments.cases import trivial

ROOT = Path(__file__).parents[2]
PATH = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
TABLES = ("results.parquet", "cells.csv")


def changed(study, *pairs):
    """Another study beside one, with parts of its text replaced."""
    text = study.read_text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = study.with_name(f"{abs(hash(text))}.toml")
    path.write_text(text)
    return path


def run(study, out, work=trivial, **settings):
    return engine.reported_montecarlo(study, out, work=work, **({"workers": 1} | settings))


def tables(out):
    return {name: (out / name).read_bytes() for name in TABLES}


def timings(out):
    return pd.read_parquet(out / "timings.parquet")


def kept(out):
    """Method, level and seed of every result in parts and journals."""
    parts = out / "parts"
    found = set()
    for path in parts.glob("*/*/*/*/[!.]*/[!.]*.parquet"):  # not what is being written
        found |= {(path.parent.name, path.parent.parent.name, k) for k in pq.read_table(path)["seed"].to_pylist()}
    for path in parts.rglob("_*.jsonl"):
        lines = path.read_bytes().split(b"\n")[:-1] if path.exists() else []
        found |= {(path.parent.name, path.parent.parent.name, json.loads(line)["seed"]) for line in lines}
    return found
