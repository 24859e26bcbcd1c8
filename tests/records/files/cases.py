"""A simulated trial and its text in the forms that trial files have."""

from __future__ import annotations

import numpy as np

import pymc_ship as ps
from pymc_ship.trial.record import rudder_line

NAMES = ("time", "u", "v", "r", "p", "phi", "psi", "x", "y", "delta")


def record(container, duration=40.0):
    """20/20 zigzag at 10 Hz, in SI units, and revolutions of its propeller."""
    run = ps.simulate(container, ps.zigzag(20.0, 20.0), duration=duration, step=0.1, method="rk4")
    run = run.drop_vars([name for name in run.data_vars if name not in NAMES])
    return run.assign(n=("time", 1.5 + 0.01 * np.sin(run["time"].values)))


def columns(trial, names=NAMES):
    """Columns of a trial as arrays that may be changed."""
    return {name: trial[name].values.copy() for name in names}


def written(table, delimiter=",", header=None, cell=repr):
    """Text of a table, with the side of a positive rudder in its last line; cells that are NaN are empty."""
    names = list(table) if header is None else header
    rows = zip(*(values.tolist() for values in table.values()), strict=True)
    lines = [delimiter.join("" if value != value else cell(value) for value in row) for row in rows]
    stated = [rudder_line("port")] if "delta" in table else []
    return "\n".join([delimiter.join(names), *lines, *stated]) + "\n"
