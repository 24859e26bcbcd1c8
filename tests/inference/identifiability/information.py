"""Fisher information itself, and the identifiability of the runs of a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from pymc_ship.inference.identifiability.information import identifiability, runs_root
from pymc_ship.inference.trajectory.fit import TrajectoryFit


def fisher_information(runs, vessel, *, noise_sd, initial_states=None) -> np.ndarray:
    """Fisher information of all coefficients at the reference values of a vessel."""
    root = runs_root(runs, vessel, None, noise_sd, None, initial_states)
    return root.T @ root


def fitted_identifiability(fit: TrajectoryFit) -> xr.Dataset:
    """:func:`identifiability` of the runs of a fit, at its mode, with its noise and with the scales of its prior."""
    problem = fit.problem
    places = zip(problem.runs, problem.nuisances, strict=True)
    return identifiability(
        problem.runs,
        problem.vessel,
        replace(problem.prior, scale=problem.current_scales.sd, law=None),
        coefficients=fit.coefficients,
        noise=problem.noise,
        initial_states=[fit.unknowns[place][: run.n_states] for run, place in places],
    )
