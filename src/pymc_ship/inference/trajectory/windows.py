"""Fit of a model to short windows of several runs, each simulated from its own initial state.

Residuals are serially correlated: the log likelihood is divided by a design effect (Ribatet, Cooley & Davison 2012,
doi:10.5705/ss.2009.248). The prior is Student's t, the covariance a sandwich.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
import xarray as xr

from pymc_ship.inference.trajectory.fit import Problem, TrajectoryFit, fit_trajectory, initial_problem
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.inference.trajectory.runs import Run, trajectory_run
from pymc_ship.machine.errors import FitError, ShipError, TrialError
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.inputs import recorded_inputs
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.parts import FIXED_SD
from pymc_ship.physics.vessel.vessel import Vessel, per_run_indices
from pymc_ship.trial.channels import CHANNELS, default_channels
from pymc_ship.trial.record import sampling_interval

LENGTH = 5.0  # length of a window [L/U_nom]
SAMPLES = 50  # samples in L/U_nom; means of faster records are taken
HEADING = STATE.index("psi")
_BLOCKS = 30  # blocks compared in L/U
_STEPS = 30  # least integration steps in L/U
_SMOOTHED = 0.5  # L/U, length of the local cubic for the initial state of a window
_SMOOTHING = 4.0 / np.sqrt(_SMOOTHED)  # its sd at the end of a record, for unit noise and 1 sample in L/U
_FIRST_SD = {"m/s": 0.01, "rad/s": 0.02, "rad": 0.01}  # initial sd by unit: fraction of U, of U/L, or rad
_CHANGE = 1e-3  # convergence of the log posterior
_LEAST_SD = 1e-3  # least sd as a fraction of _FIRST_SD
_PASSES, _CONVERGED = 20, 0.01  # passes, and the change of a log sd that ends them


@dataclass(frozen=True)
class Window:
    """Window as a run of a trajectory fit, with the number of its trial."""

    run: Run
    trial: int = 0

    @property
    def state(self) -> np.ndarray:
        """Initial state by the smoothed record, (n_states,)."""
        return self.run.initial_state[0]


@dataclass(frozen=True)
class WindowFit:
    """Coefficients (n_coefficients,) fitted to windows of several runs."""

    vessel: Vessel
    coefficients: np.ndarray
    from_windows: np.ndarray  # part of the covariance by the scatter of the windows' gradients
    from_prior: np.ndarray  # part of the covariance by the prior
    information: np.ndarray  # curvature of the negative log posterior with initial states profiled out
    channel_sd: dict[str, float]  # root mean square residual of each channel, SI
    design_effect: float  # variance of the gradients of windows over that of independent residuals
    n_windows: int
    mode: TrajectoryFit | None = None  # with normal priors equivalent to Student's t; None for a law without windows

    @property
    def mode_of_windows(self) -> TrajectoryFit:
        """The mode; ShipError without windows."""
        if self.mode is None:
            raise ShipError(
                "The prior is known for a fit to windows, found a normal law without windows; use fit_windows."
            )
        return self.mode

    @property
    def prior(self) -> CoefficientPrior:
        """Prior of the fit: the normal prior equivalent to Student's t."""
        return self.mode_of_windows.problem.prior

    @property
    def effective_sd(self) -> dict[str, float]:
        """Sd of the likelihood of each channel, SI: root mean square residual times the root of the design effect."""
        return {name: sd * float(np.sqrt(self.design_effect)) for name, sd in self.channel_sd.items()}

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the coefficients: sum of both parts."""
        return self.from_windows + self.from_prior


def thin_record(trial: xr.Dataset, vessel: Vessel) -> xr.Dataset:
    """Record of a trial averaged to :data:`SAMPLES` in L/U_nom; TrialError if shorter than half a window."""
    unit, step = vessel.particulars.ship_time, sampling_interval(trial)
    count = max(int(unit / SAMPLES / step + 1e-6), 1)
    size = round(LENGTH * unit / (count * step))
    if trial["time"].size // count < max(size // 2, 1):
        raise TrialError(
            f"A run to identify a ship from lasts half a window of {LENGTH:g} L/U = {LENGTH * unit:.3g} s at least, "
            f"found {trial['time'].size * step:.3g} s; use a longer run."
        )
    for name in ("psi", "wind_direction"):
        if name in trial:
            trial = trial.assign({name: ("time", np.unwrap(trial[name].values), trial[name].attrs)})
    return trial if count == 1 else trial.coarsen(time=count, boundary="trim").mean(keep_attrs=True)


def window_records(trial: xr.Dataset, vessel: Vessel) -> list[xr.Dataset]:
    """Consecutive windows of a thinned record; a remainder of half a window or more is also one."""
    unit = vessel.particulars.ship_time
    size = round(LENGTH * unit / sampling_interval(trial))
    begins = range(0, trial["time"].size - size // 2 + 1, size)
    return [trial.isel(time=slice(begin, begin + size)) for begin in begins]


def prepared_windows(trial: xr.Dataset, vessel: Vessel, number: int = 0) -> list[Window]:
    """Windows of a thinned record, which is trial ``number``, for fits and scores."""
    unit, step = vessel.particulars.ship_time, sampling_interval(trial)
    channels = default_channels(rolling="roll" in vessel.dofs)
    size = {"m/s": vessel.particulars.nominal_speed, "rad/s": 1.0 / unit, "rad": 1.0}
    units = {name: CHANNELS[name].unit.name for name in channels}
    sd = {name: _FIRST_SD[of] * size[of] for name, of in units.items()}
    block, substeps = max(round(unit / _BLOCKS / step), 1), substeps_of(step, vessel)
    smooth = trial.assign({name: ("time", smoothed_channel(trial[name].values, unit / step)) for name in channels})
    scatter = {name: _SMOOTHING / np.sqrt(unit / step) * np.std(trial[name] - smooth[name]) for name in channels}
    smooth = smooth.assign(inputs=(("input", "time"), recorded_inputs(trial, vessel)))
    windows = []
    for record, start in zip(window_records(trial, vessel), window_records(smooth, vessel), strict=True):
        run = trajectory_run(record, vessel, channels=channels, noise_sd=sd)
        run = replace(run, inputs=np.ascontiguousarray(start["inputs"].values), block=block, substeps=substeps)
        state, spread = (values.copy() for values in run.initial_state)
        state[list(run.rows)] = [start[name].values[0] for name in channels]
        spread[list(run.rows)] = [np.hypot(sd[name], scatter[name]) for name in channels]
        if run.heads:
            state[HEADING], spread[HEADING] = start["psi"].values[0], _FIRST_SD["rad"]
        windows.append(Window(replace(run, restart=(state, spread)), number))
    return windows


def substeps_of(step: float, vessel: Vessel) -> int:
    """Integration steps in a sampling interval ``step`` [s]."""
    return int(np.ceil(_STEPS * step / vessel.particulars.ship_time))


def window_misfit(window: Window, vessel: Vessel, coefficients: np.ndarray) -> np.ndarray:
    """Record minus simulation of a window from its initial state, (n_channels, n_blocks); NaN where it diverges."""
    run = window.run
    motion = replay(vessel, run.inputs, window.state, coefficients, block=run.block, **run.integration)
    return run.means - motion[list(run.rows), 0]


def smoothed_channel(values: np.ndarray, unit: float) -> np.ndarray:
    """Channel smoothed by a local cubic over half an L/U; ``unit`` is the samples in L/U."""
    size = max(round(_SMOOTHED * unit) | 1, 5)
    return scipy.signal.savgol_filter(values, size, 3) if size <= values.size else values


def fit_windows(
    windows: Sequence[Window],
    vessel: Vessel,
    prior: CoefficientPrior,
    start: np.ndarray | WindowFit,
) -> WindowFit:
    """Fit coefficients to windows of one or many trials; FitError when the start diverges or no minimum is reached.

    ``start``: coefficients (n_coefficients,), or a fit to these windows or more.
    """
    fit, noise_sd, design_effect = _iterated_fit(windows, vessel, prior, start)
    covariance, n, own = _shared_covariance(fit), fit.problem.n_coefficients, fit.problem.per_run
    # sandwich covariance C (G + P) C (White 1982, doi:10.2307/1912526); windows are clusters
    middles = (_squared_gradients(fit), _prior_precision(fit))
    parts = ((covariance @ middle @ covariance)[:n, :n] for middle in middles)
    from_windows, from_prior = (0.5 * (part + part.T) for part in parts)
    from_prior[own], from_prior[:, own] = 0.0, 0.0
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


def _iterated_fit(
    windows: Sequence[Window], vessel: Vessel, prior: CoefficientPrior, start: np.ndarray | WindowFit
) -> tuple[TrajectoryFit, np.ndarray, float]:
    """Fit, root mean square residual of each channel (n_channels,) and design effect, iterated to convergence."""
    runs = [window.run for window in windows]
    fixed_prior = prior.fixed
    trial_indices = np.unique([window.trial for window in windows], return_inverse=True)[1]
    problem = replace(initial_problem(runs, vessel, fixed_prior), trial_indices=tuple(trial_indices.tolist()))
    least = _LEAST_SD * runs[0].sample_sd
    if isinstance(start, WindowFit):
        spread = np.array([start.effective_sd[name] for name in runs[0].channels])
        problem = replace(problem, prior=replace(fixed_prior, scale=start.prior.scale))
        unknowns = _unknowns_of(start.mode_of_windows, problem)
    else:
        spread = _rms_residual(windows, vessel, start)
        unknowns = np.r_[start, problem.center[start.size :]]
    spread, rows = np.maximum(spread, least), None
    for _ in range(_PASSES):
        fit = fit_trajectory(problem.with_noise_sd(spread), unknowns, _CHANGE, rows)
        square = np.sum([np.sum(values**2, axis=1) for values in fit.residuals], axis=0)
        noise_sd = np.maximum(spread * np.sqrt(square / sum(run.n_blocks for run in runs)), least)
        design_effect = max(_design_effect(fit) * float(np.exp(2.0 * np.mean(np.log(spread / noise_sd)))), 1.0)
        ratio, unknowns = noise_sd * np.sqrt(design_effect) / spread, fit.unknowns
        robust = fixed_prior.as_normal_at(fit.coefficients, fit.sd)
        changes = np.log(np.r_[ratio, robust.scale / problem.prior.scale])
        if np.max(np.abs(changes)) < _CONVERGED:
            break
        problem, spread = replace(problem, prior=robust), spread * ratio
        rows = [run.with_noise_times(ratio) for run in fit.point.runs]
    return fit, noise_sd, design_effect


def _unknowns_of(mode: TrajectoryFit, problem: Problem) -> np.ndarray:
    """Unknowns of a problem (n_unknowns,) at the mode of another, which has its runs and maybe more."""
    unknowns, numbers = problem.center, {id(run): k for k, run in enumerate(mode.problem.runs)}
    unknowns[: problem.n_coefficients] = mode.coefficients
    theirs = list(zip(mode.problem.columns, mode.problem.nuisances, strict=True))
    for run, columns, nuisances in zip(problem.runs, problem.columns, problem.nuisances, strict=True):
        of_run = theirs[numbers[id(run)]]
        unknowns[columns], unknowns[nuisances] = (mode.unknowns[indices] for indices in of_run)
    return unknowns


def _rms_residual(windows: Sequence[Window], vessel: Vessel, coefficients: np.ndarray) -> np.ndarray:
    """Root mean square residual of each channel over the windows that do not diverge."""
    square = np.array([np.mean(window_misfit(window, vessel, coefficients) ** 2, axis=1) for window in windows])
    finite = np.isfinite(square).all(axis=1)
    return np.sqrt(np.mean(square[finite], axis=0)) if finite.any() else windows[0].run.sample_sd


def _design_effect(fit: TrajectoryFit) -> float:
    """Design effect tr(C G) / (n - tr(C P)); G squared gradients of windows, P prior precision, C covariance."""
    C, G, P = _shared_covariance(fit), _squared_gradients(fit), _prior_precision(fit)
    return float(np.trace(C @ G) / (len(C) - np.trace(C @ P)))


def _shared_covariance(fit: TrajectoryFit) -> np.ndarray:
    """Posterior covariance of the unknowns that runs share, (n_shared, n_shared)."""
    root = fit.square_root[: fit.problem.n_shared]
    return root @ root.T


def _prior_precision(fit: TrajectoryFit) -> np.ndarray:
    """Precision of the shared unknowns by the prior and the likelihood of other data, (n_shared, n_shared)."""
    n = fit.problem.n_shared
    rows = fit.problem.likelihood_design[:, :n]
    return np.diag(fit.problem.precision[:n] / fit.problem.unit[:n] ** 2) + rows.T @ rows


def _squared_gradients(fit: TrajectoryFit) -> np.ndarray:
    """Sum over windows of g g' times n / (n - 1), g the gradient of a window's log likelihood."""
    g, count = fit.gradients, len(fit.gradients)
    return g.T @ g * (count / max(count - 1, 1))


def with_constants(windows: Sequence[Window], fit: WindowFit) -> np.ndarray:
    """Coefficients of a fit with the constants of one trial, such as its current, fitted to the windows of that trial.

    Those of the fit where the vessel has no such constants, or their fit fails.
    """
    own = per_run_indices(fit.vessel)
    if not own:
        return fit.coefficients
    scale = np.full(fit.coefficients.size, FIXED_SD)
    scale[own] = [parameter.sd for parameter in fit.vessel.parameters if parameter.per_run]
    fixed_others = CoefficientPrior(fit.coefficients, scale, scale, "fixed")
    problem = initial_problem([window.run for window in windows], fit.vessel, fixed_others)
    spread = np.array(list(fit.effective_sd.values()))
    unknowns = np.concatenate([fit.coefficients, *(window.state for window in windows)])
    try:
        return fit_trajectory(problem.with_noise_sd(spread), unknowns, _CHANGE).coefficients
    except FitError:
        return fit.coefficients


def inflate_covariance(fit: WindowFit, factor: float) -> WindowFit:
    """Fit with the sd from the windows multiplied by a factor; the part from the prior stays."""
    return replace(fit, from_windows=factor**2 * fit.from_windows)


def normal_draws(fit: WindowFit, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws (count, n_coefficients) from the normal approximation, by the symmetric root of the correlation matrix."""
    sd = np.sqrt(np.diag(fit.covariance))
    unit = np.where(sd > 0.0, sd, 1.0)
    values, vectors = np.linalg.eigh(fit.covariance / np.outer(unit, unit))
    root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return fit.coefficients + rng.standard_normal((count, values.size)) @ root * sd
