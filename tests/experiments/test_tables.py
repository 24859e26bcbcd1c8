"""Scores, costs and the plan of larger studies."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from pymc_ship.experiments.grid import Cell
from pymc_ship.experiments.tables import Costs, Sizes, bottleneck, cell_row, group_rows, plan_rows, session_rows
from pymc_ship.experiments.task import STAGES


def test_what_could_not_be_computed_counts_as_wrong():
    cell, nan = Cell("s", "m", "white", 0.01, "x"), float("nan")
    scores = {
        "median_error": [1.0, 2.0, nan],
        "coverage": [90.0, 90.0, nan],
        "coverage_half": [50.0, 40.0, nan],
        "tactical_diameter_error": [1.0, nan, nan],
    }
    rows = {name: np.array(values) for name, values in scores.items()}
    row = cell_row(cell, rows | {"status": np.array(["ok", "diverged", "failed"])})
    assert (row["median_error"], row["coverage"], row["tactical_diameter_error"]) == (2.0, 60.0, np.inf)
    assert (row["ok"], row["diverged"], row["failed"]) == (1, 1, 1)
    assert row["coverage_half"] == pytest.approx(30.0)
    without = rows | {"coverage_half": np.full(3, nan), "status": np.array(3 * ["ok"])}
    assert np.isnan(cell_row(cell, without)["coverage_half"])
    assert np.isnan(row["tactical_diameter_error_se"])
    assert row["coverage_se"] == pytest.approx(np.std([90.0, 90.0, 0.0]) / np.sqrt(3), rel=0.15)


def made_up(n, workers=2, seconds=1.0, parent=0.002, wall=None):
    """Costs of n tasks of so many seconds each."""
    parts = dict.fromkeys(STAGES, seconds / len(STAGES)) | {"cpu": 0.9 * seconds}
    clock = {"session": 1, "executor": "dask", "workers": workers}
    step = seconds / workers / 0.8 if wall is None else wall
    rows = [parts | clock | {"wall": (k + 1) * step, "parent": parent} for k in range(n)]
    costs = Costs(STAGES)
    costs.add("x", pa.Table.from_pylist(rows))
    return costs


def test_the_plan_is_computed_from_the_costs():
    costs = made_up(50)
    assert session_rows(costs)[0]["overhead"] == pytest.approx(20.0)
    rows = {row["quantity"]: row["value"] for row in plan_rows(costs, Sizes(1, 5000, 20_000, 3 * 10**8, 0.5))}
    assert rows["processor time"] == pytest.approx(0.9e6 / 3600)
    assert rows["time on 64 cores"] == pytest.approx(1e6 / 0.8 / 64 / 3600)
    assert rows["time on 1024 cores"] == pytest.approx(1e6 * 0.002 / 3600)
    assert rows["workers that one parent can feed"] == pytest.approx(500.0)
    assert rows["storage"] == pytest.approx(100.0)
    assert rows["files"] == pytest.approx(20_000)
    assert rows["tables from the parts"] == pytest.approx(10_000.0)
    assert "Up to about 5e+02 workers the cores are the bottleneck" in bottleneck(costs)
    assert group_rows(costs)[0]["sum"] == pytest.approx(1.0)
