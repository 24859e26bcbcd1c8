"""How close each method comes to the Cramer-Rao bound: the same data sets, many seeds, every way to the coefficients.

A cell is one kind of data set (which runs, which integrator, which noise); at each noise level and for each seed it is
simulated anew and measured: one :class:`Measurement` for each estimator. Every random number is named by cell, level
and seed, so that the order of the work and the number of processes do not matter.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

from pymc_ship.denoise import denoise
from pymc_ship.equations_of_motion import reference_coefficients
from pymc_ship.forecast import forecast
from pymc_ship.identifiability import identifiability
from pymc_ship.identification import identify
from pymc_ship.indices import indices
from pymc_ship.manoeuvres import Manoeuvre, turning_circle, zigzag
from pymc_ship.noise import FACTORS
from pymc_ship.simulate import simulate
from pymc_ship.study import generator
from pymc_ship.tables import forecast_row, relative_error
from pymc_ship.trajectory_data import SENSORS, trajectory_run
from pymc_ship.trajectory_fit import TrajectoryError
from pymc_ship.trajectory_noise import fit_with_noise
from pymc_ship.trajectory_posterior import TrajectoryMode, laplace_posterior, trajectory_mode
from pymc_ship.trial_design import candidate_trials
from pymc_ship.vessel import Vessel

LEVELS = (0.001, 0.01, 0.05)
"""Noise levels, as :func:`pymc_ship.pollute` takes them."""

FORECASTS = {"zigzag": (zigzag(10, 10), 400.0), "turn": (turning_circle(35), 600.0)}
"""Manoeuvres that are forecast and their durations [s]."""

DIFFERENCES = {
    "central difference at 1 s": ("central", 1.0),
    "central difference": ("central", None),
    "Savitzky-Golay at 1 s": ("savgol", 1.0),
    "Savitzky-Golay": ("savgol", None),
}
"""Rivals among the differencing methods: derivative and interval of the rows [s], on the denoised record."""

DRAWS = 300
"""Posterior draws of a forecast."""

SLOW_SPEED = 6.0
"""Approach speed [m/s] of the random rudder programme that is added to the zigzag."""

_STEP = 0.02
_SMALL_STEP = 0.002
_NORMAL_90 = 1.6448536269514722
_SAME_MODE = 0.5


@dataclass(frozen=True)
class Cell:
    """One kind of data set and what is measured on it.

    Attributes
    ----------
    name : str
    estimators : tuple of str
        Keys of :data:`ESTIMATORS`.
    levels : tuple of float
    method : {"euler", "rk4"}
        Integrator of the fit. The ship itself moves by the same Euler steps of 0.02 s, or by Runge-Kutta steps of
        0.002 s recorded every 0.02 s.
    n_designed : int
        Runs added to the zigzag: random steps of the rudder from 6 m/s, then a 35/35 zigzag.
    noise : str
        Key of :data:`NOISES`.
    """

    name: str
    estimators: tuple[str, ...]
    levels: tuple[float, ...] = LEVELS
    method: str = "euler"
    n_designed: int = 0
    noise: str = "white"


_CHECKED = ("default", "white assumed")

CELLS = (
    Cell("white", ("bound", "flat", "default", "forecast", "regression")),
    Cell("one designed run", ("bound", "default"), n_designed=1),
    Cell("two designed runs", ("bound", "default"), n_designed=2),
    Cell("small-step truth", ("bound", "fit"), method="rk4"),
    Cell("correlated 0.2 s", _CHECKED, (0.01,), noise="correlated 0.2 s"),
    Cell("correlated 1 s", _CHECKED, (0.01,), noise="correlated 1 s"),
    Cell("offsets", _CHECKED, (0.01,), noise="offsets"),
    Cell("Student-t3", _CHECKED, (0.01,), noise="Student-t3"),
)
"""What the table of the frontier is made from."""


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
        of 90 %; and what is particular to the estimator.
    deviation : ndarray, shape (n_coefficients,)
        Estimate minus truth over the Cramer-Rao bound; NaN where no bound was computed.
    """

    cell: str
    level: float
    seed: int
    estimator: str
    values: dict[str, float]
    deviation: np.ndarray


@dataclass(frozen=True)
class DataSet:
    """Runs of one cell, level and seed, with the bound of the coefficients (None until it is computed)."""

    vessel: Vessel
    cell: Cell
    level: float
    seed: int
    root: int
    clean: tuple[xr.Dataset, ...]
    trials: tuple[xr.Dataset, ...]
    bound: np.ndarray | None = None

    def rng(self, purpose: str) -> np.random.Generator:
        """Generator of one purpose."""
        return generator(self.root, purpose, self.cell.name, self.level, self.seed)

    def measured(self, estimator: str, estimate: np.ndarray, sd: np.ndarray | None = None, **values) -> Measurement:
        """Errors of an estimate and, with its standard deviations, the coverage of its intervals of 90 %."""
        reference = reference_coefficients(self.vessel)
        scores = {"median_error": float(np.nanmedian(relative_error(estimate, reference)))}
        if sd is not None:
            scores["coverage"] = 100.0 * float(np.mean(np.abs(estimate - reference) <= _NORMAL_90 * sd))
        deviation = np.full(reference.size, np.nan) if self.bound is None else (estimate - reference) / self.bound
        return Measurement(self.cell.name, self.level, self.seed, estimator, scores | values, deviation)


def _white(size: int, rng: np.random.Generator) -> np.ndarray:
    return rng.standard_normal(size)


def _student(size: int, rng: np.random.Generator) -> np.ndarray:
    return rng.standard_t(3.0, size) / np.sqrt(3.0)


def _correlated(size: int, rng: np.random.Generator, *, time_constant: float) -> np.ndarray:
    """First-order autoregression of unit variance from its stationary state."""
    from scipy.signal import lfilter

    correlation = np.exp(-_STEP / time_constant)
    shocks = rng.standard_normal(size) * np.sqrt(1.0 - correlation**2)
    shocks[0] /= np.sqrt(1.0 - correlation**2)
    return lfilter([1.0], [1.0, -correlation], shocks)


NOISES = {
    "white": _white,
    "correlated 0.2 s": partial(_correlated, time_constant=0.2),
    "correlated 1 s": partial(_correlated, time_constant=1.0),
    "offsets": _white,
    "Student-t3": _student,
}
"""Sensor noise of unit variance: (size, generator) -> (size,); ``offsets`` adds half to all of the level to each."""


def noisy_trial(clean: xr.Dataset, level: float, noise: str, rng: np.random.Generator) -> xr.Dataset:
    """Trial with noise of the size that :func:`pymc_ship.pollute` gives, of another kind."""
    trial = clean.copy()
    for name in SENSORS:
        values = clean[name].values
        peak = level * np.abs(values).max()
        seen = values + FACTORS[name] * peak * NOISES[noise](values.size, rng)
        if noise == "offsets":
            seen = seen + peak * rng.uniform(0.5, 1.0) * rng.choice((-1.0, 1.0))
        trial[name] = ("time", seen, clean[name].attrs)
        trial.attrs[f"noise_sd_{name}"] = float(FACTORS[name] * peak)
    return trial


def data_set(vessel: Vessel, cell: Cell, level: float, seed: int, *, root: int, duration: float = 400.0) -> DataSet:
    """Simulate the runs of a cell and put the noise of a level on them.

    Parameters
    ----------
    vessel : Vessel
    cell : Cell
    level : float
    seed : int
        Number of the data set.
    root : int
        Root of every random number.
    duration : float, optional
        Of each run [s].

    Returns
    -------
    DataSet
        Without bound.
    """
    empty = DataSet(vessel, cell, level, seed, root, (), ())
    settings = {"method": cell.method, "step": _STEP if cell.method == "euler" else _SMALL_STEP}
    clean = tuple(
        simulate(vessel, manoeuvre, duration=duration, record_interval=_STEP, **settings)
        for manoeuvre in _manoeuvres(vessel, cell.n_designed, duration, empty.rng("rudder"))
    )
    rng = empty.rng("noise")
    return replace(empty, clean=clean, trials=tuple(noisy_trial(one, level, cell.noise, rng) for one in clean))


def _manoeuvres(vessel: Vessel, n_designed: int, duration: float, rng: np.random.Generator) -> list[Manoeuvre]:
    steps = candidate_trials(vessel, duration=duration, rng=rng)["random steps 35"]
    return [zigzag(20, 20), replace(steps, approach_speed=SLOW_SPEED), zigzag(35, 35)][: 1 + n_designed]


def with_bound(data: DataSet) -> DataSet:
    """Data set with the Cramer-Rao bound at the truth: white noise of the true size, initial states unknown."""
    runs, states = [], []
    for clean, trial in zip(data.clean, data.trials, strict=True):
        sd = {name: trial.attrs[f"noise_sd_{name}"] for name in SENSORS}
        run = trajectory_run(clean, data.vessel, noise_sd=sd, method=data.cell.method)
        runs.append(run)
        states.append(run.samples[:, 0])
    return replace(data, bound=identifiability(runs, data.vessel, initial_states=states)["bound"].values)


def _bound(data: DataSet) -> list[Measurement]:
    """Median error that normal, unbiased estimates on the bound would have."""
    from scipy.optimize import brentq
    from scipy.stats import norm

    reference = reference_coefficients(data.vessel)
    relative = 100.0 * data.bound[reference != 0.0] / np.abs(reference[reference != 0.0])
    error = brentq(lambda x: np.mean(2.0 * norm.cdf(x / relative) - 1.0) - 0.5, 0.0, 10.0 * relative.max())
    values = {"median_error": error, "median_sd": float(np.median(relative))}
    deviation = np.full(reference.size, np.nan)
    return [Measurement(data.cell.name, data.level, data.seed, "bound", values, deviation)]


def _mode(data: DataSet, prior: str = "order_damped", **settings) -> TrajectoryMode | None:
    try:
        return trajectory_mode(data.trials, data.vessel, prior, method=data.cell.method, **settings)
    except TrajectoryError:
        return None


def _fitted(data: DataSet, estimator: str, mode: TrajectoryMode | None, **values) -> Measurement:
    """Scores of a fit; one that failed is infinitely wrong and covers nothing."""
    if mode is None:
        size = reference_coefficients(data.vessel).size
        return data.measured(estimator, np.full(size, np.inf), np.full(size, np.nan), failed=1.0, **values)
    fit = mode.choice.fit
    return data.measured(estimator, fit.coefficients, fit.sd, failed=0.0, chi2=fit.chi2, **values)


def _flat(data: DataSet) -> list[Measurement]:
    return [_fitted(data, "flat prior", _mode(data, "flat"))]


def _fit(data: DataSet) -> list[Measurement]:
    return [_fitted(data, "default prior", _mode(data))]


def _white_assumed(data: DataSet) -> list[Measurement]:
    return [_fitted(data, "white assumed", _mode(data, noise="white", offsets=False))]


def _default(data: DataSet) -> list[Measurement]:
    """Fit with all defaults, how many of its starts reach the optimum, and the noise it chose."""
    mode = _mode(data)
    if mode is None:
        return [_fitted(data, "default prior", None, starts=2.0, reaching=0.0)]
    choice = mode.choice
    problem = choice.fit.problem
    reaching = float(mode.n_agreeing)
    if data.cell.noise == "white":
        truth = reference_coefficients(data.vessel)
        best = fit_with_noise(problem.runs, data.vessel, problem.prior, truth).fit
        distance = np.max(np.abs(best.coefficients - choice.fit.coefficients) / choice.fit.sd)
        if distance >= _SAME_MODE and best.log_evidence > choice.fit.log_evidence:
            reaching = 0.0
    chosen = {f"chose_{kind}": float(choice.kind == kind) for kind in ("white", "ar1", "student_t")}
    values = {"starts": float(mode.n_starts), "reaching": reaching, **chosen, "offsets": float(choice.offsets)}
    return [_fitted(data, "default prior", mode, **values)]


def _forecast(data: DataSet) -> list[Measurement]:
    """Fit with all defaults and its forecasts of manoeuvres it has not seen."""
    found, mode = [], _mode(data)
    for name, (manoeuvre, duration) in FORECASTS.items():
        estimator = f"forecast of the {name}"
        if mode is None:
            found.append(_fitted(data, estimator, None, error=np.inf, band_coverage=0.0))
            continue
        rng = data.rng(estimator)
        tree = laplace_posterior(mode, draws=DRAWS, chains=4, rng=rng)
        tree = forecast(data.vessel, tree, manoeuvre, draws=DRAWS, rng=rng, duration=duration, noise_sd={})
        reference = simulate(data.vessel, manoeuvre, duration=duration, record_interval=0.5)
        row = forecast_row(reference, indices(reference), tree)
        values = {key: row[key] for key in ("error", "share_diverged")}
        values |= {"band_coverage": row["coverage"], "share_extrapolated": 100.0 * tree.attrs["share_extrapolated"]}
        found.append(_fitted(data, estimator, mode, **values, **_index_errors(row, name)))
    return found


def _index_errors(row: dict, name: str) -> dict[str, float]:
    """Errors of the medians of the indices: overshoots [deg], tactical diameter [%]."""
    if name == "turn":
        reference = row["tactical_diameter_reference"]
        return {"tactical_diameter_error": 100.0 * abs(row["tactical_diameter_median"] / reference - 1.0)}
    both = [f"{which}_overshoot_angle" for which in ("first", "second")]
    return {f"{index}_error": abs(row[f"{index}_median"] - row[f"{index}_reference"]) for index in both}


def _regression(data: DataSet) -> list[Measurement]:
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
        measured.append(data.measured(name, mean, sd))
        if name == "paper's pipeline":
            plain = np.concatenate([rows.least_squares for rows in found.data.values()])
            measured.append(data.measured("paper's pipeline, least squares", plain))
    return measured


ESTIMATORS: dict[str, Callable[[DataSet], list[Measurement]]] = {
    "bound": _bound,
    "flat": _flat,
    "fit": _fit,
    "default": _default,
    "white assumed": _white_assumed,
    "forecast": _forecast,
    "regression": _regression,
}
"""What can be measured on a data set; ``bound`` comes first where deviations are to be measured by it."""


def measure(vessel: Vessel, cell: Cell, level: float, seed: int, root: int, duration: float) -> list[Measurement]:
    """Simulate one data set and measure every estimator of its cell on it."""
    with threadpool_limits(1):
        data = data_set(vessel, cell, level, seed, root=root, duration=duration)
        if "bound" in cell.estimators:
            data = with_bound(data)
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
        Called with a short text from time to time.

    Returns
    -------
    list of Measurement
        By cell, level, seed and estimator.

    Raises
    ------
    ValueError
        For fewer than two seeds.
    """
    if seeds < 2:
        raise ValueError(
            f"Medians and coverages need two seeds or more, found {seeds}; take at least 25 for a verdict."
        )
    tasks = [(vessel, cell, level, k, seed, duration) for k in range(seeds) for cell in cells for level in cell.levels]
    found: dict[tuple, list[Measurement]] = {}
    for task, measurements in _measured(tasks, workers):
        found[task[1].name, task[2], task[3]] = measurements
        progress(_bar(len(found), len(tasks)))
    order = [(cell.name, level, k) for cell in cells for level in cell.levels for k in range(seeds)]
    return [measurement for key in order for measurement in found[key]]


def _measured(tasks: Sequence[tuple], workers: int) -> Iterator[tuple[tuple, list[Measurement]]]:
    """Tasks with their measurements as they are completed."""
    if workers == 1:
        for task in tasks:
            yield task, measure(*task)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _ignore_interrupts) as pool:
        try:
            futures = {pool.submit(measure, *task): task for task in tasks}
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _ignore_interrupts() -> None:
    """Leave an interrupt to the parent process, which ends the workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _bar(done: int, total: int, width: int = 30) -> str:
    filled = width * done // total
    return f"{'█' * filled}{'░' * (width - filled)} {done} of {total} data sets"
