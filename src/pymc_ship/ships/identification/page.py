"""Report of a ship identified from trials: runs, term sets, held-out manoeuvres, coefficients and figures."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymc_ship.inference.captive.comparison import captive_figure, comparison_page_table, comparison_rows
from pymc_ship.inference.trajectory.windows import LENGTH, thin_record
from pymc_ship.machine.arguments import check_callables, check_counts, check_kind
from pymc_ship.machine.errors import ShipError
from pymc_ship.machine.files import writable_folder
from pymc_ship.pages.page import Content, Page, write_page
from pymc_ship.pages.tables import Columns, Table, fixed_point, heads, number, table
from pymc_ship.physics.manoeuvre.kinds import UNITS
from pymc_ship.physics.manoeuvre.steering_record import approach_speed
from pymc_ship.physics.vessel.parts import FIXED_SD
from pymc_ship.physics.vessel.term_sets import PART_SETS, TERM_SETS
from pymc_ship.physics.vessel.vessel import LETTER, Vessel, coefficient_names, most_dofs
from pymc_ship.records.checks.verdicts import Check
from pymc_ship.ships.ensemble.index_error import error_rows
from pymc_ship.ships.forecasting.figures import overview
from pymc_ship.ships.forecasting.force_curves import force_curves
from pymc_ship.ships.forecasting.page import PRIORS, verdict_rows, verdict_table
from pymc_ship.ships.forecasting.steady_turns import spiral_curve, spiral_sentence, steady_turns
from pymc_ship.ships.identification.candidates import Candidate, Refusal
from pymc_ship.ships.identification.figures import (
    diverging_motion,
    held_out_overshoots,
    held_out_windows,
    restarted_motion,
    score_differences,
    term_set_scores,
)
from pymc_ship.ships.identification.held_out_errors import harder_index_rows, index_error_rows
from pymc_ship.ships.identification.model import ShipIdentification
from pymc_ship.ships.identification.opening import (
    DOUBTS,
    fit_sentences,
    held_out_sentences,
    measured_sentences,
    opening_sentences,
)
from pymc_ship.trial.channels import CHANNELS
from pymc_ship.trial.quality_flags import worst_verdict
from pymc_ship.trial.record import named_trials, sampling_interval
from pymc_ship.trial.units import Unit

CORRELATED = 0.95  # correlation of two coefficients that the page lists
DISAGREE = 2.0  # prior sds between estimate and prior that count as a prior-data conflict

SOURCES = (
    "Yao, Vehtari, Simpson & Gelman (2018), Using stacking to average Bayesian predictive distributions, "
    "doi:10.1214/17-BA1091",
    "White (1982), Maximum likelihood estimation of misspecified models, doi:10.2307/1912526",
    "Bortz, Messenger & Dukic (2023), Direct estimation of parameters in ODE models using WENDy, "
    "doi:10.1007/s11538-023-01208-6",
)

_FIGURES = (
    *("overview", "diverging_motion", "held_out_windows", "held_out_overshoots"),
    *("term_set_scores", "force_curves", "captive_forces", "spiral"),
)
_TABLES = (
    *("runs", "checks", "term_sets", "refusals", "held_out_indices", "harder_indices", "model_error"),
    *("coefficients", "correlations", "captive"),
)

PAGE = Page(
    "index.html",
    Path(__file__).with_name("page.html.j2"),
    own=(*(f"figures/{name}.png" for name in _FIGURES), *(f"tables/{name}.csv" for name in _TABLES)),
    packages=("pymc-ship", "numpy", "scipy", "xarray", "numba", "matplotlib"),
)
"""The page of a ship; its folder may hold the page of forecasts, too."""

_LEFT_OUT = " terms were left out: "
REFUSED = Page(
    "refused.html",
    PAGE.template,
    own=("figures/diverging_motion.png", "tables/refusals.csv", "tables/doubts.csv"),
    packages=PAGE.packages,
)
"""The page of an identification without a term set."""

_REFUSALS = heads(str, terms="term set", manoeuvre="fails in") | heads(number(3), time="after [s]")
_REFUSALS |= heads(str, fault="the ship")
_RUNS = heads(str, run="run", manoeuvre="recognised as") | heads(fixed_point(0), duration="duration s")
_RUNS |= heads(fixed_point(1), duration_L_U="in L/U") | heads(fixed_point(2), approach_speed="approach speed m/s")
_RUNS |= heads(number(3), sampling="sampling interval s", fitted_at="interval of the fit s")
_RUNS |= heads(fixed_point(0), checks="checks made") | heads(str, verdict="worst verdict")
_INDICES = heads(str, run="run", manoeuvre="manoeuvre", index="index", unit="unit")
_INDICES |= {key: (key, fixed_point(2)) for key in ("measured", "forecast", "error", "sd", "z")}
_BEYOND = heads(fixed_point(1), beyond="ranges beyond the milder runs")
_MODEL_ERROR = heads(str, kind="kind")
_MODEL_ERROR |= heads(lambda value: fixed_point(1)(100.0 * value), median="sd [%]", upper="95 % below")
_MODEL_ERROR |= heads(str, unit="of")
_COEFFICIENTS = heads(str, coefficient="coefficient") | heads(fixed_point(1), estimate="estimate", sd="sd")
_COEFFICIENTS |= heads(fixed_point(1), known_value="known beforehand", known_sd="± sd", prior_sds_away="sd away")
_COEFFICIENTS |= heads(str, correlated_with=f"correlated beyond {CORRELATED:g} with")
_PARAMETERS = heads(str, coefficient="parameter")
_PARAMETERS |= heads(number(4), estimate="estimate", sd="sd", known_value="known beforehand", known_sd="± sd")
_PARAMETERS |= heads(fixed_point(1), prior_sds_away="sd away")
_PARAMETERS |= heads(str, unit="unit, or what it is", source="known from")
_PAIRS = heads(str, first="coefficient", second="with") | heads(fixed_point(3), correlation="correlation")


def write_ship_report(
    result: ShipIdentification,
    trials: Mapping[str, xr.Dataset],
    checks: Mapping[str, Sequence[Check]],
    out: str | Path,
    *,
    command: str,
    seed: int,
    forecasts: Mapping[str, xr.DataTree] = MappingProxyType({}),
    summary: Sequence[str] = (),
    captive: xr.Dataset | None = None,
    given: Vessel | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write the page of an identified ship.

    Parameters
    ----------
    result : ShipIdentification
        From :func:`pymc_ship.identify_ship`.
    trials : mapping of str to Dataset, dims (time,)
        Fitted records, by the names of the runs.
    checks : mapping of str to sequence of Check
        Checks of the runs, from :func:`pymc_ship.trial_checks`.
    out : str or Path
        Folder, created where it is missing.
    command : str
        What repeats the page.
    seed : int
        Seed of the random numbers.
    forecasts : mapping of str to DataTree, optional
        Of the standard manoeuvres, by label.
    summary : sequence of str, optional
        Sentences of :func:`pymc_ship.ships.design.outlook.manoeuvring_summary`.
    captive : Dataset, optional
        From :func:`pymc_ship.ships.identification.model.captive_comparison`.
    given : Vessel, optional
        As in its file, for its steering gear.
    progress : callable, optional
        Called with a short text before each step.

    Returns
    -------
    Path
        ``out/index.html``, written after ``out/figures`` and ``out/tables``.

    Raises
    ------
    TrialError
        For trials without names, or no trials.
    ValueError
        For other trials than those of the identification.
    OutputError
        When the folder cannot be written.
    """
    check_callables(progress=progress)
    check_counts(least=0, seed=seed)
    trials = named_trials(trials)
    check_kind("The result", result, ShipIdentification, "make it by identify_ship")
    if tuple(trials) != result.names:
        raise ShipError(
            f"The report takes the trials of the identification, {', '.join(result.names)}, in this order; found "
            f"{', '.join(trials) or 'none'}."
        )
    out = writable_folder(out)
    rows = {
        "runs": run_rows(result, trials, checks),
        "checks": check_rows(checks),
        "term_sets": term_set_rows(result),
        "refusals": refusal_rows(result.refusals),
        "held_out_indices": index_error_rows(result.held_out_indices, result.ship.motion_error),
        "harder_indices": harder_index_rows(result.ship),
        "model_error": error_rows(result.ship.index_error or {}, most_dofs(c.vessel for c in result.candidates)),
        "coefficients": coefficient_rows(result.candidates[0]),
        "correlations": correlation_rows(result.candidates[0]),
        "captive": comparison_rows(captive) if captive is not None else [],
    }
    verdicts = [row for label, tree in forecasts.items() for row in verdict_rows(label, tree, result.vessel)]
    progress("drawing the figures")
    turns = steady_turns(result.ship)
    drawn = _figures(result, list(trials.values()), seed, captive) | {"spiral": spiral_curve(turns)}
    if forecasts:
        drawn["overview"] = overview(forecasts, result.vessel)
    progress("writing the page")
    values = _values(result, trials, rows, summary) | {
        "measured": measured_sentences(result, rows["held_out_indices"], forecasts),
        "opening": opening_sentences(result, verdicts, forecasts),
        "verdicts": verdict_table(verdicts) if verdicts else None,
        "steering": _steering(result, given),
        "command": command,
        "seed": seed,
    }
    values["spiral"] = spiral_sentence(turns)
    return write_page(PAGE, out, Content(values, drawn, rows, sources=(*result.vessel.sources, *SOURCES)))


def write_refusals(
    refusals: Sequence[Refusal],
    vessel: Vessel,
    checks: Mapping[str, Sequence[Check]],
    out: str | Path,
    *,
    command: str,
) -> Path:
    """Write ``out/refused.html``, the page of an identification without a term set: refusals of a FitError and checks.

    ``command`` repeats the page. OutputError when the folder cannot be written.
    """
    made = check_rows(checks)
    rows = {"refusals": refusal_rows(refusals), "doubts": [row for row in made if row["verdict"] in DOUBTS]}
    values = {
        "vessel": vessel,
        "best": None,
        "n_runs": len(checks),
        "doubtful": rows["doubts"],
        "checked": bool(made),
        "unchecked": _unchecked(made),
        "corrections": {},
        "steering": [],
        "left_out": [refusal.sentence for refusal in refusals if refusal.failure is None],
        "tables": {"refusals": table(rows["refusals"], _REFUSALS)},
        "command": command,
    }
    return write_page(REFUSED, out, Content(values, _diverging_motion(refusals), rows))


def refusal_rows(refusals: Sequence[Refusal]) -> list[dict]:
    """Where each term set fails: ``terms``, ``manoeuvre``, ``time`` [s] and ``fault``."""
    rows = []
    for refusal in refusals:
        row = {"terms": refusal.name, "manoeuvre": "the fit itself", "time": np.nan, "fault": "cannot be fitted"}
        if (failure := refusal.failure) is not None:
            row |= {"manoeuvre": failure.manoeuvre.label, "time": failure.time, "fault": failure.fault}
        rows.append(row)
    return rows


def _diverging_motion(refusals: Sequence[Refusal]) -> dict[str, Figure]:
    shown = [refusal for refusal in refusals if refusal.failure is not None]
    return {"diverging_motion": diverging_motion(shown)} if shown else {}


def run_rows(
    result: ShipIdentification, trials: Mapping[str, xr.Dataset], checks: Mapping[str, Sequence[Check]]
) -> list[dict]:
    """Manoeuvre, duration [s and L/U], approach speed [m/s], sampling [s] and worst check of each run."""
    unit, rows = result.vessel.particulars.ship_time, []
    for (name, trial), manoeuvre in zip(trials.items(), result.manoeuvres, strict=True):
        duration = float(np.ptp(trial["time"].values))
        row: dict[str, Any] = {"run": name, "manoeuvre": "none recognised" if manoeuvre is None else manoeuvre.label}
        row |= {"duration": duration, "duration_L_U": duration / unit, "approach_speed": approach_speed(trial)}
        row |= {"sampling": sampling_interval(trial), "fitted_at": sampling_interval(thin_record(trial, result.vessel))}
        made = [check.verdict for check in checks.get(name, ()) if check.verdict != "not checked"]
        rows.append(row | {"checks": len(made), "verdict": worst_verdict(made) if made else "not checked"})
    return rows


def check_rows(checks: Mapping[str, Sequence[Check]]) -> list[dict]:
    """Every check of every run: ``run``, ``check``, ``verdict``, ``sentence``."""
    return [
        {"run": run, "check": check.name, "verdict": check.verdict, "sentence": check.sentence}
        for run, made in checks.items()
        for check in made
    ]


def term_set_rows(result: ShipIdentification) -> list[dict]:
    """Weight, held-out score, rms of each channel [SI], inflation and draws of each term set, by falling weight."""
    best = result.candidates[0].held_out.log_density.sum()
    rows = []
    for candidate in result.candidates:
        score = candidate.held_out.log_density.sum()
        lost = not np.isfinite(score)
        row = {"terms": candidate.name, "coefficients": candidate.fit.coefficients.size, "weight": candidate.weight}
        row |= {"score": -np.inf if lost else float(score), "to_best": -np.inf if lost else float(score - best)}
        row |= {f"rms_{channel}": np.nan if lost else sd for channel, sd in candidate.held_out.rms.items()}
        row |= {"inflation": candidate.inflation, "design_effect": candidate.fit.design_effect}
        row["draws"] = len(candidate.draws)
        row["infeasible_fraction"] = candidate.infeasible_fraction if len(candidate.draws) else np.nan
        known = TERM_SETS | PART_SETS
        about = known[candidate.name].description if candidate.name in known else "terms of the vessel file"
        rows.append(row | {"about": about.replace("`", '"')})
    return rows


def coefficient_rows(candidate: Candidate) -> list[dict]:
    """Estimate and sd (sandwich, inflated) of each coefficient, its prior and scale inflation, prime values."""
    vessel, sd = candidate.vessel, np.sqrt(np.diag(candidate.fit.covariance))
    by_name = {c.name: c for c in (*(c for force in vessel.forces.values() for c in force), *vessel.parameters)}
    pairs, scale_inflation = correlation_rows(candidate), candidate.fit.prior.scale / candidate.prior.scale
    columns, rows = (coefficient_names(vessel), candidate.fit.coefficients, sd, scale_inflation), []
    for name, value, spread, factor in zip(*columns, strict=True):
        known = by_name[name]
        center, width = (known.value, known.sd) if known.sd > 0.0 else (np.nan, np.nan)
        partners = [row["second" if row["first"] == name else "first"] for row in pairs if name in row.values()]
        row = {"coefficient": name, "estimate": float(value), "sd": float(spread)}
        row |= {"known_value": center, "known_sd": width, "prior_sds_away": float((value - center) / width)}
        row |= {"scale_inflation": float(factor), "unit": known.unit, "source": known.source}
        rows.append(row | {"correlated_with": " ".join(partners)})
    return rows


def correlation_rows(candidate: Candidate) -> list[dict]:
    """Pairs of coefficients whose estimates are correlated by more than :data:`CORRELATED`."""
    sd = np.sqrt(np.diag(candidate.fit.covariance))
    correlation = candidate.fit.covariance / np.outer(sd, sd)
    names = coefficient_names(candidate.vessel)
    return [
        {"first": names[i], "second": names[j], "correlation": float(correlation[i, j])}
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True)
        if abs(correlation[i, j]) > CORRELATED
    ]


def _figures(
    result: ShipIdentification, trials: Sequence[xr.Dataset], seed: int, captive: xr.Dataset | None
) -> dict[str, Figure]:
    best = result.candidates[0]
    density = np.where(np.isfinite(best.held_out.log_density), best.held_out.log_density, -np.inf)
    order = np.argsort(density, kind="stable").tolist()
    ends = {order[-1]: "best", order[0]: "worst"} if len(trials) > 1 else {0: "only"}
    titles = {k: f"{result.names[k]}, the {word} forecast run" for k, word in ends.items()}
    runs = {title: held_out_windows(best, trials, k) for k, title in titles.items()}
    drawn = {"held_out_windows": restarted_motion(runs)}
    if any("overshoot" in name for name in result.held_out_indices["index"].values):
        drawn["held_out_overshoots"] = held_out_overshoots(result.held_out_indices)
    if len(result.candidates) > 1:
        differences = score_differences(result.candidates, np.random.default_rng(seed))
        drawn["term_set_scores"] = term_set_scores(differences, best.name)
    drawn["force_curves"] = force_curves(result.ship.models, result.ship.motion)
    drawn |= _diverging_motion(result.refusals)
    if captive is not None:
        drawn["captive_forces"] = captive_figure(captive)
    return drawn


def _values(
    result: ShipIdentification,
    trials: Mapping[str, xr.Dataset],
    rows: Mapping[str, list[dict]],
    summary: Sequence[str],
) -> dict:
    left_out = [remark for remark in result.ship.remarks if _LEFT_OUT in remark]
    return {
        "vessel": result.vessel,
        "n_runs": len(trials),
        "length": f"{LENGTH:g}",
        "correlated": f"{CORRELATED:g}",
        "evidence": fit_sentences(result, rows, summary),
        "prior": PRIORS[result.ship.prior],
        "corrections": {name: list(trial.attrs.get("corrections", ())) for name, trial in trials.items()},
        "doubtful": [row for row in rows["checks"] if row["verdict"] in DOUBTS],
        "checked": bool(rows["checks"]),
        "unchecked": _unchecked(rows["checks"]),
        "left_out": left_out,
        "best": result.candidates[0],
        "prior_conflicts": [row for row in rows["coefficients"] if abs(row["prior_sds_away"]) > DISAGREE],
        "disagree": f"{DISAGREE:g}",
        "n_coefficients": len(rows["coefficients"]),
        "summary": held_out_sentences(rows["held_out_indices"]),
        "tables": _tables(result, rows),
        "remarks": [remark for remark in result.ship.remarks if remark not in left_out],
    }


def _steering(result: ShipIdentification, given: Vessel | None) -> list[str]:
    sentences, first = [], next(iter(result.ship.facilities))
    main = first or "the runs without a facility"
    for name, gear in result.ship.facilities.items():
        where = f" at {name}" if name else ""
        if not gear.n_reversals:
            whose = "the vessel file" if name == first or not result.ship.facilities[first].n_reversals else main
            sentences.append(f"No run{where} reverses the rudder: the steering gear is that of {whose}.")
            continue
        for key, word, unit in (("rudder_rate_deg", "rate", "deg/s"), ("rudder_delay", "delay", "s")):
            text = f"Rudder {word}{where} measured over {gear.n_reversals} movements: {getattr(gear, key):.3g} {unit}"
            stated = "" if given is None else f"; in the vessel file {getattr(given.particulars, key):.3g} {unit}"
            sentences.append(f"{text}{stated}.")
    if len(result.ship.facilities) > 1:
        return [*sentences, f"Forecasts use the gear of {main} by default."]
    measured = ["Fits and forecasts use the measured values."] if result.ship.facilities[first].n_reversals else []
    return [*sentences, *measured]


def _unchecked(rows: Sequence[Mapping]) -> str:
    names = [row["check"] for row in rows if row["verdict"] == "not checked"]
    return ", ".join(f"{name} ({names.count(name)})" for name in dict.fromkeys(names))


def _tables(result: ShipIdentification, rows: Mapping[str, list[dict]]) -> dict[str, Table]:
    units = {name: CHANNELS[name].unit for candidate in result.candidates for name in candidate.held_out.rms}
    sets = heads(str, terms="term set") | heads(fixed_point(0), coefficients="coefficients")
    sets |= heads(fixed_point(1), weight="weight %")
    sets |= heads(_score, score="held-out elpd", to_best="difference to best")
    sets |= {f"rms_{name}": (f"rms {name} {unit.display}", _three_digits) for name, unit in units.items()}
    sets |= heads(fixed_point(2), inflation="sd inflation")
    sets |= heads(fixed_point(0), design_effect="design effect", draws="draws")
    sets |= heads(fixed_point(1), infeasible_fraction="diverged %") | heads(str, about="description")
    lines: dict[str, tuple[list[dict], Columns]] = {
        "runs": (rows["runs"], _RUNS),
        "term_sets": ([_term_set_cells(row, units) for row in rows["term_sets"]], sets),
        "refusals": (rows["refusals"], _REFUSALS),
        "held_out_indices": ([_index_cells(row) for row in rows["held_out_indices"]], _INDICES),
        "harder_indices": ([_index_cells(row) for row in rows["harder_indices"]], _INDICES | _BEYOND),
        "model_error": (rows["model_error"], _MODEL_ERROR),
        "correlations": (rows["correlations"], _PAIRS),
        "captive": comparison_page_table(rows["captive"]),
        **_coefficient_lines(result.candidates[0].vessel, rows["coefficients"]),
    }
    return {name: table(lines_of, columns) for name, (lines_of, columns) in lines.items() if lines_of}


def _coefficient_lines(vessel: Vessel, rows: Sequence[dict]) -> dict[str, tuple[list[dict], Columns]]:
    """Rows and columns of the parameters of a modular vessel, else of the coefficients of each degree of freedom."""
    if vessel.modular:
        return {"parameters": ([row for row in rows if row["known_sd"] > FIXED_SD], _PARAMETERS)}
    of_dof = {dof: [row for row in rows if row["coefficient"][0] == LETTER[dof]] for dof in vessel.dofs}
    return {f"coefficients_{dof}": ([_prime_cells(row) for row in mine], _COEFFICIENTS) for dof, mine in of_dof.items()}


def _three_digits(value: float) -> str:
    return f"{value:#.3g}".rstrip(".") if np.isfinite(value) else "–"


def _score(value: object) -> str:
    return "−∞" if value == -np.inf else fixed_point(1)(value)


def _term_set_cells(row: Mapping, units: Mapping[str, Unit]) -> dict:
    cells = {f"rms_{name}": unit.display_factor * row.get(f"rms_{name}", np.nan) for name, unit in units.items()}
    return dict(row) | cells | {key: 100.0 * row[key] for key in ("weight", "infeasible_fraction")}


def _index_cells(row: Mapping) -> dict:
    return dict(row) | {"index": row["index"].replace("_", " "), "unit": UNITS[row["kind"]]}


def _prime_cells(row: Mapping) -> dict:
    return dict(row) | {key: 1e5 * row[key] for key in ("estimate", "sd", "known_value", "known_sd")}
