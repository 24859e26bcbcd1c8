"""Laplace approximation of the posterior of all coefficients from raw records, as a DataTree."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.tree import CITATIONS, provenance, rng_state
from pymc_ship.inference.trajectory.fit import TrajectoryFit, linear_problem
from pymc_ship.inference.trajectory.mode import TrajectoryMode, trajectory_mode
from pymc_ship.inference.trajectory.noise import sample_residuals, white_misfit
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.inference.trajectory.scale_law import FREEDOM, gibbs_draws
from pymc_ship.machine.arguments import check_counts
from pymc_ship.machine.errors import FitError, ShipError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.prime_record import prime_record
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel

KHAT_LIMIT = 0.7  # Pareto k-hat above which the normal approximation is unreliable (Vehtari et al. 2024)
_FEWEST_DRAWS = 25  # of whose importance weights a fifth are the tail of k-hat, five or more
_LOG_2PI = np.log(2.0 * np.pi)


def trajectory_posterior(
    trials: xr.Dataset | Sequence[xr.Dataset],
    vessel: VesselLike,
    prior: str | CoefficientPrior = "order_damped",
    *,
    draws: int = 1000,
    chains: int = 4,
    rng: Seed,
    **settings: Any,
) -> xr.DataTree:
    """Posterior of all coefficients from whole trajectories (output-error method, Laplace approximation).

    Draws are not weighted; for a Pareto k-hat above 0.7 use :func:`pymc_ship.trajectory_nuts_posterior`.

    Parameters
    ----------
    trials : Dataset or sequence of Dataset, dims (time,)
        Raw records with ``delta`` and any of u, v, r, p, phi, psi, x, y; each run has its own initial state.
    vessel : Vessel, str or Path
        Its reference coefficients are used under the prior ``"sister_ship"`` only.
    prior : {"order_damped", "sister_ship", "flat"} or CoefficientPrior, optional
        See :func:`pymc_ship.coefficient_prior`.
    draws, chains : int, optional
        Total number of draws (independent), and number of chains for ArviZ.
    rng : int, SeedSequence or Generator
    **settings
        ``channels`` to fit (default: those of u, v, r, p, phi there are), ``noise_sd`` of single samples by channel
        (default: from second differences), ``noise`` ("auto", "white", "ar1", "student_t"), ``offsets`` (True, False;
        default: by a test of the residuals), ``method`` ("rk4", "euler").

    Returns
    -------
    DataTree
        Groups posterior (``coefficients`` of all DOFs, ``initial_state`` and, with offsets, ``sensor_offset`` of each
        run), log_likelihood (``response``, one row for each block of samples, all channels together), log_prior (of all
        unknowns), observed_data (block means by row and channel) and constant_data (``time``, ``run``, prime
        ``motion``, ``fitted``, ``prior_sd``, ``noise_sd`` of a sample, ``block_sd`` and ``correlation`` of the blocks).
        Attrs: noise model with its reason, mean chi2, Pareto k-hat, verdict, tau, starts that agree, fraction of
        diverged draws.

    Raises
    ------
    TrialError, InferenceError
        For trials or priors that cannot be used.
    FitError
        For no trial, an unknown noise model, or when no start converges.
    ValueError
        When ``draws`` is no positive multiple of ``chains``.

    References
    ----------
    Maine & Iliff (1986), NASA RP-1168; Tierney & Kadane (1986), doi:10.1080/01621459.1986.10478240; Vehtari et al.
    (2024), Pareto smoothed importance sampling, JMLR 25(72).

    Examples
    --------
    Fit to a noisy zigzag; posterior mean and reference value of a rudder coefficient:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=400, step=0.5, method="rk4")
    >>> noisy = ps.pollute(trial, level=0.01, rng=rng)
    >>> tree = ps.trajectory_posterior(noisy, vessel, "sister_ship", draws=200, rng=rng)
    >>> tree.attrs["noise_model"], tree.attrs["verdict"]
    ('white', 'the normal approximation can be trusted')
    >>> draws = tree["posterior"]["coefficients"].sel(coefficient="Ngsincos")
    >>> print(f"{draws.mean():.5f}, {vessel.coefficients('yaw').sel(coefficient='Ngsincos'):.5f}")
    -0.00176, -0.00176
    """
    check_counts(chains=chains)
    check_counts(draws=draws, least=_FEWEST_DRAWS)
    rng, vessel = random_generator(rng), as_vessel(vessel)
    if draws % chains:
        raise ShipError(
            f"Chains have equal numbers of draws, found {draws} draws for {chains} chains; give a multiple."
        )
    mode = trajectory_mode(trials, vessel, prior, **settings)
    return laplace_posterior(mode, draws=draws, chains=chains, rng=rng)


def laplace_posterior(mode: TrajectoryMode, *, draws: int, chains: int, rng: np.random.Generator) -> xr.DataTree:
    """Draws from the approximation at a mode; see :func:`trajectory_posterior`."""
    fit, state = mode.choice.fit, rng_state(rng)
    unknowns, eta, linear = approximate_draws(fit, chains, draws // chains, rng)
    log_likelihood = log_likelihood_rows(fit, unknowns)
    finite = np.isfinite(log_likelihood).all(axis=1)
    if finite.sum() < _FEWEST_DRAWS:
        raise FitError(
            f"The normal approximation needs {_FEWEST_DRAWS} draws that do not diverge, found {finite.sum()} of "
            f"{finite.size}; give a narrower prior, or more draws."
        )
    khat = pareto_khat((log_likelihood.sum(axis=1) - linear)[finite])
    attrs = {"pareto_khat": khat, "verdict": verdict(khat), "diverged_fraction": float(np.mean(~finite))}
    parts = unknowns, eta, log_likelihood, log_prior_density(fit, unknowns, np.median(eta, axis=0))
    by_chain = (values.reshape(chains, draws // chains, *values.shape[1:]) for values in parts)
    return trajectory_tree(mode, *by_chain, method="trajectory", attrs=attrs | {"rng_state": state})


def approximate_draws(
    fit: TrajectoryFit, chains: int, draws: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draws under the likelihood linearised at the mode, with the scales of the prior integrated out.

    Returns unknowns (chains * draws, n_unknowns), log factors of the scales (chains * draws, n_factors), none for a
    fixed prior, and the linearised log likelihood (chains * draws,), up to a constant.
    """
    problem, point, n = fit.problem, fit.point, fit.problem.n_coefficients
    law = problem.prior.law
    if law is None:
        unknowns = fit.unknowns + rng.standard_normal((chains * draws, fit.unknowns.size)) @ fit.square_root.T
        eta = np.empty((chains * draws, 0))
    else:
        linear, nuisances = linear_problem(problem, law, fit.unknowns, point)
        parts = gibbs_draws(linear, problem.current_scales, chains, draws, rng)
        deviations, eta = (values.reshape(chains * draws, -1) for values in parts)
        others = nuisances.mean + (deviations - linear.mode) @ nuisances.slope.T
        others += rng.standard_normal(others.shape) @ nuisances.root.T
        unknowns = problem.center + np.hstack([deviations, others * problem.unit[n:]])
    change, other = (unknowns - fit.unknowns) / problem.unit, problem.prior.likelihood_or_flat
    log_likelihood = -change @ point.gradient - 0.5 * np.sum((change @ point.matrix) * change, axis=1)
    of_others = -0.5 * np.sum((other.response - unknowns[:, :n] @ other.design.T) ** 2, axis=1)
    return unknowns, eta, log_likelihood - of_others


def pareto_khat(log_weight: np.ndarray) -> float:
    """Pareto k-hat, the shape of the generalised Pareto tail of importance weights; NaN where there is none.

    Vehtari et al. (2024), JMLR 25(72); Zhang & Stephens (2009), doi:10.1198/tech.2009.08017. The estimate of ArviZ,
    without its long import.
    """
    weight = np.exp(np.sort(log_weight) - log_weight.max())
    n = int(3.0 * np.sqrt(weight.size)) if weight.size > 225 else weight.size // 5
    excess = weight[-n:] - weight[-n - 1]
    quartile, n_grid = excess[int(0.25 * n - 0.5)], 30 + int(np.sqrt(n))
    if quartile <= excess[0]:
        return np.nan
    b = (1.0 - np.sqrt(n_grid / (np.arange(n_grid) + 0.5))) / (3.0 * quartile) + 1.0 / excess[-1]
    k = np.mean(np.log1p(-b[:, None] * excess), axis=1)
    log_profile = n * (np.log(-b / k) - k - 1.0)
    profile = np.exp(log_profile - log_profile.max())
    shape = np.mean(np.log1p(-np.sum(profile * b) / np.sum(profile) * excess))
    return float((n * shape + 0.5 * 10.0) / (n + 10.0))  # the prior of the shape: ten values with a mean of a half


def verdict(khat: float) -> str:
    """Whether the normal approximation is reliable, with the remedy where it is not."""
    if khat <= KHAT_LIMIT:
        return "the normal approximation can be trusted"
    return "the normal approximation is not to be trusted: sample with trajectory_nuts_posterior"


def log_likelihood_rows(fit: TrajectoryFit, unknowns: np.ndarray) -> np.ndarray:
    """Log likelihood of every block, given the one before, (n_draws, n_rows); NaN where a draw diverges."""
    rows = []
    for k, noise in enumerate(fit.problem.noise):
        white = white_misfit(fit.problem, k, unknowns)
        rows.append(np.zeros(white.shape[1:]))
        for values, sd, correlation in zip(white, noise.sd, noise.correlation, strict=True):
            rows[-1] -= 0.5 * (values**2 + _LOG_2PI) + np.log(sd)
            rows[-1][:, 1:] -= 0.5 * np.log1p(-(correlation**2))
    return np.hstack(rows)


def log_prior_density(fit: TrajectoryFit, unknowns: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Log prior density of all unknowns given log factors eta (..., n_factors), (n_draws,); flat priors add 0."""
    problem, n = fit.problem, fit.problem.n_coefficients
    precision, unit = problem.precision, problem.unit
    proper = precision > 0.0
    if problem.prior.law is not None:
        proper[:n] = False
    distance = precision[proper] * ((unknowns - problem.center) / unit)[:, proper] ** 2
    constant = 0.5 * np.log(precision[proper]) - 0.5 * _LOG_2PI - np.log(unit[proper])
    density = constant.sum() - 0.5 * distance.sum(axis=1)
    if problem.prior.law is None:
        return density
    z = (unknowns[:, :n] - problem.prior.mean) / problem.prior.scale
    return density + problem.prior.law.log_density(z, eta) - np.log(problem.prior.scale).sum()


def trajectory_tree(
    mode: TrajectoryMode,
    unknowns: np.ndarray,
    eta: np.ndarray,
    log_likelihood: np.ndarray,
    log_prior: np.ndarray,
    *,
    method: str,
    attrs: Mapping[str, object],
    groups: Mapping[str, xr.Dataset] | None = None,
) -> xr.DataTree:
    """DataTree as of :func:`trajectory_posterior`, of draws (chain, draw, ...) by a method of ``CITATIONS``."""
    sample = ("chain", "draw")
    coords = {"chain": np.arange(unknowns.shape[0]), "draw": np.arange(unknowns.shape[1])}
    constant, observed = _records(mode.choice.fit, eta)
    problem = mode.choice.fit.problem
    labels, channels = problem.labels, problem.channels
    initial = np.full((*unknowns.shape[:2], len(problem.runs), len(labels["state"])), np.nan)
    offset = np.full((*unknowns.shape[:2], len(problem.runs), len(channels)), np.nan)
    for k, (run, noise, nuisance_slice) in enumerate(zip(problem.runs, problem.noise, problem.nuisances, strict=True)):
        nuisances = unknowns[..., nuisance_slice]
        initial[..., k, : run.n_states] = nuisances[..., : run.n_states]
        if noise.offsets:
            offset[..., k, [channels.index(name) for name in run.channels]] = nuisances[..., run.n_states :]
    variables = {
        "coefficients": ((*sample, "coefficient"), unknowns[..., : problem.n_coefficients]),
        "initial_state": ((*sample, "run", "state"), initial),
    }
    if "factor" in labels:
        variables["scale_factor"] = ((*sample, "factor"), np.exp(eta))
    if "channel" in labels:
        variables["sensor_offset"] = ((*sample, "run", "channel"), offset)
    tree = {
        "posterior": xr.Dataset(variables, coords | labels),
        "log_likelihood": xr.Dataset(
            {"response": ((*sample, "row"), log_likelihood)}, coords | {"row": constant["row"]}
        ),
        "log_prior": xr.Dataset({"coefficients": (sample, log_prior)}, coords),
        "observed_data": observed,
        "constant_data": constant,
    }
    root = xr.Dataset(attrs=_attrs(mode, eta, method) | dict(attrs))
    return xr.DataTree.from_dict({"/": root, **tree, **(groups or {})})


def _records(fit: TrajectoryFit, eta: np.ndarray) -> tuple[xr.Dataset, xr.Dataset]:
    """Groups constant_data and observed_data, block by block."""
    problem, parts, noise_dims = fit.problem, [], ("run_index", "channel")
    noise_sd, block_sd, correlation = np.full((3, len(problem.runs), len(problem.channels)), np.nan)
    for k, residuals in enumerate(sample_residuals(problem, fit.unknowns)):
        parts.append(_record(fit, k))
        columns = [problem.channels.index(name) for name in problem.runs[k].channels]
        noise_sd[k, columns] = np.sqrt(np.mean(residuals**2, axis=1))
        block_sd[k, columns], correlation[k, columns] = problem.noise[k].sd, problem.noise[k].correlation
    whole = xr.concat(parts, "row").assign_coords(row=np.arange(sum(run.n_blocks for run in problem.runs)))
    constant = whole[["time", "run", "motion", "fitted"]]
    law, prior_sd = problem.prior.law, problem.prior.scale.copy()
    if law is not None:
        factor = np.exp(law.exponents @ np.median(eta, axis=(0, 1)))
        prior_sd[law.is_scaled] *= (factor * np.sqrt(FREEDOM / (FREEDOM - 2.0)))[law.is_scaled]
    constant["prior_sd"] = xr.DataArray(prior_sd, {"coefficient": problem.labels["coefficient"]})
    constant["noise_sd"] = ("channel", np.sqrt(np.nanmean(noise_sd**2, axis=0)))
    constant["block_sd"], constant["correlation"] = (noise_dims, block_sd), (noise_dims, correlation)
    return constant, whole[["response"]]


def _record(fit: TrajectoryFit, index: int) -> xr.Dataset:
    """Block means of a run with the motion and channels that are fitted to them."""
    problem, run = fit.problem, fit.problem.runs[index]
    start = fit.unknowns[problem.nuisances[index]][: run.n_states]
    motion = replay(problem.vessel, run.inputs, start, fit.coefficients, block=run.block, **run.integration)[:, 0]
    record = dict(zip(STATE[:5], motion, strict=False)) | {"delta": run.block_means(run.inputs[0])}
    prime, _, _ = prime_record(problem.vessel, record)
    response, fitted = np.full((2, run.n_blocks, len(problem.channels)), np.nan)
    columns = [problem.channels.index(name) for name in run.channels]
    response[:, columns], fitted[:, columns] = run.means.T, motion[list(run.rows)].T
    return xr.Dataset(
        {
            "time": ("row", run.time, {"units": "s"}),
            "run": ("row", np.full(run.n_blocks, index)),
            "motion": (("row", "symbol"), np.column_stack([prime[symbol] for symbol in SYMBOLS])),
            "fitted": (("row", "channel"), fitted),
            "response": (("row", "channel"), response),
        },
        {"symbol": list(SYMBOLS), "channel": problem.channels},
    )


def _attrs(mode: TrajectoryMode, eta: np.ndarray, method: str) -> dict[str, object]:
    choice, problem = mode.choice, mode.choice.fit.problem
    law = problem.prior.law
    prior = {
        "family": problem.prior.kind,
        "mean": problem.prior.mean.tolist(),
        "scale": problem.prior.scale.tolist(),
        "factors": dict(zip(law.names, np.exp(np.median(eta, axis=(0, 1))).tolist(), strict=True)) if law else {},
    }
    return {
        "method": method,
        "vessel": problem.vessel.name,
        "dof": " ".join(problem.vessel.dofs),
        "derivative": "none",
        "integrator": problem.runs[0].method,
        "prior": json.dumps(prior),
        "noise_model": choice.kind + (" + offsets" if choice.offsets else ""),
        "noise_sentence": choice.sentence,
        "chi2": choice.fit.chi2,
        "log_evidence": choice.fit.log_evidence,
        **mode.quality_flags,
        "starts": mode.n_starts,
        "starts_agreeing": mode.n_agreeing,
        **provenance(CITATIONS[method]),
    }
