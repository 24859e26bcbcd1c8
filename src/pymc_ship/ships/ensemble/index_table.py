"""Dataset of measured and forecast indices of recorded manoeuvres, runs x indices, with the parts of the error."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import xarray as xr

from pymc_ship.physics.manoeuvre.kinds import UNITS
from pymc_ship.physics.manoeuvre.registry import KINDS

_SDS = ("parameter_sd", "model_sd", "measured_sd")
VARIABLES = ("measured", "forecast", *_SDS, "scale", "beyond", "sd", "lower", "upper")
"""Variables of the table; ``scale`` is the unit of the model error, ``beyond`` the distance from the milder runs, and
``lower`` to ``upper`` the interval of 95 % of the forecast."""


def index_table(rows: Sequence[Mapping]) -> xr.Dataset:
    """Table of indices, dims (run, index), from rows.

    Rows have ``run``, ``manoeuvre``, ``index``, ``kind`` and any of :data:`VARIABLES`. NaN for an index that a run does
    not have; coordinates ``manoeuvre`` (run), ``quantity`` and ``units`` (index).
    """
    runs: list[dict[str, Mapping]] = []
    for row in rows:
        if not runs or row["index"] in runs[-1] or next(iter(runs[-1].values()))["run"] != row["run"]:
            runs.append({})
        runs[-1][row["index"]] = row
    quantity = {row["index"]: row["kind"] for row in rows}
    order: list[str] = []  # by kind of manoeuvre; an index of several kinds is listed with the last
    for kind in KINDS.values():
        order = [name for name in order if name not in kind.scored] + list(kind.scored)
    known = [name for name in order if name in quantity]
    names = [*known, *(name for name in quantity if name not in known)]
    firsts = [next(iter(run.values())) for run in runs]
    variables = [name for name in VARIABLES if not rows or name in rows[0]]
    values = {
        name: (("run", "index"), np.array([[run.get(index, {}).get(name, np.nan) for index in names] for run in runs]))
        for name in variables
    }
    coords = {
        "run": [row["run"] for row in firsts],
        "manoeuvre": ("run", [row["manoeuvre"] for row in firsts]),
        "index": names,
        "quantity": ("index", [quantity[name] for name in names]),
        "units": ("index", [UNITS[quantity[name]] for name in names]),
    }
    empty = (("run", "index"), np.empty((0, 0)))
    return xr.Dataset(values if rows else dict.fromkeys(variables, empty), coords)


def index_rows(table: xr.Dataset) -> Iterator[dict]:
    """Rows of :func:`index_table`, run after run."""
    heads = {name: table[name].values.tolist() for name in ("run", "manoeuvre", "index", "quantity")}
    numbers = {name: table[name].values for name in VARIABLES if name in table}
    for k, j in np.argwhere(np.isfinite(numbers["measured"])):
        row = {"run": heads["run"][k], "manoeuvre": heads["manoeuvre"][k]}
        row |= {"index": heads["index"][j], "kind": heads["quantity"][j]}
        yield row | {name: float(values[k, j]) for name, values in numbers.items()}
