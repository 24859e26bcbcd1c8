"""Draws of an identified ship at another draught.

The prior means of a modular model follow the draught; the standardised deviation of each parameter stays the same.
"""

from dataclasses import replace

import numpy as np

from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.vessel.parts import FIXED_SD, with_parts
from pymc_ship.physics.vessel.vessel import Vessel

_SAME = 0.05  # largest relative difference in L of one ship


def at_loading(model: Vessel, rows: np.ndarray, tried: Vessel, loaded: Vessel) -> tuple[Vessel, np.ndarray]:
    """Vessel and draws (n_draws, n_coefficients) of a modular model, identified at draught ``tried``, at another."""
    if not np.isclose(tried.particulars.L, loaded.particulars.L, rtol=_SAME):
        raise TrialError(
            f"The vessel at full load and that of the trial have the same L, found {loaded.particulars.L:g} m and "
            f"{tried.particulars.L:g} m; give the file of the same ship."
        )
    here, there = (_with_parts_of(model, vessel) for vessel in (tried, loaded))
    value, sd = np.array([[c.value, c.sd] for c in here.parameters]).T
    other, other_sd = np.array([[c.value, c.sd] for c in there.parameters]).T
    free = sd > FIXED_SD
    return there, np.where(free, other + (rows - value) / np.where(free, sd, 1.0) * other_sd, other)


def _with_parts_of(model: Vessel, vessel: Vessel) -> Vessel:
    """Vessel with parts and steering gear of a model, and parameters of its file or typical ones."""
    gear = {name: getattr(model.particulars, name) for name in ("rudder_rate_deg", "rudder_delay")}
    bare = replace(vessel, particulars=replace(vessel.particulars, **gear), forces=dict.fromkeys(model.forces, ()))
    names = {c.name for c in model.parameters}
    file_parameters = {c.name: c for c in vessel.parameters if c.name in names}
    fixed = [c.name for c in model.parameters if c.sd <= FIXED_SD]
    return with_parts(replace(bare, parts=(), parameters=()), model.parts, file_parameters, fixed)
