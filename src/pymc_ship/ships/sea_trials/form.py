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
"""Lines of the manoeuvring data: item, manoeuvre and index."""

ADDITIONAL = (("spiral, width of the loop", SPIRAL, "loop_width"),)
"""Lines of manoeuvres that the circular recommends for unstable ships alone."""

SIDES = ("port", "starboard")
"""Columns of the manoeuvring data."""


def ship_rows(vessel: Vessel, loaded: Vessel | None, conditions: Conditions, wind: float) -> list[dict]:
    """Ship data, at full load where it is known, and trial data.

    Parameters
    ----------
    vessel, loaded : Vessel
        At the trial, and at full load (or None).
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
        "L/V": _text_or_not_stated(s.ship_time, ".1f", " s"),
        "L/B": _text_or_not_stated(s.L / s.B, ".2f"),
        "B/T": _text_or_not_stated(s.B / d, ".2f"),
        "C_B": _text_or_not_stated(s.volume / (s.L * s.B * d), ".3f"),
        "rudder type": form.get("rudder_type", NOT_STATED),
        "total rudder area over L T": _text_or_not_stated(100.0 * area, ".2f", " %"),
        "number of rudders": form.get("number_of_rudders", NOT_STATED),
        "propeller type": form.get("propeller_type", NOT_STATED),
        "number of propellers": form.get("number_of_propellers", NOT_STATED),
        "engine type": form.get("engine_type", NOT_STATED),
        "trim": _text_or_not_stated(trim, ".2f", " m by the stern"),
        "water depth over trial draught": _text_or_not_stated(conditions.water_depth / draught, ".1f"),
        "wind": f"Beaufort {beaufort(wind)}" if np.isfinite(wind) else NOT_STATED,
        "sea state": _text_or_not_stated(conditions.sea_state, ".0f"),
        "loading condition": _loading(draught, conditions.full_load, corrected=loaded is not None),
    }
    return [{"item": item, "value": value} for item, value in values.items()]


def _text_or_not_stated(value: float, form: str, unit: str = "") -> str:
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
    """Manoeuvring data: each line of the form with the least favourable run to either side.

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
    lines = []
    for item, manoeuvre, index in (*LINES, *ADDITIONAL):
        runs = [row for row in rows if row["manoeuvre"].startswith(manoeuvre)]
        if not runs and (item, manoeuvre, index) in ADDITIONAL:
            continue
        cells = {side: _least_favourable([row for row in runs if row["side"] in (side, "")], index) for side in SIDES}
        index_runs = [row for row in runs if row["index"] == index]
        lines.append(
            {
                "item": item,
                **cells,
                "criterion": _criterion(manoeuvre, index_runs),
                "conformity": _least_conformity({row["conformity"] for row in index_runs}),
            }
        )
    return lines


def _least_favourable(rows: Sequence[Mapping], index: str) -> str:
    """Least favourable value of an index over runs to one side."""
    if not rows:
        return "not run"
    index_runs = [row for row in rows if row["index"] == index]
    return _cell(max(index_runs, key=lambda row: row["corrected"])) if index_runs else "not measured"


def _cell(row: Mapping) -> str:
    """Value and expanded uncertainty."""
    decimals = 1 if row["units"] == "deg" else 2
    if not np.isfinite(row["corrected"]):
        return "not reached"
    uncertainty = f" ± {row['U']:.2g}" if np.isfinite(row["U"]) else ""
    single_run = " in one run" if uncertainty and row["runs"] == 1 else ""
    return f"{row['corrected']:.{decimals}f}{uncertainty} {row['units']}{single_run}"


def _criterion(manoeuvre: str, rows: Sequence[Mapping]) -> str:
    if manoeuvre == LABEL:
        return f"{LIMIT:g} to {LARGE:g} L"
    return f"{rows[0]['limit']:.3g} {rows[0]['units']}" if rows else ""


def _least_conformity(conformities: set[str]) -> str:
    """Least favourable conformity; empty for none."""
    order = ("not met", "not met as measured", "open", "met as measured", "met")
    return next((conformity for conformity in order if conformity in conformities), "")
