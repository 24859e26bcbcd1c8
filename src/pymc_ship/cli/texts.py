"""Printed tables and sentences: one line for each coefficient, index, criterion or candidate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.tune import bound_text
from pymc_ship.physics.vessel.rescaling import rescale
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.scores import BANDS
from pymc_ship.trial.channels import CHANNELS

if TYPE_CHECKING:
    from pymc_ship.inference.regression.priors import ExactPosterior
    from pymc_ship.inference.regression.tune import TunedPrior
    from pymc_ship.records.checks.verdicts import Check
    from pymc_ship.ships.identification.model import ShipIdentification

_MOST_ROWS = 60  # of a printed Monte-Carlo table


class CoefficientRow(NamedTuple):
    """Estimate and reference value of a coefficient, prime values; the mean also in the systems bis and MMG."""

    dof: str
    family: str
    coefficient: str
    reference: float
    mean: float
    sd: float
    quantile_5: float
    quantile_95: float
    mean_bis: float
    mean_mmg: float


def coefficient_rows(vessel: Vessel, family: str, exact: Mapping[str, ExactPosterior]) -> list[CoefficientRow]:
    """Rows of exact posteriors by DOF."""
    rows = []
    for dof, posterior in exact.items():
        low, high = posterior.quantiles([0.05, 0.95])
        columns = {"mean": posterior.mean, "sd": posterior.sd, "quantile_5": low, "quantile_95": high}
        rows += _rows(vessel, dof, family, columns)
    return rows


def trajectory_rows(vessel: Vessel, tree: xr.DataTree) -> list[CoefficientRow]:
    """Rows of the draws of a trajectory posterior."""
    sample = tree["posterior"]["coefficients"].stack(sample=("chain", "draw"))
    rows = []
    for dof in vessel.dofs:
        names = vessel.coefficients(dof)["coefficient"].values
        draws = sample.sel(coefficient=names).transpose("sample", "coefficient").values
        low, high = np.quantile(draws, [0.05, 0.95], axis=0)
        columns = {"mean": draws.mean(axis=0), "sd": draws.std(axis=0), "quantile_5": low, "quantile_95": high}
        rows += _rows(vessel, dof, "trajectory", columns)
    return rows


def _rows(vessel: Vessel, dof: str, family: str, columns: Mapping[str, np.ndarray]) -> list[CoefficientRow]:
    reference = vessel.coefficients(dof)
    columns = {"coefficient": reference["coefficient"].values, "reference": reference.values, **columns}
    mean = reference.copy(data=columns["mean"])
    mmg = rescale(mean, vessel, "mmg") if vessel.particulars.d > 0.0 else np.nan * mean
    columns |= {"mean_bis": rescale(mean, vessel, "bis").values, "mean_mmg": mmg.values}
    lines = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [CoefficientRow(dof=dof, family=family, **dict(zip(columns, line, strict=True))) for line in lines]


def trajectory_text(tree: xr.DataTree) -> str:
    """Noise model, agreement of the starts and validity of the normal approximation."""
    attrs = tree.attrs
    return (
        f"{attrs['noise_sentence']}\n"
        f"{attrs['starts_agreeing']} of {attrs['starts']} starts converged to this mode; Pareto k-hat "
        f"{attrs['pareto_khat']:.2f}: {attrs['verdict']}"
    )


def tuning_text(tuned: TunedPrior) -> str:
    """Candidate priors with their scores, and the gain of the optimisation over the evidence maximum."""
    priors = {
        "chosen": (tuned.prior, tuned.score),
        "best evaluated": (tuned.evaluated_prior, tuned.evaluated_score),
        "best of the Gaussian process": (tuned.surrogate_prior, tuned.surrogate_score),
        "evidence maximum": (tuned.evidence_prior, tuned.evidence_score),
    }
    rows = [(name, prior.shape, prior.scale, prior.kappa, f"{score:.4f}") for name, (prior, score) in priors.items()]
    subjects = {"prior": "The chosen prior", "evidence": "The evidence maximum"}
    edges = "".join(f"\n{bound_text(subjects[name], at)}." for name, at in tuned.edges.items())
    return (
        f"{table_text(('prior', 'shape', 'scale', 'kappa', 'score'), rows, 'Priors and scores')}\n\n"
        f"Score, the log predictive density per held-out row: {tuned.score:.4f} ± {tuned.score_se:.4f}.\n"
        f"Log evidence at its maximum: {tuned.log_evidence:.2f}.\n"
        f"Bayesian optimisation: {tuned.score - tuned.evidence_score:+.4f} in the score over the evidence maximum."
        f"{edges}"
    )


def coefficient_text(rows: Sequence[CoefficientRow], families: Sequence[str]) -> str:
    """One line for each coefficient, with columns for each family."""
    lines: dict[tuple, list] = {}
    for row in rows:
        line = lines.setdefault((row.coefficient, row.dof), [1e5 * row.reference])
        line += [1e5 * value for value in (row.mean, row.sd, row.quantile_5, row.quantile_95)]
    columns = [column for family in families for column in (f"{family} mean", "sd", "5 %", "95 %")]
    caption = "Coefficients, prime values times 1e5"
    return table_text(("name", "dof", "reference", *columns), [(*key, *line) for key, line in lines.items()], caption)


def check_rows(checks: Iterable[Check]) -> list[tuple[str, str, str]]:
    """Name, verdict and sentence of each check, bad checks first; a correction in place of the remedy."""
    from pymc_ship.records.checks.trial_checks import finding_text

    order = {verdict: rank for rank, verdict in enumerate(("bad", "doubtful", "good", "not checked"))}
    checks = sorted(checks, key=lambda check: order[check.verdict])
    return [(check.name, check.verdict, finding_text(check).removeprefix("Not checked: ")) for check in checks]


def check_text(checks: Iterable[Check]) -> str:
    """One line for each check: name, verdict and sentence, bad checks first."""
    rows = check_rows(checks)
    width = max(len(name) for name, _, _ in rows)
    return "\n".join(f"{name:{width}}  {verdict:11}  {sentence}" for name, verdict, sentence in rows)


def index_text(indices: xr.Dataset, columns: Mapping[str, Mapping[Any, Any]]) -> str:
    """One line for each index, one column for each data set."""
    rows = [
        (str(name).replace("_", " "), *(float(values[name]) for values in columns.values()), index.attrs["units"])
        for name, index in indices.data_vars.items()
    ]
    return table_text(("index", *columns, "unit"), rows)


def criteria_text(criteria: list[dict]) -> str:
    """One line for each IMO criterion; empty if none applies."""
    words = {True: "pass", False: "fail", None: "not reached"}
    rows = [(c["criterion"], c["value"], c["limit"], c["units"], words[c["passed"]]) for c in criteria]
    return table_text(("IMO MSC.137(76)", "value", "limit", "unit", "verdict"), rows) if rows else ""


def design_text(result: xr.Dataset) -> str:
    """Ratio of interval widths after each candidate, its sea room, and the widths after the chosen runs."""
    from pymc_ship.ships.design.outlook import sentence_without_gain

    steps = result["step"].values
    header = ("candidate", *(f"width ratio {k}" for k in steps), "sea room [m]")
    columns = [result["width_ratio"].sel(step=k).values for k in steps]
    rows = zip(result["candidate"].values, *columns, result["sea_room"].values, strict=True)
    caption = "Half width of the 95 % intervals"
    widths = zip(result["target"].values, *result["half_width"].values, result["units"].values, strict=True)
    after = (f"after {label}" for label in result["chosen"].values)
    chosen = table_text(("index", "now", *after, "unit"), widths, caption)
    ratios = table_text(header, rows, "Interval widths after each run over those of today")
    return "\n\n".join(filter(None, [ratios, chosen, sentence_without_gain(result)]))


def montecarlo_text(rows: Sequence[Mapping], columns: Mapping[str, str]) -> str:
    """Main table of a Monte-Carlo study; a sentence if it is empty."""
    if not rows:
        return "The study has no results; the page shows the reasons."
    lines = table_text(list(columns.values()), [[row[key] for key in columns] for row in rows[:_MOST_ROWS]])
    more = len(rows) - _MOST_ROWS
    return lines + (f"\n... and {more} more rows" if more > 0 else "")


def forecast_text(tree: xr.DataTree, columns: Mapping[str, Mapping[Any, Any]]) -> str:
    """Bands of each index beside other columns, with divergence and extrapolation of the forecast."""
    from pymc_ship.ships.forecasting.forecast import NO_ROLL, draws_text, has_roll

    lines = [f"{tree.attrs['label']}: {draws_text(tree)}, bands of {tree.attrs['ci_prob']:.0%}"]
    if "index_bands" in tree.children:
        bands = tree["index_bands"].to_dataset()
        lines.append(index_text(bands, {**columns, **{band: bands.sel(band=band) for band in BANDS}}))
    lines += [] if has_roll(tree) else [NO_ROLL]
    return "\n".join([*lines, tree.attrs["extrapolation"]])


def term_set_text(identification: ShipIdentification) -> str:
    """Weight, held-out elpd and errors of every term set."""
    channels = dict.fromkeys(name for candidate in identification.candidates for name in candidate.held_out.rms)
    rows = [
        (
            *(c.name, c.weight, c.held_out.log_density.sum()),
            *(c.held_out.rms.get(name, math.nan) for name in channels),
            f"{c.infeasible_fraction:.0%}",
        )
        for c in identification.candidates
    ]
    errors = (f"rms {name} [{_unit(name)}]" for name in channels)
    return table_text(("term set", "weight", "elpd", *errors, "diverged"), rows, "Term sets, on held-out runs")


def score_text(scores: xr.Dataset) -> str:
    """Errors of every channel of every run, then windows and score of each run, then the total score."""
    from pymc_ship.ships.identification.replay import channel_rows, run_rows

    channels, runs = channel_rows(scores), run_rows(scores)
    total = scores.attrs["score"]
    last = f"Score {total:.3g}, the mean over runs of the errors relative to the motion."
    if not math.isfinite(total):
        last = "No score, since the simulation diverges in a window."
    summary = (
        f"In windows of {scores.attrs['length']:.4g} s the bands of {100.0 * scores.attrs['ci_prob']:.0f} % contain "
        f"{100.0 * float(scores['coverage'].mean()):.0f} % of the samples. {last}"
    )
    channels = [row | {"unit": _unit(row["channel"])} for row in channels]
    captions = ("Errors of each channel; relative, coverage: 1 is 100 %", "Score of each run")
    tables = [
        table_text([key.replace("_", " ") for key in rows[0]], [[*row.values()] for row in rows], caption)
        for rows, caption in zip((channels, runs), captions, strict=True)
    ]
    return "\n\n".join([*tables, summary])


def _unit(channel: str) -> str:
    return CHANNELS[channel].unit.name if channel in CHANNELS else "m"


def compared_index_text(indices: xr.Dataset, caption: str, *, scored: bool = False) -> str:
    """Measured indices and their forecasts, with their errors if ``scored``; empty without runs."""
    if not indices.sizes["run"]:
        return ""
    from pymc_ship.ships.identification.replay import index_errors

    names = (str(name).replace("_", " ") for name in indices["index"].values)
    units = dict(zip(names, indices["units"].values.tolist(), strict=True))
    heads = {key: key for key in ("run", "manoeuvre", "index", "measured", "forecast")}
    heads |= {"error": "error"} if scored else {}
    heads |= {"lower": "95 % from", "upper": "to"} if scored else {"sd": "± sd"}
    heads |= {"unit": "unit"} | ({"inside": "inside 95 %"} if scored else {})
    rows = [row | {"unit": units[row["index"]]} for row in index_errors(indices)]
    return table_text(list(heads.values()), [[row[key] for key in heads] for row in rows], caption)


def form_text(form: Sequence[Mapping]) -> str:
    """Manoeuvring data of a sea trial."""
    keys = ("item", "port", "starboard", "criterion", "conformity")
    return table_text(keys, [[row[key] for key in keys] for row in form], "Manoeuvring data, IMO MSC/Circ.1053")


def conditions_text(unmet: Sequence[Mapping]) -> str:
    """Conditions of a sea trial that are not met; empty without one."""
    rows = [[row["condition"], row["found"], row["limit"]] for row in unmet]
    return table_text(("condition", "found", "limit"), rows, "Conditions of the trial not met") if rows else ""


def table_text(header: Sequence[str], rows: Iterable[Sequence], caption: str = "") -> str:
    """Caption and columns of text, the first column aligned left and the others right."""
    cells = [list(header), *([_cell(value) for value in row] for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    lines = (
        "  ".join([row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))])
        for row in cells
    )
    return "\n".join([*([f"{caption}:"] if caption else []), *(line.rstrip() for line in lines)])


def _cell(value: str | float) -> str:
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.4g}"
