"""How close each method comes to the Cramer-Rao bound: the same data sets, many seeds, every way to the coefficients.

On each data set every estimator of its cell is measured; what comes out is one :class:`Measurement` for each, whatever
the order of the work and the number of processes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pymc_ship.inference.identifiability.bound import errors_on_bound
from pymc_ship.inference.regression.identify import identify
from pymc_ship.inference.trajectory.mode import TrajectoryMode, trajectory_mode
from pymc_ship.inference.trajectory.noise import fit_with_noise
from pymc_ship.inference.trajectory.posterior import laplace_posterior
from pymc_ship.machine.errors import FitError
from pymc_ship.machine.threads import one_thread
from pymc_ship.machine.workers import LocalCores, WorkersLostError, progress_bar, run_tasks
from pymc_ship.physics.manoeuvre.indices import indices
from pymc_ship.physics.manoeuvre.standard import turning_circle, zigzag
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.denoising.denoise import denoise
from pymc_ship.replication.estimates import DIFFERENCES
from pymc_ship.replication.measurements import AS_PUBLISHED
from pymc_ship.replication.scores import forecast_row, relative_error
from pymc_ship.ships.ensemble.ship import Ship
from pymc_ship.ships.forecasting.forecast import forecast
from studies.frontier.data_sets import CELLS, Cell, DataSet, data_set

FORECASTS = {
    "10/10 zigzag": (zigzag(10, 10), 400.0),
    "35 deg turn": (turning_circle(35), 400.0),
    "35 deg turn, 600 s": (turning_circle(35), 600.0),
}
"""Manoeuvres that are forecast and their durations [s]."""

DRAWS = 300
"""Posterior draws of a forecast."""

_NORMAL_90 = 1.6448536269514722
_SAME_MODE = 0.5


@dataclass(frozen=True)
class Measurement:
    """What one estimator made of one data set.

    Attributes
    ----------
    cell : str
    level : float
    seed : int
        Number of the data set.
    estimator : str
    values : dict of str to float
        ``median_error`` [%] over the coefficients that are not 0; where there are intervals, ``coverage`` [%] of those
        of 90 % over all; and what is particular to the estimator.
    deviation : ndarray, shape (n_coefficients,)
        Estimate minus truth over the Cramer-Rao bound; NaN where there is none.
    """

    cell: str
    level: float
    seed: int
    estimator: str
    values: dict[str, float]
    deviation: np.ndarray


def _measurement(
    data: DataSet, estimator: str, values: dict[str, float], estimate: np.ndarray | None = None
) -> Measurement:
    deviation = np.full(data.truth.size, np.nan)
    if data.bound is not None and estimate is not None:
        deviation = (estimate - data.truth) / data.bound
    return Measurement(data.cell.name, data.level, data.seed, estimator, values, deviation)


def _scored(data: DataSet, estimator: str, estimate: np.ndarray, sd: np.ndarray | None = None, **values) -> Measurement:
    """Errors of an estimate and, with its standard deviations, the coverage of its intervals of 90 %."""
    scores = {"median_error": float(np.nanmedian(relative_error(estimate, data.truth)))}
    if sd is not None:
        scores["coverage"] = 100.0 * float(np.mean(np.abs(estimate - data.truth) <= _NORMAL_90 * sd))
    return _measurement(data, estimator, scores | values, estimate)


def _bound(data: DataSet) -> list[Measurement]:
    """Median error that normal, unbiased estimates on the bound would have."""
    known = data.truth != 0.0
    relative = 100.0 * data.bound[known] / np.abs(data.truth[known])
    values = {"median_error": errors_on_bound(relative)["median"], "median_sd": float(np.median(relative))}
    return [_measurement(data, "bound", values)]


def _mode(data: DataSet, prior: str = "order_damped", **settings) -> TrajectoryMode | None:
    try:
        return trajectory_mode(data.trials, data.vessel, prior, method=data.cell.method, **settings)
    except FitError:
        return None


def _fitted(data: DataSet, estimator: str, mode: TrajectoryMode | None, **values: float) -> Measurement:
    """Scores of a fit and the noise it chose; one that failed is infinitely wrong and covers nothing."""
    if mode is None:
        wrong, nothing = np.full(data.truth.size, np.inf), np.zeros(data.truth.size)
        return _scored(data, estimator, wrong, nothing, failed=1.0, **values)
    choice = mode.choice
    chosen = {f"chose_{kind}": float(choice.kind == kind) for kind in ("white", "ar1", "student_t")}
    chosen |= {"chose_offsets": float(choice.offsets), "chi2": choice.fit.chi2, "failed": 0.0}
    return _scored(data, estimator, choice.fit.coefficients, choice.fit.sd, **chosen, **values)


def _flat(data: DataSet) -> list[Measurement]:
    return [_fitted(data, "flat prior", _mode(data, "flat"))]


def _default(data: DataSet) -> list[Measurement]:
    return [_fitted(data, "default prior", _mode(data))]


def _white_assumed(data: DataSet) -> list[Measurement]:
    return [_fitted(data, "white assumed", _mode(data, noise="white", offsets=False))]


def _starts(data: DataSet) -> list[Measurement]:
    """Fit with all defaults, and how many of its starts end where a fit that starts from the truth ends."""
    mode = _mode(data)
    return [_fitted(data, "default prior", mode, **_reaching(data, mode))]


def _reaching(data: DataSet, mode: TrajectoryMode | None) -> dict[str, float]:
    if mode is None:
        return {"reaching": 0.0}
    fit = mode.choice.fit
    best = fit_with_noise(fit.problem.runs, data.vessel, fit.problem.prior, data.truth).fit
    distance = np.max(np.abs(best.coefficients - fit.coefficients) / fit.sd)
    found = distance < _SAME_MODE or fit.log_evidence >= best.log_evidence
    return {"reaching": 100.0 * found * mode.n_agreeing / mode.n_starts, "from_truth": float(distance)}


def _forecasts(data: DataSet) -> list[Measurement]:
    """:func:`_starts`, and forecasts from that fit of manoeuvres it has not seen."""
    mode = _mode(data)
    measured = [_fitted(data, "default prior", mode, **_reaching(data, mode))]
    rng = data.rng("forecast")
    posterior = None if mode is None else laplace_posterior(mode, draws=DRAWS, chains=4, rng=rng)
    for name, (manoeuvre, duration) in FORECASTS.items():
        if posterior is None:
            measured.append(_measurement(data, name, {"error": np.inf, "band_coverage": 0.0}))
            continue
        ship = Ship.from_posterior(data.vessel, posterior, draws=DRAWS, rng=rng, noise_sd={})
        tree = forecast(ship, manoeuvre, rng=rng, duration=duration, **AS_PUBLISHED)
        reference = simulate(data.vessel, manoeuvre, duration=duration, record_interval=0.5)
        row = forecast_row(reference, indices(reference), tree)
        values = {
            "error": row["error"],
            "band_coverage": row["coverage"],
            "diverged": row["diverged"],
        }
        values |= {"extrapolated": 100.0 * tree.attrs["extrapolated_fraction"]} | _index_errors(row)
        measured.append(_measurement(data, name, values))
    return measured


def _index_errors(row: dict) -> dict[str, float]:
    """Errors of the medians of the indices: tactical diameter [%], overshoots [deg]."""
    if "tactical_diameter_median" in row:
        ratio = row["tactical_diameter_median"] / row["tactical_diameter_reference"]
        return {"tactical_diameter": 100.0 * abs(ratio - 1.0)}
    both = [f"{which}_overshoot_angle" for which in ("first", "second")]
    return {index: abs(row[f"{index}_median"] - row[f"{index}_reference"]) for index in both}


def _regressions(data: DataSet) -> list[Measurement]:
    """The paper's pipeline, its rivals among the differencing methods and the weak form, all on the same record."""
    (noisy,) = data.trials
    smooth = denoise(noisy)
    cases = {"paper's pipeline": (smooth, "euler", 1.0)}
    cases |= {name: (smooth, *how) for name, how in DIFFERENCES.items()}
    cases["weak form"] = (noisy, "weak_euler", 4.0)
    measured = []
    for name, (trial, derivative, interval) in cases.items():
        found = identify(trial, data.vessel, families=("conjugate",), derivative=derivative, interval=interval)
        exact = found.exact["conjugate"].values()
        mean, sd = (np.concatenate([getattr(one, key) for one in exact]) for key in ("mean", "sd"))
        measured.append(_scored(data, name, mean, sd))
        if name == "paper's pipeline":
            plain = np.concatenate([rows.least_squares for rows in found.data.values()])
            measured.append(_scored(data, "paper's pipeline, least squares", plain))
    return measured


ESTIMATORS: dict[str, Callable[[DataSet], list[Measurement]]] = {
    "bound": _bound,
    "flat": _flat,
    "default": _default,
    "starts": _starts,
    "forecasts": _forecasts,
    "white assumed": _white_assumed,
    "regressions": _regressions,
}
"""What can be measured on a data set; ``bound`` has deviations measured by it, too."""


def measure(vessel: Vessel, cell: Cell, level: float, seed: int, root: int, duration: float) -> list[Measurement]:
    """Simulate one data set and measure every estimator of its cell on it.

    Parameters
    ----------
    vessel, cell, level, seed, root, duration
        As :func:`studies.frontier.data_sets.data_set`.

    Returns
    -------
    list of Measurement
    """
    with one_thread():
        data = data_set(vessel, cell, level, seed, root=root, duration=duration)
        return [found for name in cell.estimators for found in ESTIMATORS[name](data)]


def frontier(
    vessel: Vessel,
    *,
    seeds: int = 25,
    seed: int = 2020,
    cells: Sequence[Cell] = CELLS,
    duration: float = 400.0,
    workers: int = 2,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Measurement]:
    """Measure all estimators of all cells on many data sets.

    Parameters
    ----------
    vessel : Vessel
    seeds : int, optional
        Data sets of each cell and level.
    seed : int, optional
        Root of every random number.
    cells : sequence of Cell, optional
    duration : float, optional
        Of each run [s].
    workers : int, optional
        Processes; 1 works in this one. The results do not depend on it.
    progress : callable, optional
        Called with a short text after each data set.

    Returns
    -------
    list of Measurement
        By cell, level, seed and estimator.

    Raises
    ------
    ValueError
        For fewer than two seeds, less than one worker, and workers that die again and again.
    """
    if seeds < 2:
        raise ValueError(f"Medians and coverages need two seeds or more, found {seeds}; take 25 for a verdict.")
    tasks = {
        (cell.name, level, k): (vessel, cell, level, k, seed, duration)
        for k in range(seeds)
        for cell in cells
        for level in cell.levels
    }
    found: dict[tuple, list[Measurement]] = {}

    def remaining() -> Iterator[tuple[tuple, tuple]] | None:
        left = tasks.keys() - found.keys()
        return ((key, task) for key, task in tasks.items() if key in left) if left else None

    try:
        with LocalCores(workers, error=ValueError) as executor:
            for key, measurements in run_tasks(executor, _measured, remaining):
                found[key] = measurements
                progress(f"{progress_bar(len(found), len(tasks))} {len(found)} of {len(tasks)} data sets")
    except WorkersLostError as error:
        raise ValueError(
            f"Workers died {error.times} times without a result in between, of {error.reason}; make room and run again."
        ) from None
    order = [(cell.name, level, k) for cell in cells for level in cell.levels for k in range(seeds)]
    return [measurement for key in order for measurement in found[key]]


def _measured(named: tuple[tuple, tuple]) -> tuple[tuple, list[Measurement]]:
    """Key of a task with its measurements."""
    key, task = named
    return key, measure(*task)
