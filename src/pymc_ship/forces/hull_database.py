"""What captive tests of other ships say of a bare hull.

Yoshimura & Masumoto (2012), Hydrodynamic database and manoeuvring prediction method with medium high-speed merchant
ships and fishing vessels, Proc. MARSIM, fitted the forces on bare hulls about midship, X', Y', N' over rho/2 L d U^2
(N' by L more) as polynomials of drift angle and yaw rate, with coefficients from C_B, L/B and d/L alone. They stand
here as others have coded them, compared with each other and with captive tests of the KVLCC2.
"""

from __future__ import annotations

import math

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


def bare_hull(L: float, B: float, d: float, volume: float) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of the hull's coefficients by name, prime values.

    Parameters
    ----------
    L, B, d : float
        Length, breadth and draught [m].
    volume : float
        Displacement volume [m3].

    Returns
    -------
    dict of str to (float, float)
        Of Xvv, Xvr, Xrr, and the linear and cubic coefficients in v and r of Y and N, about midship. The added mass of
        the steady turn (m_y v r, m_x u r), which the equations of motion leave to the coefficients, is in them.
    """
    fullness, slender, by_draught = volume / (L**2 * d), L / B, d / L
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
