"""Prime quantities of a record at every instant."""

from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.physics.forces.terms import LOADING, N_BASE, ROW_ABSOLUTE, ROW_LOADING, ROW_SYMBOL, SYMBOLS
from pymc_ship.physics.motion.equations import STATE, Work, known_forces, prime_motion, scheme
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.trial.record import check_trial


def prime_record(vessel: Vessel, record: dict[str, np.ndarray]) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """Prime motion by symbol of the terms, speed U [m/s] and known forces (4, n_time) at every instant of a record.

    The record has u, v [m/s], r [rad/s], delta [rad]; p [rad/s] and phi [rad] where the vessel rolls. The motion has
    ``g`` and ``T`` where the vessel states its propeller.
    """
    n_time = record["u"].size
    state = np.zeros((len(STATE), n_time))
    for row, name in enumerate(STATE[:5]):
        if name in record:
            state[row] = record[name]
    constants = scheme(vessel)
    work = Work(np.empty((N_BASE, n_time)), np.empty(n_time), np.empty((4, n_time)), np.empty((0, n_time)))
    prime_motion(state, record["delta"], constants, work)
    known_forces(state, constants, work)
    motion = dict(zip(SYMBOLS, work.terms[ROW_SYMBOL:ROW_ABSOLUTE], strict=True))
    if vessel.propeller is not None:
        motion |= dict(zip(LOADING, work.terms[ROW_LOADING:N_BASE], strict=True))
    return motion, work.speed, work.force


def motion_record(trial: xr.Dataset, vessel: Vessel) -> dict[str, np.ndarray]:
    """Channels of a trial that a vessel's equations of motion need, each (n_time,); TrialError if they are unusable."""
    names = (*STATE[:3], "delta", *(STATE[3:5] if "roll" in vessel.dofs else ()))
    check_trial(trial, names)
    return {name: np.ascontiguousarray(trial[name].values, dtype=float) for name in names}
