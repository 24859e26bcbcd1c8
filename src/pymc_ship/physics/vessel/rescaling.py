"""Coefficients of terms in the bis system of Norrbin, and in that of MMG papers."""

from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import check_choice, check_kind
from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.forces.prime_system import GRAVITY
from pymc_ship.physics.forces.terms import ROW_ABSOLUTE, ROW_DELTA, ROW_RUDDER, ROW_SYMBOL, SYMBOLS, factors
from pymc_ship.physics.vessel.reading import as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, check_same_vessel

SYSTEMS = ("bis", "mmg")

_VELOCITIES = [first + SYMBOLS.index(name) for first in (ROW_SYMBOL, ROW_ABSOLUTE) for name in ("v", "r", "p")]


def rescale(coefficients: xr.DataArray, vessel: Any, system: str) -> xr.DataArray:
    """Prime coefficients of terms in another system of units.

    ``"bis"`` has the units rho V g of forces, rho V g L of moments and sqrt(g L) of velocities; a term without two
    velocities is that of the nominal speed. ``"mmg"`` has L d in place of L^2, and a rudder positive to starboard.

    Parameters
    ----------
    coefficients : DataArray, dims (..., coefficient)
        Prime values of terms, such as draws of a posterior, with their names as coordinate.
    vessel : Vessel, str or Path
    system : {"bis", "mmg"}

    Returns
    -------
    DataArray, same dims

    Raises
    ------
    VesselError
        For an unknown system, another vessel, names that are no coefficients of terms, or a vessel without a draught
        (``"mmg"``).

    References
    ----------
    Norrbin (1970), Theory and observations on the use of a mathematical model for ship manoeuvring in deep and confined
    waters, SSPA 68. Yasukawa & Yoshimura (2015), Eq. 4-12, doi:10.1007/s00773-014-0293-y.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> prime = vessel.coefficients("yaw").sel(coefficient=["Nv", "Nvvr"])
    >>> print((1e3 * ps.rescale(prime, vessel, "mmg")).round(1).values)
    [-116.  -875.5]
    """
    vessel = as_vessel(vessel)
    check_choice("A system of coefficients", system, SYSTEMS, VesselError)
    check_kind("The coefficients", coefficients, xr.DataArray, "take them from a vessel or posterior", VesselError)
    check_same_vessel("The coefficients", coefficients.attrs, vessel)
    if "coefficient" not in coefficients.coords:
        raise VesselError("Coefficients to rescale have the coordinate 'coefficient', found none; give their names.")
    terms = {c.name: c.term for force in vessel.forces.values() for c in force}
    names = coefficients["coefficient"].values.tolist()
    if unknown := [name for name in names if name not in terms]:
        raise VesselError(
            f"Coefficients to rescale are of terms of {vessel.name!r}, found {', '.join(unknown)}; leave them out."
        )
    rescaled = coefficients * xr.DataArray([_factor(terms[name], vessel, system) for name in names], dims="coefficient")
    return rescaled.assign_attrs(coefficients.attrs | {"units": system})


def _factor(term: str, vessel: Vessel, system: str) -> float:
    s, rows = vessel.particulars, factors(term)
    if system == "bis":
        froude = s.nominal_speed / np.sqrt(GRAVITY * s.L)
        return float(s.L**3 / (2.0 * s.volume) * froude ** (2 - sum(row in _VELOCITIES for row in rows)))
    if s.d <= 0.0:
        raise VesselError(f"The system 'mmg' needs the draught d of {vessel.name!r}, found none; state particulars.d.")
    return s.L / s.d * (-1.0) ** sum(row in (ROW_DELTA, ROW_RUDDER) for row in rows)
