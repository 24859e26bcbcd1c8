"""A vessel as data: particulars, inertia, the terms of each force and their reference coefficients.

Every value comes from one TOML file, described in docs/reference/vessel_toml.md and checked here key by key.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import xarray as xr

from pymc_ship.forces.propeller import Propeller, PropellerConstants
from pymc_ship.forces.terms import UnknownTerm, factors, loaded
from pymc_ship.machine.toml import Entry, toml_file

DOFS = ("surge", "sway", "yaw", "roll")
"""Degrees of freedom, in the order of the equations of motion."""

LETTER = {"surge": "X", "sway": "Y", "yaw": "N", "roll": "K"}
"""First letter of a coefficient's name: X and Y are forces, N and K are moments."""

ADDED_MASS = ("Xudot", "Yvdot", "Yrdot", "Ypdot", "Nvdot", "Nrdot", "Npdot", "Kvdot", "Krdot", "Kpdot")
"""Acceleration derivatives; those a vessel without roll does not have are zero."""

_POSITIVE = ("L", "B", "volume", "nominal_speed", "rudder_rate_deg")
_INERTIA = ("m", "I_zz", "I_xx")
_PUBLISHED = ("published", "published_error")
_DETAILS = ("value", "source", "sign_source", "note")
_OF_COEFFICIENTS = ("sd", *_PUBLISHED)
_PACKAGE = Path(__file__).parents[1]
SHIPPED = _PACKAGE / "models" if (_PACKAGE / "models").is_dir() else _PACKAGE.parents[1] / "models"


class VesselError(ValueError):
    """A vessel file that cannot be used; the sentence names the key."""


@dataclass(frozen=True)
class Coefficient:
    """One hydrodynamic coefficient: name (``Yv|v|``), prime value and where both number and sign come from.

    ``sd`` is the standard deviation of what is known of the value beforehand, NaN where nothing is.
    """

    name: str
    value: float
    source: str = ""
    sign_source: str = ""
    note: str = ""
    published: dict[str, float] = field(default_factory=dict)
    published_error: dict[str, float] = field(default_factory=dict)
    sd: float = math.nan

    @property
    def term(self) -> str:
        """The polynomial term the coefficient multiplies: ``v|v|`` for ``Yv|v|``."""
        return self.name[1:]


@dataclass(frozen=True)
class Particulars:
    """Main particulars in SI units; ``rudder_rate_deg`` is in deg/s.

    ``rudder_delay`` [s] is the time from the switching heading of a zigzag to the rudder's first movement.
    ``x_G`` forward and ``z_G`` below the origin [m], ``volume`` the displacement volume [m3], ``GM`` and ``BM`` [m],
    ``d`` the draught [m], 0 where it is not stated.
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
        """Time in which the ship covers her length at the nominal speed, L/U [s]."""
        return self.L / self.nominal_speed


@dataclass(frozen=True)
class Vessel:
    """A manoeuvring model: particulars, prime inertia, added mass, coefficients of each DOF, perhaps a propeller."""

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

    def __repr__(self) -> str:
        s, words = self.particulars, "" if self.title in ("", self.name) else f": {self.title}"
        draught = f"d = {s.d:.4g} m" if s.d > 0.0 else "draught not stated"
        size = f"  L = {s.L:.4g} m, B = {s.B:.4g} m, {draught}, nominal speed {s.nominal_speed:.4g} m/s"
        terms = [f"  {dof}: {len(force)} terms" for dof, force in self.forces.items()]
        propeller = f"  propeller: {'none' if self.propeller is None else 'yes'}>"
        return "\n".join([f"<Vessel {self.name!r}{words}", size, *terms, propeller])

    @property
    def dofs(self) -> tuple[str, ...]:
        """Degrees of freedom that have coefficients; roll may be missing."""
        return tuple(self.forces)

    def terms(self, dof: str) -> tuple[str, ...]:
        """Terms of a DOF, in the order of the file."""
        return tuple(coefficient.term for coefficient in self._force(dof))

    def coefficients(self, dof: str) -> xr.DataArray:
        """Reference values of a DOF.

        Parameters
        ----------
        dof : {"surge", "sway", "yaw", "roll"}

        Returns
        -------
        DataArray, dims (coefficient,)
            Prime values labelled ``Yv``, ``Yv|v|``, ... with coordinates ``term`` and ``sign_source``.

        Raises
        ------
        VesselError
            When the vessel has no such DOF.
        """
        force = self._force(dof)
        return xr.DataArray(
            np.array([coefficient.value for coefficient in force]),
            dims="coefficient",
            coords={
                "coefficient": [coefficient.name for coefficient in force],
                "term": ("coefficient", [coefficient.term for coefficient in force]),
                "sign_source": ("coefficient", [coefficient.sign_source for coefficient in force]),
            },
            name=f"{LETTER[dof]}'",
            attrs={"vessel": self.name, "dof": dof, "units": "prime"},
        )

    def published(self, dof: str, which: str) -> np.ndarray:
        """Published estimates of a DOF, shape (n_terms,); NaN where none is printed."""
        return np.array([coefficient.published.get(which, np.nan) for coefficient in self._force(dof)])

    def published_error(self, dof: str, which: str) -> np.ndarray:
        """Errors [%] printed beside the published estimates, shape (n_terms,); NaN where none is printed."""
        return np.array([coefficient.published_error.get(which, np.nan) for coefficient in self._force(dof)])

    def with_coefficients(self, values: dict[str, np.ndarray]) -> Vessel:
        """Copy with other coefficient values: ``{"sway": array of shape (n_terms,)}``."""
        forces = dict(self.forces)
        for dof, row in values.items():
            force = self._force(dof)
            if len(row) != len(force):
                raise VesselError(f"{dof} of {self.name!r} has {len(force)} coefficients, found {len(row)} values.")
            forces[dof] = tuple(replace(c, value=float(value)) for c, value in zip(force, row, strict=True))
        return replace(self, forces=forces)

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
        """Prime z coordinate of the centre of gravity; 0 where the vessel has no roll."""
        return self.particulars.z_G / self.particulars.L if "roll" in self.forces else 0.0

    def _force(self, dof: str) -> tuple[Coefficient, ...]:
        if dof not in self.forces:
            raise VesselError(f"{self.name!r} has the degrees of freedom {', '.join(self.forces)}; found {dof!r}.")
        return self.forces[dof]


def shipped_vessels() -> tuple[str, ...]:
    """Names of the vessels that come with the package.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> ps.shipped_vessels()
    ('container', 'kvlcc2')
    """
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.toml")))


def load_vessel(source: str | Path) -> Vessel:
    """Read a vessel.

    Parameters
    ----------
    source : str or Path
        Name of a shipped vessel (``"container"``) or the path of a TOML file of the same form.

    Returns
    -------
    Vessel

    Raises
    ------
    VesselError
        For an unknown vessel, an unreadable file, unknown or missing keys, unknown terms and non-finite values.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> vessel.dofs, vessel.particulars.L
    (('surge', 'sway', 'yaw'), 320.0)
    """
    path = Path(source)
    if path.suffix != ".toml":
        if str(source) not in shipped_vessels():
            raise VesselError(
                f"A vessel is one of {', '.join(shipped_vessels())} or the path of a .toml file; found {str(source)!r}."
            )
        path = SHIPPED / f"{source}.toml"
    return _vessel(toml_file(path, "The vessel file", VesselError))


def _vessel(file: Entry) -> Vessel:
    known = ("name", "title", "sources", "particulars", "inertia", "added_mass", "propeller", "coefficients")
    file.check_keys(known, ("name", "particulars", "inertia", "coefficients"))
    name, forces = file.at("name").text(), file.at("coefficients")
    forces.check_keys(DOFS, DOFS[:3])
    particulars = _particulars(file.at("particulars"), has_roll="roll" in forces)
    inertia = _numbers(file.at("inertia"), _INERTIA, _INERTIA if "roll" in forces else _INERTIA[:2])
    vessel = Vessel(
        name=name,
        title=file.at("title", name).text(),
        sources=_sources(file.at("sources", [])),
        particulars=particulars,
        m=inertia["m"],
        I_zz=inertia["I_zz"],
        I_xx=inertia.get("I_xx", 0.0),
        added_mass=dict.fromkeys(ADDED_MASS, 0.0) | _numbers(file.at("added_mass", {}), ADDED_MASS),
        forces={dof: _force(forces.at(dof), dof) for dof in DOFS if dof in forces},
        propeller=_propeller(file.at("propeller"), particulars.nominal_speed) if "propeller" in file else None,
    )
    idle = [c.name for force in vessel.forces.values() for c in force if loaded(c.term)] if not vessel.propeller else []
    if idle:
        raise VesselError(f"{file.file}: {', '.join(idle)} need the propeller's loading; add the table [propeller].")
    if np.linalg.cond(vessel.inertia_matrix) > 1e12:
        raise VesselError(f"{file.file}: the inertia matrix must be invertible; check [inertia] and [added_mass].")
    return vessel


def _sources(entry: Entry) -> tuple[str, ...]:
    if not isinstance(entry.value, list) or not all(isinstance(text, str) for text in entry.value):
        entry.fail(f"must be a list of texts, found {entry.value!r}; correct it.")
    return tuple(entry.value)


def _particulars(table: Entry, *, has_roll: bool) -> Particulars:
    required = (*_POSITIVE, "x_G", *(("z_G", "GM", "BM") if has_roll else ()))
    values = _numbers(table, [f.name for f in fields(Particulars)], required)
    for key in _POSITIVE:
        if values[key] <= 0.0:
            table.at(key).fail(f"must be positive, found {values[key]}; correct it.")
    box = values["L"] * values["B"] * values.get("d", 0.0)
    if box < 0.0 or 0.0 < box < values["volume"]:
        table.at("d").fail(
            f"is a draught at which L B d holds the volume, found d = {values['d']} with a block coefficient of "
            f"{values['volume'] / box:.3g}; correct it."
        )
    return Particulars(**values)


def _propeller(table: Entry, nominal_speed: float) -> Propeller:
    names = [field.name for field in fields(Propeller)]
    values = _numbers(table, names, names)
    propeller = Propeller(**values)
    c = propeller.constants(nominal_speed) if values["n"] * values["D"] else PropellerConstants()
    thrust = c.k_0 + c.k_1 * c.J + c.k_2 * c.J**2
    if not (c.J > 0.0 and thrust > 0.0 and 0.0 < c.eta <= 1.0 and c.kappa >= 0.0):
        raise VesselError(
            f"{table.file}: a propeller has positive D, n, advance ratio and thrust at the nominal speed, eta in "
            f"(0, 1] and kappa from 0 up, found J = {c.J:.3g}; correct [propeller]."
        )
    return propeller


def _numbers(table: Entry, known: Sequence[str], required: Sequence[str] = ()) -> dict[str, float]:
    """Numbers of a table by key, each of which may state its details; the table may state a source."""
    table.check_keys((*known, "source"), required)
    return {key: _value(table.at(key)) for key in table if key != "source"}


def _value(entry: Entry, details: Sequence[str] = _DETAILS) -> float:
    """Number that stands alone or in a table with its details."""
    if not isinstance(entry.value, dict):
        return entry.number()
    entry.check_keys(details, ("value",))
    return entry.at("value").number()


def _force(table: Entry, dof: str) -> tuple[Coefficient, ...]:
    table.check_table()
    source = str(table.value.get("source", ""))
    force = tuple(_coefficient(name, table.at(name), dof, source) for name in table if name != "source")
    if not force:
        table.fail(f"is empty; add at least one coefficient such as {LETTER[dof]}v.")
    return force


def _coefficient(name: str, entry: Entry, dof: str, source: str) -> Coefficient:
    if not name.startswith(LETTER[dof]):
        entry.fail(f"must begin with {LETTER[dof]}, the letter of {dof}.")
    try:
        factors(name[1:])
    except UnknownTerm as error:
        entry.fail(f"is no coefficient. {error}")
    value = _value(entry, (*_DETAILS, *_OF_COEFFICIENTS))
    more = entry if isinstance(entry.value, dict) else replace(entry, value={})
    sd = more.at("sd").number() if "sd" in more else math.nan
    if sd <= 0.0:
        more.at("sd").fail(f"must be positive, found {sd:g}; leave out what is not known.")
    published = {key: _estimates(more.at(key, {})) for key in _PUBLISHED}
    texts = {key: str(more.value.get(key, "")) for key in ("sign_source", "note")}
    return Coefficient(name, value, str(more.value.get("source", source)), **texts, **published, sd=sd)


def _estimates(table: Entry) -> dict[str, float]:
    table.check_table()
    return {key: table.at(key).number() for key in table}


def reference_coefficients(vessel: Vessel) -> np.ndarray:
    """All coefficients of a vessel in the order of :func:`scheme`, shape (n_coefficients,)."""
    return np.concatenate([vessel.coefficients(dof).values for dof in vessel.dofs])
