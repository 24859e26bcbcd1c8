"""The door to all foreign ships: a ship sails a manoeuvre in wind and current, and its sensors are read.

Axes: x forward, y starboard, origin midship, psi and r positive to starboard; a positive rudder angle turns to port.
A ship is an object with ``papers`` (:class:`Papers`) and ``accelerations(motion, delta, n, push)``: from surge, sway,
yaw rate, roll rate and heel through the water, the rudder angle, revolutions and a force and moments from outside
(X, Y, K, N about midship [N, N m]) to the rates of surge, sway, yaw rate and roll rate. All of it is SI and rad.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.optimize import root

SIDES = {"starboard": 1.0, "port": -1.0}
AIR = 1.225
CX, CY, ARM = 0.6, 0.85, 0.18
"""Wind: longitudinal and transverse coefficient, and how far its centre moves [L/rad] (Blendermann 1994)."""


@dataclass(frozen=True)
class Papers:
    """What a naval architect knows of a ship: SI units; the propeller as the vessel file of the package wants it."""

    name: str
    title: str
    L: float
    B: float
    d: float
    volume: float
    speed: float
    rudder_area: float
    rudder_height: float
    frontal_area: float
    lateral_area: float
    rudder_rate_deg: float
    rudder_delay: float
    propeller: dict[str, float]
    x_G: float = 0.0
    stability: tuple[tuple[str, float], ...] = ()

    @property
    def unit(self) -> float:
        """Time in which it covers its length [s]."""
        return self.L / self.speed


@dataclass(frozen=True)
class Trial:
    """A manoeuvre: ``zigzag``, ``circle``, ``pull-out`` or ``stop``, rudder and heading to switch at [deg], first side.

    In a stop the rudder is amidships and the revolutions go evenly to ``astern`` [1/s], a magnitude, in ``reversal``
    [s]; it ends when the ship makes no way ahead.
    """

    kind: str
    rudder: float
    heading: float = 0.0
    side: str = "starboard"
    astern: float = 0.0
    reversal: float = 0.0

    def revolutions(self, nominal: float, time: float) -> float:
        """Of the propeller at a time [1/s]."""
        if self.kind != "stop":
            return nominal
        return nominal - (nominal + self.astern) * min(time / max(self.reversal, 1e-9), 1.0)

    @property
    def label(self) -> str:
        """Kind, angles [deg] and side."""
        if self.kind == "stop":
            return f"stop {self.astern:g}"
        angles = f"{self.rudder:g}" if self.kind == "circle" else f"{self.rudder:g}/{self.heading:g}"
        return f"{self.kind} {angles} {self.side}"


@dataclass(frozen=True)
class Weather:
    """True wind [m/s] and where it comes from, current [m/s] and where it sets to [deg]; directions over the ground."""

    wind: float = 0.0
    wind_from_deg: float = 0.0
    current: float = 0.0
    current_to_deg: float = 0.0

    def seen_from(self, course_deg: float) -> Weather:
        """Weather in the axes of an approach course: headings of a record count from the course of its approach."""
        turned = {"wind_from_deg": self.wind_from_deg, "current_to_deg": self.current_to_deg}
        return replace(self, **{name: (angle - course_deg) % 360.0 for name, angle in turned.items()})

    @property
    def drift(self) -> tuple[float, float]:
        """Current along x and y [m/s]."""
        angle = math.radians(self.current_to_deg)
        return self.current * math.cos(angle), self.current * math.sin(angle)


CALM = Weather()


@dataclass(frozen=True)
class Sensors:
    """Standard deviations: speeds over the nominal one, rates [rad/s], angles [rad] and positions [m]."""

    speed: float = 0.005
    rate: float = math.radians(0.02)
    angle: float = math.radians(0.1)
    position: float = 0.5

    def read(self, record: xr.Dataset, speed: float, rng: np.random.Generator) -> xr.Dataset:
        """Record with noise; rudder angle and revolutions are exact."""
        sd = {"u": self.speed * speed, "v": self.speed * speed, "r": self.rate, "p": self.rate}
        sd |= {"phi": self.angle, "psi": self.angle, "x": self.position, "y": self.position}
        noisy = {k: record[k] + sd[k] * rng.standard_normal(record.sizes["time"]) for k in sd if k in record}
        return record.assign(noisy)


SENSORS = Sensors()


def wind_push(
    papers: Papers, weather: Weather, psi: float, motion: tuple[float, ...]
) -> tuple[float, float, float, float]:
    """Force and moments of the wind about midship; the heeling arm is half the draught and half the mean height."""
    if not weather.wind:
        return 0.0, 0.0, 0.0, 0.0
    angle = math.radians(weather.wind_from_deg)
    north, east = weather.drift
    north, east = north + weather.wind * math.cos(angle), east + weather.wind * math.sin(angle)
    cosine, sine = math.cos(psi), math.sin(psi)
    ahead, abeam = motion[0] + north * cosine + east * sine, motion[1] - north * sine + east * cosine
    speed, side = math.hypot(ahead, abeam), math.atan2(abeam, ahead)
    pressure = 0.5 * AIR * speed * speed
    x = -CX * pressure * papers.frontal_area * math.cos(side)
    y = -CY * pressure * papers.lateral_area * math.sin(side)
    height = 0.5 * (papers.d + papers.lateral_area / papers.L)
    return x, y, height * y, ARM * (0.5 * math.pi - abs(side)) * papers.L * y


def over_ground(u, v, psi, weather: Weather):
    """Speeds over the ground along the ship from those through the water; arrays or numbers."""
    north, east = weather.drift
    return u + north * np.cos(psi) + east * np.sin(psi), v - north * np.sin(psi) + east * np.cos(psi)


def approach(ship, weather: Weather = CALM) -> tuple[tuple[float, ...], float]:
    """Motion and helm [rad] of the straight course along x at the revolutions of the nominal speed."""
    papers = ship.papers
    rolls = bool(papers.stability)

    def residual(unknown):
        motion = (unknown[0] * papers.speed, unknown[1] * papers.speed, 0.0, 0.0, unknown[3])
        rates = ship.accelerations(motion, unknown[2], papers.propeller["n"], wind_push(papers, weather, 0.0, motion))
        scale = papers.speed / papers.unit
        last = rates[3] * papers.unit**2 if rolls else unknown[3]
        return [rates[0] / scale, rates[1] / scale, rates[2] * papers.unit**2, last]

    found = root(residual, [1.0, 0.0, 0.0, 0.0], tol=1e-12)
    if np.abs(found.fun).max() > 1e-8:
        raise ValueError(f"{papers.name} finds no straight course: {found.message}")
    speed, sway, helm, heel = found.x
    return (speed * papers.speed, sway * papers.speed, 0.0, 0.0, heel), helm


class Helmsman:
    """Orders of a manoeuvre; a delay after the heading has changed far enough a zigzag reverses, a pull-out ends."""

    def __init__(self, trial: Trial, delay: float):
        self.order = -SIDES[trial.side] * math.radians(trial.rudder)
        self.turn = math.copysign(1.0, -self.order)
        self.heading = math.inf if trial.kind in ("circle", "stop") else math.radians(trial.heading)
        self.then = 0.0 if trial.kind == "pull-out" else -1.0
        self.delay, self.due = delay, math.inf

    def watch(self, time: float, step: float, before: float, now: float) -> None:
        """See the headings at the begin and end of a step that ends at ``time``."""
        if math.isinf(self.due) and self.turn * now >= self.heading:
            passed = (self.turn * now - self.heading) / max(self.turn * (now - before), 1e-12)
            self.due, self.turn = time - min(passed, 1.0) * step + self.delay, -self.turn
        if time >= self.due - 0.5 * step:
            self.order, self.due = self.then * self.order, math.inf


def integrate(ship, trial: Trial, weather: Weather, *, duration: float, step: float, every: int) -> np.ndarray:
    """Motion by the classical Runge-Kutta method: rows of time, u, v, r, p, phi, x, y, psi and delta."""
    papers = ship.papers
    nominal, rate = papers.propeller["n"], math.radians(papers.rudder_rate_deg)
    north, east = weather.drift
    motion, delta = approach(ship, weather)
    state, helm = [*motion, 0.0, 0.0, 0.0], Helmsman(trial, papers.rudder_delay)

    def slope(at, angle, time):
        u, v, r, p, phi, _, _, psi = at
        now, n = (u, v, r, p, phi), trial.revolutions(nominal, time)
        du, dv, dr, dp = ship.accelerations(now, angle, n, wind_push(papers, weather, psi, now))
        cosine, sine, upright = math.cos(psi), math.sin(psi), math.cos(phi)
        along, across = u * cosine - v * upright * sine, u * sine + v * upright * cosine
        return du, dv, dr, dp, p, along + north, across + east, r * upright

    def moved(slopes, h):
        return [a + h * b for a, b in zip(state, slopes, strict=True)]

    rows = [(0.0, *state, delta)]
    for k in range(1, round(duration / step) + 1):
        middle, last = (delta + max(-rate * h, min(rate * h, helm.order - delta)) for h in (0.5 * step, step))
        begin, end = (k - 1) * step, k * step
        k1 = slope(state, delta, begin)
        k2 = slope(moved(k1, 0.5 * step), middle, 0.5 * (begin + end))
        k3 = slope(moved(k2, 0.5 * step), middle, 0.5 * (begin + end))
        k4 = slope(moved(k3, step), last, end)
        before = state[7]
        state = moved([(a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)], step)
        delta = last
        helm.watch(end, step, before, state[7])
        if k % every == 0:
            rows.append((end, *state, delta))
            if trial.kind == "stop" and state[0] <= 0.0:
                break
    return np.array(rows)


def sail(
    ship,
    trial: Trial,
    weather: Weather = CALM,
    *,
    course_deg: float = 0.0,
    duration: float | None = None,
    step: float = 0.1,
    interval: float = 0.5,
    ground: bool = False,
    sensors: Sensors | None = None,
    seed: int = 0,
) -> xr.Dataset:
    """Sail a manoeuvre from the straight course and read the sensors.

    Parameters
    ----------
    ship : object
        With ``papers`` and ``accelerations``.
    trial : Trial
    weather : Weather, optional
        Over the ground; the record counts headings and positions from the approach.
    course_deg : float, optional
        Of the approach, which turns the weather.
    duration : float, optional
        [s]; 25 L/U by default.
    step, interval : float, optional
        Of the integration and of the record [s].
    ground : bool, optional
        Whether u and v are over the ground.
    sensors : Sensors, optional
        Exact ones by default.
    seed : int, optional
        Of their noise.

    Returns
    -------
    Dataset, dims (time,)
        u, v, r, x, y, psi, delta, n, and p and phi of a ship that rolls; of exact sensors the attr ``rudder_delay``
        [s], from the order to the movement.
    """
    weather = weather.seen_from(course_deg)
    duration = 25.0 * ship.papers.unit if duration is None else duration
    rows = integrate(ship, trial, weather, duration=duration, step=step, every=round(interval / step))
    names = ("u", "v", "r", "p", "phi", "x", "y", "psi", "delta")
    channels = {name: ("time", values) for name, values in zip(names, rows.T[1:], strict=True)}
    record = xr.Dataset(channels, {"time": rows[:, 0]})
    turned = [trial.revolutions(ship.papers.propeller["n"], time) for time in rows[:, 0]]
    record = record.assign(n=("time", turned))
    record = record if ship.papers.stability else record.drop_vars(["p", "phi"])
    if ground:
        u, v = over_ground(record["u"], record["v"], record["psi"], weather)
        record = record.assign(u=u, v=v).assign_attrs(speeds="over ground")
    if weather.wind > 0.0:
        wind = {"wind_speed": weather.wind, "wind_direction": math.radians(weather.wind_from_deg)}
        record = record.assign({name: xr.full_like(record["u"], value) for name, value in wind.items()})
    if sensors is None:
        return record.assign_attrs(rudder_delay=ship.papers.rudder_delay)
    return sensors.read(record, ship.papers.speed, np.random.default_rng(seed))


def indices(record: xr.Dataset, trial: Trial) -> dict[str, float]:
    """Indices of an exact record: distances [m] of a circle, counted from the order; overshoots [deg] of a zigzag."""
    time, side = record["time"].values, SIDES[trial.side]
    psi, x, y = (record[name].values for name in ("psi", "x", "y"))
    if trial.kind == "circle":
        turned = side * np.rad2deg(psi)
        if turned.max() < 180.0:
            raise ValueError(f"The {trial.label} ends at {turned.max():.0f} deg; sail longer.")
        quarter, half = (first_at(angle, turned, time) for angle in (90.0, 180.0))
        return {
            "advance": float(np.interp(quarter, time, x) + record.attrs["rudder_delay"] * record["u"].values[0]),
            "transfer": float(side * np.interp(quarter, time, y)),
            "tactical_diameter": float(side * np.interp(half, time, y)),
        }
    found, begin, turn = {}, 0, side
    for name in ("first_overshoot_angle", "second_overshoot_angle"):
        beyond = turn * np.rad2deg(psi) - trial.heading
        reached = begin + int(np.argmax(beyond[begin:] >= 0.0))
        back = reached + int(np.argmax(np.diff(beyond[reached:]) < 0.0))
        if beyond[reached] < 0.0 or back in (reached, time.size - 1):
            raise ValueError(f"The {trial.label} has no {name.replace('_', ' ')}; sail longer.")
        top = slice(back - 1, back + 2)
        a, b, _ = np.polyfit(time[top] - time[back], beyond[top], 2)
        found[name] = float(beyond[back] - b * b / (4.0 * a))
        begin, turn = back, -turn
    return found


def first_at(level: float, values: np.ndarray, time: np.ndarray) -> float:
    """Time at which values first rise through a level, between two samples."""
    k = int(np.argmax(values >= level))
    return float(np.interp(level, values[k - 1 : k + 1], time[k - 1 : k + 1]))


JUDGED = tuple(Trial("circle", 35.0, side=side) for side in SIDES) + tuple(
    Trial("zigzag", 15.0, 15.0, side) for side in SIDES
)
"""Manoeuvres that forecasts are judged by."""


def truth(ship) -> dict[str, dict[str, float]]:
    """Indices of the judged manoeuvres in calm water by label."""
    return {trial.label: indices(sail(ship, trial, interval=0.1), trial) for trial in JUDGED}


def vessel_file(ship, *, propeller: bool = True) -> str:
    """TOML of what a naval architect knows of a ship, for the package; no coefficients."""
    papers = ship.papers
    known = {"L": papers.L, "B": papers.B, "d": papers.d, "volume": papers.volume, "nominal_speed": papers.speed}
    known |= {"rudder_rate_deg": papers.rudder_rate_deg, "x_G": papers.x_G, **dict(papers.stability)}
    lines = [f"name = {json.dumps(papers.name)}", f"title = {json.dumps(papers.title)}", "", "[particulars]"]
    lines += [f"{key} = {float(value)!r}" for key, value in known.items()]
    aspect_ratio = papers.rudder_height**2 / papers.rudder_area
    lines += ["", "[rudder]", f"area = {papers.rudder_area!r}", f"aspect_ratio = {aspect_ratio!r}"]
    lines += ["", "[windage]", f"frontal_area = {papers.frontal_area!r}", f"lateral_area = {papers.lateral_area!r}"]
    if propeller:
        lines += ["", "[propeller]", *(f"{key} = {float(value)!r}" for key, value in papers.propeller.items())]
    return "\n".join(lines) + "\n"
