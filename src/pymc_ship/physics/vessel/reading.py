"""Reader of vessel files (docs/reference/vessel_toml.md)."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from pymc_ship.machine.arguments import short_repr
from pymc_ship.machine.errors import VesselError
from pymc_ship.machine.names import did_you_mean
from pymc_ship.machine.toml import Entry, toml_file
from pymc_ship.physics.forces.propeller import Propeller
from pymc_ship.physics.forces.terms import UnknownTerm, factors, needs_propeller
from pymc_ship.physics.vessel.inertia import DIAGONAL, K_ZZ, displaced_mass, motora_added_mass, yaw_inertia
from pymc_ship.physics.vessel.parts import with_parts
from pymc_ship.physics.vessel.plausibility import Finding, findings, particulars_findings
from pymc_ship.physics.vessel.vessel import ADDED_MASS, DOFS, LETTER, Coefficient, Particulars, Rudder, Vessel, Windage

_TABLES = ("particulars", "inertia", "added_mass", "propeller", "rudder", "windage", "coefficients", "parameters")
_PARTICULARS = ("L", "B", "volume", "nominal_speed", "rudder_rate_deg", "x_G")
_OF_ROLL = ("z_G", "GM", "BM")
_INERTIA = ("m", "I_zz", "I_xx")
_TEXTS = ("source", "sign_source", "note")
_LONGEST = 60  # largest number of characters of the name of a vessel or a coefficient
_PACKAGE = Path(__file__).parents[2]
SHIPPED = _PACKAGE / "models" if (_PACKAGE / "models").is_dir() else _PACKAGE.parents[1] / "models"

VesselLike = Vessel | str | Path
"""Argument ``vessel`` of public functions: a vessel, the name of a shipped one, or the path of a vessel file."""


def shipped_vessels() -> tuple[str, ...]:
    """Names of the vessels in the package."""
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
        For an unknown vessel, an unreadable file, unknown or missing keys, unknown terms, and impossible values.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> vessel.dofs, vessel.particulars.L
    (('surge', 'sway', 'yaw'), 320.0)
    """
    _check_source(source)
    path = Path(source)
    if path.suffix != ".toml":
        if str(source) not in shipped_vessels():
            names = ", ".join(shipped_vessels())
            hint = did_you_mean(str(source), shipped_vessels())
            raise VesselError(f"A vessel is one of {names} or the path of a .toml file; found {str(source)!r}{hint}.")
        path = SHIPPED / f"{source}.toml"
    return _vessel(toml_file(path, "The vessel file", VesselError))


def _check_source(source: object) -> None:
    if not isinstance(source, str | Path):
        kinds = f"a Vessel, the name of a shipped one ({', '.join(shipped_vessels())}) or the path of a .toml file"
        raise VesselError(f"A vessel is {kinds}, found {short_repr(source)}; give one of these.")


def as_vessel(vessel: VesselLike) -> Vessel:
    """Vessel of a :data:`VesselLike`; a Vessel is returned unchanged. VesselError as :func:`load_vessel`."""
    return vessel if isinstance(vessel, Vessel) else load_vessel(vessel)


def _vessel(file: Entry) -> Vessel:
    file.check_keys(("name", "title", "sources", "parts", *_TABLES), ("name", "particulars"))
    name, forces = file.at("name").text(), file.at("coefficients", {})
    if not 0 < len(name) <= _LONGEST or not name.isprintable():
        file.at("name").fail(f"must be one line of 1 to {_LONGEST} characters, found {short_repr(name)}; correct it.")
    forces.check_keys(DOFS)
    parts = _texts_of(file.at("parts", []))
    rolls = "roll" in forces
    dofs = DOFS if rolls else DOFS[:3]
    particulars = _particulars(file.at("particulars"), rolls=rolls)
    inertia = _numbers(file.at("inertia", {}), _INERTIA, _INERTIA[2:] if rolls else ())
    added_mass = _numbers(file.at("added_mass", {}), ADDED_MASS)
    derived = _estimate_inertia(particulars, inertia, added_mass, file)
    vessel = Vessel(
        name=name,
        title=file.at("title", name).text(),
        sources=_texts_of(file.at("sources", [])),
        particulars=particulars,
        m=inertia["m"],
        I_zz=inertia["I_zz"],
        I_xx=inertia.get("I_xx", 0.0),
        added_mass=dict.fromkeys(ADDED_MASS, 0.0) | added_mass,
        forces={dof: _force(forces.at(dof), dof) if dof in forces else () for dof in dofs},
        propeller=_dimensions(file.at("propeller"), Propeller) if "propeller" in file else None,
        rudder=_dimensions(file.at("rudder"), Rudder, positive=True) if "rudder" in file else None,
        windage=_dimensions(file.at("windage"), Windage, positive=True) if "windage" in file else None,
        derived=derived,
    )
    if parts or "parameters" in file:
        try:
            vessel = with_parts(vessel, parts, _parameters(file.at("parameters", {})))
        except VesselError as error:
            raise VesselError(f"{file.file}: {error}") from None
    loaded = [c.name for force in vessel.forces.values() for c in force if needs_propeller(c.term)]
    if loaded and not vessel.propeller:
        raise VesselError(f"{file.file}: {', '.join(loaded)} need a propeller, found none; add the table [propeller].")
    _check_possible(findings(vessel), file)
    return vessel


def _check_possible(findings: Iterable[Finding], file: Entry) -> None:
    for finding in findings:
        if finding.impossible:
            raise VesselError(f"{file.file}: {finding.sentence}")


def _estimate_inertia(
    s: Particulars, inertia: dict[str, float], added_mass: dict[str, float], file: Entry
) -> dict[str, str]:
    """Add estimates of missing inertia and added mass to both dicts; return the method by key."""
    derived = {}
    if "m" not in inertia:
        inertia["m"] = displaced_mass(s)
        derived["inertia.m"] = f"{inertia['m']:.5g} (2 volume/L^3)"
    if "I_zz" not in inertia:
        inertia["I_zz"] = yaw_inertia(s, inertia["m"])
        derived["inertia.I_zz"] = f"{inertia['I_zz']:.5g} (a radius of gyration of {K_ZZ} L)"
    missing = [name for name in DIAGONAL if name not in added_mass]
    if missing:
        try:
            charts = motora_added_mass(s, inertia["m"])
        except VesselError as error:
            raise VesselError(f"{file.file}: added_mass lacks {', '.join(missing)}. {error}") from None
        added_mass |= {name: charts[name] for name in missing}
        derived |= {f"added_mass.{name}": f"{charts[name]:.5g} (Motora's charts)" for name in missing}
    return derived


def _texts_of(entry: Entry) -> tuple[str, ...]:
    if not isinstance(entry.value, list) or not all(isinstance(text, str) for text in entry.value):
        entry.fail(f"must be a list of texts, found {short_repr(entry.value)}; correct it.")
    return tuple(entry.value)


def _particulars(table: Entry, *, rolls: bool) -> Particulars:
    required = (*_PARTICULARS, *(_OF_ROLL if rolls else ()))
    particulars = Particulars(**_numbers(table, [f.name for f in fields(Particulars)], required))
    _check_possible(particulars_findings(particulars), table)
    return particulars


def _dimensions[T: (Propeller, Rudder, Windage)](table: Entry, kind: type[T], *, positive: bool = False) -> T:
    names = [field.name for field in fields(kind)]
    numbers = _numbers(table, names, names)
    for name, value in numbers.items():
        if positive and value <= 0.0:
            table.at(name).fail(f"must be positive, found {value:g}; correct it.")
    return kind(**numbers)


def _parameters(table: Entry) -> dict[str, Coefficient]:
    table.check_table()
    return {name: Coefficient(name, **_value_and_details(table.at(name), ("unit",))) for name in table}


def _value_and_details(entry: Entry, more: Sequence[str]) -> dict[str, Any]:
    """Value, standard deviation (NaN if not stated) and texts of a number."""
    value, details = _value(entry, ("sd", *more)), _details(entry)
    sd = details.at("sd").number() if "sd" in details else math.nan
    if sd <= 0.0:
        details.at("sd").fail(f"must be positive, found {sd:g}; leave out an unknown sd.")
    return {"value": value, "sd": sd, **_texts(details, _TEXTS)}


def _details(entry: Entry) -> Entry:
    return entry if isinstance(entry.value, dict) else replace(entry, value={})


def _numbers(table: Entry, known: Sequence[str], required: Sequence[str] = ()) -> dict[str, float]:
    """Numbers of a table by key; each may be a table with details, and the whole table may have a source."""
    table.check_keys((*known, "source"), required)
    _texts(table, ("source",))
    return {key: _value(table.at(key)) for key in table if key != "source"}


def _value(entry: Entry, more: Sequence[str] = ()) -> float:
    if not isinstance(entry.value, dict):
        return entry.number()
    entry.check_keys(("value", *_TEXTS, *more), ("value",))
    _texts(entry, _TEXTS)
    return entry.at("value").number()


def _texts(table: Entry, names: Sequence[str]) -> dict[str, str]:
    return {name: table.at(name, "").text() for name in names}


def _force(table: Entry, dof: str) -> tuple[Coefficient, ...]:
    table.check_table()
    source = table.at("source", "").text()
    force = tuple(_coefficient(name, table.at(name), dof, source) for name in table if name != "source")
    if not force:
        table.fail(f"is empty; add a coefficient such as {LETTER[dof]}v, or leave the table out.")
    spellings: dict[tuple[int, ...], str] = {}
    for one in force:
        first = spellings.setdefault(tuple(sorted(factors(one.term))), one.name)
        if first != one.name:
            table.fail(f"must have each term once, found {one.name}, which is the term of {first}; write one of them.")
    return force


def _coefficient(name: str, entry: Entry, dof: str, source: str) -> Coefficient:
    if not name.startswith(LETTER[dof]):
        entry.fail(f"must begin with {LETTER[dof]}, the letter of {dof}.")
    if len(name) > _LONGEST:
        entry.fail(f"must be at most {_LONGEST} characters long; shorten it.")
    try:
        factors(name[1:])
    except UnknownTerm as error:
        entry.fail(f"must name a coefficient. {error}")
    numbers = _value_and_details(entry, ("published", "published_error"))
    numbers["source"] = numbers["source"] or source
    for key in ("published", "published_error"):
        table = _details(entry).at(key, {})
        table.check_table()
        numbers[key] = {method: table.at(method).number() for method in table}
    return Coefficient(name, **numbers)
