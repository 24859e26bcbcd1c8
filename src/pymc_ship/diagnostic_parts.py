"""Parts of a section of the diagnostic report: what each says, tabulates and draws of one posterior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymc_ship import diagnostic_figures as drawn
from pymc_ship import diagnostics, figures
from pymc_ship.diagnostics import CI_PROB, CONTRACTION_LIMIT, DESIGN, ENVELOPE, PSENSE_LIMIT, SD_LIMIT, WHITENESS_LEVEL
from pymc_ship.page_tables import Table, fixed, number, table
from pymc_ship.vessel import Vessel

_n = number(3)
_CI = f"{100 * CI_PROB:g} %"
_PRIME = "Prime values times 1e5 (σ² times 1e10)"


@dataclass
class Part:
    """One part of a section: title, text, tables and figures with their captions."""

    title: str
    text: str = ""
    tables: list[tuple[Table, str]] = field(default_factory=list)
    images: list[tuple[str, Figure, str]] = field(default_factory=list)


def verdict(tree: xr.DataTree) -> list[str]:
    """What heads a section: the gates, what the data determine, and whether the residuals are white."""
    failed = [gate for gate in diagnostics.gates(tree) if not gate["holds"]]
    lines = ["All convergence gates hold."]
    if failed:
        said = "; ".join(f"{g['gate']} {_n(g['value'])} ({g['where']}), to be {g['limit']}" for g in failed)
        lines = [f"A convergence gate fails: {said}. The numbers below are not to be relied on."]
    if lacking := _lacking(tree, *DESIGN):
        return [*lines, f"What the data determine and the residuals are not known: {lacking}"]
    return [*lines, _determined(tree), _white(tree)]


def _determined(tree: xr.DataTree) -> str:
    table = diagnostics.contraction(tree)
    total, count = table.sizes["coefficient"], int(table["determined"].sum())
    prior = int((~table["narrowed"]).sum())
    zero = total - count - prior
    text = f"{count} of {total} coefficients are determined by the data"
    rest = [f"{prior} follow{'s' * (prior == 1)} the prior"] if prior else []
    rest += [f"{zero} cannot be told from zero"] if zero else []
    return f"{text}; {' and '.join(rest)}." if rest else f"{text}."


def _white(tree: xr.DataTree) -> str:
    values = diagnostics.residuals(tree).values
    if values.size < 10:
        return f"Whiteness of the residuals needs ten rows, found {values.size}."
    test = diagnostics.whiteness(values)
    numbers = f"r1 = {_n(test['r1'])}, Ljung-Box p = {_n(test['p_value'])} over {test['lags']} lags"
    if test["p_value"] >= WHITENESS_LEVEL:
        return f"Residuals pass for white noise ({numbers})."
    strong = test["r1"] > test["band"]
    effect = "intervals are too narrow" if strong else "intervals are not to be taken at face value"
    return (
        f"Residuals are autocorrelated ({numbers}): {effect}; leave-future-out or block folds are the right tool for "
        "serially correlated rows."
    )


def _lacking(tree: xr.DataTree, *wanted: str) -> str:
    """Sentence that says which variables a part lacks; empty when it has them all."""
    lacking = diagnostics.missing(tree, *wanted)
    return f"the tree has no {' and no '.join(lacking)}." if lacking else ""


def parts(tree: xr.DataTree, ship: Vessel | None, rng: np.random.Generator) -> list[Part]:
    """Every part of a posterior's section, in order; a part whose variables the tree lacks says so."""
    return [
        _convergence(tree),
        _coefficients(tree, ship),
        _chains(tree),
        _energy(tree),
        _noise_variance(tree, rng),
        _predictive(tree, rng),
        _correlation(tree),
        _directions(tree),
        _residuals(tree),
        _leave_one_out(tree, rng),
        _sensitivity(tree),
    ]


def _convergence(tree: xr.DataTree) -> Part:
    columns = {
        "gate": ("gate", str),
        "value": ("value", number(4)),
        "where": ("of", str),
        "limit": ("limit", str),
        "holds": ("holds", lambda holds: "yes" if holds else "NO"),
    }
    rows = table(diagnostics.gates(tree), columns)
    stats = (
        ""
        if "sample_stats" in tree.children
        else "Divergences and E-BFMI are not judged: the tree has no sample_stats."
    )
    return Part("Convergence gates", stats, [(rows, "Worst value over all quantities against its limit.")])


def _coefficients(tree: xr.DataTree, ship: Vessel | None) -> Part:
    dof, found = tree.attrs["dof"], diagnostics.summary(tree)
    narrowing = None if diagnostics.missing(tree, *DESIGN) else diagnostics.contraction(tree)
    reference = ship.coefficients(dof).values if ship else None
    published = {family: ship.published(dof, family) for family in figures.COLOURS} if ship else {}
    published = {family: values for family, values in published.items() if np.isfinite(values).any()}
    rows = _coefficient_rows(found, narrowing, reference, published)
    columns = {"quantity": ("coefficient", str)}
    columns |= {"reference": ("reference", number(4))} if ship else {}
    columns |= {f"published_{family}": (f"publ. {family}", number(4)) for family in published}
    columns |= {
        "mean": ("mean", number(4)),
        "sd": ("sd", _n),
        "lower": (f"{50 - 50 * CI_PROB:g} %", number(4)),
        "upper": (f"{50 + 50 * CI_PROB:g} %", number(4)),
    }
    if narrowing is not None:
        columns |= {"contraction": ("contraction", fixed(3)), "judged": ("judged", str)}
    chains = {
        "quantity": ("quantity", str),
        "mean": ("mean", number(4)),
        "mcse_mean": ("MCSE of mean", _n),
        "mcse_sd": ("MCSE of sd", _n),
        "r_hat": ("R-hat", fixed(4)),
        "ess_bulk": ("bulk ESS", fixed(0)),
        "ess_tail": ("tail ESS", fixed(0)),
    }
    caption = f"{_PRIME}; equal-tailed (eti) intervals of {_CI}."
    meant = (
        "Contraction is 1 − posterior variance / prior variance (that of the conjugate prior at the posterior mean of "
        f"σ²). Determined: contraction > {CONTRACTION_LIMIT:g} and |mean| > {SD_LIMIT:g} sd; prior: contraction not "
        f"above {CONTRACTION_LIMIT:g}; not from zero: narrowed by the data, yet within {SD_LIMIT:g} sd of zero."
    )
    relative = (
        "Coefficients over their reference: 1 is the reference, 0 is none; those with a reference of zero left out"
        if ship
        else "Coefficients over their posterior standard deviation, since no vessel was given"
    )
    text = "" if narrowing is None else meant
    if reference is not None:
        lower, upper = found["lower"].values[:-1], found["upper"].values[:-1]
        inside = int(np.sum((lower <= reference) & (reference <= upper)))
        text += f" The {_CI} intervals hold {inside} of {reference.size} reference values."
    note = f"{relative}; mean, 50 % and {_CI} equal-tailed (eti) intervals."
    images = []
    if np.any(found["sd"].values[:-1] if reference is None else reference):
        images = [("forest", drawn.forest(tree, reference, published), note)]
    tables = [(table(rows, columns), caption), (table(rows, chains), f"{_PRIME}; Monte Carlo errors of the chains.")]
    return Part("Coefficients", text.strip(), tables, images)


_SCALED = ("mean", "sd", "lower", "upper", "mcse_mean", "mcse_sd")


def _coefficient_rows(
    found: xr.Dataset, narrowing: xr.Dataset | None, reference: np.ndarray | None, published: Mapping[str, np.ndarray]
) -> list[dict]:
    rows = []
    for k, name in enumerate(map(str, found["quantity"].values)):
        last = k == found.sizes["quantity"] - 1
        scale = 1e10 if last else 1e5
        row = {key: float(found[key].values[k]) for key in ("r_hat", "ess_bulk", "ess_tail")}
        row |= {key: scale * float(found[key].values[k]) for key in _SCALED}
        row |= {"quantity": "σ²" if last else name, "contraction": float("nan"), "judged": ""}
        row |= {f"published_{family}": float("nan") if last else 1e5 * v[k] for family, v in published.items()}
        row["reference"] = float("nan") if last or reference is None else 1e5 * float(reference[k])
        if narrowing is not None and not last:
            one = narrowing.isel(coefficient=k)
            row["contraction"] = float(one["contraction"])
            row["judged"] = "determined" if one["determined"] else "not from zero" if one["narrowed"] else "prior"
        rows.append(row)
    return rows


def _chosen(tree: xr.DataTree) -> list[str]:
    """Quantities that are drawn: largest R-hat, the most correlated pair, the noise variance; those that vary."""
    found = diagnostics.summary(tree)
    names = [str(name) for name in found["quantity"].values]
    pairs = diagnostics.correlated_pairs(tree, 1)
    wanted = [names[int(np.argmax(np.nan_to_num(found["r_hat"].values[:-1])))]]
    wanted += [pairs[0]["first"], pairs[0]["second"]] if pairs else []
    varies = dict(zip(names, found["sd"].values > 0.0, strict=True))
    return [name for name in dict.fromkeys([*wanted, "noise_variance"]) if varies[name]]


def _chains(tree: xr.DataTree) -> Part:
    names = _chosen(tree)
    if not names:
        return Part("Chains", "Not drawn: none of the chosen quantities varies.")
    text = "Drawn are the coefficient of largest R-hat, the most correlated pair and the noise variance."
    limit = f"{diagnostics.ESS_LIMIT:g}"
    images = [
        ("trace", drawn.trace(tree, names), "Trace, one colour a chain."),
        (
            "ess",
            drawn.effective_sample_size(tree, names),
            f"Bulk (first colour) and tail ESS against the number of draws at {drawn.ESS_POINTS} points; "
            f"dashed: {limit}.",
        ),
    ]
    if tree["posterior"].sizes["chain"] < 2:
        return Part("Chains", f"{text} Ranks are not drawn: they need two chains.", [], images)
    ranks = (
        "rank",
        drawn.rank(tree, names),
        "Fractional ranks, each chain's distribution function minus the uniform one, with the p-value of "
        f"uniformity at the {100 * (1 - ENVELOPE):.0f} % level (envelope_prob {ENVELOPE:g}).",
    )
    images.insert(1, ranks)
    return Part("Chains", text, [], images)


def _energy(tree: xr.DataTree) -> Part:
    if lacking := _lacking(tree, "sample_stats/energy"):
        return Part("Energy", f"Not shown: {lacking}")
    caption = f"E-BFMI of each chain, limit {diagnostics.E_BFMI_LIMIT:g}; marginal energy and its transitions."
    return Part("Energy", "", [], [("energy", drawn.energy(tree), caption)])


def _noise_variance(tree: xr.DataTree, rng: np.random.Generator) -> Part:
    title = "Prior and posterior of the noise variance"
    if float(tree["posterior"]["noise_variance"].std()) == 0.0:
        return Part(title, "Not drawn: the noise variance does not vary.")
    caption = "Kernel densities of draws of log10 σ²; the prior's are cut to its central 95 %."
    wide = diagnostics.noise_variance_widths(tree, rng)
    ending = "; the noise variance follows its prior." if wide[1] > 0.5 * wide[0] else "."
    widths = f"{_n(wide[0])} wide under the prior, {_n(wide[1])} under the posterior"
    text = f"The central {_CI} of log10 σ² is {widths}{ending}"
    return Part(title, text, [], [("noise", drawn.noise_variance(tree, rng), caption)])


def _predictive(tree: xr.DataTree, rng: np.random.Generator) -> Part:
    title = "Prior and posterior predictive check"
    if lacking := _lacking(tree, *DESIGN):
        return Part(title, f"Not shown: {lacking}")
    low, middle, high = diagnostics.prior_predictive_ratio(tree, rng)
    made = (
        "as the tree holds them"
        if diagnostics.has(tree, "posterior_predictive/response")
        else "drawn from posterior and design"
    )
    text = (
        f"Under the prior the root mean square of the response is {_n(middle)} times that of the record "
        f"(5 to 95 % of 400 draws: {_n(low)} to {_n(high)}). Posterior predictive responses, {made}:"
    )
    caption = f"Kernel density of the response (black) and of {drawn.PREDICTIVE_SAMPLES} predictive data sets."
    return Part(title, text, [], [("predictive", drawn.predictive(diagnostics.predictive(tree, rng)), caption)])


def _correlation(tree: xr.DataTree) -> Part:
    title, pairs = "Correlation of the coefficients", diagnostics.correlated_pairs(tree)
    if not pairs or pairs[0]["correlation"] == 0.0:
        return Part(title, "Not shown: there is no pair of coefficients that vary.")
    columns = {
        "first": ("coefficient", str),
        "second": ("and", str),
        "correlation": ("posterior correlation", fixed(4)),
    }
    names = [pairs[0]["first"], pairs[0]["second"]]
    images = [
        (
            "pair",
            drawn.pair(tree, names),
            f"About {drawn.PAIR_DRAWS} draws of the most correlated pair, with marginals.",
        ),
        ("correlation", drawn.correlation(tree), "Posterior correlation of all coefficients."),
    ]
    return Part(title, "", [(table(pairs, columns), f"The {len(pairs)} strongest posterior correlations.")], images)


def _directions(tree: xr.DataTree) -> Part:
    title = "Singular directions of the design"
    if lacking := _lacking(tree, *DESIGN):
        return Part(title, f"Not shown: {lacking}")
    rows = diagnostics.singular_directions(tree)
    open_ = sum(row["share"] <= CONTRACTION_LIMIT for row in rows)
    condition = diagnostics.data_of(tree).condition_number
    said = f"leave {open_} of {len(rows)} directions to the prior" if open_ else f"determine all {len(rows)} directions"
    text = (
        f"The data {said}; a direction is left to the prior where the data's share of the posterior precision does not "
        f"exceed {CONTRACTION_LIMIT:g}. The condition number of the scaled design is {_n(condition)}."
    )
    columns = {
        "singular_value": ("singular value", _n),
        "share": ("share of the data", fixed(4)),
        "direction": ("largest loadings, scaled columns over prior sd", str),
    }
    shown = rows[: max(8, open_)]
    caption = f"The {len(shown)} weakest directions of the design times prior sd over σ; share = s² / (s² + 1)."
    return Part(title, text, [(table(shown, columns), caption)])


def _residuals(tree: xr.DataTree) -> Part:
    if lacking := _lacking(tree, *DESIGN):
        return Part("Residuals", f"Not shown: {lacking}")
    values = diagnostics.residuals(tree)
    if values.size < 10:
        return Part("Residuals", _white(tree))
    test = diagnostics.whiteness(values.values)
    size = np.abs(values.values) / np.sqrt(float(tree["posterior"]["noise_variance"].mean()))
    worst = int(size.argmax())
    moment = _n(float(values["time"][worst]))
    text = f"{_white(tree)} The largest residual is {_n(float(size[worst]))} sigma, at {moment} s (row {worst})."
    caption = (
        "Residuals at the posterior mean over time and their autocorrelation; band ± 1.96/√n. Ljung-Box Q = "
        f"{_n(test['statistic'])} over {test['lags']} lags, p = {_n(test['p_value'])}, level {WHITENESS_LEVEL:g}."
    )
    return Part("Residuals", text, [], [("residuals", drawn.residuals(values, test["band"]), caption)])


def _leave_one_out(tree: xr.DataTree, rng: np.random.Generator) -> Part:
    title = "Leave-one-out cross-validation"
    if lacking := _lacking(tree, "log_likelihood/response", *DESIGN):
        return Part(title, f"Not shown: {lacking}")
    loo = diagnostics.cross_validation(tree)
    k = np.ravel(loo.pareto_k.values)
    full = diagnostics.predictive(tree, rng)
    half, most = diagnostics.loo_pit_coverage(full)
    worst = int(np.argmax(k))
    text = (
        f"elpd {_n(float(loo.elpd))} ± {_n(float(loo.se))}, p_loo {_n(float(loo.p))}. {int(np.sum(k > loo.good_k))} of "
        f"{k.size} rows have a Pareto k above {loo.good_k:.2f}; the largest is {_n(float(k[worst]))}, row {worst}. "
        f"Leave-one-out intervals of 50 and {_CI} hold {100 * half:.0f} and {100 * most:.0f} % of the rows. "
        "With serially correlated rows leave-one-out flatters, since the neighbours of a row stay in."
    )
    images = [
        ("pareto", drawn.pareto_k(loo), f"Pareto k of every row; dashed: limit {loo.good_k:.2f}."),
        (
            "pit",
            drawn.loo_pit(full),
            f"LOO-PIT, its distribution function minus the uniform one (envelope {ENVELOPE:g}).",
        ),
    ]
    return Part(title, text, [], images)


def _sensitivity(tree: xr.DataTree) -> Part:
    title = "Sensitivity to prior and likelihood"
    if lacking := _lacking(tree, "log_prior/coefficients", "log_likelihood/response"):
        return Part(title, f"Not shown: {lacking}")
    rows = diagnostics.prior_sensitivity(tree)
    moved = [row["quantity"] for row in rows if row["prior"] > PSENSE_LIMIT]
    text = f"{len(moved)} of {len(rows)} quantities move with the prior{': ' + ', '.join(moved) if moved else ''}."
    columns = {
        "quantity": ("quantity", str),
        "prior": ("prior", fixed(3)),
        "likelihood": ("likelihood", fixed(3)),
        "diagnosis": ("diagnosis", str),
    }
    caption = f"Power-scaling sensitivity by 0.99 and 1.01 (psense); above {PSENSE_LIMIT:g} a quantity is moved."
    return Part(title, text, [(table(rows, columns), caption)])
