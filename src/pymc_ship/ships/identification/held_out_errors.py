"""Errors of the indices of held-out manoeuvres, and how often their intervals cover the measurement."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from pymc_ship.ships.ensemble.index_error import index_sd, model_error
from pymc_ship.ships.ensemble.index_table import index_rows
from pymc_ship.ships.ensemble.ship import Ship

OVERSHOOTS = ("first_overshoot", "second_overshoot")  # overshoots whose angles and times are summarised

QUANTILES = {"90": 1.6448536269514722, "95": 1.959963984540054}
"""Normal quantiles of central intervals, by probability [%]."""


def overshoot_errors(rows: Sequence[Mapping]) -> dict[str, float]:
    """Mean and largest absolute error of the overshoot angles [deg], median relative error of the times [%].

    Keys ``first_overshoot_angle_mean``, ..., ``overshoot_time_median``; NaN where no row has the index.
    """

    def errors(name: str) -> np.ndarray:
        return np.array([abs(row["forecast"] - row["measured"]) for row in rows if row["index"] == name])

    summary = {}
    for name in OVERSHOOTS:
        angle = errors(f"{name}_angle")
        summary[f"{name}_angle_mean"] = float(angle.mean()) if angle.size else np.nan
        summary[f"{name}_angle_max"] = float(angle.max()) if angle.size else np.nan
    times = [f"{name}_time" for name in OVERSHOOTS]
    relative = [abs(row["forecast"] / row["measured"] - 1.0) for row in rows if row["index"] in times]
    summary["overshoot_time_median"] = 100.0 * float(np.median(relative)) if relative else np.nan
    return summary


def index_error_rows(table: xr.Dataset, motion: Mapping[str, np.ndarray] | None = None) -> list[dict]:
    """Held-out indices, dims (run, index), as rows with ``error``, ``z`` and ``leave_one_out_sd``.

    The last one is the sd with the model error of the other runs alone, and the ``motion`` of :func:`.motion_error`.
    """
    rows, indices = [], list(index_rows(table))
    for row in indices:
        others = model_error([other for other in indices if other["run"] != row["run"]], motion)
        error = row["forecast"] - row["measured"]
        with_error = dict(row) | {"error": error, "z": error / row["sd"]}
        rows.append(with_error | {"leave_one_out_sd": index_sd(row, others)})
    return rows


def harder_index_rows(ship: Ship) -> list[dict]:
    """Indices of the harder runs, forecast by the milder ones, with ``error``, its ``sd`` and ``z``."""
    rows = []
    for row in index_rows(ship.harder_indices):
        sd = index_sd(row, ship.index_error or {}, ship.extrapolation_growth)
        error = row["forecast"] - row["measured"]
        rows.append(row | {"error": error, "sd": sd, "z": error / sd})
    return rows


def coverage(rows: Sequence[Mapping]) -> dict[str, int]:
    """Number of 90 and 95 % intervals that cover; ``_leave_one_out``: with the model error of the other runs alone."""
    counts = {}
    for probability, z in QUANTILES.items():
        counts[probability] = sum(abs(row["z"]) <= z for row in rows)
        counts[f"{probability}_leave_one_out"] = sum(abs(row["error"]) <= z * row["leave_one_out_sd"] for row in rows)
    return counts
