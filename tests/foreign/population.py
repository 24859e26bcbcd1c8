"""Ships nobody has seen: drawn around the foreign ones, sailed, identified and scored: ``make population``.

A ship is one of four by published equations with every force coefficient changed by chance, the two of the MMG method
at another scale, too; the four themselves are not among them. The trials she sails, the weather and what her papers
state are drawn, too. Even numbers are for choosing between ways to an interval, odd ones to show what the choice is
worth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from pymc_ship.machine.seeds import generator
from tests.foreign import mariner, mmg, s175, sailing
from tests.foreign.sailing import CALM, SENSORS, Trial, Weather

HULLS = ("tanker", "bulk carrier", "mariner", "s175")
_SCATTER = {"hull": 0.2, "rudder": 0.12, "roll": 0.1}
_SCALES = (0.6, 1.2)


def _zigzag(angle: float, side: str = "starboard") -> Trial:
    return Trial("zigzag", angle, angle, side)


TRIALS = {
    "one 20/20": (_zigzag(20.0),),
    "10/10 to both sides": (_zigzag(10.0), _zigzag(10.0, "port")),
    "20/20 to both sides": (_zigzag(20.0), _zigzag(20.0, "port")),
    "20/20 and 10/10": (_zigzag(20.0), _zigzag(10.0, "port")),
    "20/20 and a circle": (_zigzag(20.0), Trial("circle", 35.0, side="port")),
    "10/10 and 20/20 to both sides": tuple(_zigzag(angle, side) for angle in (10.0, 20.0) for side in sailing.SIDES),
}
"""Trials by name."""

_TRIED = 40


@dataclass(frozen=True)
class Drawn:
    """A ship of the population and what is known of her."""

    number: int
    hull: str
    ship: object
    trials: str
    weather: Weather
    ground: bool
    propeller: bool
    truth: dict[str, dict[str, float]]

    @property
    def chooses(self) -> bool:
        """Whether she belongs to the half that is used to choose."""
        return self.number % 2 == 0

    def records(self, seed: int) -> list[xr.Dataset]:
        """Records of her runs, each on a course and with noise of its own."""
        unit = self.ship.papers.unit
        return [
            sailing.sail(
                self.ship,
                trial,
                self.weather,
                course_deg=90.0 * k,
                duration=(14.0 if trial.kind == "circle" else 20.0) * unit,
                ground=self.ground,
                sensors=SENSORS,
                seed=1000 * seed + 10 * self.number + k,
            )
            for k, trial in enumerate(TRIALS[self.trials])
        ]


def drawn(number: int, seed: int) -> Drawn:
    """Draw a ship that turns and checks her yaw as ships do, and her trials.

    Raises
    ------
    RuntimeError
        Where none of many draws does.
    """
    rng = generator(seed, "population of ships", number)
    hull = HULLS[(number // 2) % len(HULLS)]
    for _ in range(_TRIED):
        ship = _ship(hull, rng)
        try:
            truth = sailing.truth(ship)
        except (ValueError, OverflowError, ZeroDivisionError):
            continue
        if _usual(truth, ship.papers.L):
            break
    else:
        raise RuntimeError(f"None of {_TRIED} draws of ship {number} sails all judged manoeuvres.")
    trials = list(TRIALS)[int(rng.integers(len(TRIALS)))]
    sky = int(rng.integers(4))
    angle = float(rng.uniform(0.0, 360.0))
    weather = {0: Weather(wind=8.0, wind_from_deg=angle), 1: Weather(current=0.5, current_to_deg=angle)}.get(sky, CALM)
    return Drawn(number, hull, ship, trials, weather, sky == 1, bool(rng.random() < 0.75), truth)


def _usual(truth: dict[str, dict[str, float]], L: float) -> bool:
    diameters = [row["tactical_diameter"] / L for row in truth.values() if "tactical_diameter" in row]
    overshoots = [row["second_overshoot_angle"] for row in truth.values() if "second_overshoot_angle" in row]
    return min(diameters) > 2.0 and max(diameters) < 6.0 and max(overshoots) < 40.0


def _changed(terms, sd: float, rng: np.random.Generator):
    """Coefficients each times a factor of median 1."""
    pairs = terms.items() if isinstance(terms, dict) else terms
    found = [(name, value * math.exp(sd * rng.standard_normal())) for name, value in pairs]
    return dict(found) if isinstance(terms, dict) else tuple(found)


def _ship(hull: str, rng: np.random.Generator):
    if hull == "mariner":
        rows = [_changed(terms, _SCATTER["hull"], rng) for terms in (mariner.SURGE, mariner.SWAY, mariner.YAW)]
        return mariner.Mariner(rows=tuple(rows))
    if hull == "s175":
        sds = [_SCATTER["hull"], _SCATTER["hull"], _SCATTER["roll"], _SCATTER["hull"]]
        rows = [_changed(row, sd, rng) for row, sd in zip(s175.ROWS, sds, strict=True)]
        # the straight course stays in balance
        rows[0]["uu"] = s175.SURGE["uu"]
        return s175.S175(GM=float(rng.uniform(0.3, 1.0)), rows=tuple(rows))
    return _mmg_ship(mmg.kvlcc2() if hull == "tanker" else mmg.cargo(), rng)


def _mmg_ship(ship: mmg.MmgShip, rng: np.random.Generator) -> mmg.MmgShip:
    def factor(sd: float) -> float:
        return math.exp(sd * rng.standard_normal())

    hull = replace(ship.hull, **{row: _changed(getattr(ship.hull, row), _SCATTER["hull"], rng) for row in "XYN"})
    names = ("f_alpha", "epsilon", "gamma_port", "gamma_starboard", "l_R", "t_R", "a_H", "x_H")
    rudder = replace(ship.rudder, **{name: getattr(ship.rudder, name) * factor(_SCATTER["rudder"]) for name in names})
    wake = replace(ship.wake, port=ship.wake.port * factor(0.1), starboard=ship.wake.starboard * factor(0.1))
    ship = replace(ship, hull=hull, rudder=rudder, wake=wake, m_y=ship.m_y * factor(0.1), J_zz=ship.J_zz * factor(0.1))
    return scaled(ship, float(rng.uniform(*_SCALES)))


def scaled(ship: mmg.MmgShip, scale: float) -> mmg.MmgShip:
    """The ship at another scale and the same Froude number."""
    p, speed = ship.papers, math.sqrt(scale)
    lengths = {name: scale * getattr(p, name) for name in ("L", "B", "d", "x_G", "rudder_height")}
    areas = {name: scale**2 * getattr(p, name) for name in ("rudder_area", "frontal_area", "lateral_area")}
    propeller = p.propeller | {"D": scale * p.propeller["D"], "n": p.propeller["n"] / speed}
    papers = replace(p, **lengths, **areas, volume=scale**3 * p.volume, speed=speed * p.speed, propeller=propeller)
    return replace(ship, papers=papers, rudder=replace(ship.rudder, area=scale**2 * ship.rudder.area))
