"""PyMC model of whole trajectories and its sampling by NUTS."""

from collections.abc import Callable, Sequence
from threading import Lock
from typing import Any

import arviz as az
import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from nutpie.compiled_pyfunc import from_pyfunc
from pytensor.tensor.variable import TensorVariable

from pymc_ship.inference.regression.tree import rng_state
from pymc_ship.inference.sampling.operations import SimulatedMotion
from pymc_ship.inference.sampling.regression_model import check_settings, sample_with_nutpie
from pymc_ship.inference.trajectory.fit import Problem
from pymc_ship.inference.trajectory.mode import TrajectoryMode, trajectory_mode
from pymc_ship.inference.trajectory.posterior import log_likelihood_rows, log_prior_density, trajectory_tree
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.inference.trajectory.scale_law import FACTOR_SD, FREEDOM
from pymc_ship.machine.errors import FitError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel


def trajectory_model(
    trials: xr.Dataset | Sequence[xr.Dataset],
    vessel: VesselLike,
    prior: str | CoefficientPrior = "order_damped",
    **settings: Any,
) -> pm.Model:
    """PyMC model of whole trajectories.

    Parameters
    ----------
    trials : Dataset or sequence of Dataset, dims (time,)
        Raw records with ``delta`` and any of u, v, r, p, phi, psi, x, y; each run has its own initial state.
    vessel : Vessel, str or Path
    prior : {"order_damped", "sister_ship", "flat"} or CoefficientPrior, optional
        See :func:`pymc_ship.coefficient_prior`.
    **settings
        ``channels``, ``noise_sd``, ``noise``, ``offsets``, ``method`` as :func:`pymc_ship.trajectory_posterior`.

    Returns
    -------
    pymc.Model
        Free variable ``direction_coordinate`` (dims direction), in which the normal approximation is standard normal;
        deterministic ``coefficients`` (dims coefficient), ``initial_state`` (dims run, state) and, with offsets,
        ``sensor_offset`` (dims run, channel), NaN where a run has no such state or channel; observed ``response`` (dims
        row, channel), the block means or, under Student's t noise, pseudo-data. Several runs: ``response_0`` (dims
        row_0, channel_0), ``response_1``, ... The prior is a potential, without prior
        predictive draws. The log density is minus infinity where the simulation diverges.

    Raises
    ------
    TrialError, InferenceError
        For trials or priors that cannot be used.
    FitError
        When no mode is found.

    References
    ----------
    Maine & Iliff (1986), NASA RP-1168; Abril-Pla et al. (2023), PyMC, doi:10.7717/peerj-cs.1516.
    """
    return mode_model(trajectory_mode(trials, as_vessel(vessel), prior, **settings))


def mode_model(mode: TrajectoryMode) -> pm.Model:
    """PyMC model around a mode; see :func:`trajectory_model`."""
    fit, problem = mode.choice.fit, mode.choice.fit.problem
    if not np.isfinite(log_likelihood_rows(fit, fit.unknowns[None])).all():
        raise FitError(
            "A model needs a mode that does not diverge, found that the ship leaves the model's range at the mode; "
            "repeat the fit."
        )
    n, law = problem.n_coefficients, problem.prior.law
    proper = problem.precision > 0.0
    if law is not None:
        proper[:n] = False
    prior_sd = problem.unit[proper] / np.sqrt(problem.precision[proper])
    coords, several = {"direction": np.arange(_n_directions(problem)), **problem.labels}, len(problem.runs) > 1
    suffixes = [f"_{k}" if several else "" for k in range(len(problem.runs))]
    for suffix, run in zip(suffixes, problem.runs, strict=True):
        coords |= {"row" + suffix: np.arange(run.n_blocks), "channel" + suffix: list(run.channels)}
    with pm.Model(coords=coords) as model:
        coordinate = pm.Flat("direction_coordinate", dims="direction", initval=np.zeros(_n_directions(problem)))
        unknowns = fit.unknowns + pt.dot(fit.square_root, coordinate[: fit.unknowns.size])
        log_prior = pm.logp(pm.Normal.dist(problem.center[proper], prior_sd), unknowns[proper]).sum()
        coefficients = unknowns[:n]
        if law is not None:
            eta = problem.current_scales.eta + FACTOR_SD * coordinate[fit.unknowns.size :]
            pm.Deterministic("scale_factor", pt.exp(eta), dims="factor")
            log_prior += pm.logp(pm.Normal.dist(law.center, FACTOR_SD), eta).sum()
            log_factor, z = pt.dot(law.exponents, eta), (coefficients - problem.prior.mean) / problem.prior.scale
            student = pm.logp(pm.StudentT.dist(nu=FREEDOM), z * pt.exp(-log_factor)) - log_factor
            log_prior += pt.where(law.is_scaled, student, pm.logp(pm.Normal.dist(), z)).sum()
            log_prior -= np.log(problem.prior.scale).sum()
        pm.Potential("log_prior", log_prior)
        other = problem.prior.likelihood_or_flat
        if other.design.size:
            residuals = other.response - pt.dot(other.design, coefficients)
            pm.Potential("log_likelihood_of_other_data", -0.5 * pt.sum(residuals**2))
        nuisances = [unknowns[nuisance_slice] for nuisance_slice in problem.nuisances]
        _deterministics(problem, coefficients, nuisances)
        for k, suffix in enumerate(suffixes):
            _response(problem, k, suffix, coefficients, nuisances[k])
    return model


def _n_directions(problem: Problem) -> int:
    """Number of coordinates: unknowns and log factors of the prior."""
    return problem.unit.size + problem.current_scales.eta.size


def _deterministics(problem: Problem, coefficients: TensorVariable, nuisances: list) -> None:
    pm.Deterministic("coefficients", coefficients, dims="coefficient")
    labels, channels, n_runs = problem.labels, problem.channels, len(problem.runs)
    state = pt.full((n_runs, len(labels["state"])), np.nan)
    offset = pt.full((n_runs, len(channels)), np.nan)
    for k, (run, noise, values) in enumerate(zip(problem.runs, problem.noise, nuisances, strict=True)):
        state = state[k, : run.n_states].set(values[: run.n_states])
        if noise.offsets:
            offset = offset[k, [channels.index(name) for name in run.channels]].set(values[run.n_states :])
    pm.Deterministic("initial_state", state, dims=("run", "state"))
    if "channel" in labels:
        pm.Deterministic("sensor_offset", offset, dims=("run", "channel"))


def _response(problem: Problem, k: int, suffix: str, coefficients: TensorVariable, nuisances: TensorVariable) -> None:
    """Likelihood of the blocks of a run, with first-order autocorrelation if any."""
    run, noise = problem.runs[k], problem.noise[k]
    motion: Any = SimulatedMotion(run, problem.vessel)(coefficients, nuisances[: run.n_states])
    fitted, values = motion[list(run.rows)].T, noise.values.T
    if noise.offsets:
        fitted = fitted + nuisances[run.n_states :]
    mean, sd = fitted, np.tile(noise.sd, (run.n_blocks, 1))
    if noise.correlation.any():
        mean = fitted[1:].inc(noise.correlation * (values[:-1] - fitted[:-1]))
        sd[1:] *= np.sqrt(1.0 - noise.correlation**2)
    mean = pt.switch(pt.isfinite(motion).all(), mean, np.inf)
    pm.Normal("response" + suffix, mean, sd, observed=values, dims=("row" + suffix, "channel" + suffix))


def trajectory_nuts_posterior(
    trials: xr.Dataset | Sequence[xr.Dataset],
    vessel: VesselLike,
    prior: str | CoefficientPrior = "order_damped",
    *,
    draws: int = 500,
    chains: int = 2,
    tune: int = 100,
    rng: Seed,
    **settings: Any,
) -> xr.DataTree:
    """Posterior of whole trajectories by NUTS.

    A draw costs about ten simulations with sensitivities.

    Parameters
    ----------
    trials, vessel, prior, **settings
        As :func:`trajectory_model`.
    draws : int, optional
        Draws of each chain after the warm-up.
    chains, tune : int, optional
        Parallel chains, and warm-up draws of each, which adapt step size and mass matrix.
    rng : int, SeedSequence or Generator
        Gives the integer seed of the sampler.

    Returns
    -------
    DataTree
        As :func:`pymc_ship.trajectory_posterior`, without the attr ``pareto_khat``, with the group sample_stats as
        :func:`pymc_ship.nuts_posterior`; attr ``verdict`` has the divergent transitions and the largest R-hat.

    Raises
    ------
    TrialError, InferenceError, FitError, ValueError
        As :func:`trajectory_model`; for counts that are not positive.

    References
    ----------
    Hoffman & Gelman (2014), JMLR 15:1593; those of :func:`trajectory_model`.
    """
    rng = random_generator(rng)
    check_settings({"draws": draws, "chains": chains, "tune": tune})
    mode = trajectory_mode(trials, as_vessel(vessel), prior, **settings)
    return mode_nuts_posterior(mode, draws=draws, chains=chains, tune=tune, rng=rng)


def mode_nuts_posterior(
    mode: TrajectoryMode, *, draws: int, chains: int, tune: int, rng: np.random.Generator
) -> xr.DataTree:
    """Draws of NUTS around a mode; see :func:`trajectory_nuts_posterior`."""
    fit, state, seed = mode.choice.fit, rng_state(rng), int(rng.integers(2**31))
    settings = {"draws": draws, "chains": chains, "tune": tune}
    sampled = sample_with_nutpie(_nutpie_density(mode), settings, seed, progress=False)
    coordinates, statistics = sampled["posterior"]["direction_coordinate"], sampled["sample_stats"].to_dataset()
    diverging = statistics["diverging"]
    verdict = f"{int(diverging.sum())} of {diverging.size} transitions of NUTS diverged"
    if chains > 1:
        with np.errstate(divide="ignore", invalid="ignore"):
            verdict += f", the largest R-hat is {float(az.rhat(coordinates).max()):.3f}"
    along, of_factors = np.split(coordinates.to_numpy().reshape(chains * draws, -1), [fit.unknowns.size], axis=1)
    flat, eta = fit.unknowns + along @ fit.square_root.T, fit.problem.current_scales.eta + FACTOR_SD * of_factors
    log_likelihood, log_prior = log_likelihood_rows(fit, flat), log_prior_density(fit, flat, np.median(eta, axis=0))
    diverged_fraction = float(np.mean(~np.isfinite(log_likelihood).all(axis=1)))
    attrs = {"verdict": verdict, "diverged_fraction": diverged_fraction, "rng_state": state}
    by_chain = (values.reshape(chains, draws, *values.shape[1:]) for values in (flat, eta, log_likelihood, log_prior))
    groups = {"sample_stats": statistics}
    return trajectory_tree(mode, *by_chain, method="trajectory_nuts", attrs=attrs, groups=groups)


def _nutpie_density(mode: TrajectoryMode) -> Any:
    """Log density for nutpie, one function for each chain."""
    fit, model, compile_lock = mode.choice.fit, mode_model(mode), Lock()
    size, n_unknowns = _n_directions(fit.problem), fit.unknowns.size

    def log_density() -> Callable[[np.ndarray], tuple[float, np.ndarray]]:
        with compile_lock:
            function = model.logp_dlogp_function(ravel_inputs=True, mode="FAST_COMPILE")
            function.set_extra_values({})

        def value_and_gradient(coordinate: np.ndarray) -> tuple[float, np.ndarray]:
            value, gradient = function(coordinate)
            return float(value), np.ascontiguousarray(gradient)

        return value_and_gradient

    def expand_draw(seed1: int, seed2: int, chain: int) -> Callable[[np.ndarray], dict[str, np.ndarray]]:
        return lambda coordinate: {"direction_coordinate": np.asarray(coordinate)}

    def start(seed: int) -> np.ndarray:
        """Random start from the normal approximation, moved towards the mode while it diverges."""
        coordinate = np.random.default_rng(seed).standard_normal(size)
        root = fit.square_root
        while not np.isfinite(log_likelihood_rows(fit, (fit.unknowns + root @ coordinate[:n_unknowns])[None])).all():
            coordinate *= 0.5
        return coordinate

    types_shapes_names = [np.dtype(float)], [(size,)], ["direction_coordinate"]
    return from_pyfunc(size, log_density, expand_draw, *types_shapes_names, make_initial_point_fn=start)
