"""Subsection of the page on the ships that prior and posterior hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.diagnostics import subsections
from pymc_ship.diagnostics.regression import data_of, prior_of
from pymc_ship.diagnostics.regression_subsections import _ships as of_regression
from pymc_ship.diagnostics.trajectory import prior_of as trajectory_prior
from pymc_ship.diagnostics.trajectory_subsections import _ships as of_trajectories
from pymc_ship.ships.forecasting.prior_ships import index_row, status_row
from tests.diagnostics.cases import hull, short_posterior, without

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(subsections, "SHIPS", 40)


@pytest.fixture(scope="module")
def sway(container, zigzag_trial):
    """Posterior of the sway coefficients from a clean record by its own integrator, which is exact."""
    data = ps.regression_data(zigzag_trial, container, "sway", interval=1.0, derivative="weak_euler")
    prior = ps.ConjugatePrior(kappa=1e4, shape=2.0, scale=1e-6)
    return ps.exact_posterior(data, prior, draws=800, rng=np.random.default_rng(7))


def rng():
    return np.random.default_rng(5)


def cells(part, which):
    """Table of a subsection as rows by head."""
    found = part.tables[which][0]
    return [dict(zip(found.heads, row, strict=True)) for row in found.cells]


def test_a_regression_shows_ships_of_its_prior_beside_those_of_its_posterior(sway, container):
    """The prior of one DOF alone is so wide that most of its ships run away; the posterior is at the reference."""
    part = of_regression(sway, container, rng())
    percentages = cells(part, 0)
    prior, posterior = (next(row for row in percentages if row["ships of the"] == of) for of in ("prior", "posterior"))
    drawn = ps.prior_ships(
        container, {"sway": (data_of(sway), prior_of(sway))}, ps.zigzag(10, 10), draws=400, rng=rng()
    )
    expected = 100.0 * drawn.attrs["diverged_fraction"]
    assert float(prior["diverged %"]) == pytest.approx(expected, abs=4.0 * 100.0 * np.sqrt(0.25 / 40 + 0.25 / 400))
    assert expected > 50.0
    assert posterior["diverged %"] == posterior["wrong way %"] == "0.0"
    assert [row["manoeuvre"] for row in percentages[::2]] == ["zigzag 10/10 port", "turning circle 35 port"]
    assert "Surge, yaw, roll keep the reference values of the vessel." in part.text
    bands = cells(part, 1)
    assert [row["index"] for row in bands] == [
        "first overshoot angle [deg]",
        "second overshoot angle [deg]",
        "advance [L]",
        "tactical diameter [L]",
    ]
    reference = ps.simulate(container, ps.turning_circle(35), duration=700.0, step=0.1, method="rk4")
    advance = float(ps.indices(reference)["advance"]) / container.particulars.L
    median, low, _, high = bands[2]["posterior"].replace("(", "").replace(")", "").split()
    assert float(low) <= float(median) <= float(high)
    assert float(median) == pytest.approx(advance, rel=0.01)


def test_the_prior_group_of_a_tree_goes_before_what_it_records(sway, container):
    """A tree of which the group prior holds the posterior's draws has the same ships on both sides."""
    own = sway.assign({"prior": sway["posterior"].copy()})
    percentages = cells(of_regression(own, container, rng()), 0)
    assert {row["none of these %"] for row in percentages} == {"100.0"}


def test_why_no_ships_are_shown_is_said(good, container):
    assert of_regression(good, None, rng()).text.startswith("Not shown: the simulation needs a vessel")
    bare = replace(container, forces=container.forces | {"roll": ()})
    assert of_regression(good, bare, rng()).text.startswith(
        "Not shown: The model of 'container' needs coefficients of roll"
    )
    assert of_regression(without(good, "observed_data"), container, rng()).text == (
        "Not shown: the tree has no observed_data/response."
    )
    flat = of_trajectories(short_posterior("flat"), hull(), rng())
    assert (flat.text, flat.tables) == ("Not shown: a coefficient with a flat prior has no draws.", [])


def test_trajectories_have_the_prior_with_its_factors():
    tree = short_posterior()
    prior = trajectory_prior(tree)
    np.testing.assert_array_equal(prior.scale, tree["constant_data"]["prior_sd"])
    part = of_trajectories(tree, hull(), rng())
    drawn = ps.prior_ships(hull(), prior, ps.zigzag(10, 10), draws=400, rng=rng())
    shown = float(cells(part, 0)[0]["course-unstable %"])
    assert shown == pytest.approx(
        100.0 * drawn.attrs["course_unstable_fraction"], abs=4.0 * 100.0 * np.sqrt(0.25 / 40 + 0.25 / 400)
    )
    assert part.text.endswith("The records chose the factors of its scales.")
    assert "reference values" not in part.text


def test_rows_are_shares_in_percent_and_bands_over_the_ships_that_reach(container):
    prior = ps.coefficient_prior(
        [ps.simulate(container, ps.zigzag(20, 20), duration=200, step=0.1, method="rk4")], container
    )
    ships = ps.prior_ships(container, prior, ps.turning_circle(35), draws=60, rng=rng())
    row, L = status_row(ships), container.particulars.L
    assert (row["manoeuvre"], row["ships"]) == ("turning circle 35 port", 60)
    assert row["diverged"] == pytest.approx(100.0 * ships["diverged"].mean())
    values = ships["advance"].values[np.isfinite(ships["advance"].values)] / L
    found = index_row(ships, "advance", L, ci_prob=0.8)
    assert 0 < values.size < 60
    assert [found[name] for name in ("lower", "median", "upper")] == pytest.approx(np.quantile(values, [0.1, 0.5, 0.9]))
    assert (found["unit"], found["reached"]) == ("L", pytest.approx(100.0 * values.size / 60))
    none = index_row(ships.isel(draw=~np.isfinite(ships["advance"].values)), "advance", L, ci_prob=0.8)
    assert np.isnan(none["median"])
    assert none["reached"] == 0.0
