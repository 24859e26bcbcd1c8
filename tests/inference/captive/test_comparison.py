"""Forces of captive tests against those of draws."""

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.captive.comparison import captive_bands, captive_figure, comparison_page_table, comparison_rows
from pymc_ship.inference.trajectory.prior import wide_prior
from tests.inference.captive.test_fit import PARTS, program


@pytest.fixture(scope="module")
def found():
    vessel = ps.with_terms(ps.load_vessel("kvlcc2"), PARTS)
    prior, rng = wide_prior([], vessel), np.random.default_rng(3)
    tests = program(vessel, rng, prior.mean).drop_vars("X")
    exact = np.tile(prior.mean, (3, 1))
    return captive_bands(tests, vessel, {"prior alone": prior.draw(200, rng), "identified": exact})


def test_bands_of_the_prior_hold_what_a_typical_ship_measures_and_those_of_one_ship_do_not(found):
    rows = {(row["force"], row["drawn"]): row for row in comparison_rows(found)}
    assert set(rows) == {(force, drawn) for force in ("Y'", "N'") for drawn in ("prior alone", "identified")}
    for force, noise in (("Y'", 1e-4), ("N'", 4e-5)):
        assert rows[force, "prior alone"]["inside"] > 0.9
        assert rows[force, "identified"]["inside"] == 0.0
        assert rows[force, "identified"]["R2"] > 0.99
        assert rows[force, "identified"]["rms"] == pytest.approx(noise, rel=4.0 / np.sqrt(2.0 * 41))


def test_a_page_shows_percentages_of_the_force(found):
    shown, columns = comparison_page_table(comparison_rows(found))
    assert set(columns) <= set(shown[0])
    assert 0.0 < shown[-1]["rms"] < 10.0
    assert shown[0]["inside"] > 90.0


def test_the_figure_has_a_column_for_each_quantity_that_was_varied_alone(found):
    fig = captive_figure(found)
    labels = [ax.get_xlabel() for ax in fig.axes if ax.get_xlabel()]
    assert labels == ["drift angle β [deg]", "yaw rate r'", "rudder δ [deg]"]
    points = [line for line in fig.axes[0].lines if line.get_marker() == "o"]
    np.testing.assert_allclose(points[0].get_xdata(), np.linspace(-20, 20, 9), atol=1e-9)
    assert fig.axes[0].get_ylabel() == "Y' · 10³"
    drift = found["Y"].values[:9]  # the program begins with them
    np.testing.assert_allclose(points[0].get_ydata(), 1e3 * drift[np.argsort(np.arctan2(-found["v"], found["u"])[:9])])
