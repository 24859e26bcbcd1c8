"""Tables of the study: rows from its result, for the page and for CSV."""

from collections.abc import Mapping

import numpy as np

from pymc_ship.diagnostics.tables import AGREEMENT, ENDS, agreement_rows, agreement_table
from pymc_ship.inference.identifiability.bound import ERROR_LIMITS
from pymc_ship.pages.tables import Columns, Table, fixed_point, heads, number, table
from pymc_ship.physics.manoeuvre.criteria import imo_criteria
from pymc_ship.physics.manoeuvre.indices import indices
from pymc_ship.physics.vessel.vessel import LETTER
from pymc_ship.records.files.noise import LITERAL_LEVEL
from pymc_ship.replication.measurements import PAPER_FAMILIES
from pymc_ship.replication.scores import coefficient_rows, relative_error
from pymc_ship.replication.study import MANOEUVRES, StudyResult
from pymc_ship.trial.channels import default_channels

ERROR_COUNTS: Columns = {f"under_{k:g}": (f"< {k:g} %", fixed_point(0)) for k in ERROR_LIMITS}
"""Columns of an error summary: percentage of coefficients under each limit."""

_OVERSHOOTS = {"first": "1st", "second": "2nd"}
_NUMBER, _PERCENT = number(3), fixed_point(0)
_COVERAGE = heads(_PERCENT, coverage="90 % intervals cover %")
_MEDIAN = heads(_NUMBER, median="median %")
_COLUMNS: dict[str, Columns] = {
    "denoising": heads(str, channel="channel")
    | heads(_NUMBER, noise="noise sd", before="RMSE before", after="RMSE after", gain="before / after"),
    "denoisers": heads(str, method="method")
    | heads(fixed_point(1), **{f"snr_{name}": f"{name} [dB]" for name in default_channels()})
    | (_MEDIAN | ERROR_COUNTS | _COVERAGE),
    "drawn_channels": heads(str, channel="channel")
    | heads(_NUMBER, sd="sd of draws", rmse="RMSE of their mean")
    | _COVERAGE,
    "drawn_coefficients": heads(str, derivative="derivative", dof="DOF")
    | (_MEDIAN | _COVERAGE)
    | heads(_NUMBER, median_pooled="pooled: median %")
    | heads(_PERCENT, coverage_pooled="cover %")
    | heads(_NUMBER, widened="sd, pooled / known"),
    "data": heads(str, dof="DOF", rows="rows", terms="terms")
    | heads(number(4), condition="condition number")
    | heads(_NUMBER, vif_median="VIF, median", vif_largest="VIF, largest")
    | heads(str, largest="of"),
    "priors": heads(str, family="family", dof="DOF", choice="choice")
    | heads(_NUMBER, shape="shape A", scale="scale b = 1/B", kappa="kappa")
    | heads(fixed_point(4), score="score", score_se="± se")
    | heads(fixed_point(1), log_evidence="log evidence"),
    "errors": heads(_NUMBER, level="noise level")
    | heads(str, family="family", dof="DOF")
    | (_MEDIAN | ERROR_COUNTS | _COVERAGE),
    "agreement": heads(str, family="family", dof="DOF") | AGREEMENT,
}


def dof_block(result: StudyResult, dof: str, exact: Mapping) -> dict:
    """Title, caption and table of one DOF's coefficients (Tables 2 and 3)."""
    n, error, families = number(4), ("error %", number(3)), (("conjugate", "conj."), ("semiconjugate", "semi-c."))
    columns: Columns = {"coefficient": ("coefficient", str), "reference": ("reference", n)}
    for family, short in families:
        columns |= {f"published_{family}": (f"publ. {short}", n), f"published_error_{family}": error}
    columns["bound_literal"] = ("bound %", number(3))
    for family, short in families:
        columns |= {
            f"mean_{family}": (f"ours {short}", n),
            f"sd_{family}": ("± sd", number(2)),
            f"error_{family}": error,
        }
    columns |= {"bound": ("bound %", number(3)), "sign_source": ("sign from", str)}
    rows = _coefficient_rows(result, dof, exact)
    number_of_table = "2" if dof in ("surge", "sway") else "3"
    return {
        "title": f"Table {number_of_table}  {dof.capitalize()}: {LETTER[dof]}-coefficients",
        "caption": "Prime values times 1e5; the published error is recomputed from the published estimate. Cramer-Rao "
        f"bounds at noise levels {LITERAL_LEVEL:.3f} (beside the published) and {result.level:g} (beside ours).",
        "table": table(rows, columns),
    }


def csv_tables(result: StudyResult) -> dict[str, list[dict]]:
    """Every table of the study as rows, by the name of its file."""
    exact = result.identifications[result.level].exact
    coefficients = [{"dof": dof, **row} for dof in result.vessel.dofs for row in _coefficient_rows(result, dof, exact)]
    own = {"coefficients": coefficients, "agreement": _agreement_rows(result)}
    tables = own | {"denoising": _denoising_rows(result), "data": _data_rows(result)} | result.tables
    return {name: rows for name, rows in tables.items() if rows}


def _coefficient_rows(result: StudyResult, dof: str, exact: Mapping) -> list[dict]:
    """Rows of Tables 2 and 3 with the bound [% of the reference] at both noise levels."""
    rows = coefficient_rows(result.vessel, dof, {family: exact[family][dof] for family in PAPER_FAMILIES})
    reference = result.vessel.coefficients(dof)
    bound = result.bound.sel(coefficient=reference["coefficient"].values).values
    unit = relative_error(reference.values + bound, reference.values)
    for row, relative in zip(rows, unit.tolist(), strict=True):
        row |= {"bound_literal": LITERAL_LEVEL * relative, "bound": result.level * relative}
    return rows


def page_tables(result: StudyResult) -> dict[str, Table]:
    """Formatted tables of the page, by name."""
    levels, errors = (result.level, "published"), result.tables["errors"] + result.tables["published"]
    own = {"errors": [row for row in errors if row["dof"] == "all" or row["level"] in levels]}
    own |= {"denoising": _denoising_rows(result), "data": _data_rows(result), "agreement": _agreement_rows(result)}
    rows, L = result.tables | own, result.vessel.particulars.L
    overshoots = {f"{name}_overshoot_angle": (f"{nth} overshoot", 1.0) for name, nth in _OVERSHOOTS.items()}
    turn = {"advance": ("advance", L), "tactical_diameter": ("tactical diameter", L)}
    return {name: table(rows[name], columns) for name, columns in _COLUMNS.items()} | {
        "indices": _index_table(result),
        "prior_ships": _prior_ship_table(result),
        "forecast_zigzag": _forecast_table(result, "zigzag", overshoots),
        "forecast_turning_circle": _forecast_table(result, "turning_circle", turn),
    }


def _prior_ship_table(result: StudyResult) -> Table:
    n, rows = number(3), []
    for row in result.tables["prior_ships"]:
        band = f"{n(row['median'])} ({n(row['lower'])} to {n(row['upper'])})" if np.isfinite(row["median"]) else "–"
        rows.append({**row, "band": f"{row['index']} [{row['unit']}]: {band}"})
    columns = heads(str, family="family", choice="prior", manoeuvre="manoeuvre") | ENDS
    columns |= heads(str, band="index of those that reach it") | heads(fixed_point(1), reached="reach it %")
    return table(rows, columns)


def _index_table(result: StudyResult) -> Table:
    rows = []
    runs = {"zigzag 20/20": result.trial} | {MANOEUVRES[name].label: run for name, run in result.references.items()}
    L = result.vessel.particulars.L
    for label, run in runs.items():
        run_indices = indices(run)
        limits = {row["criterion"].replace(" ", "_"): row for row in imo_criteria(run_indices, result.vessel)}
        for name, value in run_indices.data_vars.items():
            if not np.isfinite(value):
                continue
            unit = value.attrs["units"]
            shown = float(value) / (L if unit == "m" else 1.0)
            limit = limits.get(name)
            verdict = "" if limit is None else {True: "passes", False: "FAILS", None: "not reached"}[limit["passed"]]
            rows.append(
                {
                    "run": label,
                    "index": str(name).replace("_", " "),
                    "value": shown,
                    "unit": "L" if unit == "m" else unit,
                    "limit": "" if limit is None else f"≤ {limit['limit']:.3g}",
                    "verdict": verdict,
                }
            )
    columns = {"run": "manoeuvre", "index": "index", "value": "value", "unit": "unit", "limit": "IMO", "verdict": ""}
    return table(rows, {key: (head, fixed_point(2) if key == "value" else str) for key, head in columns.items()})


def _denoising_rows(result: StudyResult) -> list[dict]:
    noisy, smooth = result.noisy[result.level], result.smooth[result.level]
    rows = []
    for name in smooth.attrs["denoised"].split():
        clean = result.trial[name].values
        before, after = (float(np.sqrt(np.mean((r[name].values - clean) ** 2))) for r in (noisy, smooth))
        unit = result.trial[name].attrs["units"]
        sd = noisy.attrs[f"noise_sd_{name}"]
        ratio = before / after if after > 0.0 else float("nan")
        rows.append({"channel": f"{name} [{unit}]", "noise": sd, "before": before, "after": after, "gain": ratio})
    return rows


def _data_rows(result: StudyResult) -> list[dict]:
    rows = []
    for dof, data in result.identifications[result.level].data.items():
        inflation = data.variance_inflation_factors
        rows.append(
            {
                "dof": dof,
                "rows": data.n_rows,
                "terms": data.n_terms,
                "condition": data.condition_number,
                "vif_median": float(np.median(inflation)),
                "vif_largest": float(inflation.max()),
                "largest": data.coefficients[int(inflation.argmax())],
            }
        )
    return rows


def _agreement_rows(result: StudyResult) -> list[dict]:
    return [
        {"family": family, "dof": dof, **row}
        for family, by_dof in result.agreement.items()
        for dof, dataset in by_dof.items()
        for row in agreement_rows(dataset)
    ]


def agreement_blocks(result: StudyResult) -> list[dict]:
    """Title and table of every quantity for each family and DOF."""
    return [
        {"title": f"{dof}, {family}", "table": agreement_table(dataset)}
        for family, by_dof in result.agreement.items()
        for dof, dataset in by_dof.items()
    ]


def _forecast_table(result: StudyResult, name: str, wanted: Mapping[str, tuple[str, float]]) -> Table:
    rows = []
    columns = heads(number(3), level="noise level") | heads(str, family="family") | heads(number(3), error="error %")
    columns |= heads(fixed_point(0), coverage="coverage %") | heads(fixed_point(1), diverged="diverged %")
    for row in result.tables[f"forecast_{name}"]:
        extra = {}
        for index, (_, unit) in wanted.items():
            low, median, high = (row[f"{index}_{band}"] / unit for band in ("lower", "median", "upper"))
            extra[index] = f"{median:.2f} ({low:.2f} to {high:.2f})" if np.isfinite(median) else "not reached"
            extra[f"{index}_reference"] = row[f"{index}_reference"] / unit
        rows.append({**row, **extra})
    for index, (label, _) in wanted.items():
        columns |= {index: (label, str), f"{index}_reference": ("reference", fixed_point(2))}
    return table(rows, columns)
