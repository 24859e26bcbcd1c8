"""Numbers of a vessel outside the possible or the usual ranges."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass

import numpy as np

from pymc_ship.physics.vessel.ranges import INERTIA, PARTICULARS, PROPELLER, ROLL_COUPLINGS, Rule, coefficient_rules
from pymc_ship.physics.vessel.vessel import Particulars, Vessel


@dataclass(frozen=True)
class Finding:
    """A number of a vessel, by its ``key`` in the file, outside its usual range: ``impossible`` or doubtful."""

    key: str
    impossible: bool
    sentence: str


def particulars_findings(s: Particulars) -> list[Finding]:
    """Findings on particulars, in the order of the rules, up to the first impossible one."""
    return list(_apply_rules(PARTICULARS, s, _numbers("particulars", asdict(s))))


def findings(vessel: Vessel) -> list[Finding]:
    """Findings on all numbers of a vessel, up to the first impossible one; estimated values are not doubtful."""
    result = particulars_findings(vessel.particulars)
    if any(finding.impossible for finding in result):
        return result
    rules = (*INERTIA, *(ROLL_COUPLINGS if "roll" in vessel.forces else ()), *(PROPELLER if vessel.propeller else ()))
    others = _apply_rules((*rules, *coefficient_rules(vessel)), vessel, _numbers_by_key(vessel))
    result += [finding for finding in others if finding.impossible or finding.key not in vessel.derived]
    J = vessel.inertia_matrix
    if not any(finding.impossible for finding in result) and np.linalg.eigvalsh(J + J.T)[0] <= 0.0:
        text = "inertia and added_mass give a negative kinetic energy; correct the couplings, x_G or z_G."
        result.append(Finding("added_mass", True, text))
    return result


def remarks(vessel: Vessel) -> list[str]:
    """Sentences on the estimated and the doubtful numbers of a vessel."""
    derived = ", ".join(f"{key} = {how}" for key, how in vessel.derived.items())
    estimated = [f"Estimated, because the vessel file does not state it: {derived}."] if derived else []
    return estimated + [finding.sentence for finding in findings(vessel)]


def _numbers(table: str, values: Mapping[str, float]) -> dict[str, float]:
    return {f"{table}.{name}": value for name, value in values.items()}


def _numbers_by_key(vessel: Vessel) -> dict[str, float]:
    numbers = _numbers("particulars", asdict(vessel.particulars)) | _numbers("added_mass", vessel.added_mass)
    numbers |= _numbers("inertia", {"m": vessel.m, "I_zz": vessel.I_zz, "I_xx": vessel.I_xx})
    numbers |= _numbers("propeller", asdict(vessel.propeller) if vessel.propeller else {})
    for dof, force in vessel.forces.items():
        values = {c.name: c.value for c in force} | {f"{c.name}.sd": c.sd for c in force}
        numbers |= _numbers(f"coefficients.{dof}", values)
    return numbers


def _apply_rules(rules: Iterable[Rule], ship: Particulars | Vessel, values: Mapping[str, float]) -> Iterator[Finding]:
    for rule in rules:
        value = values[rule.key]
        number = rule.number(ship) if rule.number else value
        if number is None or rule.usual[0] <= number <= rule.usual[1]:
            continue
        impossible = not rule.possible[0] <= number <= rule.possible[1]
        low, high = rule.possible if impossible else rule.usual
        derived = f" gives {rule.what} = {number + 0.0:.3g}" if rule.what else ""
        lies = "must lie" if impossible else "usually lies"
        sentence = f"{rule.key} = {value:.6g}{derived}, which {lies} between {low:.4g} and {high:.4g}; {rule.hint}."
        yield Finding(rule.key, impossible, sentence)
        if impossible:
            return
