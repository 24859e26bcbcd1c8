"""The draws of an identified ship at another draught.

What the trials say of a ship of parts is how far each parameter is from what is typical of such a hull, propeller and
rudder, in standard deviations of ships. At another draught the typical values change, as their formulae have it; the
ship is taken to be as far from them as before. Terms of a polynomial know nothing of a draught and are left out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.vessel.parts import FIXED_SD, with_parts
from pymc_ship.physics.vessel.vessel import Vessel

_SAME = 0.05  # by which the length between perpendiculars may differ from one draught to another


def at_loading(model: Vessel, rows: np.ndarray, tried: Vessel, loaded: Vessel) -> tuple[Vessel, np.ndarray]:
    """Vessel and draws of a ship of parts at another loading.

    Parameters
    ----------
    model : Vessel
        With the parts and the steering gear with which she was identified as tried.
    rows : ndarray, shape (n_draws, n_coefficients)
    tried, loaded : Vessel
        Her files at both draughts.

    Returns
    -------
    Vessel
    ndarray, shape (n_draws, n_coefficients)

    Raises
    ------
    TrialError
        For a file that is not of the same ship.
    """
    if not np.isclose(tried.particulars.L, loaded.particulars.L, rtol=_SAME):
        raise TrialError(
            f"The ship at full load is the one that was tried, found L = {loaded.particulars.L:g} m and "
            f"{tried.particulars.L:g} m; give her own file."
        )
    here, there = (_with_parts_of(model, vessel) for vessel in (tried, loaded))
    value, sd = np.array([[c.value, c.sd] for c in here.parameters]).T
    other, other_sd = np.array([[c.value, c.sd] for c in there.parameters]).T
    free = sd > FIXED_SD
    return there, np.where(free, other + (rows - value) / np.where(free, sd, 1.0) * other_sd, other)


def _with_parts_of(model: Vessel, vessel: Vessel) -> Vessel:
    """Vessel with the parts of a model, its steering gear, and parameters as her file states them or typical."""
    gear = {name: getattr(model.particulars, name) for name in ("rudder_rate_deg", "rudder_delay")}
    bare = replace(vessel, particulars=replace(vessel.particulars, **gear), forces=dict.fromkeys(model.forces, ()))
    names = {c.name for c in model.parameters}
    stated = {c.name: c for c in vessel.parameters if c.name in names}
    held = [c.name for c in model.parameters if c.sd <= FIXED_SD]
    return with_parts(replace(bare, parts=(), parameters=()), model.parts, stated, held)
