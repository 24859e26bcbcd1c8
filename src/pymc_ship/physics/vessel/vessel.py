"""A vessel as data: particulars, inertia, the terms of each force and their reference coefficients."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import short_repr
from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.forces.part import AddedMass
from pymc_ship.physics.forces.propeller import Propeller

DOFS = ("surge", "sway", "yaw", "roll")  # degrees of freedom, in the order of the equations of motion
LETTER = {"surge": "X", "sway": "Y", "yaw": "N", "roll": "K"}
"""First letter of a coefficient by degree of freedom: X, Y forces, N, K moments."""

ADDED_MASS = AddedMass._fields  # acceleration derivatives; those of roll are zero for a vessel without roll


@dataclass(frozen=True)
class Coefficient:
    """A hydrodynamic coefficient, or a parameter of a part: name (``Yv|v|``), prime value and sources.

    ``sd`` is the prior standard deviation, NaN if unknown; ``unit`` is that of a parameter. ``per_run``: each run has
    its own value; ``per_facility``: each facility may have its own.
    """

    name: str
    value: float
    source: str = ""
    sign_source: str = ""
    note: str = ""
    published: dict[str, float] = field(default_factory=dict)
    published_error: dict[str, float] = field(default_factory=dict)
    sd: float = math.nan
    unit: str = "prime"
    per_run: bool = False
    per_facility: bool = False

    @property
    def term(self) -> str:
        """The polynomial term the coefficient multiplies: ``v|v|`` for ``Yv|v|``."""
        return self.name[1:]


@dataclass(frozen=True)
class Particulars:
    """Main particulars in SI units; ``rudder_rate_deg`` is in deg/s, ``x_G`` forward and ``z_G`` below the origin.

    ``rudder_delay`` is the time from the switching heading of a zigzag to the rudder's first movement; ``d`` is the
    draught, 0 if not stated.
    """

    L: float
    B: float
    volume: float
    nominal_speed: float
    rudder_rate_deg: float
    x_G: float = 0.0
    z_G: float = 0.0
    GM: float = 0.0
    BM: float = 0.0
    rudder_delay: float = 0.0
    d: float = 0.0

    @property
    def ship_time(self) -> float:
        """Ship lengths in time, L/U at the nominal speed [s]."""
        return self.L / self.nominal_speed


@dataclass(frozen=True)
class Rudder:
    """Rudder: ``area`` [m2] and ``aspect_ratio``, height over mean chord."""

    area: float
    aspect_ratio: float


@dataclass(frozen=True)
class Windage:
    """Frontal and lateral projected areas above the water [m2]."""

    frontal_area: float
    lateral_area: float


@dataclass(frozen=True)
class Vessel:
    """A manoeuvring model of a ship.

    Forces are polynomial terms with ``forces``, or sums of ``parts`` with ``parameters``; a DOF without both is to be
    identified. ``derived`` has the method for each estimated quantity, by its key in the file.
    """

    name: str
    particulars: Particulars
    m: float
    I_zz: float
    I_xx: float
    added_mass: dict[str, float]
    forces: dict[str, tuple[Coefficient, ...]]
    title: str = ""
    sources: tuple[str, ...] = ()
    propeller: Propeller | None = None
    rudder: Rudder | None = None
    windage: Windage | None = None
    parts: tuple[str, ...] = ()
    parameters: tuple[Coefficient, ...] = ()
    derived: dict[str, str] = field(default_factory=dict, compare=False)

    def __repr__(self) -> str:
        s, words = self.particulars, "" if self.title in ("", self.name) else f": {self.title}"
        draught = f"d = {s.d:.4g} m" if s.d > 0.0 else "draught not stated"
        size = f"  L = {s.L:.4g} m, B = {s.B:.4g} m, {draught}, nominal speed {s.nominal_speed:.4g} m/s"
        terms = [f"  {dof}: {len(force)} terms" for dof, force in self.forces.items() if force or not self.modular]
        terms += [f"  parts: {', '.join(self.parts)}, {len(self.parameters)} parameters"] if self.parts else []
        propeller = f"  propeller: {'none' if self.propeller is None else 'yes'}>"
        return "\n".join([f"<Vessel {self.name!r}{words}", size, *terms, propeller])

    @property
    def dofs(self) -> tuple[str, ...]:
        """Degrees of freedom, with or without roll."""
        return tuple(self.forces)

    @property
    def modular(self) -> bool:
        """Whether all forces are sums of parts, without terms."""
        return bool(self.parts) and not any(self.forces.values())

    def check_model(self) -> None:
        """Raise VesselError unless every degree of freedom has coefficients or parts."""
        for dof in self.forces:
            self._force(dof)

    def terms(self, dof: str) -> tuple[str, ...]:
        """Terms of a DOF, in the order of the file."""
        return tuple(coefficient.term for coefficient in self._force(dof))

    def coefficients(self, dof: str) -> xr.DataArray:
        """Reference values of a DOF, prime, dims (coefficient,), with coordinates ``term`` and ``sign_source``.

        VesselError without this DOF, or coefficients of it.
        """
        force = self._force(dof)
        coords = {
            "coefficient": [c.name for c in force],
            "term": ("coefficient", [c.term for c in force]),
            "sign_source": ("coefficient", [c.sign_source for c in force]),
        }
        values, attrs = np.array([c.value for c in force]), {"vessel": self.name, "dof": dof, "units": "prime"}
        return xr.DataArray(values, coords, "coefficient", f"{LETTER[dof]}'", attrs)

    @property
    def all_coefficients(self) -> tuple[Coefficient, ...]:
        """Coefficients DOF after DOF, then the parameters of parts; VesselError without coefficients of a DOF."""
        return (*(one for dof in self.dofs for one in self._force(dof)), *self.parameters)

    def published_estimates(self, dof: str, which: str) -> np.ndarray:
        """Published estimates of a DOF, shape (n_terms,); NaN if not published."""
        return np.array([coefficient.published.get(which, np.nan) for coefficient in self._force(dof)])

    def published_errors(self, dof: str, which: str) -> np.ndarray:
        """Published errors [%] of these estimates, shape (n_terms,); NaN if not published."""
        return np.array([coefficient.published_error.get(which, np.nan) for coefficient in self._force(dof)])

    def with_coefficients(self, values: dict[str, np.ndarray]) -> "Vessel":
        """Copy with other values of coefficients, such as ``{"sway": array of shape (n_terms,)}``."""
        forces = dict(self.forces)
        for dof, row in values.items():
            force = self._force(dof)
            if len(row) != len(force):
                known = f"{dof} of {self.name!r} has {len(force)} coefficients"
                raise VesselError(f"{known}, found {len(row)} values; give one for each.")
            forces[dof] = tuple(replace(c, value=float(value)) for c, value in zip(force, row, strict=True))
        return replace(self, forces=forces)

    @cached_property
    def compiled(self) -> dict[str, Any]:
        """What the equations of motion prepare of the vessel once, by name."""
        return {}

    @cached_property
    def inertia_matrix(self) -> np.ndarray:
        """J of the equations of motion (prime), shape (4, 4): rows surge, sway, yaw, roll; columns u, v, r, p."""
        a = self.added_mass
        mx, mz = self.m * self.x_G, self.m * self.z_G
        J = np.array(
            [
                [self.m - a["Xudot"], 0.0, 0.0, 0.0],
                [0.0, self.m - a["Yvdot"], mx - a["Yrdot"], -mz - a["Ypdot"]],
                [0.0, mx - a["Nvdot"], self.I_zz - a["Nrdot"], -a["Npdot"]],
                [0.0, -mz - a["Kvdot"], -a["Krdot"], self.I_xx - a["Kpdot"]],
            ]
        )
        if "roll" not in self.forces:
            J[3, :], J[:, 3], J[3, 3] = 0.0, 0.0, 1.0
        return J

    @property
    def x_G(self) -> float:
        """Prime x coordinate of the centre of gravity."""
        return self.particulars.x_G / self.particulars.L

    @property
    def z_G(self) -> float:
        """Prime z coordinate of the centre of gravity; 0 without roll."""
        return self.particulars.z_G / self.particulars.L if "roll" in self.forces else 0.0

    def _force(self, dof: str) -> tuple[Coefficient, ...]:
        if not isinstance(dof, str) or dof not in self.forces:
            found = f"{', '.join(self.forces)}, found {short_repr(dof)}"
            raise VesselError(f"{self.name!r} has the degrees of freedom {found}; choose one of them.")
        if not self.forces[dof] and not self.modular:
            raise VesselError(
                f"The model of {self.name!r} needs coefficients of {dof}, found none; identify them with `pymc-ship "
                f"identify`, or add [coefficients.{dof}]."
            )
        return self.forces[dof]


def reference_coefficients(vessel: Vessel) -> np.ndarray:
    """All coefficients, shape (n_coefficients,): DOF after DOF, then the parameters of parts."""
    return np.array([one.value for one in vessel.all_coefficients], dtype=float)


def per_run_indices(vessel: Vessel) -> list[int]:
    """Indices of the parameters with a value for each run, among all coefficients."""
    first = sum(map(len, vessel.forces.values()))
    return [first + k for k, parameter in enumerate(vessel.parameters) if parameter.per_run]


def per_facility_indices(vessel: Vessel) -> list[int]:
    """Indices of the parameters that may differ between facilities, among all coefficients."""
    first = sum(map(len, vessel.forces.values()))
    return [first + k for k, parameter in enumerate(vessel.parameters) if parameter.per_facility]


def check_same_vessel(what: str, attrs: Mapping[Any, Any], vessel: Vessel, where: str = "") -> None:
    """Raise VesselError if attrs, those of what the error begins with, name another vessel; ``where`` ends it."""
    name = attrs.get("vessel") or vessel.name
    if name != vessel.name:
        raise VesselError(f"{what} must be of the vessel {vessel.name!r}, found {name!r}{where}; give its own vessel.")


def most_dofs(vessels: Iterable[Vessel]) -> Vessel:
    """First vessel with the largest number of degrees of freedom."""
    return max(vessels, key=lambda vessel: len(vessel.dofs))


def coefficient_names(vessel: Vessel) -> list[str]:
    """Names of all coefficients, in the order of :func:`reference_coefficients`."""
    return [one.name for one in vessel.all_coefficients]
