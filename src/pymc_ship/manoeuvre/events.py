"""Events of one run: headings reached, peaks, distances and the steady turn.

Events are located on the cubic Hermite interpolant of the record, whose slopes are psi_dot = r cos phi and the
kinematics of the track, so that they do not depend on the sampling interval.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class SteadyTurn(NamedTuple):
    """Mean rate of turn [rad/s], speed through the water and along the track [m/s] and drift angle [rad]."""

    yaw_rate: float
    speed: float
    track_speed: float
    drift: float


class Record:
    """One run up to its divergence: time, motion, and interpolants of heading and track."""

    def __init__(self, time: np.ndarray, motion: dict[str, np.ndarray]):
        good = np.isfinite(motion["psi"])
        end = good.size if good.all() else int(np.argmin(good))
        self.time = time[:end]
        self.motion = {name: values[:end] for name, values in motion.items()}
        psi, upright = self.motion["psi"], np.cos(self.motion["phi"])
        surge, sway = self.motion["u"], self.motion["v"] * upright
        self.psi_dot = self.motion["r"] * upright
        self.x_dot = surge * np.cos(psi) - sway * np.sin(psi)
        self.y_dot = surge * np.sin(psi) + sway * np.cos(psi)

    def at(self, name: str, when: float) -> float:
        """Value of psi, x or y at a time."""
        slope = {"psi": self.psi_dot, "x": self.x_dot, "y": self.y_dot}[name]
        k = min(max(int(np.searchsorted(self.time, when)) - 1, 0), self.time.size - 2)
        a, b, c, d = _cubic(self.time, self.motion[name], slope, k)
        s = when - self.time[k]
        return a + s * (b + s * (c + s * d))

    def crossing(self, level: float, sign: float, after: float = -np.inf) -> float:
        """First time after ``after`` at which sign * psi rises through ``level``; NaN where it does not."""
        k0 = max(int(np.searchsorted(self.time, after, side="right")) - 1, 0)
        ahead = sign * self.motion["psi"][k0:] >= level
        risen = ahead[1:] & ~ahead[:-1]
        if not risen.any():
            return np.nan
        k = k0 + int(np.argmax(risen))
        return self._root(k, lambda a: (a[0] - sign * level, *a[1:]), after)

    def peak(self, after: float) -> float:
        """First time after ``after`` at which the heading turns back; NaN where it does not."""
        k0 = max(int(np.searchsorted(self.time, after, side="right")) - 1, 0)
        rate = self.psi_dot[k0:]
        turned = np.flatnonzero(rate[1:] * rate[:-1] <= 0.0)
        if not turned.size:
            return np.nan
        return self._root(k0 + int(turned[0]), lambda a: (a[1], 2.0 * a[2], 3.0 * a[3]), after)

    def largest(self, name: str) -> float:
        """Largest magnitude of a channel [SI, rad]."""
        return float(np.abs(self.motion[name]).max())

    def distance(self, until: float) -> float:
        """Distance run [m] up to a time."""
        path = np.append(self.time[self.time < until], until)
        x, y = (np.array([self.at(name, when) for when in path]) for name in ("x", "y"))
        return float(np.hypot(np.diff(x), np.diff(y)).sum())

    def displacement(self, when: float) -> tuple[float, float]:
        """Position [m] at a time, counted from the first one: along the first heading, and to starboard of it."""
        north, east = (self.at(name, when) - self.motion[name][0] for name in ("x", "y"))
        course = self.motion["psi"][0]
        return north * np.cos(course) + east * np.sin(course), east * np.cos(course) - north * np.sin(course)

    def steady(self) -> SteadyTurn | None:
        """Means over the last 90 deg of heading; None where the heading changes by no more than 450 deg in all."""
        psi = self.motion["psi"]
        if abs(psi[-1] - psi[0]) <= 2.5 * np.pi:
            return None
        last = np.abs(psi - psi[-1]) <= 0.5 * np.pi
        u, v = self.motion["u"][last], self.motion["v"][last]
        return SteadyTurn(
            yaw_rate=np.abs(self.psi_dot[last]).mean(),
            speed=np.hypot(u, v).mean(),
            track_speed=np.hypot(self.x_dot, self.y_dot)[last].mean(),
            drift=np.abs(np.arctan2(v, u)).mean(),
        )

    def _root(self, k: int, polynomial, after: float) -> float:
        """First root of a polynomial made of the cubic of psi on interval k that lies in the interval."""
        coefficients = polynomial(_cubic(self.time, self.motion["psi"], self.psi_dot, k))
        roots = np.roots(coefficients[::-1])
        width = self.time[k + 1] - self.time[k]
        real = np.sort(roots[np.abs(roots.imag) < 1e-6 * width].real)
        inside = real[(real > -1e-6 * width) & (real < (1.0 + 1e-6) * width) & (self.time[k] + real >= after)]
        return float(self.time[k] + inside[0]) if inside.size else float(self.time[k + 1])


def _cubic(time: np.ndarray, value: np.ndarray, slope: np.ndarray, k: int) -> tuple[float, float, float, float]:
    """Coefficients of the Hermite cubic on interval k, in powers of the time since its begin."""
    h = time[k + 1] - time[k]
    secant = (value[k + 1] - value[k]) / h
    c = (3.0 * secant - 2.0 * slope[k] - slope[k + 1]) / h
    return value[k], slope[k], c, (slope[k] + slope[k + 1] - 2.0 * secant) / h**2
