"""Criteria of IMO MSC.137(76), and the probability that a forecast ship meets each."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import check_kind
from pymc_ship.machine.errors import SimulationError
from pymc_ship.physics.manoeuvre.registry import kind_named
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, check_same_vessel

CONFORMANCE_PROBABILITY = 0.95  # probability from which a forecast states conformity; below 1 minus it, non-conformity
_SHORTER = 0.99  # of the duration of its kind: a forecast of less may end before an event


def imo_probabilities(tree: xr.DataTree, vessel: VesselLike) -> list[dict[str, Any]]:
    """Probability of conformity with each criterion of IMO MSC.137(76).

    Parameters
    ----------
    tree : DataTree
        From :func:`pymc_ship.forecast`; its attr ``calibration_cap``, if any, bounds the probabilities.
    vessel : Vessel, str or Path
        Vessel of the forecast; gives L. The speed is the approach speed of the manoeuvre.

    Returns
    -------
    list of dict
        ``criterion``, ``limit``, ``units`` (deg or L), ``median``, ``lower``, ``upper``, ``probability``,
        ``standard_error`` (binomial), ``not_reached`` (fraction of draws that diverge or do not reach the event, which
        counts as not passing), ``unfinished`` (fraction of draws that a forecast shorter than those of its kind ends
        before the event), ``conformity`` (passes, open or fails), ``surroundings`` (wind, current or
        revolutions that no criterion has, as words) and ``verdict``, one sentence. With unfinished draws
        ``probability`` is the least one; it is bounded as by :func:`fraction_of_draws`, but 0 or 1 for a single draw.

    Raises
    ------
    SimulationError, VesselError
        For anything but a forecast; for another vessel than that of the forecast.
    """
    vessel = as_vessel(vessel)
    check_kind("A forecast", tree, xr.DataTree, "make it by ps.forecast", SimulationError)
    check_same_vessel("The forecast", tree.attrs, vessel)
    if "indices" not in tree.children:
        return []
    index_draws, bands = tree["indices"].to_dataset(), tree["index_bands"].to_dataset()
    running = ~tree["trajectories"].to_dataset()["diverged"].values
    duration = float(tree["trajectories"].to_dataset()["time"].values[-1])
    needed = kind_named(index_draws.attrs["manoeuvre"]).reach * vessel.particulars.ship_time
    cap = tree.attrs.get("calibration_cap", 1.0)
    rows = []
    for name, limit, unit, units in imo_limits(index_draws.attrs, vessel):
        values = index_draws[name].values / unit
        reached = running & np.isfinite(values)
        holds = reached & (values <= limit)
        probability = float(np.clip(fraction_of_draws(holds), 1.0 - cap, cap) if values.size > 1 else holds[0])
        unfinished = float(np.mean(running & ~reached)) if duration < _SHORTER * needed else 0.0
        passes, fails = (
            probability >= CONFORMANCE_PROBABILITY,
            probability + unfinished <= 1.0 - CONFORMANCE_PROBABILITY,
        )
        row = {"criterion": name.replace("_", " "), "limit": limit, "units": units}
        row |= {band: float(bands[name].sel(band=band)) / unit for band in ("median", "lower", "upper")}
        row |= {
            "probability": probability,
            "standard_error": float(np.sqrt(probability * (1.0 - probability) / values.size)),
            "not_reached": float(np.mean(~reached)),
            "unfinished": unfinished,
            "conformity": "passes" if passes else "fails" if fails else "open",
        }
        row["surroundings"] = _surroundings(index_draws.attrs)
        sentence = _sentence(row, duration, needed) if values.size > 1 else _sentence_on_one(row)
        rows.append(row | {"verdict": sentence})
    return rows


def _sentence_on_one(row: dict[str, Any]) -> str:
    """Verdict in words on a forecast of one draw, which is a ship without uncertainty."""
    decimals = 1 if row["units"] == "deg" else 2
    value = f"{row['median']:.{decimals}f} {row['units']}" if np.isfinite(row["median"]) else "not reached"
    meets = "meets" if row["probability"] else "does not meet"
    limit = f"{row['limit']:.{decimals}f} {row['units']}"
    return f"{row['criterion']} {value}{_beside(row)}: one ship, without uncertainty, {meets} the limit of {limit}."


def _beside(row: dict[str, Any]) -> str:
    return f" {row['surroundings']}" if row["surroundings"] else ""


def _surroundings(attrs: Mapping[str, Any]) -> str:
    """Words on current, wind and revolutions of a forecast, which no criterion has; empty without them."""
    flows = {what: attrs[f"{what}_speed"] for what in ("wind", "current") if f"{what}_speed" in attrs}
    given = [f"a {what} of {speed:.3g} m/s" for what, speed in flows.items()]
    given += [f"n = {attrs['n']:.3g} 1/s"] if "n" in attrs else []
    return f"with {' and '.join(given)}, not as in the criteria" if given else ""


def fraction_of_draws(holds: np.ndarray) -> float:
    """Fraction of n draws for which a statement holds, from 1/(n+2) to (n+1)/(n+2): Laplace's rule of succession."""
    return float(np.clip(np.mean(holds), 1.0 / (holds.size + 2), (holds.size + 1) / (holds.size + 2)))


def probability_text(probability: float) -> str:
    """Probability with two decimals; "less than 0.01" and "more than 0.99" at the ends, as draws are finite."""
    if probability < 0.005:
        return "less than 0.01"
    return "more than 0.99" if probability > 0.995 else f"{probability:.2f}"


def _sentence(row: dict[str, Any], duration: float, needed: float) -> str:
    """Verdict in words, with one decimal for angles and two for ship lengths; ``duration`` and that ``needed`` [s]."""
    decimals = 1 if row["units"] == "deg" else 2
    median, lower, upper, limit = (f"{row[key]:.{decimals}f}" for key in ("median", "lower", "upper", "limit"))
    within, uncounted = "", "which does not count as passing"
    if row["unfinished"]:
        within, uncounted = f" within {duration:.4g} s", f"forecast for {needed:.4g} s"
    if not np.isfinite(row["median"]):
        return f"{row['criterion']}: no draw of the forecast reaches it{within}, {uncounted}."
    fraction = f"{float(format(100.0 * row['not_reached'], '.2g')):g} %"
    lacking = f" ({fraction} of the draws diverge or do not reach it{within}, {uncounted})"
    return (
        f"{row['criterion']} {median} {row['units']} ({lower} to {upper}){_beside(row)}: passes the limit of {limit} "
        f"{row['units']} with probability {'at least ' if within else ''}{probability_text(row['probability'])}"
        f"{lacking if row['not_reached'] else ''}."
    )


def imo_limits(attrs: Mapping[str, Any], vessel: Vessel) -> list[tuple[str, float, float, str]]:
    """Limits of IMO MSC.137(76) for a manoeuvre with these attrs: index, limit, size and name of its unit."""
    L = vessel.particulars.L
    ratio = L / attrs.get("approach_speed", vessel.particulars.nominal_speed)
    limits = kind_named(attrs["manoeuvre"]).limits(attrs, ratio)
    return [(name, limit, L if units == "L" else 1.0, units) for name, limit, units in limits]


def imo_criteria(measured: xr.Dataset, vessel: VesselLike) -> list[dict[str, Any]]:
    """Compare indices with the limits of IMO MSC.137(76) that apply to the manoeuvre.

    ``measured`` are :func:`indices` of a 10/10 or 20/20 zigzag or of a turning circle at 35 deg or more. Rows have
    ``criterion``, ``value``, ``limit``, ``units`` and ``passed`` (None if the record does not reach the event).
    """
    rows = []
    for name, limit, unit, units in imo_limits(measured.attrs, as_vessel(vessel)):
        value = float(measured[name]) / unit
        row = {"criterion": name.replace("_", " "), "value": value, "limit": limit, "units": units}
        rows.append(row | {"passed": bool(value <= limit) if np.isfinite(value) else None})
    return rows
