"""Wind, current and a constant residual force, as parts.

Wind: X as the cosine, Y as the sine, N as the sine of twice the relative direction (Fossen 2011, section 8.1).
Equation numbers are those of docs/reference/equations.md.
"""

import numpy as np

from pymc_ship.machine.arguments import number_or_nan, short_repr
from pymc_ship.machine.errors import SimulationError
from pymc_ship.physics.forces.expressions import Expression
from pymc_ship.physics.forces.part import Expressions, Force, Motion, Parameter, Part, ShipDimensions, no_force, speed

AIR_OVER_WATER = 1.225 / 1025.0  # density of air over that of sea water
CURRENT_COMPONENTS = ("c_north", "c_east")
"""Parameters of the components of a current, over the nominal speed, for each run."""

Flow = tuple[float, float] | None
"""Wind or current: speed [m/s] and direction [deg], from which wind blows, to which a current sets."""

_FOSSEN = "Fossen (2011), Handbook of Marine Craft Hydrodynamics and Motion Control, section 8.1"


def flow_components(flow: Flow) -> np.ndarray:
    """North and east components [m/s] of a flow, from its speed [m/s] and the direction it goes to [deg]."""
    if flow is None:
        return np.zeros(2)
    pair = [number_or_nan(value) for value in flow] if isinstance(flow, tuple | list | np.ndarray) else []
    if len(pair) != 2 or not np.isfinite(pair).all() or pair[0] < 0.0:
        raise SimulationError(
            "Wind and current have a speed from 0 m/s and a direction in degrees, found "
            f"{short_repr(flow)}; correct them."
        )
    speed, direction = pair[0], np.deg2rad(pair[1])
    return speed * np.array([np.cos(direction), np.sin(direction)])


def _wind_parameters(ship: ShipDimensions) -> tuple[Parameter, ...]:
    return (
        Parameter("C_X", 0.7, 0.25, _FOSSEN, "wind coefficient"),
        Parameter("C_Y", 0.8, 0.25, _FOSSEN, "wind coefficient"),
        Parameter("C_N", 0.12, 0.1, _FOSSEN, "wind coefficient"),
        Parameter("k_drift", 0.005, 0.008, "surface drift, by judgement", "over the wind speed"),
    )


def _wind(ship: ShipDimensions, motion: Motion, p: Expressions, shared: dict[str, Expression]) -> Force:
    u, v = motion.u_air, motion.v_air
    V = speed(u, v)  # Eq. 42
    X = -AIR_OVER_WATER * ship.frontal * p["C_X"] * u * V
    Y = -AIR_OVER_WATER * ship.lateral * p["C_Y"] * v * V
    return Force(X, Y, -2.0 * AIR_OVER_WATER * ship.lateral * p["C_N"] * u * v)


def _current_parameters(ship: ShipDimensions) -> tuple[Parameter, ...]:
    source = "currents of half a knot or so, by judgement"
    sd = 0.5 / ship.nominal_speed
    directions = zip(CURRENT_COMPONENTS, ("north", "east"), strict=True)
    return tuple(
        Parameter(name, 0.0, sd, source, f"U_nom, current to the {way}", per_run=True) for name, way in directions
    )


def _constant_parameters(ship: ShipDimensions) -> tuple[Parameter, ...]:
    size = "a degree of rudder or so, by judgement"
    return (Parameter("Y_run", 0.0, 2e-5, size, per_run=True), Parameter("N_run", 0.0, 1e-5, size, per_run=True))


def _constant(ship: ShipDimensions, motion: Motion, p: Expressions, shared: dict[str, Expression]) -> Force:
    return Force(0.0, p["Y_run"], p["N_run"])


WIND = Part("wind", "wind by frontal and lateral area, and the drift of the surface", _wind_parameters, _wind, "wind")
CURRENT = Part("current", "a uniform current, two constants a run", _current_parameters, no_force, "current")
CONSTANT = Part(
    "constant force", "a constant force and moment a run", _constant_parameters, _constant, "constant force"
)
