"""A ship of parts on the way of a PyMC user: posterior, forecast, report and model of its trajectory."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from tests.physics.forces.test_parts import AHEAD, tanker
from tests.ships.ensemble.cases import posterior_forecast

pytestmark = [
    pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning"),  # of ArviZ in the tail of a Pareto law
    pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning"),
]


@pytest.fixture(scope="module")
def trial():
    run = ps.simulate(tanker(AHEAD), ps.zigzag(20, 20), duration=400, step=0.5, method="rk4")
    return ps.pollute(run, level=0.01, rng=np.random.default_rng(4))


@pytest.fixture(scope="module")
def posterior(trial):
    return ps.trajectory_posterior(trial, tanker(AHEAD), draws=400, rng=1)


def test_every_parameter_is_in_the_posterior_and_narrower_than_its_prior(posterior):
    vessel = tanker(AHEAD)
    draws = posterior["posterior"]["coefficients"]
    assert draws["coefficient"].values.tolist() == coefficient_names(vessel)
    z = (draws.mean(("chain", "draw")).values - reference_coefficients(vessel)) / draws.std(("chain", "draw")).values
    assert np.abs(z).max() < 4.0
    prior = np.array([parameter.sd for parameter in vessel.parameters])
    ratio = dict(zip(coefficient_names(vessel), draws.std(("chain", "draw")).values / prior, strict=True))
    assert max(ratio.values()) < 1.2
    assert ratio["N_P"] < 0.3 < 0.8 < ratio["T_nn"]


def test_its_turn_is_forecast(posterior):
    vessel, turn = tanker(AHEAD), ps.turning_circle(35)
    bands = posterior_forecast(vessel, posterior, turn, draws=60, duration=1200, step=0.5, rng=1)["index_bands"]
    exact = float(ps.indices(ps.simulate(vessel, turn, duration=1200, step=0.5))["tactical_diameter"])
    lower, _, upper = bands["tactical_diameter"].values
    assert lower < exact < upper


@pytest.mark.usefixtures("undrawn")
def test_its_posterior_is_diagnosed(posterior, tmp_path):
    text = ps.diagnostic_report({"tanker": posterior}, tmp_path, tanker(AHEAD)).read_text(encoding="utf-8")
    assert "Parts, parameters times 1e5" in text
    for name in ("gamma_R", "kappa", "f2"):
        assert f"<td>{name}</td>" in text


@pytest.mark.slow
def test_its_trajectory_is_a_pymc_model(trial):
    model = ps.trajectory_model(trial, tanker(AHEAD))
    point = model.initial_point()
    slope = model.compile_dlogp(mode="FAST_COMPILE")(point)
    (name,) = (variable.name for variable in model.free_RVs)
    logp, step = model.compile_logp(mode="FAST_COMPILE"), np.zeros_like(point[name])
    for k in (0, 5, 20):
        step[:] = 0.0
        step[k] = 1e-4
        difference = (logp({name: point[name] + step}) - logp({name: point[name] - step})) / 2e-4
        assert slope[k] == pytest.approx(difference, rel=1e-3, abs=1e-2)
