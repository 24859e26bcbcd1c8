"""Page of forecasts: IMO criteria, and every manoeuvre in numbers and figures."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import check_callables, check_kind, short_repr
from pymc_ship.machine.errors import ShipError
from pymc_ship.machine.files import writable_folder
from pymc_ship.pages.page import Content, Page, write_page
from pymc_ship.pages.tables import Table, fixed_point, heads, number, percent, rounded_percent, table
from pymc_ship.physics.manoeuvre.criteria import CONFORMANCE_PROBABILITY, imo_probabilities, probability_text
from pymc_ship.physics.manoeuvre.indices import needs_roll
from pymc_ship.physics.manoeuvre.registry import kind_named
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.steering.measured import measured_indices, wind_off_bow
from pymc_ship.ships.ensemble.index_error import EXTRAPOLATION_SD, error_rows
from pymc_ship.ships.ensemble.scores import BANDS
from pymc_ship.ships.ensemble.ship import Ship, ShipLike, as_ship
from pymc_ship.ships.forecasting.extrapolation import percentage_outside
from pymc_ship.ships.forecasting.figures import manoeuvre_figures, overview
from pymc_ship.ships.forecasting.force_curves import force_curves
from pymc_ship.ships.forecasting.forecast import NO_ROLL, has_roll
from pymc_ship.ships.forecasting.steady_turns import spiral_curve, spiral_sentence
from pymc_ship.ships.forecasting.stopping import COLUMNS as STOPPING_COLUMNS
from pymc_ship.ships.forecasting.stopping import stopping_rows, stopping_sentence, stopping_tracks
from pymc_ship.trial.quality_flags import ground_remarks, quality_remarks
from pymc_ship.trial.record import named_trials

PAGE = Page(  # its folder may hold the page of the ship, too
    "forecast.html",
    Path(__file__).with_name("page.html.j2"),
    own=("figures/forecast_*.png", "tables/forecast_*.csv"),
    packages=("pymc-ship", "numpy", "xarray", "numba", "matplotlib"),
    digits=6,
)

SOURCES = ("IMO (2002), Standards for ship manoeuvrability, resolution MSC.137(76)",)

_CAPTIONS = {
    "track": "Track seen from above, in ship lengths; outlines are to scale.",
    "heading_and_rudder": "Heading and rudder; a positive rudder angle turns to port.",
    "motion": "Velocities, rates and angles.",
}
PRIORS = {  # of the coefficients, by Ship.prior
    "hull_database": "the hull by captive tests of other ships (Yoshimura & Masumoto 2012), all else wide about 0",
    "order_damped": "wide about 0",
    "sister_ship": "about the values of the vessel file, with 30 % of them as sd",
}
_SWINGS = " Bands are quantiles at each instant; the marks are the overshoots."
_DEFINITIONS = (
    " Advance, transfer: at a change of heading of 90 deg; tactical diameter: at 180 deg (ITTC 7.5-04-02-01)."
)
_DECIMALS = {"deg": 2, "L": 2, "s": 1, "m/s": 2, "deg/s": 3}  # decimals of an index by its unit


def write_forecast_page(
    ship: ShipLike,
    forecasts: Mapping[str, xr.DataTree],
    out: str | Path,
    *,
    vessel: VesselLike | None = None,
    measured: Mapping[str, xr.Dataset] | None = None,
    turns: xr.Dataset | None = None,
    stop: xr.Dataset | None = None,
    command: str = "",
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write the page of forecasts.

    Parameters
    ----------
    ship : Ship, Vessel, str or Path
    forecasts : mapping of str to DataTree
        From :func:`pymc_ship.forecast`, by the name of their section, such as ``"zigzag 10/10 port"``.
    out : str or Path
        Folder of the page, created where it is missing; other files in it stay.
    vessel : Vessel, str or Path, optional
        By default that of the ship.
    measured : mapping of str to Dataset, optional
        Measured trials by the name of their forecast.
    turns, stop : Dataset, optional
        From :func:`pymc_ship.steady_turns` and :func:`pymc_ship.stopping`.
    command : str, optional
        Command that repeats the page.
    progress : callable, optional
        Called with a short text before each step.

    Returns
    -------
    Path
        ``out/forecast.html``, written after ``figures/forecast_*.png`` and ``tables/forecast_*.csv``.

    Raises
    ------
    ValueError
        Without a forecast, or for a trial that belongs to none.
    OutputError
        When the folder cannot be written.
    """
    check_callables(progress=progress)
    ship = as_ship(ship)
    vessel = ship.vessel if vessel is None else as_vessel(vessel)
    measured = {} if measured is None else measured
    check_kind("measured", measured, Mapping, "give a dict of trials by the name of their forecast")
    check_kind("forecasts", forecasts, Mapping, "give a dict of forecasts by name")
    for argument, given in (("turns", turns), ("stop", stop)):
        if given is not None:
            check_kind(argument, given, xr.Dataset, "make it by ps.steady_turns or ps.stopping")
    if not forecasts and turns is None and stop is None:
        raise ShipError("A page of forecasts needs at least one forecast, found none; forecast a manoeuvre.")
    if unknown := [name for name in measured if name not in forecasts]:
        raise ShipError(
            f"A measured trial belongs to one of the forecasts {', '.join(forecasts)}; found {unknown[0]!r}; rename it."
        )
    _check_forecasts(forecasts)
    measured, out = named_trials(measured), writable_folder(out)
    verdicts = [row for name, tree in forecasts.items() for row in verdict_rows(name, tree, vessel, measured.get(name))]
    rows, sections = {"forecast_verdict": verdicts} if verdicts else {}, []
    drawn = {"forecast_overview": overview(forecasts, vessel, measured)} if forecasts else {}
    compared: dict[str, list[dict] | None] = {}
    for slug, (name, tree) in zip(_slugs(forecasts), forecasts.items(), strict=True):
        progress(f"drawing {name}")
        trial = measured.get(name)
        drawn |= {f"{slug}_{kind}": figure for kind, figure in manoeuvre_figures(tree, vessel, trial).items()}
        lines = index_rows(tree, vessel, trial)
        rows |= ({slug: lines} if lines else {}) | {f"{slug}_bands": band_rows(tree)}
        of_section = [row["verdict"] for row in verdicts if row["manoeuvre"] == name]
        sections.append(_section(slug, name, tree, lines, of_section))
        compared[name] = lines if trial is not None else None
    progress("drawing the force curves")
    drawn["forecast_forces"] = force_curves(ship.models, ship.motion)
    if turns is not None:
        drawn["forecast_spiral"] = spiral_curve(turns)
    if stop is not None:
        drawn["forecast_stopping"] = stopping_tracks(stop)
        rows["forecast_stopping"] = stopping_rows(stop)
    no_roll = [] if all(map(has_roll, forecasts.values())) else [NO_ROLL]
    progress("writing the page")
    circles = {kind_named(tree.attrs["manoeuvre"]).circles for tree in forecasts.values()}
    values = _head(ship, forecasts, vessel) | {
        "overview": " and ".join(["turning circles"] * (True in circles) + ["headings"] * (False in circles)),
        "evidence": measured_sentences(forecasts, compared) if forecasts else [],
        "verdicts": verdict_table(verdicts) if verdicts else None,
        "assessed": any(np.isfinite(row["extrapolated"]) for row in verdicts),
        "monte_carlo": f"{max((row['standard_error'] for row in verdicts), default=0.0):.1g}",
        "sections": sections,
        "spiral": spiral_sentence(turns) if turns is not None else "",
        "stopping": stopping_sentence(stop) if stop is not None else "",
        "stopping_table": table(rows["forecast_stopping"], STOPPING_COLUMNS) if stop is not None else None,
        "remarks": [*measured_doubts(measured, forecasts), *ship.remarks, *interval_remarks(ship, forecasts), *no_roll],
        "command": command,
    }
    return write_page(PAGE, out, Content(values, drawn, rows, sources=(*vessel.sources, *SOURCES)))


def _check_forecasts(forecasts: Mapping) -> None:
    for name, tree in forecasts.items():
        if not isinstance(tree, xr.DataTree) or "bands" not in tree.children:
            raise ShipError(
                f"forecasts must be a dict of forecasts by name, found {short_repr(type(tree))} at {name!r}; make them "
                "by ps.forecast."
            )


def _head(ship: Ship, forecasts: Mapping[str, xr.DataTree], vessel: Vessel) -> dict:
    draws = _draws(ship, forecasts)
    return {
        "method": _method(ship, draws, _term_sets(ship, forecasts)),
        "single": draws == 1,
        "title": f"{vessel.name}: forecast of its manoeuvres",
        "vessel_title": vessel.title or vessel.name,
        "particulars": vessel.particulars,
        "bands": " and ".join(dict.fromkeys(percent(tree.attrs["ci_prob"]) for tree in forecasts.values())),
        "sure": f"{CONFORMANCE_PROBABILITY:g}",
        "unsure": f"{1.0 - CONFORMANCE_PROBABILITY:.2g}",
    }


def _draws(ship: Ship, forecasts: Mapping[str, xr.DataTree]) -> int:
    return max((tree.attrs["draws"] for tree in forecasts.values()), default=ship.draws)


def _term_sets(ship: Ship, forecasts: Mapping[str, xr.DataTree]) -> str:
    count = max((tree.attrs["term_sets"] for tree in forecasts.values()), default=len(ship.models))
    return f"{count} term sets, weighted by held-out runs" if count > 1 else "1 term set"


def _method(ship: Ship, draws: int, sets: str) -> str:
    """Sentence: number of draws, term sets and prior of a forecast."""
    if ship.index_error is None:
        return f"Each forecast simulates {draws} draws of {sets}, without model error."
    prior = f" and the prior: {PRIORS[ship.prior]}" if ship.prior in PRIORS else ""
    return f"Each forecast simulates {draws} draws of {sets}. The draws are from the posterior of the runs{prior}."


def measured_sentences(
    forecasts: Mapping[str, xr.DataTree], compared: Mapping[str, Sequence[Mapping] | None]
) -> list[str]:
    """Sentences: measured indices outside their intervals first, then forecasts without a measurement.

    ``compared`` has the rows of :func:`index_rows` of each forecast with a measured trial, and None for the others.
    """
    sentences = []
    for name, rows in compared.items():
        known = [row for row in rows or () if row["covered"]]
        missed = [row for row in known if row["covered"] == "no"]
        if rows is None:
            continue
        if not known:
            sentences.append(f"{_capital(name)}: measured, but no index of the record and of the forecast is known.")
            continue
        interval = f"intervals of {percent(forecasts[name].attrs['ci_prob'])}"
        if not missed:
            sentences.append(f"{_capital(name)}: all {len(known)} measured indices lie inside the {interval}.")
            continue
        listed = "; ".join(_missed(row) for row in missed)
        sentences.insert(
            0,
            f"{_capital(name)}: {len(missed)} of {len(known)} measured indices lie outside the {interval}: {listed}. "
            "The intervals and probabilities of this manoeuvre are too certain.",
        )
    unmeasured = [f"{name} ({_outside(forecasts[name])})" for name, rows in compared.items() if rows is None]
    return [*sentences, *([f"Without a measurement: {'; '.join(unmeasured)}."] if unmeasured else [])]


def _missed(row: Mapping) -> str:
    n = fixed_point(_DECIMALS[row["units"]])
    return f"{row['index']} {n(row['measured'])} {row['units']} against {_interval(row, n)}"


def measured_doubts(measured: Mapping[str, xr.Dataset], forecasts: Mapping[str, xr.DataTree]) -> list[str]:
    """Sentences: doubtful checks of the measured trials by the name of their forecast, and what it does not have."""
    remarks = quality_remarks({f"{name}, measured": trial for name, trial in measured.items()})
    still = {name: trial for name, trial in measured.items() if "current_speed" not in forecasts[name].attrs}
    for name, trial in measured.items():
        wind = wind_off_bow(trial)
        if wind is not None and "wind_speed" not in forecasts[name].attrs:
            speed, bow = f"{wind[0]:.3g}", round(wind[1]) % 360
            remarks += [
                f"{name}, measured: its mean wind, {speed} m/s from {bow} deg off the bow of the approach, "
                f"is not in the forecast. Forecast with wind {speed}/{bow}, if the ship has wind forces."
            ]
    return remarks + ground_remarks(still)


def _outside(tree: xr.DataTree) -> str:
    """Text: percentage of the instants outside the motion of the runs."""
    fraction = tree.attrs["extrapolated_fraction"]
    return f"{percentage_outside(fraction)} extrapolated" if np.isfinite(fraction) else "extrapolation not assessed"


def interval_remarks(ship: Ship, forecasts: Mapping[str, xr.DataTree]) -> list[str]:
    """Remarks: which uncertainties the intervals include."""
    if _draws(ship, forecasts) == 1:
        return ["The forecasts are of one ship: no interval includes an uncertainty."]
    if ship.index_error is None:
        return [
            "Each forecast simulates every draw of the coefficients; the intervals are quantiles of the draws. They "
            "include the uncertainty of the coefficients, not that of the model's form."
        ]
    remarks = [
        f"The draws are of {_term_sets(ship, forecasts)}: bands, tracks and force curves include the scatter of the "
        f"coefficients{' and between sets' * (len(ship.models) > 1)}.",
        *(f"{label}: {tree.attrs['steering']}" for label, tree in forecasts.items()),
        *filter(None, map(refused_sentence, forecasts.values())),
        *dict.fromkeys(tree.attrs["reliability"] for tree in forecasts.values() if "reliability" in tree.attrs),
    ]
    if not forecasts:
        return [*remarks, "The intervals do not include a model error."]
    widened = ", ".join(
        "{kind} {median:.2g} of {unit} (95 % below {upper:.2g})".format(**row)
        for row in error_rows(ship.index_error, ship.vessel)
    )
    if widened:
        remarks.append(
            "Intervals of the indices also include the model error, as of ships of other simulators and of held-out "
            f"manoeuvres, if there are any. Its sd by kind of index is: {widened}."
        )
    median, upper = np.quantile(EXTRAPOLATION_SD * ship.extrapolation_growth, (0.5, 0.95))
    harder = ship.harder_indices.sizes["run"]
    evidence, farther = "alone", ""
    if harder:
        evidence = f"and {harder} harder run{'s' * (harder != 1)} forecast by the milder ones"
        farther = f" Past {float(ship.harder_indices['beyond'].max()):.2g} ranges, no run measured it: there the error "
        farther += "of other ships is added."
    return [
        *remarks,
        "They also include the extrapolation error. For each range of the runs by which the median ship leaves their "
        f"motion, its sd is {median:.2g} of the peak heading, of L/U and of L (95 % below {upper:.2g}). This comes "
        f"from ships of other simulators {evidence}.{farther}",
    ]


def refused_sentence(tree: xr.DataTree) -> str:
    """Sentence on the draws that diverge in a manoeuvre; empty where none does."""
    fraction = tree.attrs["infeasible_fraction"]
    label = tree.attrs["label"]
    return f"{rounded_percent(fraction)} of the draws diverge in the {label} and are left out." if fraction else ""


def unreached_sentence(tree: xr.DataTree) -> str:
    """Sentence on the indices that some or all of the draws do not reach; empty where all draws reach all."""
    if "indices" not in tree.children:
        return ""
    draws, kinds = tree["indices"].dataset, kind_named(tree["indices"].attrs["manoeuvre"]).indices
    fractions = {name: float(np.isfinite(draws[name]).mean()) for name in draws if not needs_roll(kinds[str(name)])}
    words = {name: str(name).replace("_", " ") for name in fractions}
    none = [words[name] for name, fraction in fractions.items() if fraction == 0.0]
    some = [f"{words[name]} ({100.0 * f:.3g} % of the draws)" for name, f in fractions.items() if 0.0 < f < 1.0]
    within = f"Within {tree['trajectories'].to_dataset()['time'].values[-1]:.4g} s"
    sentences = (
        [f"{within} not all draws reach: {', '.join(some)}; the intervals are of those that do."] if some else []
    )
    return " ".join([*sentences, *([f"{within} no draw reaches: {', '.join(none)}."] if none else [])])


def verdict_rows(name: str, tree: xr.DataTree, vessel: Vessel, measured: xr.Dataset | None = None) -> list[dict]:
    """Rows of :func:`pymc_ship.imo_probabilities` with manoeuvre, measured value [deg, L] and extrapolated fraction.

    The sentence ``verdict`` includes a measured value outside the interval.
    """
    measured_values = {} if measured is None else measured_indices(measured, tree.attrs)
    rows = []
    for row in imo_probabilities(tree, vessel):
        unit = vessel.particulars.L if row["units"] == "L" else 1.0
        value = measured_values.get(row["criterion"].replace(" ", "_"), np.nan) / unit
        row |= {"measured": value, "missed": bool(value < row["lower"] or value > row["upper"])}
        if row["missed"]:
            n = fixed_point(_DECIMALS[row["units"]])
            row["verdict"] += (
                f" Measured {n(value)} {row['units']}, outside the interval: the probability is too certain."
            )
        rows.append({"manoeuvre": name, **row, "extrapolated": tree.attrs["extrapolated_fraction"]})
    return rows


def index_rows(tree: xr.DataTree, vessel: Vessel, measured: xr.Dataset | None = None) -> list[dict]:
    """Indices of a forecast and of the measured trial; distances in ship lengths.

    Rows: ``index``, ``units``, ``median``, ``lower``, ``upper``, ``reached`` (fraction of the draws) and, with a trial,
    ``measured``, ``error`` of the median, ``error_units`` (deg for angles, else %) and ``covered`` (yes, no or empty).
    """
    if "index_bands" not in tree.children:
        return []
    bands, draws = tree["index_bands"].to_dataset(), tree["indices"].to_dataset()
    measured_values = {} if measured is None else measured_indices(measured, tree.attrs)
    rows = []
    for name in map(str, bands.data_vars):
        units = bands[name].attrs["units"]
        unit, units = (vessel.particulars.L, "L") if units == "m" else (1.0, units)
        row = {"index": name.replace("_", " "), "units": units}
        row |= {band: float(bands[name].sel(band=band)) / unit for band in ("median", "lower", "upper")}
        row["reached"] = float(np.isfinite(draws[name].values).mean())
        row |= {} if measured is None else _measured_columns(row, measured_values.get(name, np.nan) / unit)
        rows.append(row)
    return rows


def band_rows(tree: xr.DataTree) -> list[dict]:
    """Bands of a forecast over time: ``time`` and ``<channel>_<band>``, SI and rad."""
    bands = tree["bands"].to_dataset()
    columns = {"time": bands["time"].values.tolist()}
    for channel, values in bands.data_vars.items():
        columns |= {f"{channel}_{band}": values.sel(band=band).values.tolist() for band in BANDS}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _measured_columns(row: Mapping, value: float) -> dict:
    error, units = row["median"] - value, "deg"
    if row["units"] != "deg":
        error, units = 100.0 * (row["median"] / value - 1.0) if value else np.nan, "%"
    known = np.isfinite(value) and np.isfinite(row["median"])
    covered = ("no", "yes")[row["lower"] <= value <= row["upper"]] if known else ""
    return {"measured": value, "error": float(error), "error_units": units, "covered": covered}


def _slugs(names: Iterable[str]) -> list[str]:
    """File names such as ``forecast_zigzag_10_10_port``, with a number where two would be the same."""
    slugs: list[str] = []
    for name in names:
        slug = "forecast_" + (re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") or "manoeuvre")
        taken = {"forecast_verdict", "forecast_forces", *slugs}
        slugs.append(next(s for s in (slug, *(f"{slug}_{k}" for k in range(2, len(taken) + 3))) if s not in taken))
    return slugs


def _section(slug: str, name: str, tree: xr.DataTree, rows: list[dict], verdicts: list[str]) -> dict:
    kind = kind_named(tree.attrs["manoeuvre"])
    return {
        "id": slug,
        "name": _capital(name),
        "definitions": _DEFINITIONS if kind.circles else "",
        "draws": f"{tree.attrs['draws']} draws, {100.0 * tree.attrs['diverged_fraction']:.3g} % diverged",
        "speed": f"{tree.attrs['approach_speed']:.4g}",
        "extrapolation": tree.attrs["extrapolation"],
        "verdicts": [_capital(sentence) for sentence in verdicts],
        "table": index_table(rows, tree.attrs["ci_prob"]) if rows else None,
        "captions": {
            f"{slug}_{name}": caption + (_SWINGS if name == "heading_and_rudder" and kind.swings else "")
            for name, caption in _CAPTIONS.items()
        },
    }


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def index_table(rows: Sequence[Mapping], ci_prob: float) -> Table:
    """Table of :func:`index_rows`."""
    lines = []
    for row in rows:
        n = fixed_point(_DECIMALS[row["units"]])
        texts = {key: n(row[key]) for key in ("median", "measured") if key in row}
        lines.append(dict(row) | texts | {"interval": _interval(row, n), "reached": 100.0 * row["reached"]})
    columns = heads(str, index="index", units="") | heads(number(), median="median")
    columns |= heads(str, interval=f"interval of {percent(ci_prob)}")
    if "measured" in rows[0]:
        for line in lines:
            error = fixed_point(2 if line["error_units"] == "deg" else 1)(line["error"])
            line["error"] = error if error == "–" else f"{'' if error[0] == '−' else '+'}{error} {line['error_units']}"
        columns |= heads(number(), measured="measured") | heads(str, error="error of the median", covered="covered")
    if any(row["reached"] < 1.0 for row in rows):
        columns |= heads(number(3), reached="reached by % of the draws")
    return table(lines, columns)


def _interval(row: Mapping, formatter: Callable[[object], str]) -> str:
    return f"{formatter(row['lower'])} to {formatter(row['upper'])}" if np.isfinite(row["median"]) else "–"


def verdict_table(rows: Sequence[Mapping]) -> Table:
    """Table of :func:`verdict_rows`."""
    lines = []
    for row in rows:
        n = fixed_point(1 if row["units"] == "deg" else 2)
        texts = {key: f"{n(row[key])} {row['units']}" for key in ("limit", "measured") if np.isfinite(row[key])}
        texts = {"measured": "–"} | texts
        median = f"{n(row['median'])} ({_interval(row, n)})" if np.isfinite(row["median"]) else "–"
        texts |= {"forecast": median, "probability": probability_text(row["probability"])}
        texts["extrapolated"] = percentage_outside(row["extrapolated"]) if np.isfinite(row["extrapolated"]) else "–"
        texts["manoeuvre"] = ", ".join(filter(None, [row["manoeuvre"], row["surroundings"]]))
        if row["missed"]:
            texts["measured"] += ", outside"
            texts["conformity"] = f"{row['conformity']}, interval missed"
        lines.append(dict(row) | texts)
    columns = heads(str, manoeuvre="manoeuvre", criterion="criterion", limit="limit", forecast="forecast (interval)")
    if any(np.isfinite(row["measured"]) for row in rows):
        columns |= heads(str, measured="measured")
    columns |= heads(str, probability="probability of passing", conformity="verdict", extrapolated="extrapolated")
    return table(lines, columns)
