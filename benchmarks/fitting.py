"""Fits of the whole trajectory and forecasts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import least_squares

import pymc_ship as ps
from benchmarks.table import Row, median_seconds
from pymc_ship.inference.rows.weak_form import weak_form_start
from pymc_ship.inference.trajectory.fit import fit_trajectory, initial_problem
from pymc_ship.inference.trajectory.prior import coefficient_prior
from pymc_ship.inference.trajectory.runs import trajectory_run
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.replication.measurements import AS_PUBLISHED
from pymc_ship.ships.ensemble.draws import coefficient_draws


def trajectory(vessel, noisy) -> Iterator[Row]:
    """Fit of the trajectory, flat and with the prior scales by evidence, against least squares of scipy."""
    run = trajectory_run(noisy, vessel, method="euler")
    damped, flat = (coefficient_prior([noisy], vessel, kind) for kind in ("order_damped", "flat"))
    first = weak_form_start([noisy], vessel, damped.mean, damped.scale, method="euler")
    problem = initial_problem([run], vessel, flat)
    start = np.concatenate([first, run.initial_state[0]])
    settings = {"interval": run.interval, "method": "euler", "block": run.block}
    n, sd, rows = first.size, problem.noise[0].sd[:, None], list(run.rows)

    def residual(unknowns):
        motion = replay(vessel, run.inputs, unknowns[None, n:], unknowns[None, :n], **settings)[rows, 0]
        return np.append(((run.means - motion) / sd).ravel(), (unknowns[n:] - start[n:]) / problem.unit[n:])

    fit_trajectory(problem, start)
    ours, fit = median_seconds(lambda: fit_trajectory(problem, start), 5)
    theirs, peer = median_seconds(lambda: least_squares(residual, start, x_scale=problem.unit))
    apart = np.max(np.abs(peer.x - fit.unknowns)[:n] / fit.sd)
    name = "scipy least_squares, finite differences"
    yield Row("trajectory fit, 102 coefficients", ours, name, theirs, "max |d| [posterior sd]", apart, 0.05)
    tuned, damped_fit = median_seconds(lambda: fit_trajectory(initial_problem([run], vessel, damped), start), 5)
    reference = reference_coefficients(vessel)
    errors = [np.sqrt(np.mean(((x[:n] - reference) / fit.sd) ** 2)) for x in (damped_fit.unknowns, peer.x)]
    note = "not the same work: ours finds the prior scales by evidence, scipy has no prior"
    check = ("RMS error of ours / its", errors[0] / errors[1], 1.0)
    yield Row("the same with prior scales by evidence", tuned, name, theirs, *check, note=note)


def forecasts(vessel, noisy) -> Iterator[Row]:
    """A thousand forecasts with bands and extrapolation against one ship at a time without them."""
    tree = ps.trajectory_posterior(noisy, vessel, rng=np.random.default_rng(3), method="euler")
    circle = ps.turning_circle(35)

    def forecast():
        rng = np.random.default_rng(4)
        ship = ps.Ship.from_posterior(vessel, tree, draws=1000, rng=rng)
        return ps.forecast(ship, circle, rng=rng, duration=400.0, **AS_PUBLISHED)

    ours, found = median_seconds(forecast, 3)
    draws = coefficient_draws(vessel, tree, 1000, np.random.default_rng(4))[:50]
    settings = {"duration": 400, "record_interval": 0.5}
    theirs, runs = median_seconds(
        lambda: [ps.simulate(vessel, circle, coefficients=d[None], **settings) for d in draws]
    )
    together = found["trajectories"]["psi"].values[:50]
    gap = np.nanmax(np.abs(together - np.concatenate([run["psi"].values for run in runs])))
    peer, check = "one ship at a time (50, scaled), no bands", ("max |d psi| [rad]", gap, 1e-6)
    yield Row("1000 forecasts of a 35 deg turn, bands, indices", ours, peer, 20.0 * theirs, *check)
