"""The named cases: what is sailed with which ship, in which weather, and what its papers state."""

from __future__ import annotations

from dataclasses import dataclass

import xarray as xr

from studies.foreign import mmg, sailing
from studies.foreign.mariner import Mariner
from studies.foreign.s175 import S175
from studies.foreign.sailing import CALM, SENSORS, Sensors, Trial, Weather

SHIPS = {
    "kvlcc2": mmg.kvlcc2,
    "kvlcc2 with race": lambda: mmg.with_race(mmg.kvlcc2()),
    "cargo": mmg.cargo,
    "cargo with race": lambda: mmg.with_race(mmg.cargo(), gamma=0.2, wake=0.4),
    "mariner": Mariner,
    "s175": S175,
}
"""Ships by name; the published KVLCC2 has flow straightening and wake by side, the race adds a side force to it."""

FOUR = tuple(Trial("zigzag", angle, angle, side) for angle in (10.0, 20.0) for side in sailing.SIDES)
TWO = (Trial("zigzag", 20.0, 20.0, "starboard"), Trial("zigzag", 10.0, 10.0, "port"))
COURSES = (0.0, 90.0, 180.0, 270.0)
"""Of the approaches of the runs [deg]: known to the weather alone."""
LONG = 20.0
"""Length of a run [L/U]: four reversals of the rudder or more."""


@dataclass(frozen=True)
class Case:
    """Runs of a ship to be identified; the forecasts are judged by the ship in calm water."""

    name: str
    ship: str
    trials: tuple[Trial, ...] = FOUR
    weather: Weather = CALM
    ground: bool = False
    sensors: Sensors | None = SENSORS
    propeller: bool = True

    def records(self, seed: int = 1) -> list[xr.Dataset]:
        """Records of the runs, each with noise of its own."""
        ship = SHIPS[self.ship]()
        runs = zip(self.trials, COURSES, strict=False)
        settings = {"duration": LONG * ship.papers.unit, "ground": self.ground, "sensors": self.sensors}
        return [
            sailing.sail(ship, trial, self.weather, course_deg=course, seed=100 * seed + k, **settings)
            for k, (trial, course) in enumerate(runs)
        ]

    def vessel_file(self) -> str:
        """TOML of the ship's papers."""
        return sailing.vessel_file(SHIPS[self.ship](), propeller=self.propeller)


def named_cases() -> dict[str, Case]:
    """All cases by name."""
    cases = []
    for ship in ("kvlcc2", "cargo", "mariner", "s175"):
        cases += [
            Case(f"{ship}-calm", ship),
            Case(f"{ship}-clean", ship, sensors=None),
            Case(f"{ship}-two", ship, trials=TWO),
            Case(f"{ship}-wind", ship, weather=Weather(wind=10.0, wind_from_deg=60.0)),
            Case(f"{ship}-current", ship, weather=Weather(current=0.5, current_to_deg=120.0), ground=True),
            Case(f"{ship}-no-propeller", ship, propeller=False),
        ]
        cases += [Case(f"{ship}-race", f"{ship} with race")] if f"{ship} with race" in SHIPS else []
    return {case.name: case for case in cases}
