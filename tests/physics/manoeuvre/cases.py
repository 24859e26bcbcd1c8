"""Records as trials of ships of any size and speed give them: an approach, sensor noise, a zigzag steered by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.physics.manoeuvre.kinds import SIDES

NOISE = {"u": 0.05, "v": 0.05, "r": 5e-4, "psi": 2e-3, "x": 1.0, "y": 1.0, "delta": 2.5e-3, "phi": 2e-3}
"""Standard deviations of a speed log, a gyro, GNSS and a rudder indicator [SI]."""


def scaled(name, L, ship_time, rate=2.35, delay=0.0):
    """A shipped vessel of another length [m] and L/U [s], with its steering gear [deg/s, s]."""
    vessel = ps.load_vessel(name)
    gear = {"rudder_rate_deg": rate, "rudder_delay": delay}
    return replace(vessel, particulars=replace(vessel.particulars, L=L, nominal_speed=L / ship_time, **gear))


def simulated(vessel, manoeuvre, *, ship_times=30.0, interval=0.5):
    """The manoeuvre itself."""
    steps = {"step": interval / 4.0, "record_interval": interval, "method": "rk4"}
    return ps.simulate(vessel, manoeuvre, duration=ship_times * vessel.particulars.ship_time, **steps)


def measured(run, approach=0.0, *, seed=None, course=0.7, helm=0.0):
    """The run after a straight approach [s] with a constant helm [rad], on a course, with noise for a seed."""
    step = float(run["time"][1])
    n = round(approach / step)
    before = {name: np.full(n, run[name].values[0]) for name in ("u", "v", "r", "p", "phi", "psi", "y")}
    before["x"] = -step * run["u"].values[0] * np.arange(n, 0, -1)
    before["delta"] = helm * np.sin(0.3 * step * np.arange(n))
    values = {name: np.concatenate([head, run[name].values]) for name, head in before.items()}
    x, y, c, s = values["x"], values["y"], np.cos(course), np.sin(course)
    values |= {"x": 500.0 + c * x - s * y, "y": s * x + c * y - 300.0, "psi": values["psi"] + course}
    if seed is not None:
        rng = np.random.default_rng(seed)
        values |= {name: values[name] + sd * rng.standard_normal(values[name].size) for name, sd in NOISE.items()}
    return xr.Dataset(
        {name: ("time", row) for name, row in values.items()}, {"time": step * np.arange(values["u"].size)}
    )


def steered_by_hand(vessel, manoeuvre, headings, *, ship_times=30.0, interval=0.5):
    """A zigzag whose reversals a helmsman orders at these heading changes [deg], and the times of his orders [s]."""
    sign, delay = SIDES[manoeuvre.side], vessel.particulars.rudder_delay
    times, angles, orders = [0.0], [-sign * np.deg2rad(manoeuvre.rudder_deg)], []
    for k, heading in enumerate(headings):
        run = simulated(vessel, ps.rudder_programme(times, angles), ship_times=ship_times, interval=0.1)
        turned = sign * (-1.0) ** k * np.rad2deg(run["psi"].values) >= heading
        reached = np.flatnonzero(turned & (run["time"].values > (orders[-1] if orders else 0.0)))
        orders.append(float(run["time"][reached[0]]))
        times += [orders[-1] + delay, orders[-1] + delay + 1e-3]
        angles += [angles[-1], -angles[-1]]
    return simulated(vessel, ps.rudder_programme(times, angles), ship_times=ship_times, interval=interval), orders
