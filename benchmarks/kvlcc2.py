"""The KVLCC2 tanker's 7 m model as shipmmg documents it, cut down to what it and this package express alike.

Taken from shipmmg: hull polynomials, added masses, propeller thrust k_0 + k_2 J^2 and rudder normal force. Left out:
the linear k_1 J, the wake, flow straightening and slipstream at the rudder; the centre of gravity is amidships. What is
left is a polynomial in the prime motion but for sin(delta), cos(delta) and u / U, whose series are taken so far that
they are right to 1e-6 at 20 deg (Yasukawa & Yoshimura 2015, doi:10.1007/s00773-014-0293-y).
"""

from __future__ import annotations

from collections import Counter

import pymc_ship as ps
from pymc_ship.physics.vessel.vessel import ADDED_MASS, LETTER, Coefficient, Particulars

DENSITY, LENGTH, BREADTH, DRAUGHT = 1025.0, 7.0, 1.27, 0.46
SPEED, REVOLUTIONS, DIAMETER = 1.179, 10.4, 0.216
MASS = 3.27 * DENSITY
INERTIA = MASS * (0.25 * LENGTH) ** 2
ADDED = {"x": 0.022, "y": 0.223, "z": 0.011}
"""Added masses over 1/2 rho L^2 d, and the added moment of inertia over 1/2 rho L^4 d."""

THRUST = {"k_0": 0.2931, "k_2": -0.1385, "deduction": 0.220}
RUDDER = {"area": 0.0539, "gradient": 2.747, "t_R": 0.387, "a_H": 0.312, "x_R": -0.5, "x_H": -0.464}
HULL = {
    "surge": {"0": -0.022, "vv": -0.040, "vr": 0.002, "rr": 0.011, "vvvv": 0.771},
    "sway": {"v": -0.315, "r": 0.083, "vvv": -1.607, "vvr": 0.379, "vrr": -0.391, "rrr": 0.008},
    "yaw": {"v": -0.137, "r": -0.049, "vvv": -0.030, "vvr": -0.294, "vrr": 0.055, "rrr": -0.013},
}
_SINE_COSINE = (1.0, -2.0 / 3.0, 2.0 / 15.0, -4.0 / 315.0)
_SINE_SQUARED = (1.0, -1.0 / 3.0, 2.0 / 45.0, -1.0 / 315.0)


def forces() -> dict[str, Counter]:
    """Prime coefficient of every term, by degree of freedom."""
    slender = DRAUGHT / LENGTH
    found = {dof: Counter({term: slender * value for term, value in row.items()}) for dof, row in HULL.items()}
    surge, sway, yaw = (found[dof] for dof in HULL)
    thrust = 2.0 * (1.0 - THRUST["deduction"]) * DIAMETER**2 / LENGTH**2
    a, b = thrust * THRUST["k_0"] * (REVOLUTIONS * DIAMETER / SPEED) ** 2, thrust * THRUST["k_2"]
    surge.update({"0": a + b, "u": -2.0 * a, "uu": a, "vv": -b})
    surge.update({"vr": ADDED["y"] * slender})
    drift = ADDED["x"] * slender
    sway.update({"r": -drift, "vvr": drift / 2.0, "vvvvr": drift / 8.0, "vvvvvvr": drift / 16.0})
    normal = RUDDER["area"] * RUDDER["gradient"] / LENGTH**2
    arm = RUDDER["x_R"] + RUDDER["a_H"] * RUDDER["x_H"]
    shares = (surge, -(1.0 - RUDDER["t_R"]), _SINE_SQUARED, 2), (sway, -(1.0 + RUDDER["a_H"]), _SINE_COSINE, 1)
    for force, share, series, first in (*shares, (yaw, -arm, _SINE_COSINE, 1)):
        for k, factor in enumerate(series):
            term = "delta" * (first + 2 * k)
            force.update({term: share * normal * factor, f"vv{term}": -share * normal * factor})
    return found


def n_terms() -> int:
    """Number of polynomial terms."""
    return sum(len(row) for row in forces().values())


def vessel() -> ps.Vessel:
    """The vessel of this package."""
    unit, slender = 0.5 * DENSITY * LENGTH**3, DRAUGHT / LENGTH
    added = dict.fromkeys(ADDED_MASS, 0.0)
    added |= {"Xudot": -ADDED["x"] * slender, "Yvdot": -ADDED["y"] * slender, "Nrdot": -ADDED["z"] * slender}
    coefficients = {
        dof: tuple(Coefficient(LETTER[dof] + term, value) for term, value in row.items())
        for dof, row in forces().items()
    }
    particulars = Particulars(LENGTH, BREADTH, 3.27, SPEED, 15.0)
    return ps.Vessel("kvlcc2", particulars, MASS / unit, INERTIA / (unit * LENGTH**2), 0.0, added, coefficients)


def shipmmg_inputs(library) -> tuple:
    """Basic and manoeuvring parameters of shipmmg."""
    unit = 0.5 * DENSITY * LENGTH**2 * DRAUGHT
    basic = library.Mmg3DofBasicParams(
        L_pp=LENGTH,
        B=BREADTH,
        d=DRAUGHT,
        x_G=0.0,
        D_p=DIAMETER,
        m=MASS,
        I_zG=INERTIA,
        A_R=RUDDER["area"],
        η=DIAMETER / 0.345,
        m_x=ADDED["x"] * unit,
        m_y=ADDED["y"] * unit,
        J_z=ADDED["z"] * unit * LENGTH**2,
        f_α=RUDDER["gradient"],
        ϵ=1.0,
        t_R=RUDDER["t_R"],
        x_R=RUDDER["x_R"] * LENGTH,
        a_H=RUDDER["a_H"],
        x_H=RUDDER["x_H"] * LENGTH,
        γ_R_minus=0.0,
        γ_R_plus=0.0,
        l_R=-0.710,
        κ=0.0,
        t_P=THRUST["deduction"],
        w_P0=0.0,
        x_P=-0.650,
    )
    hull = {
        f"{LETTER[dof]}_{term}_dash": value for dof, row in HULL.items() for term, value in row.items() if term != "0"
    }
    thrust = {"k_0": THRUST["k_0"], "k_1": 0.0, "k_2": THRUST["k_2"]}
    return basic, library.Mmg3DofManeuveringParams(**thrust, R_0_dash=-HULL["surge"]["0"], **hull)
