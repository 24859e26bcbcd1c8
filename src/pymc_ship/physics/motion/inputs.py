"""Inputs of the equations of motion: rudder, revolutions and wind."""

from collections.abc import Iterable

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import number_or_nan, short_repr
from pymc_ship.machine.errors import SimulationError
from pymc_ship.physics.forces.part import INPUTS
from pymc_ship.physics.forces.screw import NOMINAL_REVOLUTIONS
from pymc_ship.physics.forces.surroundings import WIND, Flow, flow_components
from pymc_ship.physics.vessel.parts import FIXED_SD, ship_dimensions
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.trial.record import has_ground_speeds

_SAME_SPEED = 0.1  # of the nominal speed, within which terms without revolutions hold a speed
_MOST_REVOLUTIONS = 5.0  # over the nominal ones
_WIND = {"wind_speed", "wind_direction"}


def completed_inputs(inputs: np.ndarray) -> np.ndarray:
    """Inputs of shape (4, n_time); a rudder alone is completed by nominal revolutions and no wind."""
    values = np.ascontiguousarray(inputs, dtype=float)
    if values.ndim != 1:
        return values
    rows = np.zeros((len(INPUTS), values.size))
    rows[0], rows[1] = values, 1.0
    return rows


def recorded_inputs(trial: xr.Dataset, vessel: Vessel) -> np.ndarray:
    """Inputs of the equations of motion from a record, shape (4, n_time), rows of ``INPUTS`` of the forces.

    ``trial`` has ``delta`` [rad] and, if measured, ``n`` [1/s], ``wind_speed`` [m/s] and ``wind_direction`` [rad].
    Revolutions that are not measured, or whose nominal ones are unknown, are in proportion to the initial speed
    (nominal if it is over ground).
    """
    values = completed_inputs(trial["delta"].values)
    if not vessel.parts:
        return values
    U = vessel.particulars.nominal_speed
    measured = revolutions_measured(trial)
    n_is_estimated = any(c.name == NOMINAL_REVOLUTIONS and c.sd > FIXED_SD for c in vessel.parameters)
    if measured and vessel.modular and (vessel.propeller is not None or n_is_estimated):
        values[1] = trial["n"].values / ship_dimensions(vessel).n
    else:
        speed = np.hypot(trial["u"].values[:10], trial["v"].values[:10] if "v" in trial else 0.0)
        values[1] = 1.0 if has_ground_speeds(trial) else float(np.median(speed)) / U
        if measured and trial["n"].values[0] > 0.0:
            values[1] *= trial["n"].values / trial["n"].values[0]
    if WIND.name in vessel.parts and set(trial.data_vars) >= _WIND:
        speed, direction = trial["wind_speed"].values / U, trial["wind_direction"].values
        values[2], values[3] = -speed * np.cos(direction), -speed * np.sin(direction)
    return values


def recorded_wind(trial: xr.Dataset) -> complex | None:
    """Mean true wind of a record: speed [m/s] and, as its argument, the direction of origin; None without wind."""
    if not set(trial.data_vars) >= _WIND:
        return None
    return complex(np.nanmean(trial["wind_speed"].values * np.exp(1j * trial["wind_direction"].values)))


def revolutions_measured(trial: xr.Dataset) -> bool:
    """Whether a record has finite revolutions at every sample."""
    return "n" in trial and bool(np.isfinite(trial["n"].values).all())


def takes_revolutions(vessel: Vessel) -> bool:
    """Whether the thrust of a vessel depends on revolutions in 1/s: it has parts and a stated propeller."""
    return vessel.modular and vessel.propeller is not None


def speed_remarks(vessels: Iterable[Vessel], approach_speed: float, n: float | None = None) -> list[str]:
    """Sentence on vessels that tend to another speed than that of the approach [m/s]; none without any."""
    for vessel in vessels if n is None else ():
        nominal = vessel.particulars.nominal_speed
        if not vessel.modular and abs(approach_speed - nominal) > _SAME_SPEED * nominal:
            return [
                f"Terms without revolutions hold {nominal:.4g} m/s alone: from {approach_speed:.4g} m/s the ship tends "
                "to it, which changes times and distances."
            ]
    return []


def steady_inputs(
    vessel: Vessel, approach_speed: float, *, n: float | None = None, wind: Flow = None, current: Flow = None
) -> np.ndarray:
    """Constant inputs without the rudder, (3,): revolutions over the nominal ones, velocity of the air over U_nom.

    ``n`` [1/s] is by default that of the approach speed [m/s].
    """
    U = vessel.particulars.nominal_speed
    revolutions = approach_speed / U if n is None else _relative_revolutions(vessel, n)
    if wind is not None and WIND.name not in vessel.parts:
        raise SimulationError(
            f"Wind acts on a ship with the part wind, found {vessel.name!r} without it; leave out the wind, or add the "
            "part and [windage] to the vessel file."
        )
    drift = float(np.hypot(*flow_components(current)))
    if drift > U:
        raise SimulationError(
            f"A current is slower than the ship, found {drift:g} m/s at a nominal speed of {U:g} m/s; "
            "correct it (knots times 0.514 are m/s)."
        )
    air = -flow_components(wind) - flow_components(current) if wind is not None else np.zeros(2)
    return np.array([revolutions, *(air / U)])


def _relative_revolutions(vessel: Vessel, n: float) -> float:
    """Revolutions over those at the nominal speed."""
    propeller = vessel.propeller
    if propeller is None or not takes_revolutions(vessel):
        raise SimulationError(
            f"Revolutions need a ship of parts whose propeller is stated, found {vessel.name!r}; leave out n, or add "
            "parts and [propeller] to the vessel file."
        )
    if not abs(number_or_nan(n)) <= _MOST_REVOLUTIONS * propeller.n:
        raise SimulationError(
            f"Revolutions are a number [1/s] up to {_MOST_REVOLUTIONS:g} times the nominal {propeller.n:g}, "
            f"found {short_repr(n)}; correct them (1/min over 60 are 1/s)."
        )
    return n / propeller.n
