"""Which manoeuvre to run next: the expected gain of candidate runs and the accuracy they promise, before going to sea.

Each candidate is simulated in closed loop with the posterior mean and some posterior draws; the Fisher information
along the rudder record that results, with the initial state as a nuisance, is added to the posterior precision. Runs
are chosen one after the other. Uncertainty is carried as roots L, L L' = covariance, and information as R, R' R: the
singular values s of R L give the gain, sum log(1 + s^2), and the root that is left, L V (1 + s^2)^-1/2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from pymc_ship.inference.identifiability.information import information_root
from pymc_ship.inference.trajectory.fit import Noise, TrajectoryFit
from pymc_ship.inference.trajectory.runs import Run, trajectory_run
from pymc_ship.machine.errors import SimulationError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, turning_circle, zigzag
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names, reference_coefficients
from pymc_ship.records.files.noise import noise_factors
from pymc_ship.records.files.noise import noise_sd as noise_size
from pymc_ship.ships.design.candidates import NextRun, candidate_trials, labelled_trials
from pymc_ship.ships.design.closed_loop import STEP, closed_loop_sensitivities, straight_course
from pymc_ship.ships.forecasting.draws import coefficient_draws
from pymc_ship.ships.forecasting.stopping import StoppingTest
from pymc_ship.trial.channels import channel_names, sensors

CRITERIA = ("information", "forecast")
"""Greatest log determinant of the posterior precision (D-optimal), or least variance of forecast manoeuvres."""

_THINNING = 5  # samples of a forecast, for one that is scored


@dataclass(frozen=True)
class _Knowledge:
    """Posterior mean (n,), root (n, n) of the covariance and the points (n_points, n) to linearise at."""

    mean: np.ndarray
    root: np.ndarray
    points: np.ndarray


@dataclass(frozen=True)
class _Sensors:
    """Noise of the runs to come: sd (n_channels,) of values ``spacing`` [s] apart, or the noise level of each run."""

    channels: tuple[str, ...]
    level: float | None
    sd: np.ndarray
    correlation: np.ndarray
    offsets: bool
    spacing: float

    def noisy(self, ship: xr.Dataset, vessel: Vessel) -> tuple[Run, Noise]:
        """Simulated ship as a run, and the noise of its blocks."""
        run = trajectory_run(ship, vessel, channels=self.channels, noise_sd=dict.fromkeys(self.channels, 1.0))
        run = replace(run, block=max(run.block, round(self.spacing / STEP)))
        sd = self.sd
        if self.level is not None:
            factors = noise_factors()
            sd = np.array([self.level * factors[name] * np.abs(ship[name].values).max() for name in self.channels])
            sd[sd == 0.0] = np.inf  # noise is a share of the peak: a channel that stays 0 tells nothing
        sd = sd * np.sqrt(self.spacing / (run.block * STEP))
        return run, Noise(sd, self.correlation, self.offsets, run.means)


def design_trials(
    vessel: VesselLike,
    posterior: xr.DataTree | TrajectoryFit | tuple[np.ndarray, np.ndarray],
    candidates: Mapping[str, NextRun] | Sequence[NextRun] | None = None,
    n: int = 2,
    *,
    rng: Seed,
    criterion: str = "information",
    interest: Sequence[Manoeuvre] | None = None,
    level: float | None = None,
    noise_sd: Mapping[str, float] | None = None,
    draws: int = 8,
    duration: float = 400.0,
    interval: float = 0.02,
) -> xr.Dataset:
    """Choose the runs that will tell most, one after the other, and predict what they leave unknown.

    Parameters
    ----------
    vessel : Vessel, str or Path
        Its reference coefficients are the scale of relative accuracies only.
    posterior : DataTree, TrajectoryFit or (mean, covariance)
        What is known of the coefficients of all DOFs: joint draws, a fit, or shapes (n,) and (n, n).
    candidates : mapping of str to Manoeuvre or sequence of Manoeuvre, optional
        :func:`candidate_trials` by default; a :class:`pymc_ship.StoppingTest` is one, too. A candidate can be chosen
        again.
    n : int, optional
        Runs to choose.
    rng : int, SeedSequence or Generator
    criterion : {"information", "forecast"}, optional
        Greatest expected log determinant of the posterior precision, or least expected variance of the forecast
        trajectories of ``interest``: u, v, r, phi and psi relative to their ranges, mean over channels and time.
    interest : sequence of Manoeuvre, optional
        Manoeuvres to forecast well; the 10/10 zigzag and the 35 deg turn by default.
    level : float, optional
        Noise level of the runs to come, with the factors of :func:`pymc_ship.pollute` and the peaks of each run.
    noise_sd : mapping of str to float, optional
        In its place, the standard deviation of single samples by channel [SI], which names the channels measured. By
        default noise, with its correlation and offsets, is what the posterior found in its last run.
    draws : int, optional
        Posterior draws to average over, beside the mean.
    duration : float, optional
        Of every run [s].
    interval : float, optional
        Sampling interval that ``level`` and ``noise_sd`` are meant for [s].

    Returns
    -------
    Dataset, dims (step, candidate, stage, coefficient)
        Over step and candidate: ``gain``, the rise of the log determinant or the fall of the log variance; what the
        candidate leaves: ``relative_sd`` [%, median over coefficients whose reference is not 0] and ``shrinkage``
        (geometric mean of the factors by which standard deviations fall in this step). ``chosen`` (step).
        ``n_diverged`` (candidate): points at which the ship left the model's range, which are left out. Over stage, 0
        before and k after k chosen runs: ``sd`` (prime) of each coefficient, its median ``relative_sd_chosen`` [%],
        ``shrinkage_chosen`` from stage 0 and ``forecast_sd`` [% of the ranges]; NaN where the posterior mean cannot run
        a manoeuvre of interest.

    Raises
    ------
    SimulationError
        For an unknown criterion, no candidate, counts below one, too few posterior draws, no noise or two, or where
        every ship diverged.
    SimulationError, TrialError, VesselError
        For settings that no run can have, noise that is not positive, or a posterior of other coefficients.

    References
    ----------
    Fedorov (1972), Theory of Optimal Experiments; Goodwin & Payne (1977), Dynamic System Identification, ch. 6;
    Chaloner & Verdinelli (1995), doi:10.1214/ss/1177009939, for the average over a posterior.

    Examples
    --------
    Which of two runs tells more about coefficients that are known to 30 %:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> mean = np.concatenate([vessel.coefficients(dof) for dof in vessel.dofs])
    >>> known = mean, np.diag((0.3 * mean) ** 2)
    >>> runs = [ps.zigzag(10, 10), ps.zigzag(20, 20)]
    >>> settings = {"level": 0.01, "draws": 2, "duration": 200, "interval": 0.5}
    >>> plan = ps.design_trials(vessel, known, runs, n=1, rng=np.random.default_rng(1), **settings)
    >>> plan["chosen"].item()
    'zigzag 20/20 port'
    """
    rng = random_generator(rng)
    vessel = as_vessel(vessel)
    if criterion not in CRITERIA or n < 1 or draws < 1:
        raise SimulationError(
            f"A design needs a criterion of {', '.join(CRITERIA)} and one run and draw or more, found {criterion!r}, "
            f"{n} and {draws}; correct them."
        )
    knowledge = _knowledge(vessel, posterior, draws, rng)
    sensors = _sensors(vessel, posterior, level, noise_sd, interval)
    if candidates is None:
        candidates = candidate_trials(vessel, duration=duration, rng=rng)
    labelled = labelled_trials(candidates)
    if not labelled:
        raise SimulationError("A design chooses among candidates, found none; give one.")
    manoeuvres = (zigzag(10, 10), turning_circle(35)) if interest is None else tuple(interest)
    forecast = _forecast_root(vessel, manoeuvres, knowledge.mean, duration)
    if criterion == "forecast" and not np.isfinite(forecast).all():
        raise SimulationError(
            "The ship of the posterior mean leaves the model's range in a manoeuvre of interest; choose by information."
        )
    information = {
        label: _information(vessel, one, knowledge.points, sensors, duration) for label, one in labelled.items()
    }
    return _greedy(vessel, knowledge.root, information, forecast, n, criterion)


def _knowledge(vessel: Vessel, posterior, draws: int, rng: np.random.Generator) -> _Knowledge:
    size = reference_coefficients(vessel).size
    if isinstance(posterior, xr.DataTree):
        held = posterior["posterior"].sizes
        sample = coefficient_draws(vessel, posterior, held["chain"] * held["draw"], rng)
        if len(sample) < max(2 * size, draws):
            raise SimulationError(
                f"A covariance of {size} coefficients needs {2 * size} posterior draws or more, found {len(sample)}; "
                "draw more."
            )
        mean = sample.mean(axis=0)
        root = np.linalg.qr((sample - mean) / np.sqrt(len(sample) - 1.0), mode="r").T
        return _Knowledge(mean, root, np.vstack([mean, sample[:draws]]))
    if isinstance(posterior, TrajectoryFit):
        mean, root = posterior.coefficients, np.linalg.qr(posterior.square_root[:size].T, mode="r").T
    else:
        mean, root = _moments(vessel, *posterior)
    return _Knowledge(mean, root, np.vstack([mean, mean + rng.standard_normal((draws, size)) @ root.T]))


def _moments(vessel: Vessel, mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and a root of the covariance, both checked."""
    mean, covariance = np.asarray(mean, dtype=float), np.asarray(covariance, dtype=float)
    size = reference_coefficients(vessel).size
    fits = mean.shape == (size,) and covariance.shape == (size, size)
    if not fits or not np.isfinite(mean).all() or not np.isfinite(covariance).all():
        raise SimulationError(
            f"A posterior of {vessel.name!r} has a finite mean and covariance of {size} coefficients, found shapes "
            f"{mean.shape} and {covariance.shape} or values that are not finite; give its own."
        )
    sd = np.sqrt(np.diag(covariance))
    unit = np.where(sd > 0.0, sd, 1.0)
    w, V = np.linalg.eigh(covariance / np.outer(unit, unit))
    return mean, unit[:, None] * V * np.sqrt(np.maximum(w, 0.0))


def _sensors(
    vessel: Vessel, posterior, level: float | None, noise_sd: Mapping[str, float] | None, interval: float
) -> _Sensors:
    """Noise of the runs to come: as given, or white, or as the posterior found it."""
    if level is None and noise_sd is None:
        return _fitted_sensors(posterior)
    sd = noise_sd if level is None else dict.fromkeys(sensors(), noise_size(level))
    rolling = channel_names(lambda channel: channel.rolling)
    channels = tuple(name for name in sd if "roll" in vessel.dofs or name not in rolling)
    values = np.array([sd[name] for name in channels])
    given_twice = level is not None and noise_sd is not None
    if given_twice or not channels or not all(0.0 < value < np.inf for value in (interval, *values)):
        raise SimulationError(
            "A design needs the noise of the runs to come, either a positive level or a positive noise_sd, sampled at "
            f"a positive interval; found {level}, {noise_sd} and {interval} s; correct them."
        )
    return _Sensors(channels, values[0] if level is not None else None, values, 0.0 * values, False, interval)


def _fitted_sensors(posterior) -> _Sensors:
    """Noise of the blocks of the last run that a posterior was fitted to."""
    if isinstance(posterior, TrajectoryFit):
        run, noise = posterior.problem.runs[-1], posterior.problem.noise[-1]
        spacing = run.block * run.interval
        return _Sensors(run.channels, None, noise.sd, noise.correlation, noise.offsets, spacing)
    held = posterior["constant_data"] if isinstance(posterior, xr.DataTree) and "constant_data" in posterior else {}
    if "block_sd" not in held:
        raise SimulationError("The posterior does not tell the noise of its sensors; give level or noise_sd.")
    last = held.dataset.isel(run_index=-1)
    last = last.isel(channel=np.isfinite(last["block_sd"].values))
    offsets = "offsets" in posterior.attrs.get("noise_model", "")
    spacing = float(np.median(np.diff(held["time"].values)))
    channels = tuple(map(str, last["channel"].values))
    return _Sensors(channels, None, last["block_sd"].values, last["correlation"].values, offsets, spacing)


def _sailed(vessel: Vessel, run: NextRun, points: np.ndarray, duration: float) -> xr.Dataset:
    """Motion of the ships of some points, as :func:`pymc_ship.simulate` returns it; a stopping test has its n, too."""
    if not isinstance(run, StoppingTest):
        return simulate(vessel, run, duration=duration, step=STEP, method="rk4", coefficients=points)
    time = STEP * np.arange(round(duration / STEP))
    n, states = run.sailed(vessel, points, time)
    motion = {name: (("draw", "time"), states[k]) for k, name in enumerate(STATE)}
    motion["delta"] = ("draw", "time"), np.zeros(states.shape[1:])
    motion |= {"n": ("time", n), "diverged": ("draw", ~np.isfinite(states[0]).all(axis=1))}
    return xr.Dataset(motion, {"time": time})


def _information(
    vessel: Vessel, manoeuvre: NextRun, points: np.ndarray, sensors: _Sensors, duration: float
) -> list[np.ndarray | None]:
    """Root of the information of a run at each point, None where the ship diverged."""
    ships = _sailed(vessel, manoeuvre, points, duration)
    roots: list[np.ndarray | None] = []
    for k, point in enumerate(points):
        ship, root = ships.isel(draw=k), None
        if not ship["diverged"]:
            run, noise = sensors.noisy(ship, vessel)
            root = information_root(vessel, run, noise, point, straight_course(vessel, manoeuvre, run.n_states))
        roots.append(root)
    return roots


def _forecast_root(
    vessel: Vessel, manoeuvres: Sequence[Manoeuvre], coefficients: np.ndarray, duration: float
) -> np.ndarray:
    """G with |G L|^2 (Frobenius) the variance of forecasts, in squares of the ranges, mean over channels and time.

    NaN where the ship leaves the model's range.
    """
    rows = []
    for manoeuvre in manoeuvres:
        ship, jacobian = closed_loop_sensitivities(vessel, manoeuvre, coefficients, duration=duration)
        if ship["diverged"]:
            return np.full((1, coefficients.size), np.nan)
        moving = [name for name in channel_names(lambda channel: channel.scored) if np.ptp(ship[name].values) > 0.0]
        scaled = [jacobian[STATE.index(name), ::_THINNING] / np.ptp(ship[name].values) for name in moving]
        rows.append(np.vstack(scaled) / np.sqrt(len(manoeuvres) * len(scaled) * len(scaled[0])))
    return np.linalg.qr(np.vstack(rows), mode="r")


def _greedy(
    vessel: Vessel, root: np.ndarray, information: Mapping[str, list], forecast: np.ndarray, n: int, criterion: str
) -> xr.Dataset:
    """Choose runs by the mean gain over the points that have not diverged."""
    labels = list(information)
    known = dict.fromkeys(range(len(information[labels[0]])), root)
    stages, chosen = [known], []
    table = {name: np.full((n, len(labels)), np.nan) for name in ("gain", "relative_sd", "shrinkage")}
    for step in range(n):
        for c, label in enumerate(labels):
            ahead, log_gain = _after(known, information[label])
            if not ahead:
                continue
            before = {k: known[k] for k in ahead}
            gain = np.mean(log_gain)
            if criterion == "forecast":
                gain = np.log(_variance(forecast, before) / _variance(forecast, ahead))
            table["gain"][step, c] = gain
            table["relative_sd"][step, c] = _relative(vessel, _sd(ahead))
            table["shrinkage"][step, c] = _shrinkage(_sd(before), _sd(ahead))
        if np.isnan(table["gain"][step]).all():
            raise SimulationError(
                f"In run {step + 1} every simulated ship leaves the model's range; give milder candidates or a "
                "posterior that knows more."
            )
        chosen.append(labels[int(np.nanargmax(table["gain"][step]))])
        known, _ = _after(known, information[chosen[-1]])
        stages.append(known)
    found = xr.Dataset({name: (("step", "candidate"), values) for name, values in table.items()})
    found["chosen"] = "step", chosen
    found["n_diverged"] = "candidate", [sum(one is None for one in roots) for roots in information.values()]
    found = found.assign_coords(step=1 + np.arange(n), candidate=labels)
    return found.merge(_stages(vessel, stages, forecast)).assign_attrs(vessel=vessel.name, criterion=criterion)


def _after(known: Mapping[int, np.ndarray], roots: list) -> tuple[dict[int, np.ndarray], list[float]]:
    """Roots of the covariance after a run and the gains in log precision, where the ship did not diverge."""
    ahead, gains = {}, []
    for k, root in known.items():
        if roots[k] is not None:
            _, s, right = np.linalg.svd(roots[k] @ root)
            s = np.append(s, np.zeros(len(right) - s.size))
            ahead[k] = root @ right.T / np.sqrt(1.0 + s**2)
            gains.append(float(np.sum(np.log1p(s**2))))
    return ahead, gains


def _stages(vessel: Vessel, stages: list[dict[int, np.ndarray]], forecast: np.ndarray) -> xr.Dataset:
    """Predicted knowledge of the coefficients before and after each chosen run."""
    sd = np.array([_sd(known) for known in stages])
    variance = [_variance(forecast, known) for known in stages]
    columns = {
        "sd": (("stage", "coefficient"), sd),
        "relative_sd_chosen": ("stage", [_relative(vessel, one) for one in sd]),
        "shrinkage_chosen": ("stage", [_shrinkage(sd[0], one) for one in sd]),
        "forecast_sd": ("stage", 100.0 * np.sqrt(variance)),
    }
    return xr.Dataset(columns, {"stage": np.arange(len(stages)), "coefficient": coefficient_names(vessel)})


def _variance(forecast: np.ndarray, known: Mapping[int, np.ndarray]) -> float:
    """Variance of the forecasts, averaged over the points."""
    return float(np.mean([np.sum((forecast @ root) ** 2) for root in known.values()]))


def _sd(known: Mapping[int, np.ndarray]) -> np.ndarray:
    """Standard deviation of each coefficient, its variance averaged over the points."""
    return np.sqrt(np.mean([np.sum(root**2, axis=1) for root in known.values()], axis=0))


def _relative(vessel: Vessel, sd: np.ndarray) -> float:
    """Median relative standard deviation [%] of the coefficients whose reference is not 0."""
    reference = reference_coefficients(vessel)
    known = reference != 0.0
    return float(np.median(100.0 * sd[known] / np.abs(reference[known])))


def _shrinkage(before: np.ndarray, after: np.ndarray) -> float:
    """Geometric mean of the factors by which the standard deviations fall.

    Coefficients that are known exactly do not count.
    """
    unknown = before > 0.0
    return float(np.exp(np.mean(np.log(before[unknown] / after[unknown]))))
