"""How the cost grows with rows, terms, draws and runs: one curve each, with its exponent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import pymc_ship as ps
from benchmarks.table import median_seconds
from pymc_ship.inference.trajectory.fit import fit_trajectory, initial_problem
from pymc_ship.inference.trajectory.runs import trajectory_run

UPPER = 10.0
"""The exponent is that of the sizes within this factor of the largest, where what grows outweighs what does not."""


@dataclass(frozen=True)
class Curve:
    """Seconds against the size of a problem, by method.

    Attributes
    ----------
    name, xlabel, title : str
        Of the file, of the axis and of the figure.
    sizes : tuple of int
    seconds : dict of str to list of float
    """

    name: str
    xlabel: str
    title: str
    sizes: tuple[int, ...]
    seconds: dict[str, list[float]]

    def exponent(self, method: str) -> float:
        """Slope of log seconds against log size over the upper sizes."""
        x, y = np.log(self.sizes), np.log(self.seconds[method])
        upper = x >= x[-1] - np.log(UPPER) - 1e-9
        upper[-2] = True
        return float(np.polyfit(x[upper], y[upper], 1)[0])


def _measured(
    name: str, xlabel: str, title: str, sizes: tuple[int, ...], methods: dict[str, Callable[[int], Callable]]
) -> Curve:
    """Time each method at each size; short calls are repeated."""
    seconds = {method: [] for method in methods}
    for size in sizes:
        for method, make in methods.items():
            work = make(size)
            first, _ = median_seconds(work)
            seconds[method].append(min(first, median_seconds(work, 9 if first < 0.1 else 3)[0]) if first < 1 else first)
    return Curve(name, xlabel, title, sizes, seconds)


def _regression(n_rows: int, n_terms: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    X = rng.standard_normal((n_rows, n_terms))
    return X, X @ rng.standard_normal(n_terms) + rng.standard_normal(n_rows)


def _in_memory(n_rows: int, n_terms: int) -> Callable:
    X, y = _regression(n_rows, n_terms)
    return lambda: ps.ConjugatePrior().exact(ps.RegressionData.from_arrays(X, y, scaling="none"))


def rows() -> Curve:
    """Exact posterior of 28 terms against the rows."""
    methods = {"SVD in memory": lambda n: _in_memory(n, 28)}
    sizes = (400, 2000, 10_000, 100_000, 1_000_000)
    return _measured("rows", "rows", "exact posterior of 28 terms", sizes, methods)


def terms() -> Curve:
    """Exact posterior of 4000 rows against the terms."""
    methods = {"SVD in memory": lambda n: _in_memory(4000, n)}
    return _measured("terms", "terms", "exact posterior of 4000 rows", (5, 10, 20, 50, 100, 200), methods)


def draws(data, prior) -> Curve:
    """Independent draws and Gibbs draws of one regression against their number."""
    exact = prior.exact(data)

    def gibbs(n: int) -> Callable:
        return lambda: ps.gibbs_posterior(data, prior, draws=n // 4, chains=4, tune=0, rng=np.random.default_rng(0))

    methods = {"exact": lambda n: lambda: exact.draw(n, np.random.default_rng(0)), "Gibbs, 4 chains": gibbs}
    sizes = (100, 1000, 10_000, 100_000)
    return _measured("draws", "draws", f"draws of {data.n_terms} coefficients", sizes, methods)


def runs(vessel) -> Curve:
    """Joint fit of ten coefficients to short runs against their number."""
    from tests.physics.vessel.cases import small_vessel

    small = small_vessel(vessel)
    rng = np.random.default_rng(0)
    angles = np.linspace(10.0, 30.0, 100)
    trials = [
        ps.pollute(
            ps.simulate(small, ps.zigzag(angle, angle), duration=60.0, step=0.1, method="rk4"), level=0.01, rng=rng
        )
        for angle in angles
    ]
    prior = ps.coefficient_prior(trials[:1], small, "sister_ship")

    def fit(n: int) -> Callable:
        prepared = [trajectory_run(trial, small) for trial in trials[:n]]
        problem = initial_problem(prepared, small, prior)
        return lambda: fit_trajectory(problem, problem.center)

    return _measured("runs", "runs of 60 s", "trajectory fit of 10 coefficients", (1, 3, 10, 30, 100), {"fit": fit})


def draw_figure(curve: Curve, path: Path) -> None:
    """Draw one curve on logarithmic axes, with the exponents in its legend."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(5.0, 3.4), layout="constrained")
        axes = figure.subplots()
        for (method, seconds), colour in zip(curve.seconds.items(), ("#0072B2", "#D55E00"), strict=False):
            label = f"{method}: time ~ size^{curve.exponent(method):.2f}"
            axes.loglog(curve.sizes, seconds, "o-", color=colour, label=label, markersize=4.0, linewidth=1.5)
        axes.set(xlabel=curve.xlabel, ylabel="time [s]", title=curve.title)
        axes.grid(color="0.9", linewidth=0.6)
        axes.legend(frameon=False)
        figure.savefig(path, dpi=130)
