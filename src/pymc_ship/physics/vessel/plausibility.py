"""What is odd about the numbers of a vessel: what no ship has, and what ships rarely have."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass

import numpy as np

from pymc_ship.physics.vessel.ranges import (
    INERTIA,
    PARTICULARS,
    PROPELLER,
    ROLL_COUPLINGS,
    Rule,
    coefficient_rules,
    rolls,
)
from pymc_ship.physics.vessel.vessel import Particulars, Vessel


@dataclass(frozen=True)
class Finding:
    """A number of a vessel that is not that of a usual ship.

    Attributes
    ----------
    key : str
        Where it stands in the file.
    impossible : bool
        Whether no ship has it; else it is doubtful.
    sentence : str
        Key, value, what it leads to, the range, and what may explain it.
    """

    key: str
    impossible: bool
    sentence: str


def particulars_findings(s: Particulars) -> list[Finding]:
    """What is odd about particulars, in the order of the rules; the first that is impossible ends the list."""
    return list(_judged(PARTICULARS, s, _numbers("particulars", asdict(s))))


def findings(vessel: Vessel) -> list[Finding]:
    """What is odd about the numbers of a vessel.

    Parameters
    ----------
    vessel : Vessel

    Returns
    -------
    list of Finding
        In the order of the rules; the first that is impossible ends the list, since others are judged by it. What was
        derived is not called doubtful.
    """
    found = particulars_findings(vessel.particulars)
    if any(finding.impossible for finding in found):
        return found
    rules = (*INERTIA, *(ROLL_COUPLINGS if rolls(vessel) else ()), *(PROPELLER if vessel.propeller else ()))
    others = _judged((*rules, *coefficient_rules(vessel)), vessel, _stated(vessel))
    found += [finding for finding in others if finding.impossible or finding.key not in vessel.derived]
    J = vessel.inertia_matrix
    if not any(finding.impossible for finding in found) and np.linalg.eigvalsh(J + J.T)[0] <= 0.0:
        text = "inertia and added_mass make a negative kinetic energy; correct the couplings, x_G or z_G."
        found.append(Finding("added_mass", True, text))
    return found


def remarks(vessel: Vessel) -> list[str]:
    """Sentences on a vessel: what was derived where her file states nothing, and what is doubtful in it."""
    derived = ", ".join(f"{key} = {how}" for key, how in vessel.derived.items())
    said = [f"Derived, since the vessel file leaves it out: {derived}."] if derived else []
    return said + [finding.sentence for finding in findings(vessel)]


def _numbers(table: str, values: Mapping[str, float]) -> dict[str, float]:
    return {f"{table}.{name}": value for name, value in values.items()}


def _stated(vessel: Vessel) -> dict[str, float]:
    """Every number of a vessel by its key in the file."""
    found = _numbers("particulars", asdict(vessel.particulars)) | _numbers("added_mass", vessel.added_mass)
    found |= _numbers("inertia", {"m": vessel.m, "I_zz": vessel.I_zz, "I_xx": vessel.I_xx})
    found |= _numbers("propeller", asdict(vessel.propeller) if vessel.propeller else {})
    for dof, force in vessel.forces.items():
        found |= _numbers(
            f"coefficients.{dof}", {c.name: c.value for c in force} | {f"{c.name}.sd": c.sd for c in force}
        )
    return found


def _judged(rules: Iterable[Rule], ship: Particulars | Vessel, stated: Mapping[str, float]) -> Iterator[Finding]:
    """Findings of some rules, to the first that is impossible."""
    for rule in rules:
        value = stated[rule.key]
        number = rule.number(ship) if rule.number else value
        if number is None or rule.usual[0] <= number <= rule.usual[1]:
            continue
        impossible = not rule.possible[0] <= number <= rule.possible[1]
        low, high = rule.possible if impossible else rule.usual
        leads = f" makes {rule.what} {number + 0.0:.3g}" if rule.what else ""
        lies = "must lie" if impossible else "usually lies"
        sentence = f"{rule.key} = {value:.6g}{leads}, which {lies} from {low:.4g} to {high:.4g}; {rule.perhaps}."
        yield Finding(rule.key, impossible, sentence)
        if impossible:
            return
