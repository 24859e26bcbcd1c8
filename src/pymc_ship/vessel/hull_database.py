"""What is known of a hull before she is tried: regression formulae of captive model tests.

Yoshimura & Masumoto (2012), Hydrodynamic database and manoeuvring prediction method with medium high-speed merchant
ships and fishing vessels, Proc. MARSIM, fitted the forces on bare hulls about midship, X', Y', N' over rho/2 L d U^2
(N' by L more) as polynomials of drift angle and yaw rate, with coefficients from C_B, L/B and d/L alone. A few zigzags
tell linear from cubic forces poorly, since v follows r in all of them; the formulae tell them apart. They stand here as
others have coded them, compared with each other and with captive tests of the KVLCC2.
"""

from __future__ import annotations

import math
from dataclasses import replace

from pymc_ship.vessel.reading import VesselLike, as_vessel
from pymc_ship.vessel.vessel import Coefficient, Vessel, VesselError

SOURCE = "hull database of Yoshimura & Masumoto (2012)"
"""Source of a coefficient whose value and sd come from here."""

_SD = {
    "Xvv": 0.06,
    "Xvr": 0.10,
    "Xrr": 0.03,
    "Yv": 0.12,
    "Yr": 0.04,
    "Yvvv": 0.7,
    "Yvvr": 0.6,
    "Yvrr": 0.3,
    "Yrrr": 0.05,
    "Nv": 0.03,
    "Nr": 0.015,
    "Nvvv": 0.15,
    "Nvvr": 0.25,
    "Nvrr": 0.2,
    "Nrrr": 0.02,
}
"""Standard deviations over rho/2 L d U^2, set by judgement.

Of the captive tests of the KVLCC2 (Yasukawa & Yoshimura 2015, doi:10.1007/s00773-014-0293-y) Yvvr is 1.9 sd from the
formulae, the others 1.2 at most. Nvrr is taken as 0: codings of its formula at hand differ in its sign.
"""


def hull_coefficients(vessel: VesselLike) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of the hull's coefficients by name, prime values.

    Parameters
    ----------
    vessel : Vessel, str or Path
        L, B, draught d and volume of its particulars.

    Returns
    -------
    dict of str to (float, float)
        Of Xvv, Xvr, Xrr, and the linear and cubic coefficients in v and r of Y and N, about midship. The added mass of
        the steady turn (m_y v r, m_x u r), which the equations of motion leave to the coefficients, is in them. The
        formulae have a term in v^4 for surge that no term set has: the sd of Xvv covers it up to v' of 0.3.

    Raises
    ------
    VesselError
        When the draught is not stated.

    Examples
    --------
    What captive tests of other hulls say of a tanker's yaw damping:

    >>> import pymc_ship as ps
    >>> mean, sd = ps.hull_coefficients(ps.load_vessel("kvlcc2"))["Nr"]
    >>> print(f"Nr = {mean:.4f}, sd {sd:.4f}")
    Nr = -0.0035, sd 0.0010
    """
    vessel = as_vessel(vessel)
    s = vessel.particulars
    if s.d <= 0.0:
        raise VesselError(
            f"The prior from the hull database needs the draught of {vessel.name!r}; add d to [particulars], or choose "
            "the prior order_damped."
        )
    fullness, slender, by_draught = s.volume / (s.L**2 * s.d), s.L / s.B, s.d / s.L
    block, aspect = fullness * slender, 2.0 * by_draught
    mean = {
        "Xvv": 1.15 * fullness - 0.18,
        "Xvr": 1.91 * fullness - 0.08,
        "Xrr": -0.085 * fullness + 0.008,
        "Yv": -(0.5 * math.pi * aspect + 1.4 * fullness),
        "Yr": 0.5 * fullness,
        "Yvvv": -(0.185 * slender + 0.48),
        "Yvvr": -0.75,
        "Yvrr": -(0.26 * (1.0 - block) * slender + 0.11),
        "Yrrr": -0.051,
        "Nv": -aspect,
        "Nr": -0.54 * aspect + aspect**2,
        "Nvvv": -(0.66 - 0.69 * block),
        "Nvvr": 1.55 * fullness - 0.76,
        "Nvrr": 0.0,
        "Nrrr": 0.25 * fullness - 0.056,
    }
    return {name: (value * by_draught, _SD[name] * by_draught) for name, value in mean.items()}


def with_hull_database(vessel: Vessel) -> Vessel:
    """Vessel whose hull coefficients are known to what the database says.

    A coefficient of which the vessel file states an sd stays as it is; so does a linear one of sway and yaw without a
    partner by the propeller's loading (``gv`` of ``v``), since it holds the share of the rudder, too. Beside squares of
    v and r, where the formulae have cubes, a linear force is another by less than its sd.

    Raises
    ------
    VesselError
        When the draught is not stated.
    """
    known = hull_coefficients(vessel)
    names = {c.name for force in vessel.forces.values() for c in force}

    def informed(c: Coefficient) -> Coefficient:
        linear = c.name[0] in "YN" and c.term in ("v", "r")
        if c.name not in known or c.sd > 0.0 or (linear and f"{c.name[0]}g{c.term}" not in names):
            return c
        value, sd = known[c.name]
        return replace(c, value=value, sd=sd, source=SOURCE)

    return replace(vessel, forces={dof: tuple(informed(c) for c in force) for dof, force in vessel.forces.items()})
