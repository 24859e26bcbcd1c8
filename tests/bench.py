"""Ratios of this package against named peers doing the same work, measured side by side in one run: ``make bench``.

Each row says what was timed, ours and the peer's median seconds over repeated runs, their ratio, and how far the two
results differ, so that a fast wrong answer shows.
"""

from __future__ import annotations

import os
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pywt
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import peers
import plain_hull
import pymc_ship as ps
from pymc_ship.equations_of_motion import reference_coefficients
from pymc_ship.forecast import coefficient_draws
from pymc_ship.simulate import replay
from pymc_ship.trajectory_data import trajectory_run
from pymc_ship.trajectory_fit import fit_trajectory, initial_problem
from pymc_ship.trajectory_prior import coefficient_prior
from pymc_ship.weak_form import weak_form_start


def median_seconds(work: Callable[[], object], repeats: int) -> tuple[float, object]:
    """Median wall time of a call over repeats, and its last result."""
    seconds, result = [], None
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds), result


def row(name: str, ours: float, peer: str, theirs: float, difference: str) -> None:
    """Print one comparison."""
    print(
        f"{name:<48} {ours:>9.4f} s   {peer:<34} {theirs:>9.3f} s   {theirs / ours:>8.2f} x   {difference}", flush=True
    )


def plain_zigzag(n_steps: int, step: float) -> np.ndarray:
    """Heading of the container ship's 20/20 zigzag to port by a loop over the plain equations of plain_hull."""
    state, delta, target = np.array([plain_hull.NOMINAL_SPEED, *[0.0] * 7]), 0.0, np.deg2rad(20.0)
    travel, heading = np.deg2rad(2.3) * step, np.empty(n_steps)
    for k in range(n_steps):
        heading[k] = state[5]
        if (target > 0.0 and state[5] <= -np.deg2rad(20.0)) or (target < 0.0 and state[5] >= np.deg2rad(20.0)):
            target = -target
        state = state + step * np.array(plain_hull.rate(state, delta))
        delta += min(max(target - delta, -travel), travel)
    return heading


def universal_soft(y: np.ndarray, wavelet: str = "sym8", levels: int = 6) -> np.ndarray:
    """Translation-invariant universal soft thresholding with PyWavelets, as its documentation shows."""
    size = -len(y) % 2**levels
    approximation, *details = pywt.swt(np.pad(y, (0, size), "symmetric"), wavelet, levels, trim_approx=True, norm=True)
    sd = np.median(np.abs(details[-1])) / 0.6745
    kept = [pywt.threshold(d, sd * np.sqrt(2.0 * np.log(d.size)), "soft") for d in details]
    return pywt.iswt([approximation, *kept], wavelet, norm=True)[: len(y)]


def simulation(vessel) -> None:
    """One 20000-step zigzag against a plain NumPy loop and against scipy."""
    manoeuvre = ps.zigzag(20, 20)
    ps.simulate(vessel, manoeuvre, duration=1)
    ours, trial = median_seconds(lambda: ps.simulate(vessel, manoeuvre, duration=400), 15)
    plain, heading = median_seconds(lambda: plain_zigzag(20000, 0.02), 1)
    gap = np.abs(heading - trial["psi"].values).max()
    row("20/20 zigzag, 20000 Euler steps", ours, "the same in a Python/NumPy loop", plain, f"max |d psi| {gap:.1e} rad")
    delta = trial["delta"].values
    programme = ps.rudder_programme(trial["time"].values, delta, rate_limited=False)
    ours, record = median_seconds(lambda: ps.simulate(vessel, programme, duration=400, step=0.1, method="rk4"), 15)
    reach = record["time"].values[-1]

    def scipy_run():
        start = [vessel.particulars.nominal_speed, *[0.0] * 7]
        time = trial["time"].values
        return solve_ivp(
            lambda t, state: plain_hull.rate(state, np.interp(t, time, delta)),
            (0.0, reach),
            start,
            rtol=1e-8,
            atol=1e-8,
        )

    theirs, solution = median_seconds(scipy_run, 1)
    gap = abs(solution.y[5, -1] - record["psi"].values[-1])
    row(
        "the same rudder record, RK4 at 0.1 s",
        ours,
        "scipy solve_ivp (RK45, rtol 1e-8)",
        theirs,
        f"|d psi| at end {gap:.1e} rad",
    )


def batch(vessel) -> None:
    """A thousand posterior draws against one at a time."""
    rng = np.random.default_rng(0)
    reference = np.concatenate([vessel.coefficients(dof).values for dof in vessel.dofs])
    draws = reference * (1.0 + 0.01 * rng.standard_normal((1000, reference.size)))
    settings = {"duration": 400, "record_interval": 0.5}
    together, many = median_seconds(lambda: ps.simulate(vessel, ps.zigzag(10, 10), coefficients=draws, **settings), 3)
    alone, one = median_seconds(
        lambda: [ps.simulate(vessel, ps.zigzag(10, 10), coefficients=row[None], **settings) for row in draws[:50]], 1
    )
    gap = np.abs(one[-1]["psi"].values[0] - many["psi"].values[49]).max()
    row(
        "1000 draws x 20000 steps",
        together,
        "one draw at a time (50, scaled)",
        20 * alone,
        f"max |d psi| {gap:.1e} rad",
    )


def derivatives(vessel, trial) -> None:
    """Sensitivities of 107 columns along 20000 steps against central differences of as many runs, side by side."""
    delta, start = trial["delta"].values, np.array([vessel.particulars.nominal_speed, 0.1, 0.0, 0.0, 0.0])
    point = np.concatenate([reference_coefficients(vessel), start])
    n_coefficients = point.size - start.size
    widths = np.diag(np.maximum(1e-4 * np.abs(point), 1e-7))
    points = np.concatenate([point + widths, point - widths])
    for method in ("euler", "rk4"):
        settings = {"interval": 0.02, "method": method, "block": 10}

        def differences(settings=settings):
            motion = replay(vessel, delta, points[:, n_coefficients:], points[:, :n_coefficients], **settings)
            plus, minus = np.split(motion, 2, axis=1)
            return (plus - minus) / (2.0 * np.diag(widths)[:, None])

        ps.sensitivities(vessel, delta[:20], start, **settings)
        ours, (_, jacobian) = median_seconds(lambda s=settings: ps.sensitivities(vessel, delta, start, **s), 15)
        theirs, expected = median_seconds(differences, 1)
        expected = expected.transpose(0, 2, 1)
        gap = np.median(np.abs(jacobian - expected).max(axis=1) / np.abs(expected).max(axis=1))
        row(
            f"derivatives, 107 x 20000 steps, {method}",
            ours,
            "central differences, 214 runs",
            theirs,
            f"median over columns of max |d| / max {gap:.1e}",
        )


def trajectory(vessel, noisy) -> None:
    """Fit of the trajectory, flat and with the prior scales by evidence, against least squares of scipy."""
    run = trajectory_run(noisy, vessel, method="euler")
    damped, flat = (coefficient_prior([noisy], vessel, kind) for kind in ("order_damped", "flat"))
    first = weak_form_start([noisy], vessel, damped.mean, damped.scale, method="euler")
    problem = initial_problem([run], vessel, flat)
    start = np.concatenate([first, run.initial_state[0]])
    settings = {"interval": run.interval, "method": "euler", "block": run.block}
    n, sd, rows = first.size, problem.noise[0].sd[:, None], list(run.rows)

    def residual(unknowns):
        motion = replay(vessel, run.delta, unknowns[None, n:], unknowns[None, :n], **settings)[rows, 0]
        return np.append(((run.means - motion) / sd).ravel(), (unknowns[n:] - start[n:]) / problem.unit[n:])

    ours, fit = median_seconds(lambda: fit_trajectory(problem, start), 5)
    theirs, peer = median_seconds(lambda: least_squares(residual, start, x_scale=problem.unit), 1)
    apart = np.max(np.abs(peer.x - fit.unknowns)[:n] / fit.sd)
    row("trajectory fit, 102 coefficients", ours, "scipy least_squares, same residual", theirs, f"{apart:.2g} sd apart")
    tuned, _ = median_seconds(lambda: fit_trajectory(initial_problem([run], vessel, damped), start), 5)
    row("the same with prior scales by evidence", tuned, "scipy least_squares, same residual", theirs, "")


def forecasts(vessel, noisy) -> None:
    """A thousand forecasts with bands and extrapolation against one ship at a time."""
    tree = ps.trajectory_posterior(noisy, vessel, rng=np.random.default_rng(3), method="euler")
    circle, rng = ps.turning_circle(35), np.random.default_rng(4)
    ours, _ = median_seconds(lambda: ps.forecast(vessel, tree, circle, draws=1000, rng=rng), 3)
    draws = coefficient_draws(vessel, {}, 50, rng)
    theirs, _ = median_seconds(
        lambda: [
            ps.simulate(vessel, circle, duration=400, record_interval=0.5, coefficients=draw[None]) for draw in draws
        ],
        1,
    )
    row("1000 forecasts of a 35 deg turn, bands, indices", ours, "one ship at a time (50, scaled)", 20.0 * theirs, "")


def sampling(data, prior) -> None:
    """Exact draws and Gibbs sampler against a plain Cholesky Gibbs sampler, in effective draws a second."""
    from arviz import ess

    def rate(work, repeats, pick):
        seconds, result = median_seconds(work, repeats)
        coefficients = pick(result)
        return min(float(ess(coefficients[..., j])) for j in range(coefficients.shape[-1])) / seconds, coefficients

    rng = np.random.default_rng(0)
    scaled = ps.RegressionData.from_arrays(data.scaled_design_matrix, data.scaled_response)
    ps.gibbs_posterior(scaled, prior, draws=10, chains=1, rng=rng)
    plain, theirs = rate(
        lambda: peers.cholesky_gibbs(scaled.design_matrix, scaled.response, prior, 4000, rng), 1, lambda r: r[0][None]
    )
    exact = ps.semiconjugate(scaled, prior)
    cases = {
        "exact independent draws, ESS": lambda: exact.draw(40000, rng)[0][None],
        "Gibbs, 64 chains x 1000, ESS": lambda: ps.gibbs(scaled, prior, draws=1000, chains=64, rng=rng)[0],
    }
    for name, work in cases.items():
        ours, coefficients = rate(work, 3, lambda r: r)
        gap = np.abs((coefficients.mean((0, 1)) - theirs.mean((0, 1))) / exact.sd).max()
        print(
            f"{name:<48} {ours:>9.3g} /s  {'Cholesky Gibbs in numpy':<34} {plain:>8.3g} /s  {ours / plain:>8.1f} x  "
            f"max |d mean| {gap:.3f} sd",
            flush=True,
        )


def nuts(data, prior) -> None:
    """NUTS on the whitened model against the direct one and a first attempt, in least effective draws a second."""
    rates = {
        name: least_ess_rate(sample)
        for name, sample in {
            "whitened": lambda: ps.nuts_posterior(data, prior, rng=np.random.default_rng(0)),
            "direct": lambda: ps.nuts_posterior(data, prior, rng=np.random.default_rng(0), parametrisation="direct"),
            "first attempt": lambda: first_attempt(data),
        }.items()
    }
    ours = rates.pop("whitened")
    names = {"direct": "direct, as the paper writes it", "first attempt": "plain PyMC, a first attempt"}
    for name, theirs in rates.items():
        print(
            f"{'NUTS whitened, with compilation, ESS':<48} {ours:>9.3g} /s  {names[name]:<34} {theirs:>8.3g} /s  "
            f"{ours / theirs:>8.1f} x",
            flush=True,
        )


def least_ess_rate(sample) -> float:
    """Least effective number of coefficient draws per second, compilation included."""
    from arviz import ess

    start = time.perf_counter()
    tree = sample()
    seconds = time.perf_counter() - start
    return float(ess(tree["posterior"].dataset)["coefficients"].min()) / seconds


def first_attempt(data):
    """Model of the same regression as a PyMC user first writes it: standardised columns, default sampling."""
    import pymc as pm

    with pm.Model():
        coefficients = pm.Normal("coefficients", 0.0, 10.0, shape=data.n_terms)
        sigma = pm.HalfNormal("sigma", 1.0)
        mean = pm.math.dot(data.scaled_design_matrix, coefficients)
        pm.Normal("response", mean, sigma, observed=data.scaled_response)
        return pm.sample(random_seed=0, progressbar=False)


def denoising(noisy) -> None:
    """Five channels of 20000 samples against universal soft thresholding with PyWavelets."""
    channels = ("u", "v", "r", "p", "phi")
    ps.denoise(noisy, channels=channels)
    ours, smooth = median_seconds(lambda: ps.denoise(noisy, channels=channels), 3)
    theirs, soft = median_seconds(lambda: {name: universal_soft(noisy[name].values) for name in channels}, 3)
    clean = noisy.attrs["clean"]
    errors = [np.sqrt(np.mean((record["v"] - clean) ** 2)) for record in ({"v": smooth["v"].values}, {"v": soft["v"]})]
    row(
        "denoise 5 x 20000, translation invariant",
        ours,
        "PyWavelets swt, universal soft",
        theirs,
        f"RMSE v {errors[0]:.2e} vs {errors[1]:.2e}",
    )


def whole_study() -> None:
    """The whole study in a process of its own: wall time and peak memory."""
    import subprocess

    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        subprocess.run([Path(sys.executable).with_name("pymc-ship"), "study", "--quiet", "--out", folder], check=True)
        seconds = time.perf_counter() - start
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024**2
    print(f"{'whole study, one process':<48} {seconds:>9.1f} s   peak memory {memory:.2f} GiB", flush=True)


def main() -> None:
    """Run every comparison and print it."""
    print(
        f"{os.cpu_count()} cores, Python {sys.version.split()[0]}, numpy {np.__version__}, pymc_ship {ps.__version__}"
    )
    vessel = ps.load_vessel("container")
    trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=400)
    noisy = ps.pollute(trial, level=0.01, rng=np.random.default_rng(1))
    noisy.attrs["clean"] = trial["v"].values
    simulation(vessel)
    batch(vessel)
    derivatives(vessel, trial)
    trajectory(vessel, noisy)
    forecasts(vessel, noisy)
    denoising(noisy)
    data = ps.regression_data(ps.denoise(noisy), vessel, "sway", interval=1.0)
    prior, _ = ps.maximise_evidence(data, "semiconjugate")
    sampling(data, prior)
    nuts(data, prior)
    whole_study()


if __name__ == "__main__":
    main()
