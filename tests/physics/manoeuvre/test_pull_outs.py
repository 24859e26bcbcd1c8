"""The pull-out: the rudder goes amidships at a heading, and a stable ship stops turning."""

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.manoeuvre.standard import standard_manoeuvre, written_manoeuvre
from pymc_ship.ships.forecasting.steady_turns import spiral_indices
from tests.sentences import refused

STABLE, UNSTABLE = "container", "kvlcc2"


def simulated_pull_out(vessel, heading=90.0, side="starboard", duration=None, **settings):
    vessel = ps.load_vessel(vessel)
    duration = duration or 60.0 * vessel.particulars.ship_time
    return ps.simulate(
        vessel, standard_manoeuvre("pull_out", 20, heading, side=side), duration=duration, step=0.5, **settings
    )


@pytest.mark.parametrize("side", ["port", "starboard"])
def test_an_unstable_ship_goes_on_turning_and_a_stable_one_does_not(side):
    stable, unstable = (ps.indices(simulated_pull_out(name, side=side)) for name in (STABLE, UNSTABLE))
    assert abs(float(stable["residual_yaw_rate"])) < 0.15 * float(stable["rate_before"])
    assert float(unstable["residual_yaw_rate"]) > 0.3 * float(unstable["rate_before"])


def test_the_residual_rate_is_that_of_the_spiral():
    vessel = ps.load_vessel(UNSTABLE)
    spiral = spiral_indices(ps.steady_turns(vessel))
    left = float(ps.indices(simulated_pull_out(UNSTABLE))["residual_yaw_rate"])
    assert left == pytest.approx(float(np.abs(spiral["residual_rate_starboard"][0])), rel=0.1)


def test_times_count_from_the_order():
    run = simulated_pull_out(STABLE)
    measured = ps.indices(run)
    psi, r = np.abs(np.rad2deg(run["psi"].values)), np.abs(np.rad2deg(run["r"].values))
    begin = float(np.interp(90.0, psi[: psi.argmax()], run["time"].values[: psi.argmax()]))
    half = begin + float(measured["time_to_half_rate"])
    assert float(np.interp(half, run["time"], r)) == pytest.approx(0.5 * float(measured["rate_before"]), rel=0.02)


@pytest.mark.parametrize("heading", [70, 90, 110])
@pytest.mark.parametrize("vessel", [STABLE, UNSTABLE])
def test_a_noisy_record_is_recognised(vessel, heading):
    run = ps.pollute(simulated_pull_out(vessel, heading), level=0.01, rng=np.random.default_rng(1))
    (recognised,), _ = ps.recognise([run], ps.load_vessel(vessel))
    assert recognised.kind == "pull_out"
    assert (recognised.rudder_deg, recognised.side) == (20.0, "starboard")
    assert recognised.heading_deg == pytest.approx(heading, abs=5.0)


def test_a_turn_of_a_round_that_ends_so_is_a_turning_circle():
    run = simulated_pull_out(STABLE, 400)
    (recognised,), _ = ps.recognise([run], ps.load_vessel(STABLE))
    assert recognised.kind == "turning_circle"


def test_it_has_words_and_a_wide_heading_that_a_zigzag_does_not():
    assert written_manoeuvre("pull out 20/270 port").heading_deg == 270.0
    with refused(ps.SimulationError, 0, 720, 800):
        standard_manoeuvre("pull_out", 20, 800)
    with refused(ps.SimulationError, 0, 90, 100):
        ps.zigzag(20, 100)
