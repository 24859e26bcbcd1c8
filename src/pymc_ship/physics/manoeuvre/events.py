"""Events of one run, on the cubic Hermite interpolant of heading and track: headings, peaks, the steady turn."""

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from pymc_ship.trial.record import unwrapped

_AHEAD = 256  # samples in which a heading that turns back is sought first


class SteadyTurn(NamedTuple):
    """Mean rate of turn [rad/s], speed through the water and along the track [m/s] and drift angle [rad]."""

    yaw_rate: float
    speed: float
    track_speed: float
    drift: float


class Record:
    """One run up to its divergence: time, motion, and interpolants of heading and track.

    The first sample is the first movement of the rudder, ``delay`` [s] after its order; the course is straight until
    then. The water drifts [m/s] to north and east where that is known.
    """

    def __init__(
        self,
        time: np.ndarray,
        motion: dict[str, np.ndarray],
        delay: float = 0.0,
        drift: Sequence[float] | np.ndarray = (0.0, 0.0),
    ):
        good = np.isfinite(motion["psi"])
        end = good.size if good.all() else int(np.argmin(good))
        self.time, self.ordered_at = time[:end], time[0] - delay
        self.motion = {name: values[:end] for name, values in motion.items()}
        self.motion["psi"] = unwrapped(self.motion["psi"])
        self.drift = complex(*drift)

    @cached_property
    def psi_dot(self) -> np.ndarray:
        """Rate of the heading [rad/s] at every sample."""
        return self.motion["r"] * np.cos(self.motion["phi"])

    @cached_property
    def turned(self) -> np.ndarray:
        """Integral of the yaw rate [rad] since the first sample, free of the compass noise."""
        turns = 0.5 * (self.psi_dot[1:] + self.psi_dot[:-1]) * np.diff(self.time)
        return np.append(0.0, np.cumsum(turns))

    def at(self, name: str, when: ArrayLike) -> Any:
        """Value of psi, x or y at a time or an array of times."""
        k = np.minimum(np.maximum(np.searchsorted(self.time, when) - 1, 0), self.time.size - 2)
        a, b, c, d = self._cubic(name, k)
        s = when - self.time[k]
        return a + s * (b + s * (c + s * d))

    def crossing(self, level: float, sign: float, after: float = -np.inf) -> float:
        """First time after ``after`` when sign * psi rises through ``level`` (middle of noisy crossings), or NaN."""
        k0 = max(int(np.searchsorted(self.time, after, side="right")) - 1, 0)
        ahead = sign * self.motion["psi"][k0:] >= level
        crossed = k0 + np.flatnonzero(ahead[1:] != ahead[:-1])
        crossed = crossed[int(ahead[0]) :]
        if not crossed.size:
            return np.nan
        if crossed.size > 1:
            turned = self._turning_interval(int(crossed[0]), sign)
            crossed = crossed[: max(int(np.searchsorted(crossed, turned)), 1)]
        k = int(crossed[(crossed.size - 1) // 2])
        return self._root(k, lambda a: (a[0] - sign * level, *a[1:]), after)

    def peak(self, after: float) -> float:
        """First time after ``after`` at which the heading turns back (largest integral of the yaw rate), or NaN."""
        k0 = max(int(np.searchsorted(self.time, after, side="right")) - 1, 0)
        k = self._turning_interval(k0, np.sign(self.psi_dot[k0 : k0 + 2].sum()))
        if k >= self.time.size - 1:
            return np.nan
        return self._root(k, lambda a: (a[1], 2.0 * a[2], 3.0 * a[3]), after)

    def largest(self, name: str) -> float:
        """Largest magnitude of a channel [SI, rad]."""
        return float(np.abs(self.motion[name]).max())

    def distance(self, until: float) -> float:
        """Distance run [m] since the order: how far the positions advance along the velocity; their noise cancels."""
        n = int(np.searchsorted(self.time, until))
        path = np.append(self.time[:n], until)
        x, y = (np.diff(np.append(self.motion[name][:n], self.at(name, until))) for name in ("x", "y"))
        middle = 0.5 * (path[1:] + path[:-1])
        velocity = np.interp(middle, self.time[: n + 1], self._velocity(slice(n + 1)))
        moving = velocity != 0.0
        advanced = (x + 1j * y)[moving] * np.conj(velocity[moving]) / np.abs(velocity[moving])
        before = (self.time[0] - self.ordered_at) * np.abs(self._velocity(0))
        return float(np.abs(advanced.sum()) + before)

    def displacement(self, when: float) -> tuple[float, float]:
        """Position [m] at a time, counted from that of the order: along the first heading, and to starboard of it."""
        north, east = (self.at(name, when) - self.motion[name][0] for name in ("x", "y"))
        moved = complex(north, east) + (self.time[0] - self.ordered_at) * self._velocity(0)
        moved *= np.exp(-1j * self.motion["psi"][0])
        return float(moved.real), float(moved.imag)

    def steady(self) -> SteadyTurn | None:
        """Means over the last 90 deg of heading; None where the heading changes by no more than 450 deg in all."""
        psi = self.motion["psi"]
        if abs(psi[-1] - psi[0]) <= 2.5 * np.pi:
            return None
        last = np.flatnonzero(np.abs(psi - psi[-1]) <= 0.5 * np.pi)
        u, v = self.motion["u"][last], self.motion["v"][last]
        return SteadyTurn(
            yaw_rate=abs(self.psi_dot[last].mean()),
            speed=np.hypot(u, v).mean(),
            track_speed=np.abs(self._velocity(last) - self.drift).mean(),
            drift=abs(np.arctan2(v, u).mean()),
        )

    def _velocity(self, k: Any) -> Any:
        """Velocity over ground [m/s] at some samples, north + i east."""
        u, v, phi, psi = (self.motion[name][k] for name in ("u", "v", "phi", "psi"))
        return (u + 1j * v * np.cos(phi)) * np.exp(1j * psi) + self.drift

    def _slopes(self, name: str, k: Any) -> Any:
        """Slope of psi, x or y at some samples."""
        if name == "psi":
            return self.psi_dot[k]
        return self._velocity(k).real if name == "x" else self._velocity(k).imag

    def _cubic(self, name: str, k: Any) -> tuple[Any, Any, Any, Any]:
        """Coefficients of the Hermite cubic on interval k (or on several), in powers of the time since its begin."""
        value, h = self.motion[name], self.time[k + 1] - self.time[k]
        begin, end = self._slopes(name, k), self._slopes(name, k + 1)
        secant = (value[k + 1] - value[k]) / h
        return value[k], begin, (3.0 * secant - 2.0 * begin - end) / h, (begin + end - 2.0 * secant) / h**2

    def _turning_interval(self, begin: int, sign: float) -> int:
        """Begin of the interval after a sample in which the heading turns back from ``sign``, or the last sample."""
        end = begin + _AHEAD
        while True:  # over as much of the record as is needed
            turned = sign * (self.turned[begin:end] - self.turned[begin])
            back = np.flatnonzero(turned[1:] <= 0.0)
            if back.size or end >= self.time.size:
                break
            end = begin + 4 * (end - begin)
        top = int(np.argmax(turned[: back[0] + 2] if back.size else turned))
        return begin + top - int(0 < top < turned.size - 1 and sign * self.psi_dot[begin + top] <= 0.0)

    def _root(self, k: int, polynomial: Callable[[Sequence[float]], Sequence[float]], after: float) -> float:
        """First root, from ``after`` on, of a polynomial made of the cubic of psi on interval k; else its end."""
        coefficients = polynomial(self._cubic("psi", k))
        begin, end = float(self.time[k]), float(self.time[k + 1])
        start = min(max(after - begin, 0.0), end - begin)
        root = first_root(list(map(float, coefficients)), start, end - begin)
        return end if math.isnan(root) else begin + root


def first_root(coefficients: Sequence[float], start: float, end: float) -> float:
    """First root of a polynomial of degree 3 or less, in rising powers, from start to end; NaN without one."""
    a, b, c, d = [*coefficients, 0.0, 0.0][:4]

    def value(x: float) -> float:
        return a + x * (b + x * (c + x * d))

    turning_points = [x for x in _quadratic_roots(b, 2.0 * c, 3.0 * d) if start < x < end]
    for low, high in pairwise([start, *turning_points, end]):
        if value(low) * value(high) <= 0.0:
            return float(scipy.optimize.brentq(value, low, high))
    return math.nan


def _quadratic_roots(a: float, b: float, c: float) -> list[float]:
    """Real roots of a + b x + c x^2, in order; without cancellation (Numerical Recipes, Eq. 5.6.4)."""
    discriminant = b * b - 4.0 * a * c
    if discriminant < 0.0:
        return []
    q = -0.5 * (b + math.copysign(math.sqrt(discriminant), b))
    return sorted(top / bottom for top, bottom in ((q, c), (a, q)) if bottom)
