"""Fisher information of runs, Cramer-Rao bound of the coefficients, and unidentified directions.

The Fisher information of a run is S' S = R' R, S the sensitivities of the trajectory in units of the noise after the
columns of the initial states and sensor offsets are projected out (Schur complement).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.trajectory.fit import Noise, run_rows, white_noise
from pymc_ship.inference.trajectory.prior import CoefficientPrior, coefficient_dofs
from pymc_ship.inference.trajectory.runs import Run, trajectory_run
from pymc_ship.machine.arguments import check_kind, real_array
from pymc_ship.machine.errors import FitError, InferenceError
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names, reference_coefficients
from pymc_ship.trial.record import as_trial

UNKNOWN = 0.5  # posterior over prior variance above which a direction counts as unidentified
_SMALLEST = 1e-12


def identifiability(
    runs: xr.Dataset | Run | Sequence[xr.Dataset | Run],
    vessel: VesselLike,
    prior: CoefficientPrior | None = None,
    *,
    coefficients: np.ndarray | None = None,
    noise_sd: Mapping[str, float] | None = None,
    noise: Sequence[Noise] | None = None,
    initial_states: Sequence[np.ndarray] | None = None,
) -> xr.Dataset:
    """How well runs determine every coefficient.

    Parameters
    ----------
    runs : Dataset, Run, or sequence of them
        Measured trials, or simulated ones with ``noise_sd``.
    vessel : Vessel, str or Path
    prior : CoefficientPrior, optional
        Its scales with factors tau of 1; flat by default.
    coefficients : array_like, shape (n_coefficients,), optional
        Point of linearisation, DOF after DOF; the vessel's reference values by default.
    noise_sd : mapping of str to float, optional
        Noise sd of single samples by channel [SI] of trials that are no Run; by default from second differences.
    noise, initial_states : sequence of Noise, of array_like, shape (n_states,), optional
        Of each run; by default white noise without offsets, and the state of the first two seconds.

    Returns
    -------
    Dataset, dims (coefficient, direction)
        Prime values. ``reference``; ``bound``, the Cramer-Rao bound on the sd, infinite for an unidentified
        coefficient; ``relative_bound`` [% of the reference; NaN if that is 0]. With the prior: ``prior_sd``,
        ``bayesian_bound`` (van Trees), ``contraction`` (1 - posterior over prior variance). ``weight`` (direction,
        coefficient): unidentified directions, unit vectors in prior sd (for a flat prior, in inverse norms of the
        sensitivities), the least known first; ``variance_ratio`` (direction): posterior over prior variance, above
        one half. Attrs: ``n_determined`` directions, and ``condition_number`` of the sensitivities scaled to unit norm.

    Raises
    ------
    FitError, TrialError, InferenceError
        If a simulation diverges; for no run, wrong numbers of noises, states or coefficients, unusable trials, or a
        prior that is no CoefficientPrior.

    References
    ----------
    Maine & Iliff (1986), NASA RP-1168; Van Trees (1968), Detection, Estimation and Modulation Theory I, sec. 2.4;
    Gill & Levit (1995), doi:10.2307/3318681.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> bound = ps.identifiability(trial, vessel, noise_sd={"u": 0.01, "v": 0.01, "r": 1e-4, "psi": 1e-3})
    >>> for name in ("Nr", "Nrrr"):
    ...     print(f"{name}: {bound['relative_bound'].sel(coefficient=name):.0f} %")
    Nr: 4 %
    Nrrr: 1328 %
    """
    vessel = as_vessel(vessel)
    if prior is not None:
        check_kind("The prior", prior, CoefficientPrior, "make one by coefficient_prior", InferenceError)
    root = runs_root(runs, vessel, coefficients, noise_sd, noise, initial_states)
    reference, flat = reference_coefficients(vessel), np.full(root.shape[1], np.inf)
    prior_sd = flat if prior is None else prior.scale
    bound, bayesian_bound = _posterior_sd(root, flat), _posterior_sd(root, prior_sd)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(reference == 0.0, np.nan, 100.0 * bound / np.abs(reference))
        contraction = np.where(np.isinf(bayesian_bound), 0.0, 1.0 - (bayesian_bound / prior_sd) ** 2)
    weight, variance_ratio = _unknown_directions(root, prior_sd)
    columns = {"reference": reference, "bound": bound, "relative_bound": relative}
    columns |= {"prior_sd": prior_sd, "bayesian_bound": bayesian_bound, "contraction": contraction}
    s = np.linalg.svd(root / _norms(root), compute_uv=False)
    singular = root.shape[0] < root.shape[1] or s[-1] <= _SMALLEST * s[0]
    return xr.Dataset(
        {name: ("coefficient", values) for name, values in columns.items()}
        | {"weight": (("direction", "coefficient"), weight), "variance_ratio": ("direction", variance_ratio)},
        {"coefficient": coefficient_names(vessel)},
        {
            "vessel": vessel.name,
            "n_determined": root.shape[1] - variance_ratio.size,
            "condition_number": np.inf if singular else float(s[0] / s[-1]),
        },
    ).assign_coords(dof=("coefficient", [vessel.dofs[g] for g in coefficient_dofs(vessel)]))


def runs_root(
    runs: xr.Dataset | Run | Sequence[xr.Dataset | Run],
    vessel: Vessel,
    coefficients: np.ndarray | None,
    noise_sd: Mapping[str, float] | None,
    noise: Sequence[Noise] | None,
    initial_states: Sequence[np.ndarray] | None,
) -> np.ndarray:
    """Factor R of the Fisher information R' R of all runs, nuisance parameters eliminated."""
    sequence: Sequence[Any] = runs if isinstance(runs, list | tuple) else [runs]
    sequence = [run if isinstance(run, Run) else as_trial(run) for run in sequence]
    prepared = [run if isinstance(run, Run) else trajectory_run(run, vessel, noise_sd=noise_sd) for run in sequence]
    noise = [white_noise(run) for run in prepared] if noise is None else noise
    check_kind("noise", noise, Sequence, "give a list, one for each run", FitError)
    states = [run.initial_state[0] for run in prepared] if initial_states is None else initial_states
    check_kind("initial_states", states, Sequence, "give a list, one for each run", FitError)
    for one in noise:
        check_kind("Each of noise", one, Noise, "give those of a fit, or leave it out", FitError)
    reference = reference_coefficients(vessel)
    theta = reference if coefficients is None else real_array("Coefficients", coefficients, FitError)
    if not prepared or not len(noise) == len(states) == len(prepared) or theta.shape != reference.shape:
        raise FitError(
            f"An information needs at least one run, a noise and an initial state of each, and {reference.size} "
            f"coefficients; found {len(prepared)} runs, {len(noise)} noises, {len(states)} states and coefficients of "
            f"shape {theta.shape}; correct them."
        )
    roots = []
    for k, run in enumerate(prepared):
        offsets = np.zeros(len(run.channels) if noise[k].offsets else 0)
        state = real_array(f"State {k + 1} of initial_states", states[k], FitError)
        if state.shape != (run.n_states,):
            raise FitError(
                f"State {k + 1} of initial_states must have {run.n_states} numbers, found the shape {state.shape}; "
                "give one for each state."
            )
        rows = run_rows(vessel, run, noise[k], theta, np.concatenate([state, offsets]))
        if rows is None:
            raise FitError(f"The simulation must stay in range, found it diverged in run {k + 1}; change coefficients.")
        design = np.vstack(list(rows[1]))
        roots.append(np.linalg.qr(_without(design[:, : theta.size], design[:, theta.size :]), mode="r"))
    return np.linalg.qr(np.vstack(roots), mode="r")


def _norms(columns: np.ndarray) -> np.ndarray:
    """Euclidean norm of each column, 1 where it is zero."""
    norms = np.linalg.norm(columns, axis=0)
    return np.where(norms > 0.0, norms, 1.0)


def _without(columns: np.ndarray, nuisances: np.ndarray) -> np.ndarray:
    """Part of the columns that is orthogonal to those of the nuisance parameters, which may be zero."""
    left, s, _ = np.linalg.svd(nuisances / _norms(nuisances), full_matrices=False)
    left = left[:, s > _SMALLEST * s.max(initial=0.0)]
    return columns - left @ (left.T @ columns)


def _posterior_sd(root: np.ndarray, prior_sd: np.ndarray) -> np.ndarray:
    """Square roots of the diagonal of (R' R + prior precision)^-1; infinite where it has no inverse."""
    stacked = np.vstack([root, np.diag(1.0 / prior_sd)])
    norms = _norms(stacked)
    _, s, right = np.linalg.svd(stacked / norms, full_matrices=False)
    null = s <= _SMALLEST * s.max(initial=0.0)
    sd = np.linalg.norm(right[~null] / s[~null, None], axis=0) / norms
    return np.where(np.linalg.norm(right[null], axis=0) > np.sqrt(_SMALLEST), np.inf, sd)


def _unknown_directions(root: np.ndarray, prior_sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unidentified directions and their posterior over prior variance, the largest first."""
    flat = np.isinf(prior_sd)
    free = root[:, flat] / _norms(root[:, flat])
    # columns of coefficients with a prior are projected on the complement of those without
    parts = ((~flat, _without(root[:, ~flat] * prior_sd[~flat], free), 1.0), (flat, free, 0.0))
    weights, variance_ratios = [], []
    for which, columns, precision in parts:
        _, s, right = np.linalg.svd(columns, full_matrices=True)
        s = np.append(s, np.zeros(len(right) - s.size))
        s = np.where(s <= _SMALLEST * s.max(initial=0.0), 0.0, s)
        variance = np.where(s > 0.0, precision / (precision + np.where(s > 0.0, s, 1.0) ** 2), 1.0)
        unknown = variance > UNKNOWN
        weight = np.zeros((unknown.sum(), prior_sd.size))
        weight[:, which] = right[unknown]
        weights.append(weight)
        variance_ratios.append(variance[unknown])
    variance_ratio = np.concatenate(variance_ratios)
    order = np.argsort(-variance_ratio, kind="stable")
    return np.vstack(weights)[order], variance_ratio[order]
