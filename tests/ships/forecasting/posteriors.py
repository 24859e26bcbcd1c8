"""Posteriors around the reference coefficients, by degree of freedom and joint."""

from __future__ import annotations

import numpy as np
import xarray as xr

from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.motion.prime_record import prime_record


def posterior(names, values, chains=1):
    """Posterior of draws, shape (n_draws, n_terms), dealt to chains."""
    values = np.asarray(values, dtype=float)
    sample = xr.Dataset(
        {"coefficients": (("chain", "draw", "coefficient"), values.reshape(chains, -1, values.shape[1]))},
        {"coefficient": list(names)},
    )
    return xr.DataTree.from_dict({"posterior": sample})


def scattered(vessel, dof, draws, rng, spread=0.01):
    """Draws around the reference values, with a relative spread."""
    reference = vessel.coefficients(dof)
    noise = 1.0 + spread * rng.standard_normal((draws, reference.size))
    return posterior(reference["coefficient"].values, reference.values * noise)


def joint(vessel, draws, rng, spread=0.01, chains=1, trial=None, noise_sd=None):
    """Joint posterior around the reference values, with the motion of a trial and the noise of the sensors."""
    reference = reference_row(vessel)
    names = [name for dof in vessel.dofs for name in vessel.coefficients(dof)["coefficient"].values]
    tree = posterior(names, reference * (1.0 + spread * rng.standard_normal((draws, reference.size))), chains)
    constant = {}
    if trial is not None:
        motion, _, _ = prime_record(vessel, {name: trial[name].values for name in ("u", "v", "r", "p", "phi", "delta")})
        constant["motion"] = (("row", "symbol"), np.array([motion[symbol] for symbol in SYMBOLS]).T)
    if noise_sd is not None:
        constant["noise_sd"] = ("channel", list(noise_sd.values()))
    coords = {"symbol": list(SYMBOLS), "channel": list(noise_sd or {})}
    tree["constant_data"] = xr.DataTree(xr.Dataset(constant, coords))
    return tree


def reference_row(vessel):
    return np.concatenate([vessel.coefficients(dof).values for dof in vessel.dofs])
