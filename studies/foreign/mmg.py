"""Ships by the MMG standard method: the KVLCC2 tanker and a smaller cargo ship.

Yasukawa, H. & Yoshimura, Y. (2015), Introduction of MMG standard method for ship maneuvering predictions, J. Mar. Sci.
Technol. 20, 37-52, doi:10.1007/s00773-014-0293-y: equations of motion about midship, hull, propeller and rudder. In
their signs a positive rudder turns to starboard; here it turns to port.

KVLCC2, full scale. Hull, added masses, thrust, flow straightening by side (.395 to port, .640 to starboard), wake by
side (C2 1.6 to starboard, 1.1 to port), rudder and interaction: Tables 2 to 4 of that paper as the public codes
ShipMMG/ShipMMG.jl (src/data.jl, L7 model) and nikpau/mmgdynamics (calibrated_vessels.py, ``kvlcc2_full``: w_P0 = .35,
D = 9.86 m, A_R = 112.5 m2) hold them. The revolutions are those that hold 15.5 kn. Areas above water as in
mmgdynamics.

Cargo ship. Particulars, rudder and propeller of the self-unloading bulk carrier "CSL Spirit" (225 m) as published with
Fossen's MSS toolbox (VESSELS/shipModels/dataSpirit.m, A. D. Pipchenko 2007). No public set of MMG coefficients of a
smaller cargo ship was found that is not itself the regression the package takes its prior from (Yoshimura & Masumoto
2012); so the hull is that of Kijima, Katsuno, Nakiri & Furukawa (1990), On the manoeuvring performance of a ship with
the parameter of loading condition, J. SNAJ 168, at even keel, as coded in Bananawata/Projek-Manuver-Kapal: forces
linear and quadratic (v|v|, r|r|) in drift and yaw rate, w = .5 C_B - .05, wake by exp(-4 beta_P^2), l_R = 2 x_R, t_R
and a_H; gamma_R, epsilon and kappa = .6 / epsilon are functions of C_B B/L of the same paper. Added masses: Clarke,
Gedling & Hine (1983), m_x = .05 m. Surge by drift and yaw: c_m m_y v r with c_m = 1.11 C_B - .07 (Hasegawa 1980). x_H =
-.45 L, t = .6 w. f_alpha by Fujii. Resistance by the ITTC line of 1957 with form factor .25, .9e-3 for roughness and
waves, and the wetted surface of Denny & Mumford. K_T: least squares of the Wageningen polynomials (Oosterveld & van
Oossanen 1975) of B4-49.9 at P/D = .716 for J from .1 to .9, within .002; at other pitches in proportion between that
one and the Mariner's at .964.

Cross-flow ship. A hull of the same form whose forces no polynomial has: linear ones by Clarke, Gedling & Hine (1983),
and a drag of the cross flow that is summed along the length, with a coefficient that differs from bow to stern (Hooft
1994, The cross-flow drag on a manoeuvring ship, Ocean Engineering 21, 329-342; its values here are by judgement).

Propeller astern. Thrust, side force and moment by u / (n D) as public codes of the 3 m model of the Esso Osaka have
them, from tests of Hachii (Ahmed & Hasegawa 2013, Eng. Appl. Artif. Intell. 26, 2287-2304). The thrust holds the
reaction of the hull and is in proportion to k_0, .3278 there; the rudder meets no race.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from studies.foreign.sailing import Papers

WATER = 1025.0
KNOT = 1852.0 / 3600.0
_SEPARATION = math.radians(5.0)  # angle over which the lift falls beyond the stall, by judgement


@dataclass(frozen=True)
class Hull:
    """Forces over rho/2 L d U^2 (moment by L more): terms in v' and r' about midship, and their coefficients."""

    R0: float
    X: tuple[tuple[str, float], ...]
    Y: tuple[tuple[str, float], ...]
    N: tuple[tuple[str, float], ...]
    sections: tuple[tuple[float, float], ...] = ()

    def cross_flow(self, v: float, r: float) -> tuple[float, float]:
        """Side force and moment of the cross flow on equal sections: places [L] and drag coefficients."""
        Y = N = 0.0
        for x, C_D in self.sections:
            drag = -C_D * (v + x * r) * abs(v + x * r) / len(self.sections)
            Y, N = Y + drag, N + x * drag
        return Y, N


@dataclass(frozen=True)
class Wake:
    """How the wake changes with the drift angle at the propeller, to port and to starboard turns.

    ``law`` "C2": (1 - w) = (1 - w0) [1 + (1 - exp(-2 |beta|)) (C2 - 1)]; "exp": w = w0 exp(-C beta^2).
    """

    w0: float
    law: str
    port: float
    starboard: float

    def passed(self, beta: float) -> float:
        """1 - w."""
        c = self.starboard if beta > 0.0 else self.port
        if self.law == "exp":
            return 1.0 - self.w0 * math.exp(-c * beta * beta)
        return (1.0 - self.w0) * (1.0 + (1.0 - math.exp(-2.0 * abs(beta))) * (c - 1.0))


@dataclass(frozen=True)
class Rudder:
    """Normal force, its inflow and its interaction with the hull; lengths over L, ``gamma`` by the side of the turn."""

    area: float
    f_alpha: float
    epsilon: float
    kappa: float
    eta: float
    gamma_port: float
    gamma_starboard: float
    l_R: float
    t_R: float
    a_H: float
    x_H: float
    x_R: float = -0.5
    stall: float = math.inf  # angle of attack [rad] beyond which the flow separates

    def lift(self, alpha: float) -> float:
        """Normal force over f_alpha by the angle of attack: its sine; beyond the stall, 60 % of that at the stall."""
        if abs(alpha) <= self.stall:
            return math.sin(alpha)
        beyond = math.exp((self.stall - abs(alpha)) / _SEPARATION)
        return math.copysign(math.sin(self.stall) * (0.6 + 0.4 * beyond), alpha)


@dataclass(frozen=True)
class Astern:
    """Propeller turning astern: ``thrust`` and ``side`` are factors on what is published, the screw right-handed."""

    thrust: float = 1.0
    side: float = 1.0

    def force(self, J: float, k_0: float) -> float:
        """Over rho n^2 D^4, at J = u / (n D)."""
        return self.thrust * k_0 / 0.3278 * max(-0.175 + 0.33 * J, -0.251)

    def aside(self, J: float) -> tuple[float, float]:
        """Side force, and moment by L, over rho/2 L d (n D)^2."""
        if J > -0.06:
            Y, N = -5.58e-4, 2.25e-4
        elif J >= -0.35:
            Y, N = -7.9e-5 + 7.99e-3 * J, 3.5e-5 - 3.17e-3 * J
        else:
            Y, N = -4.93e-3 - 5.87e-3 * J, 1.96e-3 + 2.33e-3 * J
        return self.side * Y, self.side * N


@dataclass(frozen=True)
class MmgShip:
    """A ship of the MMG standard method; ``Y_P`` and ``N_P`` are side force and moment (by L) over the thrust."""

    papers: Papers
    hull: Hull
    wake: Wake
    rudder: Rudder
    m_x: float
    m_y: float
    J_zz: float
    t_P: float
    x_P: float = -0.48
    Y_P: float = 0.0
    N_P: float = 0.0
    astern: Astern = Astern()

    def screw(self, u: float, n: float, passed: float) -> tuple[tuple[float, float, float], float]:
        """Forces ahead and aside [N] and moment [N m], and 8 K_T / (pi J^2) of the race."""
        if n <= 0.0:
            return self.screw_astern(u, n), 0.0
        thrust, loading = self.thrust(u, n, passed)
        return ((1.0 - self.t_P) * thrust, self.Y_P * thrust, self.N_P * self.papers.L * thrust), loading

    def screw_astern(self, u: float, n: float) -> tuple[float, float, float]:
        """Forces ahead and aside [N] and moment [N m] of the propeller astern."""
        p, D = self.papers, self.papers.propeller["D"]
        J, q = u / min(n * D, -1e-9), WATER * (n * D) ** 2
        (Y, N), sides = self.astern.aside(J), 0.5 * q * p.L * p.d
        return q * D * D * self.astern.force(J, p.propeller["k_0"]), sides * Y, sides * p.L * N

    def thrust(self, u: float, n: float, passed: float) -> tuple[float, float]:
        """Thrust [N] and 8 K_T / (pi J^2)."""
        propeller = self.papers.propeller
        J = u * passed / (n * propeller["D"])
        K_T = propeller["k_0"] + propeller["k_1"] * J + propeller["k_2"] * J * J
        return WATER * n * n * propeller["D"] ** 4 * K_T, 8.0 * K_T / (math.pi * J * J)

    def normal_force(self, u: float, yaw: tuple[float, float, float], delta: float, race: tuple[float, float]) -> float:
        """Of the rudder [N]: surge, (U, beta, r'), its angle, positive to starboard, and (1 - w, 8 K_T / (pi J^2))."""
        s, (U, beta, r), (passed, loading) = self.rudder, yaw, race
        beta_R = beta - s.l_R * r
        jet = 1.0 + s.kappa * (math.sqrt(max(1.0 + loading, 0.0)) - 1.0)
        u_R = s.epsilon * u * passed * math.sqrt(s.eta * jet * jet + 1.0 - s.eta)
        v_R = U * (s.gamma_starboard if beta_R > 0.0 else s.gamma_port) * beta_R
        inflow = u_R * u_R + v_R * v_R
        return 0.5 * WATER * s.area * inflow * s.f_alpha * s.lift(delta - math.atan2(v_R, u_R))

    def accelerations(self, motion, delta, n, push):
        """Rates of u, v, r and p, the last 0."""
        u, v, yaw_rate, _, _ = motion
        p, s, delta = self.papers, self.rudder, -delta
        U = math.hypot(u, v)
        v_, r_ = v / U, yaw_rate * p.L / U
        beta = math.atan2(-v, u)
        passed = self.wake.passed(beta - self.x_P * r_)
        (ahead, aside, around), loading = self.screw(u, n, passed)
        F_N = self.normal_force(u, (U, beta, r_), delta, (passed, loading))
        area = 0.5 * WATER * p.L * p.d
        q, hull = area * U * U, self.hull
        X = q * (polynomial(hull.X, v_, r_) - hull.R0) + ahead
        Y = q * polynomial(hull.Y, v_, r_) + aside
        N = q * p.L * polynomial(hull.N, v_, r_) + around
        X += push[0] - (1.0 - s.t_R) * F_N * math.sin(delta)
        across, turning = hull.cross_flow(v_, r_)
        Y, N = Y + q * across, N + q * p.L * turning
        Y += push[1] - (1.0 + s.a_H) * F_N * math.cos(delta)
        N += push[3] - (s.x_R + s.a_H * s.x_H) * p.L * F_N * math.cos(delta)
        m = WATER * p.volume
        m_x, m_y, J = self.m_x * area * p.L, self.m_y * area * p.L, self.J_zz * area * p.L**3
        lever = m * p.x_G
        inertia = m * ((0.25 * p.L) ** 2 + p.x_G**2) + J
        du = (X + (m + m_y) * v * yaw_rate + lever * yaw_rate**2) / (m + m_x)
        Y -= (m + m_x) * u * yaw_rate
        N -= lever * u * yaw_rate
        determinant = (m + m_y) * inertia - lever * lever
        return du, (inertia * Y - lever * N) / determinant, ((m + m_y) * N - lever * Y) / determinant, 0.0


def polynomial(terms: tuple[tuple[str, float], ...], v: float, r: float) -> float:
    """Sum of terms such as ``vvr``; capitals are magnitudes: ``vV`` is v |v|."""
    factors = {"v": v, "r": r, "V": abs(v), "R": abs(r)}
    total = 0.0
    for name, value in terms:
        for letter in name:
            value *= factors[letter]
        total += value
    return total


def balanced_revolutions(resistance: float, speed: float, propeller: dict[str, float], share: float) -> float:
    """Revolutions [1/s] at which ``share`` of the thrust is the resistance [N] at a speed: a quadratic equation."""
    D, advance = propeller["D"], (1.0 - propeller["wake_fraction"]) * speed
    scale = share * WATER * D**4
    a, b = propeller["k_0"] * scale, propeller["k_1"] * scale * advance / D
    c = propeller["k_2"] * scale * (advance / D) ** 2 - resistance
    return (-b + math.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)


def kvlcc2() -> MmgShip:
    """The KVLCC2 tanker, full load, 15.5 kn."""
    speed, R0, t_P = 15.5 * KNOT, 0.022, 0.22
    propeller = {"D": 9.86, "n": 0.0, "wake_fraction": 0.35, "k_0": 0.2931, "k_1": -0.2753, "k_2": -0.1385}
    propeller |= {"eta": 9.86 / 15.8, "kappa": 0.5}
    resistance = 0.5 * WATER * 320.0 * 20.8 * speed**2 * R0
    propeller["n"] = balanced_revolutions(resistance, speed, propeller, 1.0 - t_P)
    papers = Papers(
        name="foreign_kvlcc2",
        title="KVLCC2 tanker by the MMG standard method",
        L=320.0,
        B=58.0,
        d=20.8,
        volume=312600.0,
        speed=speed,
        rudder_area=112.5,
        rudder_height=15.8,
        frontal_area=1200.0,
        lateral_area=3600.0,
        rudder_rate_deg=2.34,
        rudder_delay=2.0,
        propeller=propeller,
        x_G=11.2,
    )
    hull = Hull(
        R0,
        X=(("vv", -0.040), ("vr", 0.002), ("rr", 0.011), ("vvvv", 0.771)),
        Y=(("v", -0.315), ("r", 0.083), ("vvv", -1.607), ("vvr", 0.379), ("vrr", -0.391), ("rrr", 0.008)),
        N=(("v", -0.137), ("r", -0.049), ("vvv", -0.030), ("vvr", -0.294), ("vrr", 0.055), ("rrr", -0.013)),
    )
    rudder = Rudder(
        area=112.5,
        f_alpha=2.747,
        epsilon=1.09,
        kappa=0.5,
        eta=propeller["eta"],
        gamma_port=0.395,
        gamma_starboard=0.640,
        l_R=-0.710,
        t_R=0.387,
        a_H=0.312,
        x_H=-0.464,
    )
    return MmgShip(papers, hull, Wake(0.35, "C2", 1.1, 1.6), rudder, m_x=0.022, m_y=0.223, J_zz=0.011, t_P=t_P)


@dataclass(frozen=True)
class Form:
    """Form of a cargo ship: hull, speed [m/s], rudder, diameter and pitch over diameter of its propeller; SI."""

    L: float = 225.023
    B: float = 32.192
    d: float = 14.0
    block: float = 0.817
    speed: float = 14.0 * KNOT
    rudder_area: float = 45.9
    rudder_height: float = 8.98
    D: float = 7.24
    pitch: float = 0.716
    x_G: float = 0.0


def cargo(form: Form | None = None, name: str = "foreign_cargo") -> MmgShip:
    """A cargo ship of a form; by default a bulk carrier of 225 m, full load, 14 kn."""
    f = form or Form()
    L, B, d, block, speed = f.L, f.B, f.d, f.block, f.speed
    volume, fullness, flat, k = L * B * d * block, block * B / L, d / B, 2.0 * d / L
    mass, m_x = 2.0 * volume / (L * L * d), 0.05 * 2.0 * volume / (L * L * d)
    m_y = math.pi * d / L * (1.0 + 0.16 * block / flat - 5.1 * (B / L) ** 2)
    J_zz = math.pi * d / L * (1.0 / 12.0 + 0.017 * block / flat - 0.33 * B / L)
    friction = 0.075 / (math.log10(speed * L / 1.19e-6) - 2.0) ** 2
    R0 = (1.25 * friction + 0.9e-3) * (1.7 * L * d + volume / d) / (L * d)
    wake = 0.5 * block - 0.05
    t_P = 0.6 * wake
    pitch = (f.pitch - 0.716) / (0.964 - 0.716)
    curve = {"k_0": 0.3009 + 0.1167 * pitch, "k_1": -0.2709 - 0.0022 * pitch, "k_2": -0.1313 + 0.0038 * pitch}
    propeller = {"D": f.D, "n": 0.0, "wake_fraction": wake} | curve
    epsilon = -156.2 * fullness**2 + 41.6 * fullness - 1.76
    propeller |= {"eta": min(f.D / f.rudder_height, 1.0), "kappa": 0.6 / epsilon}
    propeller["n"] = balanced_revolutions(0.5 * WATER * L * d * speed**2 * R0, speed, propeller, 1.0 - t_P)
    papers = Papers(
        name=name,
        title="Cargo ship by the MMG method, hull of Kijima (1990)",
        L=L,
        B=B,
        d=d,
        volume=volume,
        speed=speed,
        rudder_area=f.rudder_area,
        rudder_height=f.rudder_height,
        frontal_area=650.0 * B * L / (32.192 * 225.023),
        lateral_area=2300.0 * (L / 225.023) ** 2,
        rudder_rate_deg=2.5,
        rudder_delay=1.5,
        propeller=propeller,
        x_G=f.x_G,
    )
    # Kijima's forces are in beta = -v': odd terms change their sign
    hull = Hull(
        R0,
        X=(("vv", R0), ("vr", (1.11 * block - 0.07 - 1.0) * m_y)),
        Y=(
            ("v", -(0.5 * math.pi * k + 1.4 * fullness)),
            ("r", mass + m_x - 1.5 * fullness),
            ("vV", -(2.5 * flat * (1.0 - block) + 0.5)),
            ("rR", 0.343 * flat * block - 0.07),
            ("vrr", -5.95 * flat * (1.0 - block)),
            ("vvr", 1.5 * flat * block - 0.65),
        ),
        N=(
            ("v", -k),
            ("r", -0.54 * k + k * k),
            ("vV", 0.96 * flat * (1.0 - block) - 0.066),
            ("rR", 0.5 * fullness - 0.09),
            ("vrr", 0.5 * flat * block - 0.05),
            ("vvr", -(57.5 * fullness**2 - 18.4 * fullness + 1.6)),
        ),
    )
    gamma, aspect = -22.2 * fullness**2 + 0.02 * fullness + 0.68, f.rudder_height**2 / f.rudder_area
    rudder = Rudder(
        area=f.rudder_area,
        f_alpha=6.13 * aspect / (aspect + 2.25),
        epsilon=epsilon,
        kappa=0.6 / epsilon,
        eta=propeller["eta"],
        gamma_port=gamma,
        gamma_starboard=gamma,
        l_R=-1.0,
        t_R=0.45 - 0.28 * block,
        a_H=min(2.2835 * block**2 - 0.833 * block, 0.82),
        x_H=-0.45,
    )
    return MmgShip(papers, hull, Wake(wake, "exp", 4.0, 4.0), rudder, m_x=m_x, m_y=m_y, J_zz=J_zz, t_P=t_P)


def cross_flow(form: Form, drag: float, skew: float, ends: float) -> MmgShip:
    """A cargo ship whose hull has linear forces and a cross flow.

    The drag coefficient is ``drag`` amidships and differs along the length: by ``skew`` from stern to bow, by ``ends``
    at both ends, over that amidships.
    """
    ship, p = cargo(form, "foreign_cross_flow"), math.pi * form.d / form.L
    beam, flat = form.B / form.L, form.B / form.d
    places = [(k + 0.5) / 20 - 0.5 for k in range(20)]
    hull = replace(
        ship.hull,
        Y=(("v", -p * (1.0 + 0.4 * form.block * flat)), ("r", ship.m_x - p * (2.2 * beam - 0.08 * flat - 0.5))),
        N=(("v", -p * (0.5 + 2.4 * form.d / form.L)), ("r", -p * (0.25 + 0.039 * flat - 0.56 * beam))),
        sections=tuple((x, drag * (1.0 + skew * x + ends * 4.0 * x * x)) for x in places),
    )
    papers = replace(ship.papers, title="Cargo ship by the MMG method, hull with cross flow")
    return replace(ship, papers=papers, hull=hull)


def mirrored(ship: MmgShip) -> MmgShip:
    """The ship with an equal propeller race on both sides: means of what differs."""
    wake, rudder = ship.wake, ship.rudder
    mean, gamma = 0.5 * (wake.port + wake.starboard), 0.5 * (rudder.gamma_port + rudder.gamma_starboard)
    return replace(
        ship,
        wake=replace(wake, port=mean, starboard=mean),
        rudder=replace(rudder, gamma_port=gamma, gamma_starboard=gamma),
        Y_P=0.0,
        N_P=0.0,
    )


def with_race(ship: MmgShip, *, gamma: float = 0.0, wake: float = 0.0, side_force: float = 0.02) -> MmgShip:
    """The ship with a more asymmetric propeller race.

    ``gamma`` and ``wake`` are half the difference of the sides over the mean, starboard the larger; the propeller
    pushes its stern aside by ``side_force`` of the thrust, half of which acts as a moment by L.
    """
    r, w = ship.rudder, ship.wake
    rudder = replace(r, gamma_port=r.gamma_port * (1.0 - gamma), gamma_starboard=r.gamma_starboard * (1.0 + gamma))
    turned = replace(w, port=w.port * (1.0 - wake), starboard=w.starboard * (1.0 + wake))
    return replace(ship, wake=turned, rudder=rudder, Y_P=side_force, N_P=-0.5 * side_force)
