"""Texts that commands print: tables in columns, one line for each coefficient, index, criterion or candidate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.index_table import index_rows
from pymc_ship.ships.ensemble.scores import BANDS
from pymc_ship.ships.forecasting.forecast import NO_ROLL, draws_and_shares, has_roll

if TYPE_CHECKING:
    from pymc_ship.inference.regression.priors import ExactPosterior
    from pymc_ship.inference.regression.tune import TunedPrior
    from pymc_ship.records.checks.verdicts import Check
    from pymc_ship.ships.identification.model import ShipIdentification


class CoefficientRow(NamedTuple):
    """Estimate of a coefficient beside the value of the vessel file; prime values."""

    dof: str
    family: str
    coefficient: str
    reference: float
    mean: float
    sd: float
    quantile_5: float
    quantile_95: float


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
    lines = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [CoefficientRow(dof=dof, family=family, **dict(zip(columns, line, strict=True))) for line in lines]


def trajectory_text(tree: xr.DataTree) -> str:
    """Noise model, agreement of the starts and how far to trust the normal approximation."""
    attrs = tree.attrs
    return (
        f"{attrs['noise_sentence']}\n"
        f"{attrs['starts_agreeing']} of {attrs['starts']} starts ended at this mode; Pareto k-hat "
        f"{attrs['pareto_khat']:.2f}: {attrs['verdict']}"
    )


def tuning_text(tuned: TunedPrior) -> str:
    """Chosen prior and its rivals with their scores, and what the optimisation gained over the evidence."""
    rivals = {
        "chosen": (tuned.prior, tuned.score),
        "best evaluated": (tuned.evaluated_prior, tuned.evaluated_score),
        "best of the Gaussian process": (tuned.surrogate_prior, tuned.surrogate_score),
        "evidence maximum": (tuned.evidence_prior, tuned.evidence_score),
    }
    rows = [(name, prior.shape, prior.scale, prior.kappa, f"{score:.4f}") for name, (prior, score) in rivals.items()]
    edges = "".join(
        f"\nThe {'chosen prior' if name == 'prior' else 'evidence maximum'} lies on an edge of its box in "
        f"{' and '.join(at)}: the box, not the data, ended the search there."
        for name, at in tuned.edges.items()
    )
    return (
        f"{table(('prior', 'shape', 'scale', 'kappa', 'score'), rows)}\n\n"
        f"Score (log predictive density per held-out row): {tuned.score:.4f} ± {tuned.score_se:.4f}.\n"
        f"Log evidence at its maximum: {tuned.log_evidence:.2f}.\n"
        f"Bayesian optimisation gained {tuned.score - tuned.evidence_score:+.4f} a row over the evidence maximum."
        f"{edges}"
    )


def coefficient_table(rows: Sequence[CoefficientRow], families: Sequence[str]) -> str:
    """One line for each coefficient, the families side by side."""
    lines: dict[tuple, list] = {}
    for row in rows:
        line = lines.setdefault((row.coefficient, row.dof), [1e5 * row.reference])
        line += [1e5 * value for value in (row.mean, row.sd, row.quantile_5, row.quantile_95)]
    columns = [column for family in families for column in (f"{family} mean", "sd", "5 %", "95 %")]
    return table(("times 1e5", "dof", "reference", *columns), [(*key, *line) for key, line in lines.items()])


def check_text(checks: Iterable[Check]) -> str:
    """One line for each check: name, verdict and sentence; those that nothing is the matter with come last."""
    order = {verdict: place for place, verdict in enumerate(("bad", "doubtful", "good", "not checked"))}
    checks = sorted(checks, key=lambda check: order[check.verdict])
    width = max(len(check.name) for check in checks)
    rows = ((check.name, check.verdict, check.sentence.removeprefix("Not checked: ")) for check in checks)
    return "\n".join(f"{name:{width}}  {verdict:11}  {sentence}" for name, verdict, sentence in rows)


def divergence(run: xr.Dataset) -> str:
    """When a run diverged."""
    return f"The run diverged at t = {float(run['diverged_at']):g} s; the trial holds what was before."


def index_table(found: xr.Dataset, columns: Mapping[str, Mapping[Any, Any]]) -> str:
    """One line for each index, one column for each data set."""
    rows = [
        (str(name).replace("_", " "), *(float(values[name]) for values in columns.values()), found[name].attrs["units"])
        for name in found.data_vars
    ]
    return table(("index", *columns, ""), rows)


def criteria_table(criteria: list[dict]) -> str:
    """One line for each IMO criterion; empty where none applies."""
    words = {True: "pass", False: "fail", None: "not reached"}
    rows = [(c["criterion"], c["value"], c["limit"], c["units"], words[c["passed"]]) for c in criteria]
    return table(("IMO MSC.137(76)", "value", "limit", "", ""), rows) if rows else ""


def design_text(found: xr.Dataset) -> str:
    """How many times as wide intervals would be after each candidate, its sea room, and what the chosen runs leave."""
    steps = found["step"].values
    header = ("candidate", *(f"width ratio {k}" for k in steps), "sea room m")
    columns = [found["width_ratio"].sel(step=k).values for k in steps]
    rows = zip(found["candidate"].values, *columns, found["sea_room"].values, strict=True)
    widths = zip(found["target"].values, *found["half_width"].values, found["units"].values, strict=True)
    chosen = table(("half width of 95 %", "now", *(f"after {label}" for label in found["chosen"].values), ""), widths)
    return f"{table(header, list(rows))}\n\n{chosen}"


def montecarlo_text(rows: Sequence[Mapping], columns: Mapping[str, str], most: int = 60) -> str:
    """Columns of the main table of a Monte-Carlo study, with their heads; a sentence where nothing was measured."""
    if not rows:
        return "Nothing was measured; the page says why."
    lines = table(list(columns.values()), [[row[key] for key in columns] for row in rows[:most]])
    return lines + (f"\n... and {len(rows) - most} more rows" if len(rows) > most else "")


def forecast_text(tree: xr.DataTree, beside: Mapping[str, Mapping[Any, Any]]) -> str:
    """Median and band of each index and what stands beside them, between shares of the forecast and extrapolation."""
    lines = [f"{tree.attrs['label']}: {draws_and_shares(tree)}, bands of {tree.attrs['ci_prob']:.0%}"]
    if "index_bands" in tree.children:
        bands = tree["index_bands"].to_dataset()
        lines.append(index_table(bands, {**beside, **{band: bands.sel(band=band) for band in BANDS}}))
    lines += [] if has_roll(tree) else [NO_ROLL]
    return "\n".join([*lines, tree.attrs["extrapolation"]])


def probability_text(rows: Iterable[Mapping]) -> str:
    """One sentence for each IMO criterion that applies; empty where none does."""
    return "\n".join(f"IMO MSC.137(76): {row['verdict']}" for row in rows)


def term_set_text(found: ShipIdentification) -> str:
    """Weight, held-out score and errors of every term set."""
    channels = dict.fromkeys(name for candidate in found.candidates for name in candidate.held_out.rms)
    rows = [
        (
            *(c.name, c.weight, c.held_out.log_density.sum()),
            *(c.held_out.rms.get(name, math.nan) for name in channels),
            f"{c.infeasible_fraction:.0%}",
        )
        for c in found.candidates
    ]
    return table(("term set", "weight", "score", *(f"rms {name}" for name in channels), "diverged"), rows)


def score_text(found: xr.Dataset) -> str:
    """Errors of every channel of every run, then windows and score of each run and of all."""
    from pymc_ship.ships.identification.replay import channel_rows, run_rows

    channels, runs = channel_rows(found), run_rows(found)
    total = found.attrs["score"]
    last = f"Score {total:.3g}, the mean over runs of the errors over the size of the motion."
    if not math.isfinite(total):
        last = "No score: the ship runs away in a window."
    held = f"bands of {100.0 * found.attrs['ci_prob']:.0f} % hold {100.0 * float(found['coverage'].mean()):.0f} %"
    words = f"In windows of {found.attrs['length']:.4g} s the {held} of the instants. {last}"
    tables = [
        table([key.replace("_", " ") for key in rows[0]], [[*row.values()] for row in rows])
        for rows in (channels, runs)
    ]
    return "\n\n".join([*tables, words])


def index_text(indices: xr.Dataset) -> str:
    """Indices of recorded manoeuvres beside the forecasts; empty where there are none."""
    if not indices.sizes["run"]:
        return ""
    from pymc_ship.ships.identification.replay import index_errors

    header = ("run", "manoeuvre", "index", "measured", "forecast", "error", "± sd", "inside")
    keys = ("run", "manoeuvre", "index", "measured", "forecast", "error", "sd", "inside")
    return table(header, [[row[key] for key in keys] for row in index_errors(indices)])


def form_text(form: Sequence[Mapping]) -> str:
    """Manoeuvring data of a sea trial, line by line."""
    keys = ("item", "port", "starboard", "criterion", "conformity")
    return table(keys, [[row[key] for key in keys] for row in form])


def held_out_text(found: ShipIdentification) -> str:
    """Indices of each held-out manoeuvre beside their forecast; empty where none was held out."""
    if not found.held_out_indices.sizes["run"]:
        return ""
    header = ("held-out run", "manoeuvre", "index", "measured", "forecast", "± sd")
    names = ("run", "manoeuvre", "index", "measured", "forecast", "sd")
    return table(
        header,
        [
            [str(row[n]).replace("_", " ") if n == "index" else row[n] for n in names]
            for row in index_rows(found.held_out_indices)
        ],
    )


def table(header: Sequence[str], rows: Iterable[Sequence]) -> str:
    """Columns of text, the first one flush left and the others flush right."""
    cells = [list(header), *([_cell(value) for value in row] for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    lines = (
        "  ".join([row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))])
        for row in cells
    )
    return "\n".join(line.rstrip() for line in lines)


def _cell(value: str | float) -> str:
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.4g}"
