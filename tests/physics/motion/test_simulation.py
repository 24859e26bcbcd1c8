from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, solve_ivp

import pymc_ship as ps
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.trial.record import check_trial
from tests.physics.motion import plain_hull

CHANNELS = ("u", "v", "r", "p", "phi", "psi", "x", "y", "delta")
ODD = ("v", "r", "p", "phi", "psi", "y", "delta")
"""Channels that change sign when starboard and port change places."""
RAMP = ps.rudder_programme([0.0, 100.0], [0.0, 0.5], rate_limited=False)
"""A rudder that moves steadily: no kink that would spoil the order of an integrator."""


def only(vessel, wanted):
    """Copy of a vessel with the coefficients of the terms that are not wanted set to zero."""
    return vessel.with_coefficients(
        {
            dof: [
                float(value) if wanted(dof, term) else 0.0
                for term, value in zip(vessel.terms(dof), vessel.coefficients(dof).values, strict=True)
            ]
            for dof in vessel.dofs
        }
    )


@pytest.fixture(scope="module")
def symmetric(container):
    """The container ship with port and starboard alike: forces and moments odd in v, r, p, phi, delta, surge even."""
    return only(container, lambda dof, term: plain_hull.is_odd(term) == (dof != "surge"))


@pytest.fixture(scope="module")
def smooth(container):
    """The container ship without absolute values, whose kinks would spoil the order of an integrator."""
    return only(container, lambda dof, term: "|" not in term)


@pytest.fixture(scope="module")
def draws(container):
    """33 parameter vectors around the reference."""
    reference = np.concatenate([container.coefficients(dof) for dof in container.dofs])
    return reference * (1.0 + 0.03 * np.random.default_rng(4).standard_normal((33, reference.size)))


@pytest.fixture(scope="module")
def one_by_one(container, draws):
    runs = [
        ps.simulate(container, ps.zigzag(20, 20), duration=60.0, step=0.05, coefficients=draw[None]) for draw in draws
    ]
    return {name: np.concatenate([run[name].values for run in runs]) for name in CHANNELS}


@pytest.fixture(scope="module")
def smooth_run(container):
    """A run under Runge-Kutta steps along a rudder that is linear between the samples."""
    programme = ps.rudder_programme([0.0, 20.0, 45.0, 60.0], [0.0, 0.4, -0.3, 0.1], rate_limited=False)
    return ps.simulate(container, programme, duration=80.0, step=0.1, method="rk4")


def state_at_end(vessel, step, method, duration=60.0):
    run = ps.simulate(vessel, RAMP, duration=duration + step, step=step, method=method)
    assert run["time"].values[-1] == pytest.approx(duration)
    return np.array([float(run[name][-1]) for name in CHANNELS[:-1]])


class TestIntegrators:
    @pytest.mark.parametrize(
        ("method", "order", "steps"), [("euler", 1, (0.1, 0.05, 0.025)), ("rk4", 4, (0.2, 0.1, 0.05))]
    )
    def test_order(self, smooth, method, order, steps):
        """Halving the step divides the error by 2 to the order."""
        exact = state_at_end(smooth, 0.01, "rk4")
        errors = [np.linalg.norm((state_at_end(smooth, step, method) - exact) / np.abs(exact)) for step in steps]
        slopes = [np.log2(coarse / fine) for coarse, fine in pairwise(errors)]
        np.testing.assert_allclose(slopes, order, atol=0.1)

    def test_a_run_agrees_with_an_independent_hull_under_dop853(self, container):
        run = ps.simulate(container, RAMP, duration=80.0, step=0.05, record_interval=1.0, method="rk4")
        start = [12.7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        peer = solve_ivp(
            lambda t, state: plain_hull.rate(state, 0.005 * t),
            (0.0, 80.0),
            start,
            "DOP853",
            t_eval=run["time"].values,
            rtol=1e-10,
            atol=1e-12,
        )
        for name, expected in zip(CHANNELS, peer.y, strict=False):
            np.testing.assert_allclose(run[name], expected, rtol=0.0, atol=1e-6 * np.abs(expected).max(), err_msg=name)

    def test_euler_steps_are_the_equations_to_the_last_digits(self, zigzag_trial):
        """Each step adds 0.02 s times the plain equations' rate."""
        states = np.array([zigzag_trial[name].values for name in CHANNELS])
        for k in range(0, 19_999, 1999):
            expected = states[:8, k] + 0.02 * np.array(plain_hull.rate(states[:8, k], states[8, k]))
            np.testing.assert_allclose(states[:8, k + 1], expected, rtol=1e-14, atol=1e-16)

    def test_runs_start_on_a_straight_course_at_the_approach_speed(self, container):
        for speed, expected in ((None, 12.7), (9.0, 9.0)):
            run = ps.simulate(container, ps.zigzag(20, 20, approach_speed=speed), duration=1.0)
            assert [float(run[name][0]) for name in CHANNELS] == [expected, 0, 0, 0, 0, 0, 0, 0, 0]
            assert run.attrs["approach_speed"] == expected


class TestInvariants:
    @pytest.mark.parametrize("method", ["euler", "rk4"])
    @pytest.mark.parametrize(
        "constructor", [lambda side: ps.zigzag(20, 15, side=side), lambda side: ps.turning_circle(35, side=side)]
    )
    def test_port_and_starboard_are_mirror_images_of_a_symmetric_hull(self, symmetric, method, constructor):
        port, starboard = (
            ps.simulate(symmetric, constructor(side), duration=300.0, step=0.05, method=method)
            for side in ("port", "starboard")
        )
        for name in CHANNELS:
            sign = -1.0 if name in ODD else 1.0
            np.testing.assert_array_equal(port[name], sign * starboard[name], err_msg=name)

    def test_port_and_starboard_differ_on_the_real_hull(self, container):
        port, starboard = (
            ps.simulate(container, ps.turning_circle(35, side=side), duration=300.0) for side in ("port", "starboard")
        )
        assert abs(float(port["psi"][-1] + starboard["psi"][-1])) > 0.01

    def test_zero_rudder_keeps_a_symmetric_hull_straight(self, symmetric, container):
        ahead = ps.rudder_programme([0.0], [0.0])
        run = ps.simulate(symmetric, ahead, duration=300.0)
        for name in ODD:
            assert (run[name] == 0.0).all(), name
        np.testing.assert_array_equal(run["u"], 12.7)
        np.testing.assert_allclose(run["x"], 12.7 * run["time"], rtol=1e-12)
        assert abs(float(ps.simulate(container, ahead, duration=300.0)["psi"][-1])) > 0.01

    @pytest.mark.parametrize("speed", [9.0, 15.0])
    def test_a_straight_course_comes_back_to_the_nominal_speed(self, symmetric, speed):
        ahead = ps.rudder_programme([0.0], [0.0], approach_speed=speed)
        run = ps.simulate(symmetric, ahead, duration=4000.0, step=0.5)
        assert float(run["u"][-1]) == pytest.approx(12.7, abs=1e-3)
        assert (np.sign(np.diff(run["u"])) * np.sign(12.7 - speed) >= 0.0).all()

    def test_velocity_is_the_derivative_of_position(self, container):
        run = ps.simulate(container, ps.turning_circle(35.0), duration=200.0, step=0.05, method="rk4")
        u, v, r, phi, psi = (run[name].values for name in ("u", "v", "r", "phi", "psi"))
        rates = {
            "phi": run["p"].values,
            "psi": r * np.cos(phi),
            "x": u * np.cos(psi) - v * np.cos(phi) * np.sin(psi),
            "y": u * np.sin(psi) + v * np.cos(phi) * np.cos(psi),
        }
        for name, values in rates.items():
            travelled = cumulative_simpson(values, dx=0.05, initial=0.0)
            np.testing.assert_allclose(run[name], travelled, atol=1e-6 * np.abs(run[name]).max().item(), err_msg=name)

    def test_a_vessel_without_roll_stays_upright(self, container):
        """Only terms of v, r, delta and u: the 3-DOF run is that of the plain equations' first three rows."""
        forces = {
            dof: tuple(c for c in container.forces[dof] if "phi" not in c.term and "p" not in c.term)
            for dof in ("surge", "sway", "yaw")
        }
        vessel = replace(container, forces=forces)
        run = ps.simulate(vessel, ps.turning_circle(35.0), duration=300.0)
        assert (run["p"] == 0.0).all()
        assert (run["phi"] == 0.0).all()
        assert float(run["psi"][-1]) < -np.pi
        for k in (10, 2500, 12_500):
            u, v, r = (float(run[name][k]) for name in "uvr")
            U2 = u * u + v * v
            F = plain_hull.force(u, v, r, 0.0, 0.0, float(run["delta"][k]))[:3]
            prime = np.linalg.solve(plain_hull.J[:3, :3], F)
            expected = prime * np.array([U2 / 230.66, U2 / 230.66, U2 / 230.66**2])
            simulated = [float(run[name][k + 1] - run[name][k]) / 0.02 for name in "uvr"]
            np.testing.assert_allclose(simulated, expected, rtol=1e-9)


class TestBatches:
    @pytest.mark.parametrize("size", [1, 15, 16, 17, 33])
    def test_a_batch_is_its_ships_one_by_one(self, container, draws, one_by_one, size):
        batch = ps.simulate(container, ps.zigzag(20, 20), duration=60.0, step=0.05, coefficients=draws[:size])
        assert batch.sizes == {"draw": size, "time": 1200}
        for name in CHANNELS:
            expected = one_by_one[name][:size]
            np.testing.assert_allclose(
                batch[name], expected, rtol=0.0, atol=1e-12 * np.abs(expected).max(), err_msg=name
            )

    def test_the_reference_as_a_draw_is_the_single_run(self, container, zigzag_trial):
        reference = np.concatenate([container.coefficients(dof) for dof in container.dofs])
        batch = ps.simulate(container, ps.zigzag(20, 20), duration=400.0, coefficients=reference[None])
        for name in CHANNELS:
            np.testing.assert_array_equal(batch[name][0], zigzag_trial[name])

    def test_a_diverging_draw_is_flagged_with_its_time_and_leaves_its_neighbours_alone(self, container, draws):
        wild = draws[:20].copy()
        names = [str(name) for dof in container.dofs for name in container.coefficients(dof)["coefficient"].values]
        wild[3, names.index("Kp")] *= -3.0  # negative roll damping
        wild[17] = np.nan
        calm = np.setdiff1d(np.arange(20), [3, 17])
        settings = {"duration": 200.0, "step": 0.05}
        run = ps.simulate(container, ps.zigzag(20, 20), coefficients=wild, **settings)
        alone = ps.simulate(container, ps.zigzag(20, 20), coefficients=draws[:20], **settings)
        assert np.flatnonzero(run["diverged"]).tolist() == [3, 17]
        assert np.isnan(run["diverged_at"].values[calm]).all()
        assert run["diverged_at"].values[17] == 0.05
        at = run["diverged_at"].values[3]
        assert 10.0 < at < 100.0
        for name in CHANNELS:
            np.testing.assert_array_equal(np.isnan(run[name][3]), run["time"] >= at)
            np.testing.assert_array_equal(run[name][calm], alone[name][calm])
        assert float(np.abs(run["phi"][3]).max()) < np.pi / 2.0

    def test_a_single_run_that_diverges_says_so(self, container):
        forward = container.coefficients("roll").values.copy()
        forward[container.terms("roll").index("p")] *= -3.0
        run = ps.simulate(container.with_coefficients({"roll": forward}), ps.zigzag(20, 20), duration=200.0)
        assert bool(run["diverged"])
        assert np.isnan(run["u"].sel(time=float(run["diverged_at"]), method="nearest"))
        assert np.isfinite(run["u"].sel(time=float(run["diverged_at"]) - 0.02, method="nearest"))


class TestReplay:
    """Recorded rudders from any initial state."""

    STATES = CHANNELS[:-1]

    def motion(self, run):
        return np.array([run[name].values for name in self.STATES])

    def test_it_is_the_simulated_run(self, container, smooth_run, zigzag_trial):
        for run, step, method in ((smooth_run, 0.1, "rk4"), (zigzag_trial, 0.02, "euler")):
            states, theta = self.motion(run), reference_coefficients(container)
            simulated = replay(container, run["delta"].values, states[:, 0], theta, interval=step, method=method)[:, 0]
            np.testing.assert_allclose(simulated, states, rtol=0.0, atol=1e-12 * np.abs(states).max())

    def test_it_goes_on_from_any_sample(self, container, smooth_run):
        states, theta = self.motion(smooth_run), reference_coefficients(container)
        late = replay(container, smooth_run["delta"].values[300:], states[:, 300], theta, interval=0.1)[:, 0]
        np.testing.assert_allclose(late, states[:, 300:], rtol=0.0, atol=1e-12 * np.abs(states).max())

    def test_substeps_are_steps_between_the_samples(self, container, smooth_run):
        """Five steps a sample of every fifth sample, along a rudder that is straight in between."""
        states, theta = self.motion(smooth_run), reference_coefficients(container)
        rudder = smooth_run["delta"].values[::5]
        coarse, one = (
            replay(container, rudder, states[:, 0], theta, interval=0.5, substeps=substeps)[:, 0] for substeps in (5, 1)
        )
        np.testing.assert_allclose(coarse, states[:, ::5], rtol=0.0, atol=1e-11 * np.abs(states).max())
        assert np.abs(one - coarse).max() > 1e-9

    def test_blocks_are_means_and_the_rest_is_left_out(self, container, smooth_run):
        states, theta = self.motion(smooth_run), reference_coefficients(container)
        simulated = replay(container, smooth_run["delta"].values, states[:, 0], theta, interval=0.1, block=7)[:, 0]
        expected = states[:, :798].reshape(8, 114, 7).mean(axis=2)
        np.testing.assert_allclose(simulated, expected, rtol=0.0, atol=1e-12 * np.abs(states).max())

    @pytest.mark.parametrize("n_states", [5, 6, 8])
    def test_each_ship_has_its_coefficients_and_its_start(self, container, smooth_run, draws, n_states):
        rudder, rng = smooth_run["delta"].values, np.random.default_rng(6)
        start = self.motion(smooth_run)[:n_states, 0] + 0.01 * rng.standard_normal((33, n_states))
        together = replay(container, rudder, start, draws, interval=0.1, block=10)
        assert together.shape == (n_states, 33, 80)
        for k in (0, 15, 16, 32):
            alone = replay(container, rudder, start[k], draws[k], interval=0.1, block=10)[:, 0]
            np.testing.assert_allclose(together[:, k], alone, rtol=1e-12, atol=1e-12)

    def test_a_ship_that_leaves_the_models_range_is_nan_and_its_neighbours_are_not(self, container, smooth_run, draws):
        rudder, start = smooth_run["delta"].values, np.tile(self.motion(smooth_run)[:5, 0], (3, 1))
        start[1, 0] = 0.05
        simulated = replay(container, rudder, start, draws[:3], interval=0.1)
        assert np.isnan(simulated[:, 1]).all()
        assert np.isfinite(simulated[:, [0, 2]]).all()


class TestRecord:
    def test_kept_samples_are_those_of_the_full_record(self, container, zigzag_trial):
        sparse = ps.simulate(container, ps.zigzag(20, 20), duration=400.0, record_interval=0.5)
        for name in CHANNELS:
            np.testing.assert_array_equal(sparse[name], zigzag_trial[name][::25])
        np.testing.assert_allclose(sparse["time"], zigzag_trial["time"][::25])

    def test_the_record_passes_its_own_check(self, zigzag_trial):
        assert check_trial(zigzag_trial, CHANNELS) is zigzag_trial
        assert zigzag_trial.sizes == {"time": 20_000}
        assert zigzag_trial["time"].values[-1] == pytest.approx(399.98)
        assert not bool(zigzag_trial["diverged"])
        units = ("m/s", "m/s", "rad/s", "rad/s", "rad", "rad", "m", "m", "rad")
        assert tuple(zigzag_trial[name].attrs["units"] for name in CHANNELS) == units

    def test_settings_travel_with_the_record(self, zigzag_trial):
        assert zigzag_trial.attrs == {
            "vessel": "container",
            "manoeuvre": "zigzag",
            "rudder_deg": 20.0,
            "heading_deg": 20.0,
            "side": "port",
            "approach_speed": 12.7,
            "rudder_delay": 0.0,
            "dofs": "surge sway yaw roll",
            "step": 0.02,
            "method": "euler",
        }


class TestFiguresOfThePaper:
    """METHOD.md, section 2; tolerances are half of the last printed digit or 5 % where it says 'about'."""

    def test_zigzag_20_20(self, zigzag_trial):
        simulated = ps.indices(zigzag_trial)
        for name in ("first_overshoot_angle", "second_overshoot_angle", "third_overshoot_angle"):
            assert float(simulated[name]) == pytest.approx(9.0, abs=0.5)
        assert float(simulated["maximum_roll_angle"]) == pytest.approx(10.0, abs=0.5)

    def test_turning_circle_35_to_port(self, container, circle_trial):
        simulated, L = ps.indices(circle_trial), container.particulars.L
        assert float(simulated["advance"]) / L == pytest.approx(5.0, abs=0.05)
        assert float(simulated["tactical_diameter"]) / L == pytest.approx(6.7, abs=0.05)
        heel = np.rad2deg(circle_trial["phi"].values)
        assert heel[-1] == pytest.approx(8.0, abs=0.5)  # outward is to starboard in a turn to port
        assert heel.min() == pytest.approx(-2.4, abs=0.05)
        assert heel.argmin() < heel.argmax()
