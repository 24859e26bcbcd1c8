"""The container ship's equations written plainly from Xue et al. (2020), with nothing of the package: a reference."""

from __future__ import annotations

import csv
from math import cos, sin, sqrt, tan
from pathlib import Path

import numpy as np

L, NOMINAL_SPEED, VOLUME, GM, BM = 230.66, 12.7, 46070.0, 0.83, 9.0
M, I_XX, I_ZZ = 750.81e-5, 1.30e-5, 43.25e-5
X_G, Z_G = -0.46 / L, -3.54 / L
GRAVITY = 9.81


def printed_rows() -> list[dict[str, str]]:
    """Rows of data/coefficients.csv: ten acceleration derivatives, then 102 coefficients."""
    with (Path(__file__).parents[2] / "data" / "coefficients.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def expression(term: str) -> str:
    """Python expression of a term: ``pu|pu|`` -> ``p*u*abs(p*u)``, with f for phi and d for delta."""
    parts = []
    for k, piece in enumerate(term.replace("delta", "d").replace("phi", "f").split("|")):
        if piece:
            product = "*".join(piece.replace("0", "1"))
            parts.append(f"abs({product})" if k % 2 else product)
    return "*".join(parts)


def is_odd(term: str) -> bool:
    """Whether a term changes sign with v, r, p, phi and delta."""
    point = dict.fromkeys("vrpfd", 0.37) | {"u": 0.37}
    mirrored = {symbol: -value for symbol, value in point.items()} | {"u": 0.37}
    return eval(expression(term), mirrored) == -eval(expression(term), point)


def _value(row: dict[str, str]) -> float:
    return float(f"{int(row['sign']) * float(row['rpmm_magnitude_1e5'])}e-5")


_ADDED = {(row["dof"], row["term"]): _value(row) for row in printed_rows() if row["term"].endswith("dot")}
_FORCE = {
    dof: eval(
        "lambda u, v, r, p, f, d: "
        + " + ".join(
            f"({_value(row)!r})*{expression(row['term'])}"
            for row in printed_rows()
            if row["dof"] == dof and not row["term"].endswith("dot")
        )
    )
    for dof in ("surge", "sway", "yaw", "roll")
}

J = np.array(
    [
        [M - _ADDED["surge", "udot"], 0.0, 0.0, 0.0],
        [0.0, M - _ADDED["sway", "vdot"], M * X_G - _ADDED["sway", "rdot"], -M * Z_G - _ADDED["sway", "pdot"]],
        [0.0, M * X_G - _ADDED["yaw", "vdot"], I_ZZ - _ADDED["yaw", "rdot"], -_ADDED["yaw", "pdot"]],
        [0.0, -M * Z_G - _ADDED["roll", "vdot"], -_ADDED["roll", "rdot"], I_XX - _ADDED["roll", "pdot"]],
    ]
)
"""Prime inertia matrix, rows surge, sway, yaw, roll; columns u, v, r, p."""

_J_INVERSE = np.linalg.inv(J)


def force(u: float, v: float, r: float, p: float, phi: float, delta: float) -> np.ndarray:
    """Prime F1, F2, M1, M2 of a motion in SI units."""
    U = sqrt(u * u + v * v)
    a, b, c, d = (U - NOMINAL_SPEED) / U, v / U, r * L / U, p * L / U
    X, Y, N, K = (_FORCE[dof](a, b, c, d, phi, delta) for dof in ("surge", "sway", "yaw", "roll"))
    righting_arm = (GM + 0.5 * BM * tan(phi) ** 2) * sin(phi)
    return np.array(
        [
            X + M * b * c + M * X_G * c * c - M * Z_G * c * d,
            Y - M * (u / U) * c,
            N - M * X_G * (u / U) * c,
            K + M * Z_G * (u / U) * c - 2.0 * GRAVITY * VOLUME * righting_arm / (U**2 * L**3),
        ]
    )


def rate(state: np.ndarray, delta: float) -> list[float]:
    """Time derivative of u, v, r, p, phi, psi, x, y."""
    u, v, r, p, phi, psi, _, _ = state
    surge, sway, yaw, roll = _J_INVERSE @ force(u, v, r, p, phi, delta)
    linear, angular = (u * u + v * v) / L, (u * u + v * v) / L**2
    return [
        surge * linear,
        sway * linear,
        yaw * angular,
        roll * angular,
        p,
        r * cos(phi),
        u * cos(psi) - v * cos(phi) * sin(psi),
        u * sin(psi) + v * cos(phi) * cos(psi),
    ]
