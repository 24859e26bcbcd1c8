"""Manoeuvring indices of a zigzag or a turning circle and the IMO criteria they answer to.

Events (a heading reached, an overshoot's peak) are located on the cubic Hermite interpolant of the record, whose slopes
are psi_dot = r cos phi and the kinematics of the track, so that they do not depend on the sampling interval.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from pymc_ship.manoeuvre.standard import SIDES
from pymc_ship.trial.record import TrialError, check_trial

_UNITS = {"angle": "deg", "time": "s", "distance": "m", "speed": "m/s", "rate": "deg/s"}

ZIGZAG_INDICES = {
    "first_overshoot_angle": "angle",
    "second_overshoot_angle": "angle",
    "third_overshoot_angle": "angle",
    "first_overshoot_time": "time",
    "second_overshoot_time": "time",
    "initial_turning_time": "time",
    "initial_turning_distance": "distance",
    "period": "time",
    "maximum_roll_angle": "angle",
}
"""Indices of a zigzag and their kinds; a time to overshoot runs from the rudder's reversal to the peak."""

CIRCLE_INDICES = {
    "advance": "distance",
    "transfer": "distance",
    "tactical_diameter": "distance",
    "time_to_90": "time",
    "time_to_180": "time",
    "steady_turning_diameter": "distance",
    "steady_yaw_rate": "rate",
    "steady_speed": "speed",
    "steady_drift_angle": "angle",
    "maximum_roll_angle": "angle",
}
"""Indices of a turning circle and their kinds."""


def indices(trial: xr.Dataset, *, manoeuvre: str | None = None) -> xr.Dataset:
    """Manoeuvring indices of a trial or of a batch of simulated ships.

    Parameters
    ----------
    trial : Dataset, dims (time,) or (draw, time)
        With u, v [m/s], r [rad/s], phi, psi [rad] and x, y [m]; psi of a zigzag counts from its base course, a turning
        circle may start on any. ``attrs`` hold ``manoeuvre``, ``heading_deg`` and ``side``, as
        :func:`pymc_ship.simulate` writes them.
    manoeuvre : {"zigzag", "turning_circle"}, optional
        Overrides ``attrs["manoeuvre"]``.

    Returns
    -------
    Dataset, dims () or (draw,)
        :data:`ZIGZAG_INDICES` or :data:`CIRCLE_INDICES` [deg, s, m, m/s, deg/s]; NaN where the record does not reach
        the event or diverged. Overshoots count beyond the switching heading.

    Raises
    ------
    TrialError
        For another manoeuvre, missing channels or missing attrs.

    References
    ----------
    IMO (2002), Standards for ship manoeuvrability, resolution MSC.137(76).

    Examples
    --------
    >>> import pymc_ship as ps
    >>> trial = ps.simulate(ps.load_vessel("kvlcc2"), ps.zigzag(10, 10), duration=600, step=0.5)
    >>> overshoot = ps.indices(trial)["first_overshoot_angle"]
    >>> print(f"{overshoot:.1f} {overshoot.attrs['units']}")
    10.1 deg
    """
    kind = manoeuvre or trial.attrs.get("manoeuvre", "")
    families = {"zigzag": (_zigzag, ZIGZAG_INDICES), "turning_circle": (_turning_circle, CIRCLE_INDICES)}
    if kind not in families:
        raise TrialError(f"Indices exist for a zigzag or a turning_circle, found {kind!r}; name the manoeuvre.")
    wanted = {"heading_deg", "side"} if kind == "zigzag" else {"side"}
    if wanted - trial.attrs.keys() or trial.attrs["side"] not in SIDES:
        raise TrialError(
            f"The attrs of a {kind} need {', '.join(sorted(wanted))}, the side is 'starboard' or 'port'; mend them."
        )
    measure, table = families[kind]
    channels = ("u", "v", "r", "phi", "psi", "x", "y")
    check_trial(_before_divergence(trial.isel(draw=0, missing_dims="ignore")), channels, uniform=False)
    runs = trial if "draw" in trial.dims else trial.expand_dims("draw")
    records = {name: runs[name].transpose("draw", "time").values for name in channels}
    time = runs["time"].values
    ships = [
        _Record(time, {name: record[draw] for name, record in records.items()}) for draw in range(runs.sizes["draw"])
    ]
    rows = [measure(ship, trial.attrs) if ship.time.size > 1 else {} for ship in ships]
    values = np.array([[row.get(name, np.nan) for name in table] for row in rows])
    found = xr.Dataset(
        {name: ("draw", values[:, k], {"units": _UNITS[family]}) for k, (name, family) in enumerate(table.items())},
        attrs={**trial.attrs, "manoeuvre": kind},
    )
    return found.assign_coords(draw=runs["draw"]) if "draw" in trial.dims else found.isel(draw=0)


def _before_divergence(trial: xr.Dataset) -> xr.Dataset:
    """Return the samples up to the last finite heading."""
    good = np.flatnonzero(np.isfinite(trial["psi"].values)) if "psi" in trial else np.arange(trial.sizes["time"])
    return trial.isel(time=slice(0, good[-1] + 1 if good.size else 0))


class _Record:
    """One run up to its divergence: time, motion, and interpolants of heading and track."""

    def __init__(self, time: np.ndarray, motion: dict[str, np.ndarray]):
        good = np.isfinite(motion["psi"])
        end = good.size if good.all() else int(np.argmin(good))
        self.time = time[:end]
        self.motion = {name: values[:end] for name, values in motion.items()}
        u, v, r, phi, psi = (self.motion[name] for name in ("u", "v", "r", "phi", "psi"))
        self.psi_dot = r * np.cos(phi)
        sway = v * np.cos(phi)
        self.x_dot = u * np.cos(psi) - sway * np.sin(psi)
        self.y_dot = u * np.sin(psi) + sway * np.cos(psi)

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


def _zigzag(record: _Record, attrs: dict) -> dict[str, float]:
    heading, side = np.deg2rad(attrs["heading_deg"]), SIDES[attrs["side"]]
    found: dict[str, float] = {"maximum_roll_angle": _largest(record, "phi")}
    switch = record.crossing(heading, side)
    found["initial_turning_time"] = switch - record.time[0]
    if np.isfinite(switch):
        path = np.append(record.time[record.time < switch], switch)
        x, y = (np.array([record.at(name, when) for when in path]) for name in ("x", "y"))
        found["initial_turning_distance"] = float(np.hypot(np.diff(x), np.diff(y)).sum())
    switches = [switch]
    for count, name in enumerate(("first", "second", "third")):
        peak = record.peak(switch) if np.isfinite(switch) else np.nan
        if not np.isfinite(peak):
            break
        found[f"{name}_overshoot_angle"] = float(np.rad2deg(side * record.at("psi", peak) - heading))
        if count < 2:
            found[f"{name}_overshoot_time"] = peak - switch
        side = -side
        switch = record.crossing(heading, side, after=peak)
        switches.append(switch)
    if len(switches) > 2:
        found["period"] = switches[2] - switches[0]
    return found


def _turning_circle(record: _Record, attrs: dict) -> dict[str, float]:
    side = SIDES[attrs["side"]]
    found: dict[str, float] = {"maximum_roll_angle": _largest(record, "phi")}
    x, y, course = (record.motion[name][0] for name in ("x", "y", "psi"))
    for angle in (90, 180):
        when = record.crossing(np.deg2rad(angle) + side * course, side)
        found[f"time_to_{angle}"] = when - record.time[0]
        if np.isfinite(when):
            north, east = record.at("x", when) - x, record.at("y", when) - y
            across = side * (east * np.cos(course) - north * np.sin(course))
            if angle == 90:
                found["advance"] = north * np.cos(course) + east * np.sin(course)
                found["transfer"] = across
            else:
                found["tactical_diameter"] = across
    if abs(record.motion["psi"][-1] - record.motion["psi"][0]) > 2.5 * np.pi:
        found |= _steady(record)
    return found


def _steady(record: _Record) -> dict[str, float]:
    """Means over the last 90 deg of heading change."""
    psi = record.motion["psi"]
    last = np.abs(psi - psi[-1]) <= 0.5 * np.pi
    u, v = record.motion["u"][last], record.motion["v"][last]
    rate, along = np.abs(record.psi_dot[last]).mean(), np.hypot(record.x_dot, record.y_dot)[last].mean()
    return {
        "steady_turning_diameter": float(2.0 * along / rate),
        "steady_yaw_rate": float(np.rad2deg(rate)),
        "steady_speed": float(np.hypot(u, v).mean()),
        "steady_drift_angle": float(np.rad2deg(np.abs(np.arctan2(v, u)).mean())),
    }


def _largest(record: _Record, name: str) -> float:
    return float(np.rad2deg(np.abs(record.motion[name]).max()))
