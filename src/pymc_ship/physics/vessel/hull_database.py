"""Prior of polynomial hull coefficients from :mod:`pymc_ship.physics.forces.hull_database`."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.forces.hull_database import SOURCE, bare_hull, cross_flow_terms, typical_rudder
from pymc_ship.physics.forces.terms import ROW_RUDDER, SYMBOLS, evaluate, factors, is_mirrored
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import LETTER, Coefficient, Vessel

STRIPS = "cross-flow drag of strips, C_D 0.8"  # source of the quadratic terms
TYPICAL_RUDDER = "typical rudder behind a single screw"  # source of convex rudder terms and even terms in the yaw rate

# prime motion in a hard turn: there, all terms of a degree of freedom have forces of like size a priori
HARD_TURN = {"u": 0.5, "v": 0.3, "r": 0.7, "p": 0.5, "phi": 0.2, "delta": 0.6, "g": 1.0, "T": 1.0}
SLENDER_DRAUGHT = 1.0 / 20.0  # draught over length where a vessel file states none
HULL_ERROR = 0.3  # error of the hull database as an account of other polynomials, over its rms force
_DRIFT, _TURNING = (-0.25, -0.1, 0.0, 0.1, 0.25), (-0.6, -0.3, 0.0, 0.3, 0.6)  # v' and r' where both are compared


@dataclass(frozen=True, eq=False)
class ParticularsPrior:
    """Prior of the coefficients by the particulars of a vessel, prime values in its order, (n_terms,)."""

    mean: np.ndarray  # of terms in v and r of the symmetric hull, 0 of all others
    scale: np.ndarray  # sd of those terms, or the force of the hull over the term in a hard turn
    of_hull: np.ndarray  # whether the hull database gives the mean


def particulars_prior(vessel: Vessel) -> ParticularsPrior:
    """Mean and scale of all coefficients from L, B, draught and volume, for any polynomial.

    The force of the hull database over a grid of v and r, with its covariance, is one more observation of the terms in
    v and r alone that a symmetric hull can have; roll moments have half a draught as their arm.
    """
    s = vessel.particulars
    draught = s.d or SLENDER_DRAUGHT * s.L
    v, r = np.array(list(product(_DRIFT, _TURNING))).T
    motion = dict.fromkeys(SYMBOLS, np.zeros(v.size)) | {"v": v, "r": r}
    by_letter: dict[str, tuple[np.ndarray, np.ndarray]] = {}  # force of the hull and its covariance
    for letter in "XYN":
        known = {n[1:]: law for n, law in bare_hull(s.L, s.B, draught, s.volume).items() if n[0] == letter}
        (mean, sd), columns = np.array(list(known.values())).T, evaluate(tuple(known), motion)
        force = columns @ mean
        error = HULL_ERROR**2 * np.mean(force**2) * np.eye(v.size)
        by_letter[letter] = force, (columns * sd**2) @ columns.T + error
    hard_turn = {name: np.full(1, value) for name, value in HARD_TURN.items()}
    mean, scale, of_hull = [], [], []
    for dof in vessel.dofs:
        terms, hull = vessel.terms(dof), np.array([_is_hull(term, dof) for term in vessel.terms(dof)], dtype=bool)
        force, spread = by_letter.get(LETTER[dof], by_letter["Y"])
        size = np.sqrt(np.mean(force**2)) * (0.5 * draught / s.L if dof == "roll" else 1.0)
        mean.append(np.zeros(len(terms)))
        scale.append(size / np.abs(evaluate(terms, hard_turn))[0])
        of_hull.append(hull)
        if hull.any():
            design = evaluate(tuple(np.array(terms)[hull]), motion)
            weighted = np.linalg.solve(spread, design).T
            covariance = np.linalg.inv(np.diag((2.0 * scale[-1][hull]) ** -2.0) + weighted @ design)
            mean[-1][hull], scale[-1][hull] = covariance @ (weighted @ force), np.sqrt(np.diag(covariance))
    return ParticularsPrior(np.concatenate(mean), np.concatenate(scale), np.concatenate(of_hull))


def _is_hull(term: str, dof: str) -> bool:
    rows = factors(term)
    by_v_and_r = {SYMBOLS[(row - 1) % len(SYMBOLS)] for row in rows if row < ROW_RUDDER} <= {"v", "r"}
    return bool(rows) and by_v_and_r and max(rows) < ROW_RUDDER and dof != "roll" and is_symmetric(term, dof)


def is_symmetric(term: str, dof: str) -> bool:
    """Whether a ship alike on both sides can have a term: surge is even, other forces are odd under the mirror."""
    return is_mirrored(term) == (dof != "surge")


def hull_coefficients(vessel: VesselLike) -> dict[str, tuple[float, float]]:
    """Coefficients of :func:`.bare_hull` of a vessel; VesselError without a draught."""
    vessel = as_vessel(vessel)
    s = vessel.particulars
    if s.d <= 0.0:
        raise VesselError(
            f"The prior hull_database needs the draught d of {vessel.name!r}, found none; add d [m] to [particulars], "
            "or choose the prior order_damped."
        )
    return bare_hull(s.L, s.B, s.d, s.volume)


def with_hull_database(vessel: Vessel) -> Vessel:
    """Vessel with values and sds from hull database, cross-flow drag and typical rudder; VesselError without a draught.

    A coefficient with an sd in the vessel file stays unchanged. So does a linear one of sway and yaw without a partner
    by propeller loading (``gv`` of ``v``), since it contains the force of the rudder, too.
    """
    names = {c.name for force in vessel.forces.values() for c in force}
    with_rudder = {f"{letter}{term}" for letter in "YN" for term in "vr" if f"{letter}g{term}" not in names}
    hull = {name: law for name, law in hull_coefficients(vessel).items() if name not in with_rudder}
    strips = cross_flow_terms(vessel.particulars.L, vessel.particulars.d)
    return with_typical_rudder(_with_prior(_with_prior(vessel, hull, SOURCE), _with_loading(strips), STRIPS))


def with_typical_rudder(vessel: Vessel) -> Vessel:
    """Vessel with the even and convex terms of a typical rudder where it has no sd; a missing draught is L/20."""
    s = vessel.particulars
    return _with_prior(vessel, _with_loading(typical_rudder(s.L, s.d or s.L / 20.0)), TYPICAL_RUDDER)


def _with_loading(known: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """The same laws with and without the factor g of propeller loading, which is 1 at the nominal speed."""
    return known | {f"{name[0]}g{name[1:]}": law for name, law in known.items()}


def _with_prior(vessel: Vessel, known: dict[str, tuple[float, float]], source: str) -> Vessel:
    """Vessel with values, sds and source of the known coefficients that have no sd."""

    def with_law(c: Coefficient) -> Coefficient:
        value, sd = known.get(c.name, (c.value, c.sd))
        return c if c.name not in known or c.sd > 0.0 else replace(c, value=value, sd=sd, source=source)

    return replace(vessel, forces={dof: tuple(with_law(c) for c in force) for dof, force in vessel.forces.items()})
