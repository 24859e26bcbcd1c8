"""The form of IMO MSC/Circ.1053, appendix 6, line by line."""

from collections.abc import Mapping, Sequence

import numpy as np

from pymc_ship.pages.tables import at_least, fixed_point
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.steering.stopping_tests import LABEL, LARGE, LIMIT
from pymc_ship.ships.sea_trials.conditions import DRAUGHT_TOLERANCE, NOT_STATED, Conditions, beaufort
from pymc_ship.ships.sea_trials.measured_spiral import LABEL as SPIRAL

LINES = (  # of the manoeuvring data: item, manoeuvre and index
    ("turning circle, advance", "turning circle 35", "advance"),
    ("turning circle, tactical diameter", "turning circle 35", "tactical_diameter"),
    ("zigzag 10/10, first overshoot angle", "zigzag 10/10", "first_overshoot_angle"),
    ("zigzag 10/10, second overshoot angle", "zigzag 10/10", "second_overshoot_angle"),
    ("zigzag 20/20, first overshoot angle", "zigzag 20/20", "first_overshoot_angle"),
    ("initial turning, distance to turn 10 deg with 10 deg rudder", "zigzag 10/10", "initial_turning_distance"),
    ("stopping, track reach", LABEL, "track_reach"),
)
ADDITIONAL = (("spiral, width of the loop", SPIRAL, "loop_width"),)  # recommended for unstable ships alone
SIDES = ("port", "starboard")  # columns of the manoeuvring data
_CONFORMITIES = ("not met", "not met as measured", "open", "met as measured", "met")  # least favourable first


def ship_rows(vessel: Vessel, loaded: Vessel | None, conditions: Conditions, wind: float) -> list[dict]:
    """Rows ``item`` and ``value`` of the ship data, at full load where it is known, and of the trial data.

    ``vessel`` is at the draught of the trial; ``wind`` is the largest mean wind speed of a run [m/s] or NaN.
    """
    full = loaded or vessel
    s, d = full.particulars, full.particulars.d or np.nan
    area = full.rudder.area / (s.L * d) if full.rudder else np.nan
    draught = conditions.draught(vessel)

    def texts(*keys: str) -> dict[str, str]:
        return {key.replace("_", " "): conditions.form.get(key, NOT_STATED) for key in keys}

    values = {
        **texts("administration", "reference", "date", "place", "ship_type"),
        "L/V": _text_or_not_stated(s.ship_time, ".1f", " s"),
        "L/B": _text_or_not_stated(s.L / s.B, ".2f"),
        "B/T": _text_or_not_stated(s.B / d, ".2f"),
        "C_B": _text_or_not_stated(s.volume / (s.L * s.B * d), ".3f"),
        **texts("rudder_type"),
        "total rudder area over L T": _text_or_not_stated(100.0 * area, ".2f", " %"),
        **texts("number_of_rudders", "propeller_type", "number_of_propellers", "engine_type"),
        "trim": _text_or_not_stated(conditions.aft - conditions.fore, ".2f", " m by the stern"),
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
    is_full = abs(draught / full - 1.0) <= DRAUGHT_TOLERANCE
    return "tested at full load" if is_full else "tested at partial load, not corrected"


def form_rows(rows: Sequence[Mapping]) -> list[dict]:
    """Manoeuvring data: each line of the form with the least favourable run to either side, and its conformity.

    ``rows`` are those of :func:`.uncertainty_budget`; rows of the form are ``item``, ``port``, ``starboard``,
    ``criterion`` and ``conformity``.
    """
    lines = []
    for item, manoeuvre, index in (*LINES, *ADDITIONAL):
        runs = [row for row in rows if row["manoeuvre"].startswith(manoeuvre)]
        if not runs and (item, manoeuvre, index) in ADDITIONAL:
            continue
        cells = {side: _least_favourable([row for row in runs if row["side"] in (side, "")], index) for side in SIDES}
        index_runs = [row for row in runs if row["index"] == index]
        conformities = {row["conformity"] for row in index_runs}
        conformity = next((conformity for conformity in _CONFORMITIES if conformity in conformities), "")
        criterion = f"{index_runs[0]['limit']:.3g} {index_runs[0]['units']}" if index_runs else ""
        criterion = f"{LIMIT:g} to {LARGE:g} L" if manoeuvre == LABEL else criterion
        lines.append({"item": item, **cells, "criterion": criterion, "conformity": conformity})
    return lines


def _least_favourable(rows: Sequence[Mapping], index: str) -> str:
    if not rows:
        return "not run"
    index_runs = [row for row in rows if row["index"] == index]
    if not index_runs:
        return "not measured"
    row = max(index_runs, key=lambda run: run["corrected"])
    if not np.isfinite(row["corrected"]):
        return "not reached"
    uncertainty = f" ± {at_least(2)(row['U'])}" if np.isfinite(row["U"]) else ""
    single_run = " in one run" if uncertainty and row["runs"] == 1 else ""
    return f"{fixed_point(2)(row['corrected'])}{uncertainty} {row['units']}{single_run}"
