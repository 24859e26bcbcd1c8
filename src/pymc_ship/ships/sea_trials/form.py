"""The form of IMO MSC/Circ.1053, appendix 6, line by line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.steering.stopping_tests import LABEL, LARGE, LIMIT
from pymc_ship.ships.sea_trials.conditions import DRAUGHT_TOLERANCE, NOT_STATED, Conditions, beaufort
from pymc_ship.ships.sea_trials.measured_spiral import LABEL as SPIRAL

LINES = (
    ("turning circle, advance", "turning circle 35", "advance"),
    ("turning circle, tactical diameter", "turning circle 35", "tactical_diameter"),
    ("zigzag 10/10, first overshoot angle", "zigzag 10/10", "first_overshoot_angle"),
    ("zigzag 10/10, second overshoot angle", "zigzag 10/10", "second_overshoot_angle"),
    ("zigzag 20/20, first overshoot angle", "zigzag 20/20", "first_overshoot_angle"),
    ("initial turning, distance to turn 10 deg with 10 deg rudder", "zigzag 10/10", "initial_turning_distance"),
    ("stopping, track reach", LABEL, "track_reach"),
)
"""Lines of the manoeuvring data: the item, the manoeuvre and the index it is of."""

ADDITIONAL = (("spiral, width of the loop", SPIRAL, "loop_width"),)
"""Lines that stand only where the manoeuvre was sailed: the circular recommends it for a ship that is unstable."""

SIDES = ("port", "starboard")
"""Columns of the manoeuvring data."""


def ship_rows(vessel: Vessel, loaded: Vessel | None, conditions: Conditions, wind: float) -> list[dict]:
    """Ship data, at full load where that is known, and trial data.

    Parameters
    ----------
    vessel, loaded : Vessel
        As she was tried, and at full load, None where that is not another file.
    conditions : Conditions
    wind : float
        Largest mean wind speed of a run [m/s], NaN where none is known.

    Returns
    -------
    list of dict
        ``item`` and ``value``.
    """
    form, full = conditions.form, loaded or vessel
    s, d = full.particulars, full.particulars.d or np.nan
    area = full.rudder.area / (s.L * d) if full.rudder else np.nan
    trim = conditions.aft - conditions.fore
    draught = conditions.draught(vessel)
    values = {
        "administration": form.get("administration", NOT_STATED),
        "reference": form.get("reference", NOT_STATED),
        "date": form.get("date", NOT_STATED),
        "place": form.get("place", NOT_STATED),
        "ship type": form.get("ship_type", NOT_STATED),
        "L/V": _stated(s.ship_time, ".1f", " s"),
        "L/B": _stated(s.L / s.B, ".2f"),
        "B/T": _stated(s.B / d, ".2f"),
        "C_B": _stated(s.volume / (s.L * s.B * d), ".3f"),
        "rudder type": form.get("rudder_type", NOT_STATED),
        "total rudder area over L T": _stated(100.0 * area, ".2f", " %"),
        "number of rudders": form.get("number_of_rudders", NOT_STATED),
        "propeller type": form.get("propeller_type", NOT_STATED),
        "number of propellers": form.get("number_of_propellers", NOT_STATED),
        "engine type": form.get("engine_type", NOT_STATED),
        "trim": _stated(trim, ".2f", " m by the stern"),
        "water depth over trial draught": _stated(conditions.water_depth / draught, ".1f"),
        "wind": f"Beaufort {beaufort(wind)}" if np.isfinite(wind) else NOT_STATED,
        "sea state": _stated(conditions.sea_state, ".0f"),
        "loading condition": _loading(draught, conditions.full_load, corrected=loaded is not None),
    }
    return [{"item": item, "value": value} for item, value in values.items()]


def _stated(value: float, form: str, unit: str = "") -> str:
    return f"{value:{form}}{unit}" if np.isfinite(value) else NOT_STATED


def _loading(draught: float, full: float, *, corrected: bool) -> str:
    if corrected:
        return "tested at partial load and corrected"
    if not np.isfinite(draught / full):
        return NOT_STATED
    return (
        "tested at full load"
        if abs(draught / full - 1.0) <= DRAUGHT_TOLERANCE
        else "tested at partial load, not corrected"
    )


def form_rows(rows: Sequence[Mapping]) -> list[dict]:
    """Manoeuvring data: each line of the form with the run that is least favourable to either side.

    Parameters
    ----------
    rows : sequence of mapping
        Indices of the runs: ``manoeuvre``, ``side``, ``index``, ``corrected``, ``U``, ``runs``, ``units``, ``limit``,
        ``conformity``.

    Returns
    -------
    list of dict
        ``item``, ``port``, ``starboard``, ``criterion`` and ``conformity``, that of the less favourable side.
    """
    found = []
    for item, manoeuvre, index in (*LINES, *ADDITIONAL):
        sailed = [row for row in rows if row["manoeuvre"].startswith(manoeuvre)]
        if not sailed and (item, manoeuvre, index) in ADDITIONAL:
            continue
        shown = {side: _shown([row for row in sailed if row["side"] in (side, "")], index) for side in SIDES}
        mine = [row for row in sailed if row["index"] == index]
        found.append(
            {
                "item": item,
                **shown,
                "criterion": _criterion(manoeuvre, mine),
                "conformity": _least({row["conformity"] for row in mine}),
            }
        )
    return found


def _shown(rows: Sequence[Mapping], index: str) -> str:
    """Least favourable value of an index over the runs of a manoeuvre to one side."""
    if not rows:
        return "not sailed"
    mine = [row for row in rows if row["index"] == index]
    return _cell(max(mine, key=lambda row: row["corrected"])) if mine else "not measured"


def _cell(row: Mapping) -> str:
    """Value and its expanded uncertainty, where that is known."""
    decimals = 1 if row["units"] == "deg" else 2
    if not np.isfinite(row["corrected"]):
        return "not reached"
    known = f" ± {row['U']:.2g}" if np.isfinite(row["U"]) else ""
    alone = " in one run" if known and row["runs"] == 1 else ""
    return f"{row['corrected']:.{decimals}f}{known} {row['units']}{alone}"


def _criterion(manoeuvre: str, rows: Sequence[Mapping]) -> str:
    if manoeuvre == LABEL:
        return f"{LIMIT:g} to {LARGE:g} L"
    return f"{rows[0]['limit']:.3g} {rows[0]['units']}" if rows else ""


def _least(judgements: set[str]) -> str:
    """Least favourable of some judgements; empty where there is none."""
    order = ("not met", "not met as measured", "open", "met as measured", "met")
    return next((one for one in order if one in judgements), "")
