"""The interface of a part of the force: parameters, and a formula for forces from motion, inputs and parameters.

Quantities are prime at the nominal speed U_nom, also at rest and astern. Axes point forward, to starboard and down; a
positive rudder angle turns to port.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from pymc_ship.physics.forces.expressions import Expression, root

STATES = ("u", "v", "r", "p", "phi", "psi")  # states on which forces depend, in the order of the state vector
INPUTS = ("delta", "n", "wind_x", "wind_y")
"""Inputs: rudder [rad], revolutions over nominal ones, velocity of the air to north and east over U_nom."""


class AddedMass(NamedTuple):
    """Acceleration derivatives, prime values; those of roll are zero for a vessel without roll."""

    Xudot: float
    Yvdot: float
    Yrdot: float
    Ypdot: float
    Nvdot: float
    Nrdot: float
    Npdot: float
    Kvdot: float
    Krdot: float
    Kpdot: float


class ShipDimensions(NamedTuple):
    """Fixed dimensions of a ship for the formulae.

    Lengths ``L``, ``B``, ``d`` and propeller diameter ``D`` [m], ``volume`` [m3], ``nominal_speed`` [m/s], ``n``
    nominal revolutions [1/s]; ``block`` coefficient; open-water polynomial ``k_0``, ``k_1``, ``k_2``, ``wake``
    fraction; ``eta`` diameter over the height of the rudder; ``rudder_area`` over L^2 and its ``aspect_ratio``;
    ``frontal`` and ``lateral`` areas above the water over L^2; ``m``, ``x_G``, ``z_G``, ``I_zz``, ``I_xx`` and
    ``added_mass`` prime; ``GM`` and ``BM`` [m]. Values that are not ``known`` are typical.
    """

    L: float
    B: float
    d: float
    volume: float
    nominal_speed: float
    D: float
    n: float
    k_0: float
    k_1: float
    k_2: float
    wake: float
    eta: float
    kappa: float
    propeller_known: bool
    rudder_area: float
    rudder_known: bool
    aspect_ratio: float
    frontal: float
    lateral: float
    m: float
    x_G: float
    z_G: float
    I_zz: float
    I_xx: float
    added_mass: AddedMass
    GM: float
    BM: float
    GM_known: bool
    rolls: bool

    @property
    def block(self) -> float:
        """Block coefficient."""
        return self.volume / (self.L * self.B * self.d)

    @property
    def J(self) -> float:
        """Advance ratio at nominal revolutions without wake, U_nom / (n D)."""
        return self.nominal_speed / (self.n * self.D)


@dataclass(frozen=True)
class Parameter:
    """A parameter of a part with its prior.

    ``unit`` is "prime", the unit, or what a number without unit is. ``per_run``: every run has its own value;
    ``per_facility``: each facility may have its own (revolutions, wake, asymmetry of propeller and rudder).
    """

    name: str
    value: float
    sd: float
    source: str
    unit: str = "prime"
    per_run: bool = False
    per_facility: bool = False


class Motion(NamedTuple):
    """Motion through the water and inputs as expressions; ``u_air``, ``v_air`` are velocities relative to the air."""

    u: Expression
    v: Expression
    r: Expression
    p: Expression
    phi: Expression
    delta: Expression
    n: Expression
    u_air: Expression
    v_air: Expression


class Force(NamedTuple):
    """Forces and moments of a part, prime at the nominal speed."""

    X: Expression | float = 0.0
    Y: Expression | float = 0.0
    N: Expression | float = 0.0
    K: Expression | float = 0.0


Expressions = Mapping[str, Expression]  # by name
Formula = Callable[[ShipDimensions, Motion, Expressions, dict[str, Expression]], Force]
"""Force of a part from ship, motion, parameters, and shared quantities of earlier parts, which it changes in place."""


@dataclass(frozen=True)
class Part:
    """A part of a ship's force.

    ``parameters(ship)`` are typical values, ``force`` is a :data:`Formula`. A ship has at most one part of each
    ``role``, such as ``"hull"`` or ``"rudder"``.
    """

    name: str
    description: str
    parameters: Callable[[ShipDimensions], tuple[Parameter, ...]]
    force: Formula
    role: str


def speed(u: Expression, v: Expression) -> Expression:
    """Speed sqrt(u^2 + v^2 + 1e-12), positive at rest."""
    return root(u * u + v * v + 1e-12)


def no_force(ship: ShipDimensions, motion: Motion, p: Expressions, shared: dict[str, Expression]) -> Force:
    """Formula of a part without a force of its own."""
    return Force()
