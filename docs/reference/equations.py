"""The equations of docs/reference/equations.md in plain numpy, function by function, with the page's numbers.

A pattern for another language: it needs nothing of the package. A test compares it with ``ps.simulate``.
"""

from __future__ import annotations

import re
from math import atan2, cos, exp, inf, pi, sin, sqrt, tan

import numpy as np

GRAVITY = 9.81  # m/s2
AIR_OVER_WATER = 1.225 / 1025.0  # densities
TOKEN = re.compile(r"delta|phi|sin|cos|[uvrpgT]|\|(?:delta|phi|[uvrp])+\|")


def kinematics(state):
    """Rates of phi, psi, x and y, Eq. 1 and 2."""
    u, v, r, p, phi, psi = state[:6]
    across = v * cos(phi)
    return [p, r * cos(phi), u * cos(psi) - across * sin(psi), u * sin(psi) + across * cos(psi)]


# forces as terms ------------------------------------------------------------------------------------------------------


def prime_motion(state, delta, ship):
    """Prime quantities at the instantaneous speed, Eq. 3, with the loading of the propeller, Eq. 11 to 14."""
    u, v, r, p, phi = state[:5]
    U = sqrt(u * u + v * v)
    u_a = (U - ship["nominal_speed"]) / U
    motion = {"u": u_a, "v": v / U, "r": r * ship["L"] / U, "p": p * ship["L"] / U, "phi": phi, "delta": delta}
    motion |= {"sin": sin(delta), "cos": cos(delta)}
    return U, motion | (loading(u_a, ship) if "J" in ship else {})


def loading(u_a, ship):
    """Loading g and T of the relative speed, Eq. 11 to 14."""
    k_0, k_1, k_2, J = ship["k_0"], ship["k_1"], ship["k_2"], ship["J"]

    def thrust(a):
        return k_0 * (a / J) ** 2 + k_1 * a / J + k_2

    def inflow(load):
        return ship["eta"] * (1.0 + ship["kappa"] * (sqrt(1.0 + 8.0 / pi * load) - 1.0)) ** 2 + 1.0 - ship["eta"]

    now, nominal = thrust(1.0 - u_a), thrust(1.0)
    return {"g": inflow(now) / inflow(nominal), "T": now / nominal - 1.0}


def term(name, motion):
    """Product that a term's name spells, Eq. 9."""
    value = 1.0
    for token in TOKEN.findall(name):
        if token.startswith("|"):
            for factor in TOKEN.findall(token.strip("|")):
                value *= abs(motion[factor])
        else:
            value *= motion[token]
    return value


def rates_of_terms(state, delta, ship, coefficients):
    """Accelerations by terms, Eq. 4 to 10; ``coefficients`` maps names such as ``Yv|v|`` to prime values."""
    U, motion = prime_motion(state, delta, ship)
    L, m, x_G, z_G = ship["L"], ship["m"], ship["x_G"], ship["z_G"]
    v, r, p, phi = (motion[name] for name in ("v", "r", "p", "phi"))
    turn = m * state[0] / U * r
    GZ = (ship["GM"] + 0.5 * ship["BM"] * tan(phi) ** 2) * sin(phi)
    righting = 2.0 * GRAVITY * ship["volume"] * GZ / (U**2 * L**3)
    force = np.array([m * (v * r + x_G * r * r - z_G * r * p), -turn, -x_G * turn, z_G * turn - righting])
    for name, value in coefficients.items():
        force["XYNK".index(name[0])] += value * term(name[1:], motion)
    n = 4 if ship["rolls"] else 3
    prime = np.zeros(4)
    prime[:n] = np.linalg.solve(inertia(ship)[:n, :n], force[:n])
    return prime * [U**2 / L, U**2 / L, U**2 / L**2, U**2 / L**2]


def inertia(ship):
    """Prime inertia matrix, Eq. 6; rows surge, sway, yaw, roll, columns u, v, r, p."""
    a, m, x_G, z_G = ship["added_mass"], ship["m"], ship["x_G"], ship["z_G"]
    return np.array(
        [
            [m - a["Xudot"], 0.0, 0.0, 0.0],
            [0.0, m - a["Yvdot"], m * x_G - a["Yrdot"], -m * z_G - a["Ypdot"]],
            [0.0, m * x_G - a["Nvdot"], ship["I_zz"] - a["Nrdot"], -a["Npdot"]],
            [0.0, -m * z_G - a["Kvdot"], -a["Krdot"], ship["I_xx"] - a["Kpdot"]],
        ]
    )


# forces as parts ------------------------------------------------------------------------------------------------------


def part_motion(state, delta, ship, q, n=1.0, wind=(0.0, 0.0)):
    """Motion through the water and the air, primes at the nominal speed, Eq. 15 to 17.

    ``n`` is over the nominal revolutions; ``wind`` is the velocity of the air to north and east over U_nom.
    """
    U, L, psi = ship["nominal_speed"], ship["L"], state[5]

    def to_ship(north, east):
        return north * cos(psi) + east * sin(psi), east * cos(psi) - north * sin(psi)

    drift = q.get("k_drift", 0.0)
    u_c, v_c = to_ship(q.get("c_north", 0.0) + drift * wind[0], q.get("c_east", 0.0) + drift * wind[1])
    u_w, v_w = to_ship(*wind)
    u, v = state[0] / U, state[1] / U
    motion = {"u": u - u_c, "v": v - v_c, "r": state[2] * L / U, "p": state[3] * L / U, "phi": state[4]}
    return motion | {"delta": delta, "n": n, "u_air": u - u_w, "v_air": v - v_w, "u_c": u_c, "v_c": v_c}


def hull(M, ship, q):
    """Hull of a ship that makes way ahead, Eq. 21 and 22."""
    u, v, r = M["u"], M["v"], M["r"]
    U = sqrt(u * u + v * v + 1e-12)

    def side(a):
        cubic = v * (q[a + "vvv"] * v * v + q[a + "vvr"] * v * r + q[a + "vrr"] * r * r) + q[a + "rrr"] * r**3
        return U * (q[a + "v"] * v + q[a + "r"] * r) + cubic / U

    X = q["Xvv"] * v * v + q["Xvr"] * v * r + q["Xrr"] * r * r + q["Xvvvv"] * v**4 / U**2 - q["R0"] * U * U
    return X, side("Y"), side("N")


def low_speed_hull(M, ship, q):
    """Hull at any speed, Eq. 23 to 26."""
    u, v, r = M["u"], M["v"], M["r"]
    nodes, weights = np.polynomial.legendre.leggauss(10)
    flow = v + 0.5 * nodes * r
    drag = 0.5 * weights * flow * abs(flow)
    cross = -ship["d"] / ship["L"] * q["C_D"]
    Y_cross, N_cross = cross * drag.sum(), cross * q["c_N"] * (0.5 * nodes * drag).sum()
    R = q["R0"] * (1.0 if u > 0.0 else q["R_astern"])
    X = q["Xvv"] * v * v + q["Xvr"] * v * r + q["Xrr"] * r * r - R * u * abs(u)
    Y = abs(u) * q["Yv"] * v + u * q["Yr"] * r + Y_cross
    N = u * q["Nv"] * v + abs(u) * q["Nr"] * r + N_cross + q["x_C"] * Y_cross
    return X, Y, N


def propeller(M, ship, q):
    """Propeller and its race, Eq. 27 to 33: X, Y, N and what the rudder needs of it, u_P and u_jet."""
    u, v, r, n = M["u"], M["v"], M["r"], M["n"] / q["n_0"]
    J = ship["J_s"] / q["n_0"]
    beta_P = atan2(-v + 0.48 * r, sqrt(u * u + 1e-6))
    C_2 = q["C2"] + (q["dC2"] if beta_P > 0.0 else -q["dC2"])
    u_P = (1.0 - q["w0"]) * (1.0 + (1.0 - exp(-2.0 * abs(beta_P))) * (C_2 - 1.0)) * u

    def curve(n, a):
        return ship["k_0"] * n * n + ship["k_1"] * n * a + ship["k_2"] * a * a

    nominal, a = curve(1.0, (1.0 - q["w0"]) * J), u_P * J
    if n > 0.0:
        tau, jet = curve(n, a) / nominal, curve(n, a)
        Y, N = tau * q["Y_P"], tau * q["N_P"]
    else:
        tau, jet = -ship["k_0"] * (q["T_nn"] * n * n - q["T_nu"] * n * a) / nominal, 0.0
        Y, N = q["R0"] * tau * q["Y_nn"], q["R0"] * tau * q["N_nn"]
    u_jet = sqrt(max(u_P**2 + 8.0 / pi / J**2 * jet, 0.0) + 1e-12)
    return q["R0"] * tau, Y, N, u_P, u_jet


def rudder(M, ship, q, u_P, u_jet):
    """Rudder in the race, Eq. 34 to 39."""
    alpha = -M["delta"]
    race = u_P + q["kappa"] * (u_jet - abs(u_P))
    square = ship["eta"] * race * abs(race) + (1.0 - ship["eta"]) * u_P * abs(u_P)
    u_R = q["epsilon"] * square / (square**2 + 1e-12) ** 0.25
    drift = -M["v"] - q["l_R"] * M["r"]
    v_R = q["gamma_R"] * drift + q["dgamma_R"] * abs(drift)
    across = u_R * sin(alpha) - v_R * cos(alpha)
    U_R = sqrt(u_R**2 + v_R**2 + 1e-12)
    F_N = ship["rudder_area"] * q["f_alpha"] * across * (U_R + q["f2"] * abs(across))
    X, Y = -(1.0 - q["t_R"]) * F_N * sin(alpha), -(1.0 + q["a_H"]) * F_N * cos(alpha)
    return X, Y, -(-0.5 + q["a_H"] * q["x_H"]) * F_N * cos(alpha)


def roll(M, ship, q, Y_hull, Y_rudder):
    """Side force, yaw moment and roll moment of a ship that heels, Eq. 40 and 41."""
    phi, p = M["phi"], M["p"]
    GZ = (q["GM"] + 0.5 * q["BM"] * tan(phi) ** 2) * sin(phi)
    stiffness = 2.0 * GRAVITY * ship["volume"] / (ship["nominal_speed"] ** 2 * ship["L"] ** 3)
    K = q["Kp"] * p + q["Kp|p|"] * p * abs(p) - stiffness * GZ - q["z_H"] * Y_hull - q["z_R"] * Y_rudder
    U2 = M["u"] ** 2 + M["v"] ** 2
    return q["Yphi"] * U2 * phi, q["Nphi"] * U2 * phi, K


def wind(M, ship, q):
    """Wind on the areas above the water, Eq. 42."""
    u, v = M["u_air"], M["v_air"]
    V = sqrt(u * u + v * v + 1e-12)
    front, side = AIR_OVER_WATER * ship["frontal"], AIR_OVER_WATER * ship["lateral"]
    return -front * q["C_X"] * u * V, -side * q["C_Y"] * v * V, -2.0 * side * q["C_N"] * u * v


def rates_of_parts(state, delta, ship, q, parts, **inputs):
    """Accelerations by parts, Eq. 18 to 20; ``q`` maps the parameters of the parts to their values."""
    M = part_motion(state, delta, ship, q, **inputs)
    on_hull = hull(M, ship, q) if "hull" in parts else low_speed_hull(M, ship, q)
    *on_propeller, u_P, u_jet = propeller(M, ship, q)
    on_rudder = rudder(M, ship, q, u_P, u_jet)
    X, Y, N = (np.sum(rows) for rows in zip(on_hull, on_propeller, on_rudder, strict=True))
    K = 0.0
    if "roll" in parts:
        Y_roll, N_roll, K = roll(M, ship, q, on_hull[1], on_rudder[1])
        Y, N = Y + Y_roll, N + N_roll
    if "wind" in parts:
        X, Y, N = np.add((X, Y, N), wind(M, ship, q))
    if "constant force" in parts:
        Y, N = Y + q["Y_run"], N + q["N_run"]
    m, x_G, z_G, a = ship["m"], ship["x_G"], ship["z_G"], ship["added_mass"]
    u, v, r, p = (M[name] for name in ("u", "v", "r", "p"))
    surge = (X + m * (v * r + x_G * r * r - z_G * r * p)) / (m + q["m_x"])
    matrix = [[m + q["m_y"], m * x_G - a["Yrdot"]], [m * x_G - a["Nvdot"], ship["I_zz"] + q["J_zz"]]]
    right = [Y - m * u * r, N - x_G * m * u * r]
    if "roll" in parts:
        coupling = -m * z_G - q["m_y"] * q["z_Y"]
        matrix = [[*matrix[0], coupling], [*matrix[1], -a["Npdot"]]]
        matrix += [[coupling, -a["Krdot"], ship["I_xx"] + q["J_xx"]]]
        right += [K + z_G * m * u * r]
    sway, yaw, *heel = np.linalg.solve(matrix, right)
    prime = np.array([surge + r * M["v_c"], sway - r * M["u_c"], yaw, *(heel or [0.0])])
    U, L = ship["nominal_speed"], ship["L"]
    return prime * [U**2 / L, U**2 / L, U**2 / L**2, U**2 / L**2]


# steering and integration ---------------------------------------------------------------------------------------------


def steered(command, rate, step, heading=inf, factor=1.0, delay=0):
    """Rudder angle after each Euler step, from its heading, Eq. 43 to 45; ``delay`` is in whole steps."""
    delta, sign, waiting = 0.0, 1.0, inf

    def follow(psi):
        nonlocal delta, sign, waiting
        side = -np.sign(sign * command)
        if waiting == inf and side * psi >= heading:
            waiting = delay
        if waiting < 1:
            sign, waiting = sign * factor, inf
        else:
            waiting -= 1
        delta += np.clip(sign * command - delta, -rate * step, rate * step)
        return delta

    return follow


def euler(rates, state, follow, step, n_steps):
    """States at the beginning of every step, shape (n_steps, 9): u v r p phi psi x y delta, Eq. 46."""
    rows, delta = [], 0.0
    state = np.array(state, dtype=float)
    for _ in range(n_steps):
        rows.append([*state, delta])
        ahead = follow(state[5])
        state = state + step * np.array([*rates(state, delta), *kinematics(state)])
        delta = ahead
    return np.array(rows)
