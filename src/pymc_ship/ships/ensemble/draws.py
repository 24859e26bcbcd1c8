"""Draws of coefficients from posteriors, with prime motion and sensor noise of the fitted records."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.tree import drawn_coefficients, warn_of_chains
from pymc_ship.machine.arguments import short_repr
from pymc_ship.machine.errors import SimulationError, VesselError
from pymc_ship.physics.forces.surroundings import WIND
from pymc_ship.physics.vessel.vessel import Vessel, check_same_vessel, coefficient_names

Models = Sequence[tuple[Vessel, np.ndarray]]  # vessels with draws of their coefficients, (n_draws, n_coefficients)


def coefficient_draws(
    vessel: Vessel,
    posteriors: Mapping[str, xr.DataTree] | xr.DataTree,
    draws: int,
    rng: np.random.Generator,
    *,
    group: str = "posterior",
) -> np.ndarray:
    """Draws (draws, n_coefficients) from a joint posterior, or from that of each DOF, without replacement if possible.

    A DOF without a posterior has the vessel's reference values.
    """
    if not isinstance(posteriors, Mapping) or not all(isinstance(tree, xr.DataTree) for tree in _trees(posteriors)):
        raise VesselError(
            f"A forecast takes one joint posterior or posteriors by degree of freedom, found {short_repr(posteriors)}; "
            "give a DataTree, or DataTrees under the names of the DOFs."
        )
    if isinstance(posteriors, xr.DataTree):
        return _coefficient_rows(vessel, "joint", posteriors, group, draws, rng)
    unknown = [dof for dof in posteriors if dof not in vessel.dofs]
    if unknown:
        raise VesselError(f"{vessel.name!r} has the degrees of freedom {', '.join(vessel.dofs)}; found {unknown[0]!r}.")
    blocks = [
        _coefficient_rows(vessel, dof, posteriors[dof], group, draws, rng)
        if dof in posteriors
        else np.tile(vessel.coefficients(dof).values, (draws, 1))
        for dof in vessel.dofs
    ]
    blocks.append(np.tile([parameter.value for parameter in vessel.parameters], (draws, 1)))
    return np.concatenate(blocks, axis=1)


def _coefficient_rows(
    vessel: Vessel, dof: str, tree: xr.DataTree, group: str, draws: int, rng: np.random.Generator
) -> np.ndarray:
    check_same_vessel(f"The {dof} {group}", tree.attrs, vessel)
    names = coefficient_names(vessel) if dof == "joint" else vessel.coefficients(dof)["coefficient"].values.tolist()
    drawn = drawn_coefficients(tree, f"The {dof} {group}", group=group)
    warn_of_chains(f"The {dof} {group}", drawn)
    sample = drawn["coefficients"].stack(sample=("chain", "draw"))
    lacking = sorted(set(names) - set(sample["coefficient"].values))
    if lacking:
        raise VesselError(f"The {dof} {group} lacks {', '.join(lacking)} of {vessel.name!r}; use its own terms.")
    drawn_indices = rng.choice(sample.sizes["sample"], draws, replace=sample.sizes["sample"] < draws)
    return sample.sel(coefficient=names).transpose("sample", "coefficient").values[drawn_indices]


def thinned_draws(models: Models, draws: int) -> list[tuple[Vessel, np.ndarray]]:
    """Models with at most this number of draws in all, in proportion, and at least one of each."""
    fraction = min(draws / sum(len(rows) for _, rows in models), 1.0)
    return [(vessel, rows[: max(round(fraction * len(rows)), 1)]) for vessel, rows in models]


def suitable_models(
    models: Models, *, n: float | None = None, wind: tuple[float, float] | None = None
) -> list[tuple[Vessel, np.ndarray]]:
    """Models whose forces depend on the given revolutions and wind; SimulationError where none does."""
    suitable = [
        (vessel, rows)
        for vessel, rows in models
        if (n is None or (vessel.modular and vessel.propeller is not None))
        and (wind is None or WIND.name in vessel.parts)
    ]
    if not suitable:
        inputs = " and ".join(word for word, given in (("revolutions", n), ("wind", wind)) if given is not None)
        raise SimulationError(
            f"A forecast with {inputs} needs forces that depend on {inputs}, found no such term set; give [propeller] "
            "and [windage] in the vessel file and identify the ship again, or omit them."
        )
    return suitable


def fitted_motion(posteriors: Mapping[str, xr.DataTree] | xr.DataTree) -> xr.DataArray | None:
    """Prime motion that posteriors were fitted to, dims (row, symbol); None where missing or different."""
    motions = [_constant(tree, "motion") for tree in _trees(posteriors)]
    first = motions[0] if motions else None
    return first if first is not None and all(one is not None and one.equals(first) for one in motions) else None


def sensor_noise(posteriors: Mapping[str, xr.DataTree] | xr.DataTree) -> dict[str, float]:
    """Sensor noise sd by channel [SI] of a joint posterior; empty for posteriors of single DOFs."""
    noise_sd = _constant(posteriors, "noise_sd") if isinstance(posteriors, xr.DataTree) else None
    return {} if noise_sd is None else noise_sd.to_series().to_dict()


def _trees(posteriors: Mapping[str, xr.DataTree] | xr.DataTree) -> list[xr.DataTree]:
    return [posteriors] if isinstance(posteriors, xr.DataTree) else list(posteriors.values())


def _constant(tree: xr.DataTree, name: str) -> xr.DataArray | None:
    return tree["constant_data"].data_vars.get(name) if "constant_data" in tree.children else None


def robust_sd(values: np.ndarray) -> float:
    """Half the width of the central 68 % of the finite draws, robust against diverged draws."""
    if not np.isfinite(values).any():
        return np.nan
    low, high = np.nanquantile(values, [0.16, 0.84])
    return float(0.5 * (high - low))
