"""Conditions of a sea trial, and their limits by IMO MSC/Circ.1053."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.toml import Entry, toml_table
from pymc_ship.physics.vessel.vessel import Vessel

MIN_DEPTH_RATIO = 4.0  # least water depth over mean draught (2.2.1.2.1 of the circular)
MAX_BEAUFORT, MAX_SEA_STATE = 5, 4  # highest Beaufort number and sea state of a trial
DRAUGHT_TOLERANCE = 0.05  # largest relative deviation of the mean draught from that of full load
MIN_SPEED_RATIO = 0.9  # least approach speed over that at 85 % of the highest engine output
TEXTS = (  # of the form, appendix 6 of the circular
    *("administration", "reference", "date", "place", "ship_type", "rudder_type", "number_of_rudders"),
    *("propeller_type", "number_of_propellers", "engine_type"),
)
NOT_STATED = "not stated"  # text for a missing condition
_BEAUFORT = (0.3, 1.6, 3.4, 5.5, 8.0, 10.8, 13.9, 17.2, 20.8, 24.5, 28.5, 32.7)  # m/s, least of each number from 1
_KEYS = {
    "water": ("depth", "sea_state"),
    "wind": ("speed", "from"),
    "loading": ("fore", "aft", "full_load"),
    "engine": ("speed_at_85_percent",),
    "form": TEXTS,
}


@dataclass(frozen=True)
class Conditions:
    """Conditions of a sea trial; NaN or empty where unknown."""

    water_depth: float = math.nan  # [m]
    sea_state: float = math.nan  # code of the WMO, 0 to 9
    wind: tuple[float, float] | None = None  # speed [m/s] and direction of origin [deg] of the true wind
    fore: float = math.nan  # draught forward [m]
    aft: float = math.nan  # draught aft [m]
    full_load: float = math.nan  # mean draught at full load [m]
    speed_at_85_percent: float = math.nan  # speed at 85 % of the highest engine output [m/s]
    form: dict[str, str] = field(default_factory=dict)  # texts by the keys of TEXTS

    def draught(self, vessel: Vessel) -> float:
        """Mean draught of the trial [m], else that of the vessel, else NaN."""
        mean_draught = 0.5 * (self.fore + self.aft)
        return mean_draught if np.isfinite(mean_draught) else vessel.particulars.d or math.nan


def load_conditions(source: str | Path | Mapping | None) -> Conditions:
    """Conditions of a trial from a TOML file or its table, unknown for None; TrialError if they are unusable."""
    if source is None:
        return Conditions()
    file = toml_table(source, "The conditions", TrialError)
    file.check_keys(tuple(_KEYS))
    tables = {name: file.at(name, {}) for name in _KEYS}
    for name, table in tables.items():
        table.check_keys(_KEYS[name], _KEYS[name] if name == "wind" and name in file else ())
    water, wind, loading = tables["water"], tables["wind"], tables["loading"]
    state = _number(water, "sea_state")
    if state not in (*range(10),) and np.isfinite(state):
        water.at("sea_state").fail(f"must be a whole number from 0 to 9, found {state:g}; correct it.")
    return Conditions(
        water_depth=_size(water, "depth"),
        sea_state=state,
        wind=(_number(wind, "speed"), wind.at("from").number()) if "wind" in file else None,
        fore=_size(loading, "fore"),
        aft=_size(loading, "aft"),
        full_load=_size(loading, "full_load"),
        speed_at_85_percent=_size(tables["engine"], "speed_at_85_percent"),
        form={key: tables["form"].at(key).text() for key in tables["form"]},
    )


def _number(table: Entry, key: str) -> float:
    """Number from 0 up; NaN where the key is missing."""
    return table.at(key).number(least=0.0) if key in table else math.nan


def _size(table: Entry, key: str) -> float:
    """Positive number; NaN where the key is missing."""
    value = _number(table, key)
    if value == 0.0:
        table.at(key).fail("must be positive, found 0; correct it.")
    return value


def beaufort(speed: float) -> int:
    """Beaufort number of a wind speed [m/s] at a height of 10 m."""
    return int(np.searchsorted(_BEAUFORT, speed, side="right"))


def condition_rows(conditions: Conditions, vessel: Vessel, *, wind: float, speeds: Mapping[str, float]) -> list[dict]:
    """Rows ``condition``, ``found``, ``limit`` by the circular and ``conformity`` (met, not met or not stated).

    ``vessel`` is at the draught of the trial; ``wind`` is the largest mean wind speed of a run [m/s] or NaN; ``speeds``
    are the approach speeds of the runs [m/s].
    """
    draught = conditions.draught(vessel)
    depth, depth_limit = conditions.water_depth / draught, f"above {MIN_DEPTH_RATIO:g}"
    slowest, speed_limit = min(speeds.values(), default=math.nan), f"from {100.0 * MIN_SPEED_RATIO:g} %"
    sea = conditions.sea_state
    wind_text = f"Beaufort {beaufort(wind)} ({wind:.1f} m/s)" if np.isfinite(wind) else ""
    number = beaufort(wind) if np.isfinite(wind) else math.nan
    draught_text = f"{draught:.4g} m, {conditions.full_load:.4g} m at full load"
    draught_limit = f"within {100.0 * DRAUGHT_TOLERANCE:g} % of full load"
    off_draught = abs(draught / conditions.full_load - 1.0)
    ratio = slowest / conditions.speed_at_85_percent
    speed_text = f"{slowest:.2f} m/s, {100.0 * ratio:.0f} % of that at 85 % output"
    return [
        _row("water depth over mean draught", f"{depth:.1f}", depth_limit, depth, depth > MIN_DEPTH_RATIO),
        _row("wind", wind_text, f"up to Beaufort {MAX_BEAUFORT}", number, number <= MAX_BEAUFORT),
        _row("sea state", f"{sea:g}", f"up to {MAX_SEA_STATE}", sea, sea <= MAX_SEA_STATE),
        _row("mean draught", draught_text, draught_limit, off_draught, off_draught <= DRAUGHT_TOLERANCE),
        _row("slowest approach speed", speed_text, speed_limit, ratio, ratio >= MIN_SPEED_RATIO),
    ]


def _row(condition: str, text: str, limit: str, value: float, met: bool) -> dict:
    conformity = "met" if met else "not met"
    if not np.isfinite(value):
        text = conformity = NOT_STATED
    return {"condition": condition, "found": text, "limit": limit, "conformity": conformity}
