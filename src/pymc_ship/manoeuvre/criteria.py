"""The verdict of a forecast: with what probability the ship passes each criterion of IMO MSC.137(76)."""

from __future__ import annotations

import numpy as np
import xarray as xr

from pymc_ship.manoeuvre.indices import imo_limits
from pymc_ship.vessel.vessel import Vessel

SURE = 0.95
"""Probability from which a forecast says that a ship passes, and below 1 minus which that she fails."""


def imo_probabilities(tree: xr.DataTree, vessel: Vessel) -> list[dict]:
    """Probability that each criterion of IMO MSC.137(76) which applies to a forecast manoeuvre is passed.

    Parameters
    ----------
    tree : DataTree
        From :func:`pymc_ship.forecast`: groups ``trajectories`` (``diverged`` by draw), ``indices`` (dims draw) and
        ``index_bands`` (dims band).
    vessel : Vessel
        Gives L; the speed is the approach speed of the manoeuvre.

    Returns
    -------
    list of dict
        ``criterion``, ``limit``, ``units`` (deg or L), ``median``, ``lower`` and ``upper`` of the forecast's interval,
        ``probability``, ``standard_error`` (binomial: what the finite number of draws leaves open), ``not_reached``
        (share of draws that diverged or did not reach the event), ``judgement`` (passes, open or fails) and
        ``verdict``, one sentence. The probability is the share of all draws that run to the end, reach the event and
        keep the limit: a draw that diverged or does not reach the event counts as not passing. Empty where no
        criterion applies.

    References
    ----------
    IMO (2002), Standards for ship manoeuvrability, resolution MSC.137(76).
    """
    if "indices" not in tree.children:
        return []
    found, bands = tree["indices"].to_dataset(), tree["index_bands"].to_dataset()
    running = ~tree["trajectories"]["diverged"].values
    rows = []
    for name, limit, unit, units in imo_limits(found.attrs, vessel):
        values = found[name].values / unit
        reached = running & np.isfinite(values)
        probability = float(np.mean(reached & (values <= limit)))
        row = {"criterion": name.replace("_", " "), "limit": limit, "units": units}
        row |= {band: float(bands[name].sel(band=band)) / unit for band in ("median", "lower", "upper")}
        row |= {
            "probability": probability,
            "standard_error": float(np.sqrt(probability * (1.0 - probability) / values.size)),
            "not_reached": float(np.mean(~reached)),
            "judgement": "passes" if probability >= SURE else "fails" if probability <= 1.0 - SURE else "open",
        }
        rows.append(row | {"verdict": _sentence(row)})
    return rows


def shown_probability(probability: float) -> str:
    """Probability with two decimals, which 0 and 1 have only where no draw or every draw passes."""
    if 0.0 < probability < 0.005:
        return "below 0.01"
    return "above 0.99" if 0.995 < probability < 1.0 else f"{probability:.2f}"


def _sentence(row: dict) -> str:
    """Verdict in words, with one decimal for angles and two for ship lengths."""
    decimals = 1 if row["units"] == "deg" else 2
    median, lower, upper, limit = (f"{row[key]:.{decimals}f}" for key in ("median", "lower", "upper", "limit"))
    if not np.isfinite(row["median"]):
        return f"{row['criterion']}: no ship of the forecast reaches it, which does not count as passing."
    share = f"{100.0 * row['not_reached']:.2g} %"
    lacking = f" ({share} of the ships diverge or do not reach it, which does not count as passing)"
    return (
        f"{row['criterion']} {median} {row['units']} ({lower} to {upper}): passes the limit of {limit} {row['units']} "
        f"with probability {shown_probability(row['probability'])}{lacking if row['not_reached'] else ''}."
    )
