"""Reading of captive tests: drift, yaw rate, rudder, speed and revolutions with the measured forces."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from pymc_ship.inference.captive.plausibility import check_captive_tests
from pymc_ship.machine.arguments import as_path
from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.toml import toml_table
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.files.columns import Column
from pymc_ship.records.files.format import TrialFormat, load_format
from pymc_ship.records.files.reading import TextTable, table_cells, text_table
from pymc_ship.trial.thinning import MOST_CELLS, MOST_ROWS
from pymc_ship.trial.units import METRE_PER_SECOND, RADIAN, RADIAN_PER_SECOND, REVOLUTION_PER_SECOND

FORCE_DOFS = {"X": "surge", "Y": "sway", "N": "yaw"}  # degree of freedom of each force
FORCES = tuple(FORCE_DOFS)  # measured forces; a file has one of them or more
_SPEEDS = (0.1, 2.0)  # range of the median speed of captive tests over the nominal speed
_OF_A_MODEL = 0.35  # the same, below which tests are probably of a model: 1/8 of the length, at its speed by Froude
_KNOTS, _NEAR = 3600.0 / 1852.0, 0.05  # ratio of a speed in knots, read in m/s, and its largest relative error

_MOTION = {
    "beta": (RADIAN, ("beta", "β", "drift", "drift angle")),
    "delta": (RADIAN, ("delta", "δ", "rudder", "rudder angle")),
    "r": (RADIAN_PER_SECOND, ("r", "r'", "yaw rate")),
    "U": (METRE_PER_SECOND, ("u", "v", "speed")),
    "n": (REVOLUTION_PER_SECOND, ("n", "rps", "rpm", "revolutions", "propeller speed")),
}
"""Unit and headings in lower case of each column of motion."""

_KEYS = {"rudder_positive", "reference", "forces", "froude", "facility", "delimiter", "skip_rows"}


def read_captive(path: str | Path, vessel: VesselLike, *, format: str | Path | Mapping | None = None) -> xr.Dataset:
    """Read captive tests from a text file.

    Headings, with the unit in brackets: drift angle ``beta``, rudder angle ``delta``, yaw rate ``r`` (without a unit
    r' = r L / U), speed ``U`` or ``speed``, revolutions ``n``, ``rps`` or ``rpm``, and the prime forces ``X'``, ``Y'``
    and ``N'``, over rho/2 L^2 U^2 (N' by L more) at the speed of that row. A missing column of motion is 0; missing
    revolutions are the nominal ones.

    Parameters
    ----------
    path : str or Path
    vessel : Vessel, str or Path
        For L and the nominal speed.
    format : str, Path or mapping, optional
        Frame and scale of the tests; see docs/reference/format_toml.md.

    Returns
    -------
    Dataset, dims (test,)
        u, v [m/s], r [rad/s] and delta [rad] of the full-scale ship about its origin, n [1/s] if measured, and the
        prime forces. ``attrs["reading"]`` has a line for each conversion.

    Raises
    ------
    TrialError
        For a file, heading, unit or cell that cannot be read, speeds far from the nominal one, and forces that no ship
        has: by their scale, sign or inertia, or not measured.

    Examples
    --------
    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> rows = ["beta [deg],delta [deg],speed [kn],X',Y',N'", "0,10,15.5,-1e-4,5e-4,-3e-4", "8,0,15.5,-2e-4,3e-3,1e-3"]
    >>> np.savetxt("captive.csv", rows, fmt="%s")
    >>> tests = ps.read_captive("captive.csv", "kvlcc2")
    >>> print(f"{tests['v'].values[1]:.2f} m/s", tests["Y"].values)
    -1.11 m/s [0.0005 0.003 ]
    """
    vessel, path, layout = as_vessel(vessel), as_path("path", path, TrialError), load_format(format)
    unused = [key for key, value in vars(layout).items() if value != getattr(TrialFormat(), key) and key not in _KEYS]
    if unused:
        raise TrialError(f"A format of captive tests has no {unused[0]}; leave it out, and name columns in the header.")
    table = text_table(path, layout)
    if table.every > 1:
        raise TrialError(
            f"{path}: captive tests have at most {MOST_ROWS} rows and {MOST_CELLS} cells, found more; split it."
        )
    columns = _columns(table, path)
    cells, notes = table_cells(table, columns, path)
    quantities = {name: column.si(cells[name]) for name, column in columns.items()}
    bad = [name for name, values in quantities.items() if not np.isfinite(values).all()]
    if bad:
        raise TrialError(f"{path}: every captive test needs a number in each column, {bad[0]} lacks one; fill it in.")
    if not quantities["U"].all():
        raise TrialError(f"{path}: prime forces are over the square of the speed, found a speed of 0; leave it out.")
    if "r" in quantities and not columns["r"].unit:
        quantities["r"] = quantities["r"] * quantities["U"] / (vessel.particulars.L / layout.froude)
    tests = _tests(quantities, layout, vessel)
    stated = format is not None and "froude" in toml_table(format, "The format", TrialError).at("scale", {})
    ratio = float(np.median(np.hypot(tests["u"], tests["v"]))) / vessel.particulars.nominal_speed
    _check_speed(ratio, columns["U"], vessel.particulars.nominal_speed, stated, path)
    check_captive_tests(tests, vessel, path, quantities.get("beta", np.zeros(1)))
    rows = np.column_stack([tests[name].values for name in tests])
    first = np.sort(np.unique(rows, axis=0, return_index=True)[1])
    remarks = [f"{len(rows) - first.size} repeated rows are counted once."] if first.size < len(rows) else []
    reading = "\n".join([*table.notes, *notes, *remarks])
    return tests.isel(test=first).assign_attrs(reading=reading, source=path.name)


def _check_speed(ratio: float, column: Column, nominal: float, scaled: bool, path: Path) -> None:
    if column.factor == 1.0 and abs(ratio / _KNOTS - 1.0) < _NEAR:
        raise TrialError(
            f"{path}, column {column.heading!r}: a speed{'' if column.unit else ' without a unit'} is in m/s, found a "
            f"median of {ratio:.3g} times the ship's nominal one, as in knots; write speed [kn], or correct the "
            "nominal speed of the vessel file."
        )
    slowest, fastest = _SPEEDS
    if not (slowest if scaled else _OF_A_MODEL) < ratio < fastest:
        raise TrialError(
            f"{path}: captive tests are at speeds near the ship's nominal {nominal:.3g} m/s, found "
            f"a median of {ratio * nominal:.3g} m/s; give the scale of the model as scale.froude in a format file (1: "
            "the ship itself), or correct the unit."
        )


def _columns(table: TextTable, path: Path) -> dict[str, Column]:
    columns: dict[str, Column] = {}
    for index, heading in enumerate(table.headings):
        name, unit = _name_and_unit(heading, table.units[index])
        if name == "v":
            raise TrialError(
                f"{path}, column {heading!r}: captive tests have the speed of the carriage and the drift angle, found "
                "v, which may be the velocity of sway; write U and beta."
            )
        quantity = next((force for force in FORCES if name in (force, f"{force}'")), "")
        quantity = quantity or next((key for key, (_, headings) in _MOTION.items() if name.lower() in headings), "")
        if not quantity:
            continue
        if quantity in columns:
            raise TrialError(
                f"{path}: {quantity} is to be read from one column, found {columns[quantity].heading!r} and "
                f"{heading!r}; rename one."
            )
        unit = unit or (name if name.lower() in ("rps", "rpm") else "")
        known = _MOTION[quantity][0] if quantity in _MOTION else None
        factor = known.factor(unit) if unit and known else None if unit else 1.0
        if factor is None:
            wanted = f"one of {', '.join(known.spellings)}" if known else "left out, as forces are prime"
            raise TrialError(f"{path}, column {heading!r}: the unit is {wanted}, found {unit!r}; correct it.")
        columns[quantity] = Column(channel=quantity, index=index, heading=heading, unit=unit, factor=factor)
    if "U" not in columns or not set(FORCES) & set(columns):
        raise TrialError(
            f"{path}: captive tests have the columns speed and any of X', Y', N', found {', '.join(table.headings)!r}; "
            "rename them."
        )
    return columns


def _name_and_unit(heading: str, below: str) -> tuple[str, str]:
    bracketed = re.fullmatch(r"(.*?)\s*[\[({]([^\])}]*)[\])}]\s*", heading)
    return (bracketed[1].strip(), bracketed[2].strip()) if bracketed else (heading.strip(), below)


def _tests(quantities: dict[str, np.ndarray], layout: TrialFormat, vessel: Vessel) -> xr.Dataset:
    """Tests at full scale, about the origin of the ship, with rudder positive for a turn to port."""
    L, root = vessel.particulars.L, np.sqrt(layout.froude)
    zero = np.zeros_like(quantities["U"])
    U, beta = root * quantities["U"], quantities.get("beta", zero)
    u, v, r = U * np.cos(beta), -U * np.sin(beta), quantities.get("r", zero) / root
    side = -1.0 if layout.rudder_positive == "starboard" else 1.0
    lever = layout.reference * layout.froude
    motion = {"u": u, "v": v - lever * r, "r": r, "delta": side * quantities.get("delta", zero)}
    if "n" in quantities:
        motion["n"] = quantities["n"] / root
    area = 1.0 if layout.forces == "L2" else vessel.particulars.d / L
    speed_ratio = (U / np.hypot(motion["u"], motion["v"])) ** 2
    forces = {name: area * speed_ratio * quantities[name] for name in FORCES if name in quantities}
    if "N" in forces and lever:
        if "Y" not in forces:
            raise TrialError("A moment about another point than the origin needs Y'; add it, or give N' there.")
        forces["N"] = forces["N"] + lever / L * forces["Y"]
    return xr.Dataset({name: ("test", values) for name, values in (motion | forces).items()})
