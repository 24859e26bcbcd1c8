"""Subsections on a regression: statistics of the first method, chains of the sampler."""

import json

import numpy as np
import xarray as xr

from pymc_ship.diagnostics import figures, regression, subsections, tables
from pymc_ship.diagnostics import posterior_statistics as statistics
from pymc_ship.diagnostics.agreement import Comparison
from pymc_ship.diagnostics.group_subsections import groups_subsection
from pymc_ship.diagnostics.posterior_statistics import CI_PROB, CONTRACTION_LIMIT, PSENSE_LIMIT, WHITENESS_LEVEL
from pymc_ship.diagnostics.subsections import PosteriorKind, Subsection
from pymc_ship.inference.regression.calibration import LEVEL
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.regression.tune import bound_text, on_edge
from pymc_ship.inference.sampling.error_laws import errors_of
from pymc_ship.pages.tables import fixed_point, heads, number, percent, table
from pymc_ship.physics.vessel.vessel import Vessel

_n = number(3)
_CI = percent(CI_PROB)
_PRIME = "Prime values times 1e5 (σ² times 1e10)"


def _verdict(one: Comparison) -> list[str]:
    lines = [subsections.convergence_sentence(one)]
    if one.agreement is not None:
        lines.append(f"Against the exact posterior: {one.agreement.attrs['verdict']}.")
    tree = one.posterior
    if lacking := subsections.missing_sentence(tree, *regression.required_variables(tree)):
        lines.append(f"What the data determine and the residuals are not known: {lacking}")
    else:
        lines += [subsections.determination_sentence(regression.contraction(tree)), _white(tree)]
    prior = regression.prior_of(tree)
    if prior is not None and (names := on_edge(prior)):
        lines.append(f"{bound_text('The prior', names)}.")
    return [*lines, *subsections.record_remarks(tree)]


def _white(tree: xr.DataTree) -> str:
    values = regression.residuals(tree).values
    if values.size < 10:
        return f"Whiteness of the residuals needs ten rows, found {values.size}."
    test = statistics.whiteness(values)
    summary_text = f"r1 = {_n(test['r1'])}, Ljung-Box p = {_n(test['p_value'])} over {test['lags']} lags"
    if test["p_value"] >= WHITENESS_LEVEL:
        return f"Residuals pass for white noise ({summary_text})."
    strong = test["r1"] > test["band"]
    effect = "intervals are too narrow" if strong else "intervals are not reliable"
    return (
        f"Residuals are autocorrelated ({summary_text}): {effect}; leave-future-out or block folds are the right tool "
        "for serially correlated rows."
    )


def _origin(one: Comparison) -> str:
    tree = one.posterior
    prior, sizes = json.loads(tree.attrs["prior"]), tree["posterior"].sizes
    hyperparameters = ", ".join(f"{key} {_plain(value)}" for key, value in prior.items() if key != "family")
    stated = f"{prior['family']} prior on the scaled columns: {hyperparameters}"
    if not hyperparameters:
        stated = "prior and likelihood of its own model"
    drawn = "; ".join(
        f"{name if len(one.trees) > 1 else f'method {given.attrs["method"]}'}, "
        f"{given['posterior'].sizes['chain']} chains of {given['posterior'].sizes['draw']} draws"
        for name, given in one.trees.items()
    )
    return (
        f"{tree.attrs['dof'].capitalize()} of {tree.attrs['vessel']}, {drawn}; {sizes['coefficient']} coefficients; "
        f"{stated}{''.join(f'; {name} fixed at {_n(value)}' for name, value in regression.fixed_of(tree).items())}."
    )


def _plain(value: float | list) -> str:
    return _n(value) if not isinstance(value, list) else f"{_n(min(value))} to {_n(max(value))}"


def _subsections(one: Comparison, ship: Vessel | None, rng: np.random.Generator) -> list[Subsection]:
    tree, chains = one.posterior, one.trees[one.sampler]
    return [
        _convergence(one),
        _agreement(one),
        _coefficients(tree, ship),
        *groups_subsection(tree),
        _chains(chains, one.sampler if len(one.trees) > 1 else ""),
        subsections.energy_subsection(chains),
        _noise_variance(tree, rng),
        _predictive(tree, rng),
        subsections.correlation_subsection(tree),
        _directions(tree),
        _residuals(tree),
        _leave_one_out(tree, rng),
        _sensitivity(tree),
        _ships(tree, ship, rng),
    ]


def _convergence(one: Comparison) -> Subsection:
    unknown = [method for method, tree in one.trees.items() if "sample_stats" not in tree.children]
    whose = f" of {' and '.join(unknown)}" if len(one.trees) > 1 else ""
    text = f"Divergences and E-BFMI{whose} are not judged: there are no sample_stats." if unknown else ""
    caption = "Worst value over all quantities against its limit."
    return Subsection("Convergence diagnostics", text, [(subsections.diagnostics_table(one), caption)])


def _agreement(one: Comparison) -> Subsection:
    title, tree = "Agreement with the exact posterior", one.posterior
    if one.agreement is None:
        lacking = "no exact posterior of the same data and prior is given"
        if errors_of(tree) != "normal":
            lacking = f"the exact posterior is of normal errors, these are {errors_of(tree)}"
        elif tree.attrs["method"] in FAMILIES:
            lacking = "no draws of the same data and prior by another method are given"
        return Subsection(title, f"Not shown: {lacking}.")
    worst = (
        "Largest |z| of means, standard deviations and quantiles, z from the run's own Monte Carlo error; the limit is "
        f"the two-sided normal quantile at {LEVEL:g} over {one.agreement.attrs['comparisons']} comparisons."
    )
    summary, every = (
        table(tables.agreement_rows(one.agreement), tables.AGREEMENT),
        tables.agreement_table(one.agreement),
    )
    return Subsection(title, "", [(summary, worst), (every, f"{_PRIME}; |z| q: the largest of the quantiles.")])


def _coefficients(tree: xr.DataTree, ship: Vessel | None) -> Subsection:
    dof, summary = tree.attrs["dof"], statistics.summary(tree)
    contraction = _known_contraction(tree)
    estimated = tree["posterior"].dataset["coefficient"].values
    free = np.isin(_coefficient_names(ship, tree), estimated) if ship else slice(None)
    reference = ship.coefficients(dof).values[free] if ship else None
    published = {family: values[free] for family, values in subsections.published_estimates(ship, dof).items()}
    marks = {} if reference is None else {"reference": reference}
    marks |= {f"publ. {family}": values for family, values in published.items()}
    rows = tables.coefficient_table(summary.rename(quantity="coefficient"), contraction, marks)
    relative = (
        "Coefficients over their posterior standard deviation, since no vessel was given"
        if reference is None
        else "Coefficients over their reference: 1 is the reference, 0 is none; those with a reference of zero left out"
    )
    note = f"{relative}; mean, 50 % and {_CI} equal-tailed (eti) intervals."
    images = []
    if np.any(_of_coefficients(tree, summary)["sd"] if reference is None else reference):
        images = [("forest", figures.forest(tree, reference, published), note)]
    caption = f"{_PRIME}; equal-tailed (eti) intervals of {_CI}."
    sentences = [] if contraction is None else [_contraction(tree)]
    if reference is not None:
        lower, upper = (_of_coefficients(tree, summary)[end].values for end in ("lower", "upper"))
        inside = int(np.sum((lower <= reference) & (reference <= upper)))
        sentences.append(f"The {_CI} intervals cover {inside} of {reference.size} reference values.")
    return Subsection("Coefficients", " ".join(sentences), [(rows, caption)], images)


def _of_coefficients(tree: xr.DataTree, summary: xr.Dataset) -> xr.Dataset:
    return summary.isel(quantity=slice(tree["posterior"].sizes["coefficient"]))


def _known_contraction(tree: xr.DataTree) -> xr.Dataset | None:
    return None if statistics.missing(tree, *regression.required_variables(tree)) else regression.contraction(tree)


def _contraction(tree: xr.DataTree) -> str:
    prior = "the conjugate prior at the posterior mean of σ²"
    if regression.prior_of(tree) is None:
        prior = f"a normal prior with the same central {_CI}"
    return f"Contraction is 1 − posterior variance / prior variance (that of {prior}). {subsections.DETERMINATION_TEXT}"


def _quantities_to_draw(tree: xr.DataTree) -> list[str]:
    """Names of the largest R-hat, the most correlated pair and the noise variance, without those that are constant."""
    summary = statistics.summary(tree)
    names = [str(name) for name in summary["quantity"].values]
    pairs = statistics.correlated_pairs(tree, 1)
    wanted = [names[int(np.argmax(np.nan_to_num(_of_coefficients(tree, summary)["r_hat"].values)))]]
    wanted += [pairs[0]["first"], pairs[0]["second"]] if pairs else []
    varies = dict(zip(names, summary["sd"].values > 0.0, strict=True))
    return [name for name in dict.fromkeys([*wanted, "noise_variance"]) if varies.get(name, False)]


def _chains(tree: xr.DataTree, method: str) -> Subsection:
    """Chains of one method, named where there are several."""
    names, errors = _quantities_to_draw(tree), f"{_PRIME}; Monte Carlo errors of the chains."
    shown = [(tables.chain_table(statistics.summary(tree)), errors)]
    whose = f"The chains are those of {method}. " if method else ""
    if not names:
        return Subsection("Chains", f"{whose}Not drawn: none of the chosen quantities varies.", shown)
    pair = "the most correlated pair"
    rest = f", {pair} and the noise variance" if "noise_variance" in names else f" and {pair}"
    text = f"{whose}Drawn are the coefficient of largest R-hat{rest}."
    if tree["posterior"].sizes["chain"] < 2:
        text = f"{text} Ranks are not drawn: they need two chains."
    return Subsection("Chains", text, shown, subsections.chain_images(tree, names))


def _noise_variance(tree: xr.DataTree, rng: np.random.Generator) -> Subsection:
    title = "Prior and posterior of the noise variance"
    if lacking := subsections.missing_sentence(tree, *regression.required_variables(tree)):
        return Subsection(title, f"Not shown: {lacking}")
    if float(tree["posterior"].dataset["noise_variance"].std()) == 0.0:
        return Subsection(title, "Not drawn: the noise variance does not vary.")
    caption = "Kernel densities of draws of log10 σ²; the prior's are cut to its central 95 %."
    wide = regression.noise_variance_widths(tree, rng)
    ending = "; the noise variance follows its prior." if wide[1] > 0.5 * wide[0] else "."
    widths = f"{_n(wide[0])} wide under the prior, {_n(wide[1])} under the posterior"
    text = f"The central {_CI} of log10 σ² is {widths}{ending}"
    return Subsection(title, text, [], [("noise", figures.noise_variance(tree, rng), caption)])


def _predictive(tree: xr.DataTree, rng: np.random.Generator) -> Subsection:
    title = "Prior and posterior predictive check"
    if lacking := subsections.missing_sentence(tree, *regression.required_to_predict(tree)):
        return Subsection(title, f"Not shown: {lacking}")
    low, middle, high = regression.prior_predictive_ratio(tree, rng)
    in_tree = statistics.has(tree, "posterior_predictive/response")
    made = "as the tree holds them" if in_tree else "drawn from posterior and design"
    text = (
        f"Under the prior the root mean square of the response is {_n(middle)} times that of the record "
        f"(5 to 95 % of 400 draws: {_n(low)} to {_n(high)}). Posterior predictive responses, {made}:"
    )
    caption = f"Kernel density of the response (black) and of {figures.PREDICTIVE_SAMPLES} predictive data sets."
    figure = figures.predictive(regression.with_posterior_predictive(tree, rng))
    return Subsection(title, text, [], [("predictive", figure, caption)])


def _directions(tree: xr.DataTree) -> Subsection:
    title = "Singular directions of the design"
    if lacking := subsections.missing_sentence(tree, *regression.required_variables(tree)):
        return Subsection(title, f"Not shown: {lacking}")
    rows = regression.singular_directions(tree)
    n_open = sum(row["data_precision"] <= CONTRACTION_LIMIT for row in rows)
    condition = regression.data_of(tree).condition_number
    summary_text = (
        f"leave {n_open} of {len(rows)} directions to the prior" if n_open else f"determine all {len(rows)} directions"
    )
    text = (
        f"The data {summary_text}; a direction is left to the prior where the data's share of the posterior precision "
        f"does not exceed {CONTRACTION_LIMIT:g}. The condition number of the scaled design is {_n(condition)}."
    )
    columns = heads(_n, singular_value="singular value") | heads(fixed_point(4), data_precision="share of the data")
    columns |= heads(str, direction="largest components, scaled columns over prior sd")
    shown = rows[: max(8, n_open)]
    caption = f"The {len(shown)} weakest directions of the design times prior sd over σ; share = s² / (s² + 1)."
    return Subsection(title, text, [(table(shown, columns), caption)])


def _residuals(tree: xr.DataTree) -> Subsection:
    if lacking := subsections.missing_sentence(tree, *regression.required_variables(tree)):
        return Subsection("Residuals", f"Not shown: {lacking}")
    values = regression.residuals(tree)
    if values.size < 10:
        return Subsection("Residuals", _white(tree))
    test = statistics.whiteness(values.values)
    size = np.abs(values.values) / np.sqrt(float(tree["posterior"].dataset["noise_variance"].mean()))
    worst = int(size.argmax())
    moment = _n(float(values["time"][worst]))
    text = f"{_white(tree)} The largest residual is {_n(float(size[worst]))} sigma, at {moment} s (row {worst})."
    caption = (
        "Residuals at the posterior mean over time and their autocorrelation; band ± 1.96/√n. Ljung-Box Q = "
        f"{_n(test['statistic'])} over {test['lags']} lags, p = {_n(test['p_value'])}, level {WHITENESS_LEVEL:g}."
    )
    return Subsection("Residuals", text, [], [("residuals", figures.residuals(values, test["band"]), caption)])


def _leave_one_out(tree: xr.DataTree, rng: np.random.Generator) -> Subsection:
    title = "Leave-one-out cross-validation"
    wanted = dict.fromkeys((*regression.required_for_likelihood(tree), *regression.required_to_predict(tree)))
    if lacking := subsections.missing_sentence(tree, *wanted):
        return Subsection(title, f"Not shown: {lacking}")
    full = regression.with_posterior_predictive(regression.with_log_likelihood(tree), rng)
    loo = statistics.cross_validation(full)
    pit = regression.loo_pit(full, loo)
    half, most = regression.loo_pit_coverage(pit)
    text = (
        f"{subsections.loo_sentences(loo, 'row', 3)} "
        f"Leave-one-out intervals of 50 and {_CI} cover {100 * half:.0f} and {100 * most:.0f} % of the rows. "
        "Leave-one-out is optimistic for serially correlated rows, since the neighbours of a row stay in."
    )
    caption = (
        "LOO-PIT, its distribution function minus the uniform one; orange: what most tells it from uniform "
        f"(envelope_prob {statistics.ENVELOPE:g})."
    )
    return Subsection(title, text, [], [subsections.pareto_image(loo, "row"), ("pit", figures.loo_pit(pit), caption)])


def _sensitivity(tree: xr.DataTree) -> Subsection:
    title = "Sensitivity to prior and likelihood"
    if statistics.has(tree, "posterior/group_coefficients"):
        return Subsection(title, "Not shown: power-scaling the priors of groups would change the pooling.")
    stated = next(iter(tree["log_prior"].data_vars), "coefficients") if "log_prior" in tree.children else "coefficients"
    if lacking := subsections.missing_sentence(tree, f"log_prior/{stated}", *regression.required_for_likelihood(tree)):
        return Subsection(title, f"Not shown: {lacking}")
    rows = statistics.prior_sensitivity(regression.with_log_likelihood(tree))
    moved = [row["quantity"] for row in rows if row["prior"] > PSENSE_LIMIT]
    text = f"{len(moved)} of {len(rows)} quantities move with the prior{': ' + ', '.join(moved) if moved else ''}."
    caption = f"Power-scaling sensitivity by 0.99 and 1.01 (psense); above {PSENSE_LIMIT:g} a quantity is moved."
    return Subsection(title, text, [(tables.sensitivity_table(rows, "quantity"), caption)])


def _ships(tree: xr.DataTree, ship: Vessel | None, rng: np.random.Generator) -> Subsection:
    """Draws of the prior: the tree's own where it has them, otherwise of the recorded prior."""
    if regression.fixed_of(tree):
        return Subsection(subsections.SHIPS_TITLE, "Not shown: the prior is of the free coefficients alone.")
    if statistics.has(tree, "prior/coefficients"):
        return subsections.ships_subsection(tree, ship, {tree.attrs["dof"]: tree}, rng)
    prior, lacking = regression.prior_of(tree), subsections.missing_sentence(tree, *regression.required_variables(tree))
    if prior is None or lacking:
        return Subsection(subsections.SHIPS_TITLE, f"Not shown: {lacking}")
    return subsections.ships_subsection(tree, ship, {tree.attrs["dof"]: (regression.data_of(tree), prior)}, rng)


def _coefficient_names(vessel: Vessel, tree: xr.DataTree) -> list[str]:
    return [str(value) for value in vessel.coefficients(tree.attrs["dof"])["coefficient"].values]


REGRESSION = PosteriorKind(
    check=regression.check_posterior,
    coefficient_names=_coefficient_names,
    verdict=_verdict,
    origin=_origin,
    subsections=_subsections,
    contraction=_known_contraction,
)
"""The posterior of one degree of freedom."""
