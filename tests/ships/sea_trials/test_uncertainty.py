"""The uncertainty of corrected indices from its parts."""

import numpy as np
import pytest

from pymc_ship.ships.sea_trials.uncertainty import COMPONENTS, conformity, uncertainty_budget

RNG = np.random.default_rng(7)


def row(value, *sds, manoeuvre="zigzag 10/10 port", limit=np.nan):
    parts = {name: sd * RNG.standard_normal(4000) for name, sd in zip(COMPONENTS, sds, strict=True)}
    return {"manoeuvre": manoeuvre, "index": "first_overshoot_angle", "corrected": value, "limit": limit} | parts


def test_parts_add_up_as_squares_and_the_interval_is_that_of_their_sum():
    (budget,) = uncertainty_budget([row(10.0, 0.3, 0.4, 1.2)], np.random.default_rng(1))
    assert budget["u_c"] == pytest.approx(1.3, rel=0.03)
    assert budget["U"] == 2.0 * budget["u_c"]
    assert budget["upper"] - budget["lower"] == pytest.approx(2.0 * 1.96 * 1.3, rel=0.06)
    assert (budget["runs"], np.isnan(budget["u_runs"])) == (1, True)


def test_runs_of_one_manoeuvre_scatter_and_those_of_another_do_not_count():
    rows = [row(10.0, 0.1, 0.0, 0.0), row(12.0, 0.1, 0.0, 0.0), row(30.0, 0.1, 0.0, 0.0, manoeuvre="other")]
    first, second, other = uncertainty_budget(rows, np.random.default_rng(1))
    assert first["u_runs"] == second["u_runs"] == pytest.approx(np.sqrt(2.0))
    assert first["u_c"] == pytest.approx(np.hypot(0.1, np.sqrt(2.0)), rel=0.01)
    assert first["upper"] - first["lower"] == pytest.approx(2.0 * 1.96 * np.sqrt(2.0), rel=0.06)
    assert (first["runs"], other["runs"]) == (2, 1)
    assert other["u_c"] == pytest.approx(0.1, rel=0.05)


def test_an_unknown_part_leaves_no_uncertainty():
    (budget,) = uncertainty_budget([row(10.0, np.nan, 0.0, 0.1, limit=12.0)], np.random.default_rng(1))
    assert np.isnan([budget["u_record"], budget["u_c"], budget["U"], budget["lower"]]).all()
    assert budget["conformity"] == "met as measured"


@pytest.mark.parametrize(("fraction", "word"), [(0.96, "met"), (0.5, "open"), (0.04, "not met")])
def test_conformity_is_that_of_the_draws(fraction, word):
    drawn = np.where(np.arange(1000) < 1000 * fraction, 4.0, 6.0)
    assert conformity(5.0, drawn, 5.0) == word
    assert conformity(5.0, drawn, np.nan) == ""
