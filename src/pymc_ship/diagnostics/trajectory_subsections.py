"""Subsections on a trajectory fit."""

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr

from pymc_ship.diagnostics import posterior_statistics as statistics
from pymc_ship.diagnostics import subsections, trajectory, trajectory_figures
from pymc_ship.diagnostics.agreement import Comparison
from pymc_ship.diagnostics.posterior_statistics import CI_PROB, PSENSE_LIMIT, SD_LIMIT, WHITENESS_LEVEL
from pymc_ship.diagnostics.subsections import PosteriorKind, Subsection
from pymc_ship.diagnostics.tables import chain_table, coefficient_table, sensitivity_table
from pymc_ship.diagnostics.trajectory import PRIOR_VARIABLES, RESIDUAL_VARIABLES
from pymc_ship.inference.identifiability.information import UNKNOWN
from pymc_ship.inference.trajectory.posterior import KHAT_LIMIT
from pymc_ship.inference.trajectory.posterior import verdict as khat_verdict
from pymc_ship.pages.tables import fixed_point, heads, number, percent, table
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names, reference_coefficients

_DEFAULTS = (
    f"Posteriors of whole trajectories: Pareto k-hat ≤ {KHAT_LIMIT:g} for draws of the normal approximation, the "
    "diagnostics of chains for a sampler; a direction is unknown where it keeps more than "
    f"{UNKNOWN:g} of its prior variance; whiteness at {percent(WHITENESS_LEVEL)} for all channels together."
)

_SOURCES = (
    "Maine & Iliff (1986), Application of parameter estimation to aircraft, NASA RP-1168",
    "Vehtari, Simpson, Gelman, Yao & Gabry (2024), Pareto smoothed importance sampling, JMLR 25(72)",
    "MacKay (1992), Neural Computation 4(3):415, doi:10.1162/neco.1992.4.3.415",
    "Lam (2016), Annals of Statistics 44(3):928, doi:10.1214/15-AOS1393",
    "Buerkner, Gabry & Vehtari (2020), J. Statistical Computation and Simulation 90:2499, "
    "doi:10.1080/00949655.2020.1783262",
)

_CI = percent(CI_PROB)
_WEAKEST = 8
_LISTED = 12
_n = number(3)


def _verdict(one: Comparison) -> list[str]:
    tree = one.posterior
    lines = [subsections.convergence_sentence(one)]
    if tree.attrs["method"] == "trajectory":
        khat = float(tree.attrs["pareto_khat"])
        lines.append(f"Pareto k-hat {khat:.2f} (limit {KHAT_LIMIT:g}): {khat_verdict(khat)}.")
    lacking = subsections.missing_sentence(tree, *PRIOR_VARIABLES)
    lines += [f"What the records determine is not known: {lacking}"] if lacking else _determination_lines(tree)
    lines += [tree.attrs["noise_sentence"], _white(tree)]
    agreeing, starts = int(tree.attrs["starts_agreeing"]), int(tree.attrs["starts"])
    lines.append(f"{agreeing} of {starts} starts of the fit ended at this mode; {_divergence_text(tree)}.")
    return [*lines, *subsections.record_remarks(tree)]


def _determination_lines(tree: xr.DataTree) -> list[str]:
    contraction, along = trajectory.contraction(tree), trajectory.directions(tree)
    text, total = subsections.determination_sentence(contraction), contraction.sizes["coefficient"]
    proper = total - along.attrs["n_flat"]
    if not proper:
        return [f"{text} Every coefficient has a flat prior, which nothing can follow."]
    unknown, flat = along.attrs["n_unknown"], along.attrs["n_flat"]
    left_out = f"{flat} coefficients with a flat prior are" if flat > 1 else "1 coefficient with a flat prior is"
    return [
        text,
        f"Of {proper} directions of the coefficients {unknown or 'none'} follow{'s' * (unknown == 1)} the prior (more "
        f"than {UNKNOWN:g} of its variance is left); the data determine "
        f"{along.attrs['n_effective']:.1f} effectively.{f' {left_out} left out.' * (flat > 0)}",
    ]


def _white(tree: xr.DataTree) -> str:
    if lacking := subsections.missing_sentence(tree, *RESIDUAL_VARIABLES):
        return f"The residuals are not known: {lacking}"
    rows = trajectory.channel_rows(tree)
    worst = min(rows, key=lambda row: row["p_value"])
    measured = (
        f"least Ljung-Box p = {_n(worst['p_value'])} of {len(rows)}, r1 = {_n(worst['r1'])}, channel "
        f"{worst['channel']} of run {worst['run']}"
    )
    if worst["p_value"] >= WHITENESS_LEVEL / len(rows):
        return f"Under this noise the residuals pass for white ({measured})."
    return f"Under this noise the residuals are still autocorrelated ({measured}): intervals are too narrow."


def _divergence_text(tree: xr.DataTree) -> str:
    if statistics.has(tree, "sample_stats/diverging"):
        return f"{int(tree['sample_stats']['diverging'].sum())} transitions of the sampler diverged"
    if "diverged_fraction" in tree.attrs:
        return (
            f"with {100 * float(tree.attrs['diverged_fraction']):.3g} % of the draws the ship diverged on the records"
        )
    return "divergences were not recorded"


def _origin(one: Comparison) -> str:
    tree = one.posterior
    prior, sizes, attrs = json.loads(tree.attrs["prior"]), tree["posterior"].sizes, tree.attrs
    laplace = attrs["method"] == "trajectory"
    drawn_by = "draws of the approximation at the mode" if laplace else "draws of NUTS"
    factors = ", ".join(f"{name} {_n(value)}" for name, value in prior["factors"].items())
    return (
        f"{', '.join(attrs['dof'].split()).capitalize()} of {attrs['vessel']}, method {attrs['method']}: "
        f"{sizes['chain']} chains of {sizes['draw']} {drawn_by}; {sizes['coefficient']} coefficients; "
        f"{prior['family']} prior with median factors {factors or 'none'}; noise model {attrs['noise_model']}; "
        f"integrator {attrs['integrator']}."
    )


def _subsections(one: Comparison, ship: Vessel | None, rng: np.random.Generator) -> list[Subsection]:
    tree = one.posterior
    sampled = [_chains(tree), subsections.energy_subsection(tree)] if tree.attrs["method"] != "trajectory" else []
    return [
        _convergence(one),
        *sampled,
        _motion(tree),
        _residuals(tree),
        _coefficients(tree, ship),
        _contraction(tree),
        _directions(tree),
        subsections.correlation_subsection(tree, trajectory.dofs(tree)),
        _leave_one_out(tree),
        _sensitivity(tree),
        _ships(tree, ship, rng),
    ]


def _convergence(one: Comparison) -> Subsection:
    text = (
        "The draws are independent, so there are no chains to test. Pareto k-hat is the shape of the tail of the "
        f"importance weights from the normal approximation to the posterior. Up to {KHAT_LIMIT:g} its means and "
        "intervals are reliable."
    )
    if one.posterior.attrs["method"] != "trajectory":
        text = "Over all coefficients, initial states and sensor offsets."
    worst = subsections.diagnostics_table(one), "Worst value against its limit."
    return Subsection("Convergence diagnostics", text, [worst])


def _chains(tree: xr.DataTree) -> Subsection:
    dataset = statistics.summary(tree)
    names = [str(name) for name in dataset["quantity"].values]
    worst = np.argsort(-np.nan_to_num(dataset["r_hat"].values, nan=np.inf), kind="stable")[:_LISTED]
    coefficients = set(map(str, tree["posterior"].dataset["coefficient"].values))
    chosen = [names[k] for k in worst if names[k] in coefficients][:1]
    pair = statistics.correlated_pairs(tree, 1)[:1]
    chosen = list(dict.fromkeys([*chosen, *(name for one in pair for name in (one["first"], one["second"]))]))
    text = "Drawn are the coefficient of largest R-hat and the most correlated pair (prime values times 1e5)."
    rows, caption = chain_table(dataset.isel(quantity=worst), errors=False), "The {} quantities of largest R-hat."
    return Subsection("Chains", text, [(rows, caption.format(len(worst)))], subsections.chain_images(tree, chosen))


def _motion(tree: xr.DataTree) -> Subsection:
    title = "Measured and fitted motion"
    if lacking := subsections.missing_sentence(tree, *RESIDUAL_VARIABLES, "constant_data/motion"):
        return Subsection(title, f"Not shown: {lacking}")
    caption = "Run {}: block means and the motion at the posterior mode; below, residuals in sd of a block."
    runs = range(tree["constant_data"].sizes["run_index"])
    images = [(f"motion-{k + 1}", trajectory_figures.motion_figure(tree, k), caption.format(k + 1)) for k in runs]
    return Subsection(title, "", [], images)


def _residuals(tree: xr.DataTree) -> Subsection:
    if lacking := subsections.missing_sentence(tree, *RESIDUAL_VARIABLES):
        return Subsection("Residuals", f"Not shown: {lacking}")
    dataset, rows = trajectory.residuals(tree), trajectory.channel_rows(tree)
    columns = heads(number(4), run="run") | heads(str, channel="channel") | heads(number(6), blocks="blocks")
    columns |= heads(_n, block_sd="sd of a block", offset="offset") | heads(str, unit="unit")
    columns |= heads(fixed_point(3), correlation="correlation", chi2="χ²", inside=f"within {SD_LIMIT:g} sd", r1="r1")
    columns |= heads(_n, p_value="Ljung-Box p") | heads(fixed_point(2), largest="largest [sd]")
    columns |= heads(fixed_point(1), at="at [s]")
    caption = (
        "The noise of a block of samples, sensor offset and correlation with the block before, as the noise model has "
        "them, and the residuals once that correlation is taken out: mean square χ², share within "
        f"{SD_LIMIT:g} sd (of normal ones 0.95), r1 and Ljung-Box test over {rows[0]['lags']} lags."
    )
    student = (
        " Under Student's t the sd is that of the information in a block; its mean scatters more, since the fit weighs "
        "single samples, and χ² lies above 1."
    )
    text = _white(tree) + (student if tree.attrs["noise_model"].startswith("student_t") else "")
    band = "Their autocorrelation; band of each run ± 1.96/√n."
    against = "Quantiles of these residuals against those of the normal."
    images = [("autocorrelation", trajectory_figures.autocorrelation_figure(dataset), band)]
    images.append(("quantiles", trajectory_figures.quantiles_figure(dataset), against))
    return Subsection("Residuals", text, [(table(rows, columns), caption)], images)


def _coefficients(tree: xr.DataTree, ship: Vessel | None) -> Subsection:
    title = "Coefficients"
    if lacking := subsections.missing_sentence(tree, *PRIOR_VARIABLES):
        return Subsection(title, f"Not shown: {lacking}")
    dataset = trajectory.contraction(tree)
    tails = tree["posterior"].dataset["coefficients"].quantile(statistics.TAILS, ("chain", "draw"))
    dataset = dataset.assign(lower=tails[0].drop_vars("quantile"), upper=tails[1].drop_vars("quantile"))
    tables, images, inside, total = [], [], 0, 0
    for dof in dict.fromkeys(map(str, dataset["dof"].values)):
        one = dataset.isel(coefficient=dataset["dof"].values == dof)
        marks = _marks(ship, dof, [str(name) for name in one["coefficient"].values])
        if ship:
            within = (one["lower"].values <= marks["reference"]) & (marks["reference"] <= one["upper"].values)
            inside, total = inside + int(within.sum()), total + within.size
        values = "parameters" if dof == trajectory.MODULAR_GROUP else "prime values"
        caption = f"{dof.capitalize()}, {values} times 1e5; equal-tailed (eti) intervals of {_CI}."
        tables.append((coefficient_table(one, one, marks), caption))
        intervals = f"{dof.capitalize()}: mean, 50 % and {_CI} eti."
        images.append((f"forest-{dof}", trajectory_figures.forest_figure(tree, dof, marks), intervals))
    coverage_text = f" The {_CI} intervals cover {inside} of {total} reference values." if ship else ""
    return Subsection(title, f"{subsections.DETERMINATION_TEXT}{coverage_text}", tables, images)


def _marks(ship: Vessel | None, dof: str, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Reference and published values of the coefficients of a DOF by what they are called."""
    if ship is None:
        return {}
    known = dict(zip(coefficient_names(ship), reference_coefficients(ship), strict=True))
    reference = np.array([known[name] for name in names])
    if dof not in ship.forces:
        return {"reference": reference}
    published = subsections.published_estimates(ship, dof).items()
    return {"reference": reference} | {f"publ. {name.removesuffix('ugate')}.": values for name, values in published}


def _contraction(tree: xr.DataTree) -> Subsection:
    title = "Contraction"
    if lacking := subsections.missing_sentence(tree, *PRIOR_VARIABLES):
        return Subsection(title, f"Not shown: {lacking}")
    text = "Contraction is 1 − posterior variance / prior variance at its median factors; 1 under a flat prior."
    caption = f"Contraction of every coefficient; dashed: limit {statistics.CONTRACTION_LIMIT:g}."
    figure = trajectory_figures.contraction_figure(trajectory.contraction(tree))
    return Subsection(title, text, [], [("contraction", figure, caption)])


def _directions(tree: xr.DataTree) -> Subsection:
    title = "Directions that stay unknown"
    if lacking := subsections.missing_sentence(tree, *PRIOR_VARIABLES):
        return Subsection(title, f"Not shown: {lacking}")
    dataset = trajectory.directions(tree)
    if not dataset.sizes["direction"]:
        return Subsection(title, "Not shown: every coefficient has a flat prior, which gives a direction no unit.")
    count = min(max(_WEAKEST, dataset.attrs["n_unknown"]), dataset.sizes["direction"])
    rows = [
        {"remaining": float(dataset["remaining_variance"][k]), "direction": str(dataset["text"].values[k])}
        for k in range(count)
    ]
    columns = heads(fixed_point(3), remaining="prior variance left") | heads(
        str, direction="largest components, in prior sd"
    )
    text = (
        "Principal directions of one half of the draws in prior standard deviations, and the variance of the other "
        "half along them; a share is known to a tenth or so and may come out above 1."
    )
    caption = f"The {len(rows)} least known directions."
    left = f"Prior variance left along every direction; dashed: {UNKNOWN:g}."
    image = ("directions", trajectory_figures.directions_figure(dataset), left)
    return Subsection(title, text, [(table(rows, columns), caption)], [image])


def _leave_one_out(tree: xr.DataTree) -> Subsection:
    title = "Leave-one-out by block"
    if lacking := subsections.missing_sentence(tree, "log_likelihood/response"):
        return Subsection(title, f"Not shown: {lacking}")
    loo = statistics.cross_validation(trajectory.without_diverged_draws(tree))
    text = (
        f"{subsections.loo_sentences(loo, 'block', 6)} Neighbouring blocks of a trajectory are not exchangeable, so "
        "the elpd compares models of the same record only. For the forecast of a manoeuvre leave out whole runs, or "
        "the future of one."
    )
    return Subsection(title, text, [], [subsections.pareto_image(loo, "block")])


def _sensitivity(tree: xr.DataTree) -> Subsection:
    title = "Sensitivity to prior and likelihood"
    if lacking := subsections.missing_sentence(tree, "log_prior/coefficients", "log_likelihood/response"):
        return Subsection(title, f"Not shown: {lacking}")
    rows = statistics.prior_sensitivity(trajectory.without_diverged_draws(tree))
    moved = sum(row["prior"] > PSENSE_LIMIT for row in rows)
    text = f"{moved} of {len(rows)} coefficients move with the prior at the median factors of its scales."
    shown = sorted(rows, key=lambda row: -row["prior"])[:_LISTED]
    caption = (
        f"The {len(shown)} most sensitive to the prior. Power-scaling by 0.99 and 1.01 (psense); above "
        f"{PSENSE_LIMIT:g} a coefficient is moved."
    )
    return Subsection(title, text, [(sensitivity_table(shown, "coefficient"), caption)])


def _ships(tree: xr.DataTree, ship: Vessel | None, rng: np.random.Generator) -> Subsection:
    """Ships of the prior at its median factors."""
    if lacking := subsections.missing_sentence(tree, *PRIOR_VARIABLES):
        return Subsection(subsections.SHIPS_TITLE, f"Not shown: {lacking}")
    prior = trajectory.prior_of(tree)
    if not np.isfinite(prior.scale).all():
        return Subsection(subsections.SHIPS_TITLE, "Not shown: a coefficient with a flat prior has no draws.")
    subsection = subsections.ships_subsection(tree, ship, prior, rng)
    subsection.text += " The records chose the factors of its scales." * bool(subsection.tables)
    return subsection


TRAJECTORIES = PosteriorKind(
    check=trajectory.check_trajectory,
    coefficient_names=lambda vessel, _: coefficient_names(vessel),
    verdict=_verdict,
    origin=_origin,
    subsections=_subsections,
    contraction=lambda tree: None if statistics.missing(tree, *PRIOR_VARIABLES) else trajectory.contraction(tree),
    defaults=_DEFAULTS,
    sources=_SOURCES,
)
"""The posterior of all coefficients, from whole trajectories."""
