"""The S175 container ship, 175 m, in surge, sway, yaw and roll.

Son, K. & Nomoto, K. (1982), On the coupled motion of steering and rolling of a high speed container ship, Naval
Architecture and Ocean Engineering 20, 73-83: prime coefficients and equations as in Fossen's MSS toolbox
(VESSELS/container.m, with its corrections of 2001 and 2022). In their signs a positive rudder turns to starboard; here
it turns to port. The limit of 10 deg of the rudder there is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from studies.foreign.sailing import Papers

WATER, GRAVITY = 1025.0, 9.81
LENGTH, VOLUME, SPEED = 175.0, 21222.0, 8.0
M, M_X, M_Y = 0.00792, 0.000238, 0.007049
I_X, J_X, I_Z, J_Z = 0.0000176, 0.0000034, 0.000456, 0.000419
L_X = L_Y = 0.0313
ALPHA_Y = 0.05
SURGE = {"uu": -0.0004226, "vr": -0.00311, "rr": 0.00020, "ff": -0.00020, "vv": -0.00386}
SWAY = {"v": -0.0116, "r": 0.00242, "f": -0.000063, "vvv": -0.109, "rrr": 0.00177, "vvr": 0.0214, "vrr": -0.0405}
SWAY |= {"vvf": 0.04605, "vff": 0.00304, "rrf": 0.009325, "rff": -0.001368}
ROLL = {"v": 0.0003026, "r": -0.000063, "p": -0.0000075, "f": -0.000021, "vvv": 0.002843, "rrr": -0.0000462}
ROLL |= {"vvr": -0.000588, "vrr": 0.0010565, "vvf": -0.0012012, "vff": -0.0000793, "rrf": -0.000243}
ROLL |= {"rff": 0.00003569}
YAW = {"v": -0.0038545, "r": -0.00222, "p": 0.000213, "f": -0.0001424, "vvv": 0.001492, "rrr": -0.00229}
YAW |= {"vvr": -0.0424, "vrr": 0.00156, "vvf": -0.019058, "vff": -0.0053766, "rrf": -0.0038592, "rff": 0.0024195}
ROWS = (SURGE, SWAY, ROLL, YAW)
ASPECT, RUDDER_AREA = 1.8219, 33.0376
KAPPA, EPSILON, X_R, Z_R = 0.631, 0.921, -0.5, 0.033
WAKE, TAU, X_P, DEDUCTION, DIAMETER = 0.184, 1.09, -0.526, 0.175, 6.533
A_H, X_H, C_RX = 0.237, -0.48, 0.71
INFLOW = {"v": 0.088, "r": -0.156, "rrr": -0.275, "rrv": 1.96}
K_T = (0.527, -0.455)


def revolutions() -> float:
    """Revolutions [1/s] at which (1 - t) of the thrust is the resistance at the nominal speed."""
    scale = 2.0 * DIAMETER**4 * (1.0 - DEDUCTION) / (LENGTH * SPEED) ** 2
    a, b, c = K_T[0] * scale, K_T[1] * scale * (1.0 - WAKE) * SPEED / DIAMETER, SURGE["uu"]
    return (-b + math.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)


def papers(GM: float) -> Papers:
    """Papers of the ship at a metacentric height [m]."""
    height = math.sqrt(ASPECT * RUDDER_AREA)
    return Papers(
        name="foreign_s175",
        title="S175 container ship of Son and Nomoto",
        L=LENGTH,
        B=25.4,
        d=8.5,
        volume=VOLUME,
        speed=SPEED,
        rudder_area=RUDDER_AREA,
        rudder_height=height,
        frontal_area=650.0,
        lateral_area=2600.0,
        rudder_rate_deg=3.0,
        rudder_delay=0.8,
        propeller={
            **{"D": DIAMETER, "n": revolutions(), "wake_fraction": WAKE, "k_0": K_T[0], "k_1": K_T[1], "k_2": 0.0},
            **{"eta": DIAMETER / height, "kappa": KAPPA},
        },
        stability=(("z_G", 0.0), ("GM", GM), ("BM", 10.39 - 4.6154)),
    )


def force(terms: dict[str, float], values: dict[str, float]) -> float:
    """Sum of terms such as ``vvr``; ``f`` is the heel."""
    total = 0.0
    for name, coefficient in terms.items():
        for letter in name:
            coefficient *= values[letter]
        total += coefficient
    return total


def inverse_inertia() -> np.ndarray:
    """Inverse of the inertia of sway, roll and yaw."""
    sway_roll, sway_yaw = -M_Y * L_Y, M_Y * ALPHA_Y
    return np.linalg.inv([[M + M_Y, sway_roll, sway_yaw], [sway_roll, I_X + J_X, 0.0], [sway_yaw, 0.0, I_Z + J_Z]])


@dataclass(frozen=True)
class S175:
    """The ship at a metacentric height [m]; ``rows`` are the forces of its hull."""

    GM: float = 0.3
    rows: tuple[dict[str, float], ...] = ROWS
    papers: Papers = field(init=False)
    inverse: list[list[float]] = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "papers", papers(self.GM))
        object.__setattr__(self, "inverse", inverse_inertia().tolist())

    def accelerations(self, motion, delta, n, push):
        """Rates of u, v, r and p."""
        surge, sway, roll, yaw = self.rows
        U, delta = math.hypot(motion[0], motion[1]), -delta
        u, v, r, p = motion[0] / U, motion[1] / U, motion[2] * LENGTH / U, motion[3] * LENGTH / U
        values = {"u": u, "v": v, "r": r, "p": p, "f": motion[4]}
        u_P = u * (1.0 - WAKE + TAU * (v + X_P * r) ** 2)
        J = u_P * U / (n * DIAMETER)
        coefficient = K_T[0] + K_T[1] * J
        thrust = 2.0 * DIAMETER**4 / (U * LENGTH) ** 2 * coefficient * n * abs(n)
        u_R = u_P * EPSILON * math.sqrt(max(1.0 + 8.0 * KAPPA * coefficient / (math.pi * J * J), 0.0))
        v_R = force(INFLOW, values)
        slope = 6.13 * ASPECT / (ASPECT + 2.25) * RUDDER_AREA / LENGTH**2
        F_N = -slope * (u_R * u_R + v_R * v_R) * math.sin(delta + math.atan2(v_R, u_R))
        lateral = F_N * math.cos(delta)
        scale = 0.5 * WATER * (LENGTH * U) ** 2
        weight = WATER * GRAVITY * VOLUME / scale
        X = force(surge, values) + (1.0 - DEDUCTION) * thrust + C_RX * F_N * math.sin(delta) + push[0] / scale
        X += (M + M_Y) * v * r
        Y = force(sway, values) + (1.0 + A_H) * lateral - (M + M_X) * u * r + push[1] / scale
        K = force(roll, values) - (1.0 + A_H) * Z_R * lateral + M_X * L_X * u * r
        K += push[2] / (scale * LENGTH) - weight * self.GM / LENGTH * motion[4]
        N = force(yaw, values) + (X_R + A_H * X_H) * lateral + push[3] / (scale * LENGTH)
        rate = U * U / LENGTH
        dv, dp, dr = (rate * (row[0] * Y + row[1] * K + row[2] * N) for row in self.inverse)
        return X * rate / (M + M_X), dv, dr / LENGTH, dp / LENGTH
