"""Fits a model to many short windows of several runs; each window is restarted from its own initial state.

Over a whole run the small errors of a model of a real ship add up until they say nothing about its coefficients; a
course-unstable ship runs away from its own record. Over windows of five ship lengths the model is judged by what a
forecast needs, its motion, and no window can hide behind another's errors. The initial state of each window is a
nuisance; the noise of a channel is what the windows leave of it. Those residuals are model error, the same for seconds
on end: beside the prior the windows count for as much as the scatter of their gradients says (Ribatet, Cooley &
Davison 2012, doi:10.5705/ss.2009.248), and the covariance is that of those gradients (sandwich estimator).

The prior of each coefficient is Student's t: where the records contradict it, it gives way, and no other coefficient
has to make up for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.signal import savgol_filter

from pymc_ship.inference.trajectory.fit import Noise, Problem, TrajectoryFit, fit_trajectory, initial_problem, run_rows
from pymc_ship.inference.trajectory.mode import TrajectoryMode
from pymc_ship.inference.trajectory.noise import NoiseChoice, residual_tests
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.inference.trajectory.runs import Run, trajectory_run
from pymc_ship.machine.errors import FitError, TrialError
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.inputs import recorded_inputs
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.parts import FIXED_SD
from pymc_ship.physics.vessel.vessel import Vessel, per_run_indices
from pymc_ship.trial.channels import CHANNELS, default_channels
from pymc_ship.trial.record import sampling_interval

LENGTH = 5.0
"""Length of a window in L/U_nom, which is about the ship lengths it covers."""

SAMPLES = 50
"""Samples in L/U_nom; a faster record is averaged over so many."""

HEADING = STATE.index("psi")

_BLOCKS = 30  # in L/U, of the comparison
_STEPS = 60  # in L/U, of the integration at least
_SMOOTHED = 0.5  # L/U, under which a local cubic gives the state a window restarts from
_SMOOTHING = 4.0 / np.sqrt(_SMOOTHED)  # error of that at the end of a record, for a scatter of 1 and 1 sample in L/U
_FIRST_SD = {"m/s": 0.01, "rad/s": 0.02, "rad": 0.01}  # by unit: of the speed, of U/L, or rad
_CHANGE = 1e-2  # of the log posterior: no step for less
_EXACT = 1e-3  # of the first sd: a simulated record without errors leaves no less
_PASSES = 10
_SETTLED = 0.03


@dataclass(frozen=True)
class Window:
    """A window as a run of a trajectory fit, and the number of the trial that it is a piece of."""

    run: Run
    trial: int = 0

    @property
    def state(self) -> np.ndarray:
        """State it restarts from, that of the smoothed record, (n_states,)."""
        return self.run.initial_state[0]


@dataclass(frozen=True)
class WindowFit:
    """Coefficients that fit windows of several runs.

    Attributes
    ----------
    vessel : Vessel
    coefficients : ndarray, shape (n_coefficients,)
    from_windows, from_prior : ndarray, shape (n_coefficients, n_coefficients)
        Parts of the covariance: the scatter of the estimate over windows like these, with the model error that differs
        between them, and what the prior leaves open.
    information : ndarray, shape (n_coefficients, n_coefficients)
        Curvature of the negative log posterior, the initial states profiled out.
    channel_sd : dict of str to float
        Root mean square that the windows leave of each channel, SI.
    design_effect : float
        How many times less the windows count beside the prior than residuals independent of each other would.
    n_windows : int
    mode : TrajectoryFit or None
        The fit itself, from which draws are carried on, with the normal priors that stand for Student's t; None where
        the law stands for no windows.
    """

    vessel: Vessel
    coefficients: np.ndarray
    from_windows: np.ndarray
    from_prior: np.ndarray
    information: np.ndarray
    channel_sd: dict[str, float]
    design_effect: float
    n_windows: int
    mode: TrajectoryFit | None = None

    @property
    def prior(self) -> CoefficientPrior:
        """Prior of the fit, with the normal priors that stand for Student's t."""
        if self.mode is None:
            raise ValueError("A law has a prior where it stands for windows, found none; fit windows.")
        return self.mode.problem.prior

    @property
    def spread(self) -> dict[str, float]:
        """Spread under which the windows count, by channel, SI: what they leave times the root of the dispersion."""
        return {name: sd * float(np.sqrt(self.design_effect)) for name, sd in self.channel_sd.items()}

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the coefficients, both parts together."""
        return self.from_windows + self.from_prior


def thinned(trial: xr.Dataset, vessel: Vessel) -> xr.Dataset:
    """Record of a trial at :data:`SAMPLES` in L/U_nom, by means of samples; as it is where it is slower.

    Raises
    ------
    TrialError
        For a record shorter than one window.
    """
    unit, step = vessel.particulars.ship_time, sampling_interval(trial)
    count = max(int(unit / SAMPLES / step + 1e-6), 1)
    size = round(LENGTH * unit / (count * step))
    if trial["time"].size // count < max(size // 2, 1):
        raise TrialError(
            f"A run to identify a ship from lasts half a window of {LENGTH:g} L/U = {LENGTH * unit:.3g} s at least, "
            f"found {trial['time'].size * step:.3g} s; use a longer one."
        )
    for name in ("psi", "wind_direction"):
        if name in trial:
            trial = trial.assign({name: ("time", np.unwrap(trial[name].values), trial[name].attrs)})
    return trial if count == 1 else trial.coarsen(time=count, boundary="trim").mean(keep_attrs=True)


def window_records(trial: xr.Dataset, vessel: Vessel) -> list[xr.Dataset]:
    """Windows of a thinned record, one after the other; a rest of half a window or more is one, too."""
    unit = vessel.particulars.ship_time
    size = round(LENGTH * unit / sampling_interval(trial))
    begins = range(0, trial["time"].size - size // 2 + 1, size)
    return [trial.isel(time=slice(begin, begin + size)) for begin in begins]


def prepared_windows(trial: xr.Dataset, vessel: Vessel, number: int = 0) -> list[Window]:
    """Windows of a thinned record, the trial of this number, for the fit and the score of a vessel's model."""
    unit, step = vessel.particulars.ship_time, sampling_interval(trial)
    channels = default_channels(rolling="roll" in vessel.dofs)
    size = {"m/s": vessel.particulars.nominal_speed, "rad/s": 1.0 / unit, "rad": 1.0}
    units = {name: CHANNELS[name].unit.name for name in channels}
    sd = {name: _FIRST_SD[of] * size[of] for name, of in units.items()}
    block, substeps = max(round(unit / _BLOCKS / step), 1), substeps_of(step, vessel)
    smooth = trial.assign({name: ("time", smoothed_channel(trial[name].values, unit / step)) for name in channels})
    scatter = {name: _SMOOTHING / np.sqrt(unit / step) * np.std(trial[name] - smooth[name]) for name in channels}
    inputs = xr.DataArray(recorded_inputs(trial, vessel), dims=("input", "time"))
    smooth = smooth.assign(inputs=inputs)
    found = []
    for window, start in zip(window_records(trial, vessel), window_records(smooth, vessel), strict=True):
        run = trajectory_run(window, vessel, channels=channels, noise_sd=sd)
        run = replace(run, inputs=np.ascontiguousarray(start["inputs"].values), block=block, substeps=substeps)
        state, spread = (values.copy() for values in run.initial_state)
        state[list(run.rows)] = [start[name].values[0] for name in channels]
        spread[list(run.rows)] = [np.hypot(sd[name], scatter[name]) for name in channels]
        if run.heads:
            state[HEADING], spread[HEADING] = start["psi"].values[0], _FIRST_SD["rad"]
        found.append(Window(replace(run, restart=(state, spread)), number))
    return found


def substeps_of(step: float, vessel: Vessel) -> int:
    """Steps of the integration in a sampling interval [s] of a record."""
    return int(np.ceil(_STEPS * step / vessel.particulars.ship_time))


def restarted(window: Window, vessel: Vessel, coefficients: np.ndarray) -> np.ndarray:
    """Misfit of a window restarted from its measured state: record minus simulation, shape (n_channels, n_blocks).

    NaN where the ship left the model's range.
    """
    run = window.run
    motion = replay(vessel, run.inputs, window.state, coefficients, block=run.block, **run.integration)
    return run.means - motion[list(run.rows), 0]


def smoothed_channel(values: np.ndarray, unit: float) -> np.ndarray:
    """Channel smoothed by a local cubic over half an L/U, which is ``unit`` samples."""
    size = max(round(_SMOOTHED * unit) | 1, 5)
    return savgol_filter(values, size, 3) if size <= values.size else values


def fit_windows(
    windows: Sequence[Window],
    vessel: Vessel,
    prior: CoefficientPrior,
    start: np.ndarray,
    sd: dict[str, float] | None = None,
) -> WindowFit:
    """Fit coefficients to windows, whose noise is what they leave of each channel times the dispersion of windows.

    Parameters
    ----------
    windows : sequence of Window
        From :func:`prepared_windows`, of one or many trials; all have the same channels.
    vessel : Vessel
    prior : CoefficientPrior
        Scales of Student's t, taken as stated: they are not tuned.
    start : ndarray, shape (n_coefficients,)
    sd : dict of str to float, optional
        First guess of the spread under which windows count, by channel, SI; by default what the start leaves of them.

    Returns
    -------
    WindowFit

    Raises
    ------
    FitError
        When the start leaves the model's range or no minimum is found.
    """
    fit, noise_sd, design_effect = _settled(windows, vessel, prior, start, sd)
    from_windows, from_prior = _sandwich(fit)
    return WindowFit(
        vessel=vessel,
        coefficients=fit.coefficients,
        from_windows=from_windows,
        from_prior=from_prior,
        information=np.linalg.inv(fit.covariance),
        channel_sd=dict(zip(windows[0].run.channels, noise_sd.tolist(), strict=True)),
        design_effect=design_effect,
        n_windows=len(windows),
        mode=fit,
    )


def window_mode(
    windows: Sequence[Window], vessel: Vessel, prior: CoefficientPrior, start: np.ndarray
) -> TrajectoryMode:
    """Mode of windows under the spread with which they count, for draws by the normal approximation and by NUTS.

    Parameters and errors as :func:`fit_windows`. The sandwich is not in it: draws are those of prior and likelihood.
    """
    fit, _, design_effect = _settled(windows, vessel, prior, start)
    sentence = f"what the windows leave of each channel, times the root of their dispersion {design_effect:.3g}"
    return TrajectoryMode(NoiseChoice(fit, "white", False, np.inf, residual_tests(fit), sentence), 1, 1, {})


def _settled(
    windows: Sequence[Window],
    vessel: Vessel,
    prior: CoefficientPrior,
    start: np.ndarray,
    sd: dict[str, float] | None = None,
) -> tuple[TrajectoryFit, np.ndarray, float]:
    """Fit, what the windows leave of each channel (n_channels,) and their dispersion, in turns with the prior."""
    runs = [window.run for window in windows]
    stated = replace(prior, tuned=np.zeros_like(prior.tuned))
    sailed = np.unique([window.trial for window in windows], return_inverse=True)[1]
    problem = replace(initial_problem(runs, vessel, stated), sailed=tuple(sailed.tolist()))
    constants = problem.center[problem.n_coefficients : problem.n_shared]
    unknowns = np.concatenate([start, constants, *(window.state for window in windows)])
    least = _EXACT * runs[0].sample_sd
    spread = np.array([sd[name] for name in runs[0].channels]) if sd else _left_by(windows, vessel, start)
    spread = np.maximum(spread, least)
    for _ in range(_PASSES):
        fit = fit_trajectory(_with_noise(problem, spread), unknowns, _CHANGE)
        square = np.sum([np.sum(values**2, axis=1) for values in fit.residuals], axis=0)
        noise_sd = np.maximum(spread * np.sqrt(square / sum(run.n_blocks for run in runs)), least)
        design_effect = max(_design_effect(fit) * float(np.exp(2.0 * np.mean(np.log(spread / noise_sd)))), 1.0)
        ratio, unknowns = noise_sd * np.sqrt(design_effect) / spread, fit.unknowns
        robust = stated.as_normal_at(fit.coefficients, fit.sd)
        changes = np.log(np.r_[ratio, robust.scale / problem.prior.scale])
        if np.max(np.abs(changes)) < _SETTLED:
            break
        problem, spread = replace(problem, prior=robust), spread * ratio
    return fit, noise_sd, design_effect


def _left_by(windows: Sequence[Window], vessel: Vessel, coefficients: np.ndarray) -> np.ndarray:
    """Root mean square that coefficients leave of each channel in the windows that stay in the model's range."""
    square = np.array([np.mean(restarted(window, vessel, coefficients) ** 2, axis=1) for window in windows])
    stayed = np.isfinite(square).all(axis=1)
    return np.sqrt(np.mean(square[stayed], axis=0)) if stayed.any() else windows[0].run.sample_sd


def _with_noise(problem: Problem, sd: np.ndarray) -> Problem:
    """Problem with white noise of an sd for each channel."""
    noise = tuple(Noise(sd, np.zeros(sd.size), offsets=False, values=run.means) for run in problem.runs)
    return replace(problem, noise=noise)


def _design_effect(fit: TrajectoryFit) -> float:
    """Variance of the gradients of whole windows over that of residuals independent of each other.

    The mean over the directions in which the windows, not the prior, determine the coefficients: tr(C G) / tr(C H),
    with G the sum of squared gradients and H = C^-1 - P the curvature that is the windows' own.
    """
    C, G, P = _shared_covariance(fit), _squared_gradients(fit), _prior_precision(fit)
    return float(np.trace(C @ G) / (len(C) - np.trace(C @ P)))


def _shared_covariance(fit: TrajectoryFit) -> np.ndarray:
    """Posterior covariance of the unknowns that runs share, (n_shared, n_shared)."""
    root = fit.square_root[: fit.problem.n_shared]
    return root @ root.T


def _sandwich(fit: TrajectoryFit) -> tuple[np.ndarray, np.ndarray]:
    """Parts C G C and C P C of the covariance: G the sum of squared gradients of the windows, P prior precision.

    White (1982), doi:10.2307/1912526, with windows as clusters and the prior as one more observation; C is the
    posterior covariance that residuals independent of each other would give.
    """
    C, n = _shared_covariance(fit), fit.problem.n_coefficients
    parts = ((C @ middle @ C)[:n, :n] for middle in (_squared_gradients(fit), _prior_precision(fit)))
    from_windows, from_prior = (0.5 * (part + part.T) for part in parts)
    own = fit.problem.per_run
    from_prior[own], from_prior[:, own] = 0.0, 0.0
    return from_windows, from_prior


def _prior_precision(fit: TrajectoryFit) -> np.ndarray:
    """Prior precision of the unknowns that runs share, what other data state included, (n_shared, n_shared)."""
    n = fit.problem.n_shared
    rows = fit.problem.likelihood_design[:, :n]
    return np.diag(fit.problem.precision[:n] / fit.problem.unit[:n] ** 2) + rows.T @ rows


def _squared_gradients(fit: TrajectoryFit) -> np.ndarray:
    """Sum over windows of g g', g the gradient of a window's log likelihood, times n / (n - 1) of n windows."""
    problem: Problem = fit.problem
    n, gradients = problem.n_coefficients, []
    pieces = zip(problem.runs, problem.noise, problem.columns, problem.nuisances, strict=True)
    for run, noise, columns, place in pieces:
        rows = run_rows(problem.vessel, run, noise, fit.unknowns[columns], fit.unknowns[place])
        gradient = np.zeros(problem.n_shared)
        gradient[columns] = sum(design[:, :n].T @ misfit for misfit, design in rows)
        gradients.append(gradient)
    g, count = np.array(gradients), len(gradients)
    return g.T @ g * (count / max(count - 1, 1))


def with_constants(windows: Sequence[Window], fit: WindowFit) -> np.ndarray:
    """Coefficients of a fit with the constants of a trial, such as its current, that windows of it call for.

    Parameters
    ----------
    windows : sequence of Window
        Of one trial.
    fit : WindowFit
        Its other coefficients stay.

    Returns
    -------
    ndarray, shape (n_coefficients,)
        Those of the fit where the vessel has no such constants, or none are found.
    """
    own = per_run_indices(fit.vessel)
    if not own:
        return fit.coefficients
    scale = np.full(fit.coefficients.size, FIXED_SD)
    scale[own] = [parameter.sd for parameter in fit.vessel.parameters if parameter.per_run]
    held = CoefficientPrior(fit.coefficients, scale, scale, np.zeros(scale.size, dtype=bool), "held")
    problem = initial_problem([window.run for window in windows], fit.vessel, held)
    spread = np.array(list(fit.spread.values()))
    unknowns = np.concatenate([fit.coefficients, *(window.state for window in windows)])
    try:
        return fit_trajectory(_with_noise(problem, spread), unknowns, _CHANGE).coefficients
    except FitError:
        return fit.coefficients


def widened(fit: WindowFit, factor: float) -> WindowFit:
    """Fit whose covariance from the windows is multiplied by a factor.

    The part of the covariance that comes from the prior stays.
    """
    return replace(fit, from_windows=factor**2 * fit.from_windows)


def normal_draws(fit: WindowFit, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws (count, n_coefficients) from the normal law of a fit.

    They are standard normal numbers times the symmetric root of the correlations, which changes no more than the
    covariance does; eigenvectors or a triangular root would depend on units, order or the last digit.
    """
    sd = np.sqrt(np.diag(fit.covariance))
    unit = np.where(sd > 0.0, sd, 1.0)
    values, vectors = np.linalg.eigh(fit.covariance / np.outer(unit, unit))
    root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return fit.coefficients + rng.standard_normal((count, values.size)) @ root * sd
