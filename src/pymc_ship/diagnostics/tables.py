"""Tables of a diagnosed posterior: agreement of methods, coefficients, chains and sensitivities."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.diagnostics.posterior_statistics import CI_PROB, determination_labels
from pymc_ship.pages.tables import Columns, Table, fixed_point, heads, number, table

AGREEMENT: Columns = (
    heads(str, method="method")
    | heads(fixed_point(2), largest_z="largest |z|", z_limit="limit")
    | heads(fixed_point(4), r_hat="largest R-hat")
    | heads(fixed_point(0), ess_bulk="least bulk ESS", ess_tail="least tail ESS", divergences="divergences")
    | heads(str, agrees="agrees")
)
"""Columns of a table of :func:`agreement_rows`."""


ENDS = heads(
    fixed_point(1),
    diverged="diverged %",
    wrong_way="wrong way %",
    course_unstable="course-unstable %",
    complete="none of these %",
)
"""Columns of the shares of ships by how they end."""


def agreement_rows(agreement: xr.Dataset) -> list[dict]:
    """Worst values and verdict of each method of an agreement."""
    return [
        {
            "method": str(method),
            "largest_z": float(one["largest_z"]),
            "z_limit": float(agreement.attrs["z_limit"]),
            "r_hat": float(one["r_hat"].max()),
            "ess_bulk": float(one["ess_bulk"].min()),
            "ess_tail": float(one["ess_tail"].min()),
            "divergences": float(one["divergences"]),
            "agrees": "yes" if bool(one["agrees"]) else "no",
        }
        for method in agreement["method"].values
        for one in [agreement.sel({"method": method})]
    ]


def agreement_table(agreement: xr.Dataset) -> Table:
    """Exact mean and sd of every quantity; of each method mean, sd and their z-scores; prime values times 1e5."""
    n, z = number(4), fixed_point(2)
    methods = [str(method) for method in agreement["method"].values]
    rows = []
    for quantity in agreement["quantity"].values:
        one, (label, scale) = agreement.sel(quantity=quantity), _label_and_scale(str(quantity))
        row: dict[str, Any] = {"quantity": label}
        row |= {name: scale * float(one[f"exact_{name}"]) for name in ("mean", "sd")}
        for method in methods:
            by_method = one.sel({"method": method})
            row |= {f"{method}_{name}": scale * float(by_method[name]) for name in ("mean", "sd")}
            row |= {f"{method}_{name}": float(by_method[name]) for name in ("z_mean", "z_sd")}
            row[f"{method}_z_quantile"] = float(np.abs(by_method["z_quantile"]).max())
        rows.append(row)
    columns: Columns = {"quantity": ("quantity", str), "mean": ("exact mean", n), "sd": ("exact sd", n)}
    for method in methods:
        columns |= {
            f"{method}_mean": (f"{method} mean", n),
            f"{method}_z_mean": ("z", z),
            f"{method}_sd": (f"{method} sd", n),
            f"{method}_z_sd": ("z", z),
            f"{method}_z_quantile": ("|z| q", z),
        }
    return table(rows, columns)


def coefficient_table(summary: xr.Dataset, contraction: xr.Dataset | None, marks: Mapping[str, np.ndarray]) -> Table:
    """Posterior of every coefficient with other values of it and, where known, what determines it.

    The noise variance may follow the coefficients in ``summary``. A prior mean is shown only where one is not zero.
    """
    shown = {"prior_mean": "prior mean", "prior_sd": "prior sd", "mean": "mean", "sd": "sd"}
    shown |= {"lower": f"{50 - 50 * CI_PROB:g} %", "upper": f"{50 + 50 * CI_PROB:g} %"}
    shown = {key: head for key, head in shown.items() if key in summary}
    if "prior_mean" in summary and not summary["prior_mean"].values.any():
        del shown["prior_mean"]
    columns: Columns = heads(str, coefficient="coefficient") | {name: (name, number(4)) for name in marks}
    columns |= {key: (head, number(3 if key.endswith("sd") else 4)) for key, head in shown.items()}
    if contraction is not None:
        columns |= heads(fixed_point(3), contraction="contraction") | heads(str, determined_by="evidence")
    rows, labels = [], [] if contraction is None else determination_labels(contraction).tolist()
    for k, name in enumerate(map(str, summary["coefficient"].values)):
        label, scale = _label_and_scale(name)
        row: dict[str, Any] = {"coefficient": label, "contraction": np.nan, "determined_by": ""}
        row |= {key: scale * float(summary[key].values[k]) for key in shown}
        row |= {mark: scale * float(values[k]) if k < len(values) else np.nan for mark, values in marks.items()}
        if contraction is not None and k < len(labels):
            row |= {"contraction": float(contraction["contraction"].values[k]), "determined_by": labels[k]}
        rows.append(row)
    return table(rows, columns)


def chain_table(summary: xr.Dataset, *, errors: bool = True) -> Table:
    """R-hat and effective sample sizes of every quantity, after its mean with its Monte Carlo errors."""
    scaled = heads(number(4), mean="mean") | heads(number(3), mcse_mean="MCSE of mean", mcse_sd="MCSE of sd")
    mixed = heads(fixed_point(4), r_hat="R-hat") | heads(fixed_point(0), ess_bulk="bulk ESS", ess_tail="tail ESS")
    rows = []
    for k, name in enumerate(map(str, summary["quantity"].values)):
        label, scale = _label_and_scale(name)
        row = {key: scale * float(summary[key].values[k]) for key in scaled}
        rows.append({"quantity": label} | row | {key: float(summary[key].values[k]) for key in mixed})
    return table(rows, heads(str, quantity="quantity") | (scaled if errors else {}) | mixed)


def _label_and_scale(quantity: str) -> tuple[str, float]:
    return ("σ²", 1e10) if quantity == "noise_variance" else (quantity, 1e5)


def sensitivity_table(rows: Sequence[Mapping], quantity: str) -> Table:
    """Rows of :func:`pymc_ship.diagnostics.posterior_statistics.prior_sensitivity`, the first column as named."""
    columns = heads(str, quantity=quantity) | heads(fixed_point(3), prior="prior", likelihood="likelihood")
    return table(rows, columns | heads(str, diagnosis="diagnosis"))
