"""Unknown ships, drawn around published ones: the population of ``studies/ships.toml``.

A ship is one of five kinds. A tanker has the forces of the KVLCC2, a Mariner and an S175 those of their polynomials,
with every coefficient changed by chance; the tanker sails at another scale, too. A cargo ship is of a form that is
drawn (length, beam, draught, block coefficient, speed, rudder, propeller), with the hull of Kijima or with a cross flow
along the length, and forces changed by chance. The two sides of a single screw differ. Weather and what the papers
state are drawn, too.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.ships.forecasting.stopping import StoppingTest
from studies.foreign import mariner, mmg, s175, sailing
from studies.foreign.sailing import CALM, SENSORS, Trial, Weather
from studies.population.judged_ship import DrawnShip

HULLS = ("tanker", "cargo ship", "cross flow", "mariner", "s175")
"""Kinds of ships, of equal probability."""

LEFT_OUT = ("rudder stall", "fuller", "finer")
"""Kinds by which nothing was chosen: tankers whose rudder stalls, and forms outside the range of the cargo ships."""

KINDS = {"zigzag": "zigzag", "turning_circle": "circle", "pull_out": "pull-out"}
"""What a foreign trial calls the kinds of manoeuvres of the package."""

FINITE_AT_REST = ("cargo ship", "cross flow", *LEFT_OUT)
"""Kinds that can be stopped: forces with the cube of r' grow beyond all bounds as the speed falls."""

_SCATTER = {"hull": 0.2, "rudder": 0.12, "roll": 0.1, "sides": 0.1, "thrust astern": 0.15, "side force astern": 0.5}
_CARGO = ([110.0, 5.8, 2.2, 0.6], [300.0, 7.2, 3.6, 0.85])  # L [m], L/B, B/d, C_B
_FORMS = {
    "fuller": ([150.0, 5.2, 2.5, 0.8], [330.0, 5.6, 3.2, 0.86]),
    "finer": ([110.0, 6.5, 2.7, 0.55], [250.0, 7.2, 3.5, 0.61]),
}
_SCALES = (0.6, 1.2)
_TRIED = 60
_USUAL = (Trial("zigzag", 20.0, 20.0), Trial("circle", 35.0, side="port"), Trial("circle", 35.0))
_LASTS = {"zigzag": 20.0, "circle": 14.0, "pull-out": 20.0}  # L/U, of a record


def drawn(rng: np.random.Generator) -> DrawnShip:
    """Draw a ship of :data:`HULLS` that turns and checks its yaw as ships do, and the conditions of its trials.

    Raises
    ------
    RuntimeError
        Where none of many draws does.
    """
    return _drawn(HULLS, rng)


def left_out(rng: np.random.Generator) -> DrawnShip:
    """As :func:`drawn`, of :data:`LEFT_OUT`."""
    return _drawn(LEFT_OUT, rng)


def _drawn(hulls: tuple[str, ...], rng: np.random.Generator) -> DrawnShip:
    hull = hulls[int(rng.integers(len(hulls)))]
    for _ in range(_TRIED):
        ship = a_ship(hull, rng)
        if usual(ship):
            break
    else:
        raise RuntimeError(f"None of {_TRIED} draws of a {hull} sails a circle and a zigzag as ships do.")
    sky, angle = int(rng.integers(4)), float(rng.uniform(0.0, 360.0))
    weather = {0: Weather(wind=8.0, wind_from_deg=angle), 1: Weather(current=0.5, current_to_deg=angle)}.get(sky, CALM)
    propeller, noise = bool(rng.random() < 0.75), int(rng.integers(2**31))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "vessel.toml"
        path.write_text(sailing.vessel_file(ship, propeller=propeller), encoding="utf-8")
        vessel = ps.load_vessel(path)
    unit = ship.papers.unit
    if hull in FINITE_AT_REST:
        thrust, side = np.exp(np.array([_SCATTER["thrust astern"], _SCATTER["side force astern"]]) * rng.normal(size=2))
        ship = replace(ship, astern=mmg.Astern(float(thrust), float(side)))

    def sail(manoeuvre: Manoeuvre, duration: float) -> xr.Dataset:
        return sailing.sail(ship, as_trial(manoeuvre), duration=duration)

    def record(manoeuvre: Manoeuvre, run: int) -> xr.Dataset:
        trial = as_trial(manoeuvre)
        settings = {"duration": _LASTS[trial.kind] * unit, "ground": sky == 1, "sensors": SENSORS}
        return sailing.sail(ship, trial, weather, course_deg=90.0 * run, seed=noise + run, **settings)

    def stop(test: StoppingTest, duration: float) -> xr.Dataset:
        trial = Trial("stop", 0.0, astern=test.astern, reversal=test.reversal)
        return sailing.sail(ship, trial, duration=duration)

    return DrawnShip(hull, vessel, sail, record, stop if hull in FINITE_AT_REST else None)


def as_trial(manoeuvre: Manoeuvre) -> Trial:
    """Manoeuvre of the package as a foreign ship sails it."""
    return Trial(KINDS[manoeuvre.kind], manoeuvre.rudder_deg, manoeuvre.heading_deg, manoeuvre.side)


def usual(ship) -> bool:
    """Whether a ship turns and checks its yaw as ships do.

    Its circles of 35 deg have a tactical diameter of 2 to 6 L, and after 25 L/U a drift angle amidships below 25 deg
    and a quarter of its speed or more; the second overshoot of its 20/20 zigzag is below 40 deg.
    """
    try:
        return all(_is_usual_in(ship, trial) for trial in _USUAL)
    except (ValueError, OverflowError, ZeroDivisionError):
        return False


def _is_usual_in(ship, trial: Trial) -> bool:
    run = sailing.sail(ship, trial, interval=0.5)
    found = sailing.indices(run, trial)
    if trial.kind == "zigzag":
        return found["second_overshoot_angle"] < 40.0
    u, v = float(run["u"][-1]), abs(float(run["v"][-1]))
    turns = math.atan2(v, u) < math.radians(25.0) and math.hypot(u, v) > 0.25 * ship.papers.speed
    return turns and 2.0 < found["tactical_diameter"] / ship.papers.L < 6.0


def a_ship(hull: str, rng: np.random.Generator):
    """A ship of a kind, usual or not."""
    if hull == "mariner":
        rows = [_changed(terms, _SCATTER["hull"], rng) for terms in (mariner.SURGE, mariner.SWAY, mariner.YAW)]
        return mariner.Mariner(rows=tuple(rows))
    if hull == "s175":
        sds = [_SCATTER["hull"], _SCATTER["hull"], _SCATTER["roll"], _SCATTER["hull"]]
        rows = [_changed(row, sd, rng) for row, sd in zip(s175.ROWS, sds, strict=True)]
        # the straight course stays in balance
        rows[0]["uu"] = s175.SURGE["uu"]
        return s175.S175(GM=float(rng.uniform(0.3, 1.0)), rows=tuple(rows))
    if hull in ("tanker", "rudder stall"):
        ship = scaled(_mmg_ship(mmg.kvlcc2(), rng), float(rng.uniform(*_SCALES)))
        stall = math.radians(rng.uniform(15.0, 25.0)) if hull == "rudder stall" else math.inf
        return replace(ship, rudder=replace(ship.rudder, stall=stall))
    form = a_form(rng, _FORMS.get(hull, _CARGO))
    if hull != "cross flow":
        return _mmg_ship(mmg.cargo(form), rng)
    drag, skew, ends = rng.uniform([0.5, -0.8, 0.0], [1.0, 0.8, 1.0]).tolist()
    return _mmg_ship(mmg.cross_flow(form, drag, skew, ends), rng)


def a_form(rng: np.random.Generator, ranges: tuple[list[float], list[float]]) -> mmg.Form:
    """Form of L, L/B, B/d and C_B in ``ranges``; that of a cargo ship is within the regressions of its forces.

    These are of a fullness C_B B/L from .09 to .145; fuller and finer forms are near it.
    """
    while True:
        L, slender, flat, block = rng.uniform(*ranges).tolist()
        B = L / slender
        if ranges is not _CARGO or 0.09 < block * B / L < 0.145:
            break
    d, froude, pitch, x_G = B / flat, *rng.uniform([0.14, 0.7, -0.015], [0.21, 0.96, 0.025]).tolist()
    share, aspect, wheel = rng.uniform([48.0, 1.4, 0.5], [72.0, 2.0, 0.65]).tolist()
    area = L * d / share
    speed = froude * math.sqrt(9.81 * L)
    form = mmg.Form(
        L, B, d, block, speed, rudder_area=area, rudder_height=math.sqrt(aspect * area), D=wheel * d, pitch=pitch
    )
    return replace(form, x_G=x_G * L)


def _changed(terms, sd: float, rng: np.random.Generator):
    """Coefficients each times a factor of median 1."""
    pairs = terms.items() if isinstance(terms, dict) else terms
    found = [(name, value * math.exp(sd * rng.standard_normal())) for name, value in pairs]
    return dict(found) if isinstance(terms, dict) else tuple(found)


def _mmg_ship(ship: mmg.MmgShip, rng: np.random.Generator) -> mmg.MmgShip:
    """The ship with hull, rudder, wake and added masses changed by chance, the sides each by its own factor."""

    def factor(sd: float) -> float:
        return math.exp(sd * rng.standard_normal())

    hull = replace(ship.hull, **{row: _changed(getattr(ship.hull, row), _SCATTER["hull"], rng) for row in "XYN"})
    names = ("f_alpha", "epsilon", "gamma_port", "gamma_starboard", "l_R", "t_R", "a_H", "x_H")
    rudder = replace(ship.rudder, **{name: getattr(ship.rudder, name) * factor(_SCATTER["rudder"]) for name in names})
    sides = {name: getattr(ship.wake, name) * factor(_SCATTER["sides"]) for name in ("port", "starboard")}
    masses = {name: getattr(ship, name) * factor(0.1) for name in ("m_y", "J_zz")}
    return replace(ship, hull=hull, rudder=rudder, wake=replace(ship.wake, **sides), **masses)


def scaled(ship: mmg.MmgShip, scale: float) -> mmg.MmgShip:
    """The ship at another scale and the same Froude number."""
    p, speed = ship.papers, math.sqrt(scale)
    lengths = {name: scale * getattr(p, name) for name in ("L", "B", "d", "x_G", "rudder_height")}
    areas = {name: scale**2 * getattr(p, name) for name in ("rudder_area", "frontal_area", "lateral_area")}
    propeller = p.propeller | {"D": scale * p.propeller["D"], "n": p.propeller["n"] / speed}
    papers = replace(p, **lengths, **areas, volume=scale**3 * p.volume, speed=speed * p.speed, propeller=propeller)
    return replace(ship, papers=papers, rudder=replace(ship.rudder, area=scale**2 * ship.rudder.area))
