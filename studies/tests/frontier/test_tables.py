"""Aims, ratios and the best differencing, of measurements that are made up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pymc_ship.replication.scores import statistic_and_error
from studies.frontier import measure as frontier
from studies.frontier import tables
from studies.frontier.tables import DIFFERENCES, Aim, aim_rows, best_differencing, over_seeds

Measurement = frontier.Measurement


def made_up(estimator, values, cell="white", level=0.01):
    return [Measurement(cell, level, k, estimator, {"x": x}, np.full(2, x)) for k, x in enumerate(values)]


@pytest.mark.parametrize(
    ("value", "verdict"), [(1.0, "yes"), (2.0, "yes"), (2.1, "no"), (np.inf, "no"), (np.nan, "no")]
)
def test_an_aim_is_met_within_its_limits_alone(monkeypatch, value, verdict):
    aim = Aim("x", "%", "white", ("fit",), "x", "median", limits={0.01: (1.0, 2.0)})
    monkeypatch.setattr(tables, "AIMS", (aim,))
    (row,) = aim_rows(made_up("fit", [value] * 3))
    assert row["met"] == verdict


def test_the_ratio_is_that_of_the_medians():
    found = made_up("a", [10.0, 20.0, 90.0]) + made_up("b", [4.0, 1.0, 5.0])
    assert statistic_and_error(over_seeds(found, "white", 0.01, ("a", "b"), "x"), "ratio")[0] == 5.0


def test_the_best_differencing_has_the_smallest_median():
    found = [
        replace(one, values={"median_error": one.values["x"]})
        for k, name in enumerate(DIFFERENCES)
        for one in made_up(name, [5.0 - k, 50.0, 5.0 - k])
    ]
    assert best_differencing(found, 0.01) == list(DIFFERENCES)[-1]
