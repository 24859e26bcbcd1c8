"""Tables of a diagnosed posterior: agreement of methods, coefficients, chains and sensitivities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.diagnostics.numbers import CI_PROB, judged
from pymc_ship.pages.tables import Columns, Table, fixed, number, table

_SCALED = ("mean", "sd", "lower", "upper", "mcse_mean", "mcse_sd")


AGREEMENT: Columns = {
    "method": ("method", str),
    "largest_z": ("largest |z|", fixed(2)),
    "z_limit": ("limit", fixed(2)),
    "r_hat": ("largest R-hat", fixed(4)),
    "ess_bulk": ("least bulk ESS", fixed(0)),
    "ess_tail": ("least tail ESS", fixed(0)),
    "divergences": ("divergences", fixed(0)),
    "agrees": ("agrees", str),
}
"""Columns of a table of :func:`agreement_rows`."""


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
            "agrees": "yes" if bool(one["agrees"]) else "NO",
        }
        for method in agreement["method"].values
        for one in [agreement.sel({"method": method})]
    ]


def agreement_table(agreement: xr.Dataset) -> Table:
    """Exact mean and sd of every quantity and, for each method, its own with their z-scores; prime values times 1e5."""
    n, z = number(4), fixed(2)
    methods = [str(method) for method in agreement["method"].values]
    rows = []
    for quantity in agreement["quantity"].values:
        one, scale = agreement.sel(quantity=quantity), 1e10 if quantity == "noise_variance" else 1e5
        row: dict[str, Any] = {"quantity": "σ²" if quantity == "noise_variance" else str(quantity)}
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


def coefficient_table(
    summary: xr.Dataset,
    narrowing: xr.Dataset | None,
    reference: np.ndarray | None,
    published: Mapping[str, np.ndarray],
) -> Table:
    """Posterior of every quantity beside reference and published values and, where known, what determines it."""
    columns = _coefficient_columns(narrowing, reference, published)
    return table(_coefficient_rows(summary, narrowing, reference, published), columns)


def prior_posterior_table(found: xr.Dataset, marks: dict[str, np.ndarray]) -> Table:
    """Prior and posterior of the coefficients of a DOF beside other values; prior means of zero left out."""
    scaled = {"prior_mean": "prior mean"} if found["prior_mean"].values.any() else {}
    scaled |= {"prior_sd": "prior sd", "mean": "mean", "sd": "sd"}
    scaled |= {"lower": f"{50 - 50 * CI_PROB:g} %", "upper": f"{50 + 50 * CI_PROB:g} %"}
    columns: Columns = {"coefficient": ("coefficient", str)} | {name: (name, number(4)) for name in marks}
    columns |= {key: (head, number(3 if key.endswith("sd") else 4)) for key, head in scaled.items()}
    columns |= {"contraction": ("contraction", fixed(3)), "judged": ("judged", str)}
    rows, words = [], judged(found)
    for k, name in enumerate(map(str, found["coefficient"].values)):
        one = found.isel(coefficient=k)
        rows.append(
            {"coefficient": name, "contraction": float(one["contraction"]), "judged": str(words[k])}
            | {key: 1e5 * float(one[key]) for key in scaled}
            | {mark: 1e5 * float(values[k]) for mark, values in marks.items()}
        )
    return table(rows, columns)


def sensitivity_table(rows: Sequence[Mapping], quantity: str) -> Table:
    """Rows of :func:`pymc_ship.diagnostics.numbers.prior_sensitivity`, the first column as named."""
    columns: Columns = {
        "quantity": (quantity, str),
        "prior": ("prior", fixed(3)),
        "likelihood": ("likelihood", fixed(3)),
    }
    return table(rows, columns | {"diagnosis": ("diagnosis", str)})


def chain_table(summary: xr.Dataset) -> Table:
    """Monte Carlo errors, R-hat and effective sample sizes of every quantity."""
    columns: Columns = {
        "quantity": ("quantity", str),
        "mean": ("mean", number(4)),
        "mcse_mean": ("MCSE of mean", number(3)),
        "mcse_sd": ("MCSE of sd", number(3)),
        "r_hat": ("R-hat", fixed(4)),
        "ess_bulk": ("bulk ESS", fixed(0)),
        "ess_tail": ("tail ESS", fixed(0)),
    }
    return table(_coefficient_rows(summary, None, None, {}), columns)


def _coefficient_columns(
    narrowing: xr.Dataset | None, reference: np.ndarray | None, published: Mapping[str, np.ndarray]
) -> dict:
    columns: Columns = {"quantity": ("coefficient", str)}
    columns |= {"reference": ("reference", number(4))} if reference is not None else {}
    columns |= {f"published_{family}": (f"publ. {family}", number(4)) for family in published}
    columns |= {
        "mean": ("mean", number(4)),
        "sd": ("sd", number(3)),
        "lower": (f"{50 - 50 * CI_PROB:g} %", number(4)),
        "upper": (f"{50 + 50 * CI_PROB:g} %", number(4)),
    }
    if narrowing is not None:
        columns |= {"contraction": ("contraction", fixed(3)), "judged": ("judged", str)}
    return columns


def _coefficient_rows(
    summary: xr.Dataset, narrowing: xr.Dataset | None, reference: np.ndarray | None, published: Mapping[str, np.ndarray]
) -> list[dict]:
    rows, words = [], np.array([]) if narrowing is None else judged(narrowing)
    for k, name in enumerate(map(str, summary["quantity"].values)):
        last = name == "noise_variance"
        scale = 1e10 if last else 1e5
        row: dict[str, Any] = {key: float(summary[key].values[k]) for key in ("r_hat", "ess_bulk", "ess_tail")}
        row |= {key: scale * float(summary[key].values[k]) for key in _SCALED}
        row |= {"quantity": "σ²" if last else name, "contraction": float("nan"), "judged": ""}
        row |= {f"published_{family}": float("nan") if last else 1e5 * v[k] for family, v in published.items()}
        row["reference"] = float("nan") if last or reference is None else 1e5 * float(reference[k])
        if narrowing is not None and not last:
            one = narrowing.isel(coefficient=k)
            row["contraction"] = float(one["contraction"])
            row["judged"] = str(words[k])
        rows.append(row)
    return rows
