"""Posterior draws -> manoeuvres with bands for every channel and intervals for every index."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from pymc_ship.indices import indices
from pymc_ship.manoeuvres import Manoeuvre
from pymc_ship.simulate import simulate
from pymc_ship.trial import CHANNELS
from pymc_ship.vessel import Vessel, VesselError

BANDS = ("lower", "median", "upper")
"""Coordinate ``band`` of what a forecast summarises."""


def coefficient_draws(
    vessel: Vessel, posteriors: Mapping[str, xr.DataTree], draws: int, rng: np.random.Generator
) -> np.ndarray:
    """Draw whole parameter vectors from the posteriors of the degrees of freedom.

    Parameters
    ----------
    vessel : Vessel
    posteriors : mapping of str to DataTree
        Posterior of each DOF; a DOF that is left out keeps the vessel's reference values.
    draws : int
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (draws, n_coefficients)
        DOFs one after the other in the vessel's order; drawn without repetition where a posterior has enough draws.

    Raises
    ------
    VesselError
        For a DOF the vessel does not have or a posterior that lacks one of its coefficients.
    """
    unknown = [dof for dof in posteriors if dof not in vessel.dofs]
    if unknown:
        raise VesselError(f"{vessel.name!r} has the degrees of freedom {', '.join(vessel.dofs)}; found {unknown[0]!r}.")
    blocks = []
    for dof in vessel.dofs:
        reference = vessel.coefficients(dof)
        if dof not in posteriors:
            blocks.append(np.tile(reference.values, (draws, 1)))
            continue
        sample = posteriors[dof]["posterior"]["coefficients"].stack(sample=("chain", "draw"))
        lacking = sorted(set(reference["coefficient"].values) - set(sample["coefficient"].values))
        if lacking:
            raise VesselError(f"The {dof} posterior lacks {', '.join(lacking)} of {vessel.name!r}; use its own terms.")
        chosen = rng.choice(sample.sizes["sample"], draws, replace=sample.sizes["sample"] < draws)
        values = sample.sel(coefficient=reference["coefficient"].values)
        blocks.append(values.transpose("sample", "coefficient").values[chosen])
    return np.concatenate(blocks, axis=1)


def forecast(
    vessel: Vessel,
    posteriors: Mapping[str, xr.DataTree],
    manoeuvre: Manoeuvre,
    *,
    draws: int = 300,
    rng: np.random.Generator,
    duration: float = 400.0,
    ci_prob: float = 0.9,
    **settings,
) -> xr.DataTree:
    """Forecast a manoeuvre with one simulated ship for each posterior draw.

    Parameters
    ----------
    vessel : Vessel
    posteriors : mapping of str to DataTree
        Posterior of each DOF, of any method; a DOF that is left out keeps the vessel's reference values.
    manoeuvre : Manoeuvre
    draws : int, optional
        Simulated ships.
    rng : numpy.random.Generator
    duration : float, optional
        [s].
    ci_prob : float, optional
        Probability inside the equal-tailed bands.
    **settings
        ``step``, ``method`` and ``record_interval`` of :func:`pymc_ship.simulate`; by default Euler at 0.02 s,
        recorded every 0.5 s.

    Returns
    -------
    DataTree
        ``trajectories`` (dims draw, time: the simulated ships with ``diverged`` and ``diverged_at``), ``bands`` (dims
        band, time) and, for a zigzag or a turning circle, ``indices`` (dims draw) and ``index_bands`` (dims band).
        Bands are quantiles of the ships still running at that instant; attrs tell the ``share_diverged``.

    Raises
    ------
    VesselError, SimulationError, ValueError
        For posteriors that do not fit the vessel, settings that cannot run, fewer than two draws, ``ci_prob`` not in
        (0, 1).
    """
    if draws < 2 or not 0.0 < ci_prob < 1.0:
        raise ValueError(f"A forecast needs two draws and 0 < ci_prob < 1, found {draws} and {ci_prob}; change them.")
    coefficients = coefficient_draws(vessel, posteriors, draws, rng)
    settings = {"step": 0.02, "record_interval": 0.5} | settings
    ships = simulate(vessel, manoeuvre, duration=duration, coefficients=coefficients, **settings)
    groups = {"trajectories": ships, "bands": _bands(ships[list(CHANNELS)], ci_prob)}
    if manoeuvre.kind in ("zigzag", "turning_circle"):
        groups["indices"] = indices(ships)
        groups["index_bands"] = _bands(groups["indices"], ci_prob)
    attrs = {
        **ships.attrs,
        "label": manoeuvre.label,
        "draws": draws,
        "ci_prob": ci_prob,
        "ci_kind": "eti",
        "share_diverged": float(ships["diverged"].mean()),
    }
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attrs), **groups})


def _bands(values: xr.Dataset, ci_prob: float) -> xr.Dataset:
    """Equal-tailed band and median over the draws that are not NaN."""
    tail = 0.5 * (1.0 - ci_prob)
    variables = {
        name: (("band", *variable.dims[1:]), _quantiles(variable.values, [tail, 0.5, 1.0 - tail]), variable.attrs)
        for name, variable in values.data_vars.items()
    }
    coords = {"band": list(BANDS)} | {name: values.coords[name] for name in values.coords if name != "draw"}
    return xr.Dataset(variables, coords)


def _quantiles(values: np.ndarray, probabilities: list[float]) -> np.ndarray:
    """Quantiles over the first axis without NaN (which sorts last), linear between order statistics."""
    ordered = np.sort(values, axis=0)
    count = np.isfinite(ordered).sum(axis=0)
    rank = np.multiply.outer(probabilities, np.maximum(count - 1, 0))
    below = np.floor(rank).astype(int)
    above = np.minimum(below + 1, np.maximum(count - 1, 0))
    low, high = (np.take_along_axis(ordered, index, axis=0) for index in (below, above))
    return low + (rank - below) * (high - low)
