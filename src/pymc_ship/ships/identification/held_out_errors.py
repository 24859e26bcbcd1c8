"""Errors of the indices of held-out manoeuvres, and how often their intervals cover the measurement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from pymc_ship.ships.ensemble.index_error import index_sd, model_error
from pymc_ship.ships.ensemble.index_table import index_rows

OVERSHOOTS = ("first_overshoot", "second_overshoot")
"""Overshoots whose angles and times are summarised."""

QUANTILES = {"90": 1.6448536269514722, "95": 1.959963984540054}
"""Half the width of a normal interval in sd, by its probability in %."""


def overshoot_errors(rows: Sequence[Mapping]) -> dict[str, float]:
    """Mean and largest absolute error of the overshoot angles [deg], median relative error of the times [%].

    Parameters
    ----------
    rows : sequence of dict
        From :func:`pymc_ship.ships.identification.held_out.forecast_rows`.

    Returns
    -------
    dict of str to float
        ``first_overshoot_angle_mean``, ..., ``overshoot_time_median``; NaN where no row has the index.
    """

    def errors(name: str) -> np.ndarray:
        return np.array([abs(row["forecast"] - row["measured"]) for row in rows if row["index"] == name])

    found = {}
    for name in OVERSHOOTS:
        angle = errors(f"{name}_angle")
        found[f"{name}_angle_mean"] = float(angle.mean()) if angle.size else np.nan
        found[f"{name}_angle_max"] = float(angle.max()) if angle.size else np.nan
    times = [f"{name}_time" for name in OVERSHOOTS]
    relative = [abs(row["forecast"] / row["measured"] - 1.0) for row in rows if row["index"] in times]
    found["overshoot_time_median"] = 100.0 * float(np.median(relative)) if relative else np.nan
    return found


def index_error_rows(table: xr.Dataset) -> list[dict]:
    """Indices of held-out manoeuvres with their errors, and how far the intervals owe to the run itself.

    Parameters
    ----------
    table : Dataset, dims (run, index)
        ``held_out_indices`` of a :class:`pymc_ship.ships.identification.model.ShipIdentification`.

    Returns
    -------
    list of dict
        With ``error`` and ``z``, and ``leave_one_out_sd``: the sd whose model error comes from the other runs alone.
    """
    rows, known = [], list(index_rows(table))
    for row in known:
        others = model_error([other for other in known if other["run"] != row["run"]])
        error = row["forecast"] - row["measured"]
        found = dict(row) | {"error": error, "z": error / row["sd"]}
        rows.append(found | {"leave_one_out_sd": index_sd(row, others)})
    return rows


def coverage(rows: Sequence[Mapping]) -> dict[str, int]:
    """Number of 90 and 95 % intervals that cover; ``_leave_one_out``: with the model error of the other runs alone."""
    found = {}
    for share, z in QUANTILES.items():
        found[share] = sum(abs(row["z"]) <= z for row in rows)
        found[f"{share}_leave_one_out"] = sum(abs(row["error"]) <= z * row["leave_one_out_sd"] for row in rows)
    return found
