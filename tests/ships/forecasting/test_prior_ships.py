"""Draws of a prior: status, source of the draws, errors."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.sampling.predictive import prior_draws
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients

QUICK = {"step": 0.1, "method": "rk4", "record_interval": 0.5}
ZIGZAG = ps.zigzag(10, 10)


def drawn(vessel, rows):
    """Tree whose group prior has the given draws."""
    names = coefficient_names(vessel)
    group = xr.Dataset({"coefficients": (("chain", "draw", "coefficient"), rows[None])}, {"coefficient": names})
    return xr.DataTree.from_dict({"prior": group})


def rows_of(vessel, *changes):
    """Reference coefficients, and copies in which those with one of some names are multiplied."""
    names, rows = np.array(coefficient_names(vessel)), [reference_coefficients(vessel)]
    for factors in changes:
        row = rows[0].copy()
        for name, factor in factors.items():
            row[names == name] *= factor
        rows.append(row)
    return np.stack(rows)


def against_the_rudder(vessel):
    """Changes of sign of all terms with the rudder angle."""
    return {name: -1.0 for name in coefficient_names(vessel) if "delta" in name}


def ships(vessel, prior, manoeuvre=ZIGZAG, seed=1, **settings):
    return ps.prior_ships(vessel, prior, manoeuvre, rng=np.random.default_rng(seed), **(QUICK | settings))


@pytest.mark.parametrize("manoeuvre", [ZIGZAG, ps.zigzag(20, 20, side="starboard"), ps.turning_circle(35)])
def test_each_draw_has_the_status_of_its_coefficients(container, manoeuvre):
    """Reference coefficients, reversed rudder, unstable yaw by drift, and a surge that accelerates."""
    rows = rows_of(container, against_the_rudder(container), {"Nv": 2.0}, {"Xu": -500.0})
    result = ships(container, drawn(container, rows), manoeuvre, draws=4)
    order = [int(np.flatnonzero((result["coefficients"].values == row).all(axis=1))[0]) for row in rows]
    ended = result.isel(draw=order)
    assert ended["status"].values.tolist() == ["complete", "wrong way", "course-unstable", "diverged"]
    assert ended["wrong_way"].values.tolist()[:3] == [False, True, False]
    assert ended["course_unstable"].values.tolist() == [False, False, True, False]
    assert ended["diverged"].values.tolist() == [False, False, False, True]
    np.testing.assert_array_equal(ended["growth_rate"] > 0.0, ended["course_unstable"])
    outcomes = {
        name: result.attrs[f"{name}_fraction"] for name in ("diverged", "wrong_way", "course_unstable", "complete")
    }
    assert outcomes == dict.fromkeys(outcomes, 0.25)
    assert result.attrs["summary"] == (
        f"Of 4 draws of the prior in a {manoeuvre.label}: 25 % diverge, 25 % turn the wrong way, 25 % are "
        "course-unstable; 25 % do none of this."
    )


def test_a_ship_of_a_small_zigzag_has_turned_at_its_heading(container):
    """The later swing beyond 10 deg to the other side is the second overshoot."""
    right, wrong = rows_of(container, against_the_rudder(container))
    rows = np.stack([right, wrong])
    result = ships(container, drawn(container, rows), ps.zigzag(20, 5), draws=2)
    assert result["second_overshoot_angle"].max() > 5.0
    assert sorted(result["wrong_way"].values.tolist()) == [False, True]


def test_without_rudder_no_draw_turns_the_wrong_way(container):
    result = ships(
        container, drawn(container, rows_of(container, {"Y0": 3.0})), ps.rudder_programme([0.0], [0.0]), draws=2
    )
    assert not result["wrong_way"].any()
    assert "first_overshoot_angle" not in result


def test_the_indices_are_those_of_the_drawn_ships(container):
    result = ships(container, drawn(container, rows_of(container, {"Nr": 1.1})), draws=2, duration=300.0)
    runs = ps.simulate(container, ZIGZAG, duration=300.0, coefficients=result["coefficients"].values, **QUICK)
    expected = ps.indices(runs)
    assert set(expected.data_vars) <= set(result.data_vars)
    for name, values in expected.data_vars.items():
        np.testing.assert_array_equal(result[name], values)
    assert np.isfinite(result["first_overshoot_angle"]).all()


def test_it_lasts_as_long_as_a_forecast_of_its_kind(container):
    """40 L/U; within 5 L/U there is no second overshoot."""
    prior, unit = drawn(container, rows_of(container, {"Nr": 1.1})), container.particulars.ship_time
    long, short = (ships(container, prior, draws=2, duration=duration) for duration in (None, 5.0 * unit))
    assert np.isfinite(long["second_overshoot_angle"]).all()
    assert np.isnan(short["second_overshoot_angle"]).all()


# whose draws ----------------------------------------------------------------------------------------------------------


def test_a_prior_of_coefficients_is_drawn_with_its_mean_and_scale(container, zigzag_trial):
    prior = ps.coefficient_prior([zigzag_trial], container, "sister_ship", relative_sd=0.05).fixed
    rows = prior.draw(4000, np.random.default_rng(2))
    score = (rows - prior.mean) / prior.scale
    assert np.abs(score.mean(axis=0)).max() < 4.5 / np.sqrt(4000)
    assert np.abs(score.std(axis=0) - 1.0).max() < 4.5 / np.sqrt(8000)
    result = ships(container, prior, draws=20, duration=100.0, seed=3)
    np.testing.assert_array_equal(result["coefficients"], prior.draw(20, np.random.default_rng(3)))
    assert result.attrs["fixed_dofs"] == ""


def test_regression_priors_are_drawn_on_the_columns_of_their_data(container, zigzag_trial):
    data = {dof: ps.regression_data(zigzag_trial, container, dof, interval=1.0) for dof in ("sway", "yaw")}
    prior = ps.SemiConjugatePrior(kappa=0.01)
    result = ships(container, {dof: (one, prior) for dof, one in data.items()}, draws=50, duration=100.0)
    expected = prior_draws(data["sway"], prior, 50, rng=np.random.default_rng(1))["coefficients"].values[0]
    sway = result["coefficients"].sel(coefficient=list(data["sway"].coefficients)).values
    np.testing.assert_array_equal(np.sort(sway, axis=0), np.sort(expected, axis=0))
    roll = result["coefficients"].sel(coefficient=container.coefficients("roll")["coefficient"].values)
    np.testing.assert_array_equal(roll, np.tile(container.coefficients("roll").values, (50, 1)))
    assert result.attrs["fixed_dofs"] == "surge roll"
    assert "in a zigzag 10/10 port, surge, roll at reference values: " in result.attrs["summary"]


def test_a_tree_gives_the_draws_of_its_group_prior(container, zigzag_trial):
    data, prior, rng = ps.regression_data(zigzag_trial, container, "yaw", interval=1.0), ps.ConjugatePrior(), 5
    tree = ps.exact_posterior(data, prior, draws=40, rng=np.random.default_rng(rng))
    tree = ps.with_predictive(tree, data, prior, rng=np.random.default_rng(rng), draws=30)
    result = ships(container, {"yaw": tree}, draws=30, duration=100.0)
    names = list(data.coefficients)
    given = tree["prior"]["coefficients"].values[0]
    np.testing.assert_array_equal(
        np.sort(result["coefficients"].sel(coefficient=names).values, axis=0), np.sort(given, axis=0)
    )


# refusals -------------------------------------------------------------------------------------------------------------
