"""Results of the study in sentences, tables and figures."""

import numpy as np
from matplotlib.figure import Figure

from pymc_ship.pages.tables import fixed_point, heads, number, table
from pymc_ship.records.files.noise import LITERAL_LEVEL
from pymc_ship.replication import bound_chapter, figures
from pymc_ship.replication.measurements import PAPER_FAMILIES, level_of_error
from pymc_ship.replication.prior_ships import POSTERIOR
from pymc_ship.replication.study import StudyResult
from pymc_ship.replication.tables import ERROR_COUNTS

SOURCES = (
    "Johnstone & Silverman (2004), Annals of Statistics 32(4):1594, doi:10.1214/009053604000000030",
    "Johnstone & Silverman (2005), Annals of Statistics 33(4):1700, doi:10.1214/009053605000000345",
    "Jones, Schonlau & Welch (1998), Journal of Global Optimization 13:455, doi:10.1023/A:1008306431147",
    "IMO (2002), Standards for ship manoeuvrability, resolution MSC.137(76)",
)

_n = number(2)


def _median(rows: list[dict], level: float | str, family: str) -> float:
    """Median error over all DOFs in an error table; NaN where there is no such row."""
    medians = (r["median"] for r in rows if r["level"] == level and r["family"] == family and r["dof"] == "all")
    return next(medians, float("nan"))


def _forecast(result: StudyResult, name: str, level: float, family: str) -> dict:
    rows = result.tables[f"forecast_{name}"]
    return next(row for row in rows if row["level"] == level and row["family"] == family)


def short(result: StudyResult) -> list[str]:
    """Five sentences that head the page: published errors, methods, forecasts and samplers."""
    blocks = [block for by_dof in result.agreement.values() for block in by_dof.values()]
    worst = max(blocks, key=lambda block: float(block["largest_z"].max()))
    agreeing = f"Gibbs sampler and NUTS agree with the exact posterior in {count_agreeing(result)} comparisons"
    if all(bool(block["agrees"].all()) for block in blocks):
        agreeing += f" (largest |z| {float(worst['largest_z'].max()):.2f}, limit {worst.attrs['z_limit']:.2f})"
        agreeing += ", so the choice of sampler does not explain the errors"
    published, medians = [], _published_medians(result)
    if np.isfinite(medians).all():
        errors = f"{_n(medians[0])} % (conjugate) and {_n(medians[1])} % (semi-conjugate)"
        published = [f"The published median errors are {errors}. {_where_published(result)}"]
    return [*published, *bound_chapter.short(result), f"{agreeing}."]


def _published_medians(result: StudyResult) -> list[float]:
    return [_median(result.tables["published"], "published", family) for family in PAPER_FAMILIES]


def count_agreeing(result: StudyResult) -> str:
    """Number of comparisons in which draws agree with the exact posterior, of all of them."""
    flags = np.concatenate([d["agrees"].values for by_dof in result.agreement.values() for d in by_dof.values()])
    return f"{int(flags.sum())} of {flags.size}"


def _where_published(result: StudyResult) -> str:
    published = _median(result.tables["published"], "published", "conjugate")
    level = level_of_error(result.tables["sweep"], published)
    if not np.isfinite(level):
        return "The paper's method does not reach them at any noise level of the sweep."
    return (
        f"The paper's method reaches them at a noise level of about {_n(level)}, {_n(LITERAL_LEVEL / level)} times below "
        f"the printed one of {LITERAL_LEVEL:.3f}."
    )


def sweep_figure(result: StudyResult) -> Figure:
    """Median error against noise level."""
    rows = result.tables["sweep"]
    levels = np.array([row["level"] for row in rows if row["dof"] == "all"])
    errors = {
        dof: np.array([row["median"] for row in rows if row["dof"] == dof]) for dof in (*result.vessel.dofs, "all")
    }
    published = _median(result.tables["published"], "published", "conjugate")
    return figures.errors_by_level(levels, errors, published, level_of_error(rows, published))


def all_findings(result: StudyResult) -> list[dict]:
    """Title, text and, where there is one, table or figure of each finding."""
    sections = [_discretisation, _noise, _differencing, _forecasts, _coverage, _prior_ships]
    if any(row["printed"] for row in result.tables["printed_errors"]):
        sections += [_eq15, _printed_errors, _other_slips]
    return [section(result) for section in sections]


def _finding(title: str, text: str, **more: object) -> dict:
    return {"title": title, "text": text, "table": None, "figure": None, "caption": ""} | more


def _discretisation(result: StudyResult) -> dict:
    rows = result.tables["discretisation"]
    forward, central = rows[1], rows[2]
    dofs = result.vessel.dofs
    text = (
        "Without noise only the error of differencing remains. The record has Euler steps, so its Euler difference at the "
        "step is exact. The forward difference of the same record sampled each second has median errors "
        f"of {_n(min(forward[d] for d in dofs))} to {_n(max(forward[d] for d in dofs))} % by degree of freedom, the "
        f"central difference {_n(min(central[d] for d in dofs))} to {_n(max(central[d] for d in dofs))} %."
    )
    columns = heads(str, differences="differences") | heads(_n, **{dof: f"{dof} %" for dof in dofs})
    columns |= heads(_n, worst="worst coefficient %")
    return _finding("Errors of discretisation alone", text, table=table(rows, columns))


def _noise(result: StudyResult) -> dict:
    literal = _median(result.tables["errors"], LITERAL_LEVEL, "conjugate")
    at_literal = f" At the literal level the median error is {_n(literal)} %." if np.isfinite(literal) else ""
    where = f" {_where_published(result)}" if np.isfinite(_published_medians(result)).all() else ""
    text = (
        "The sweep runs one pipeline (denoiser, Euler differences, conjugate posterior at the evidence maximum) at each "
        f"level.{where}{at_literal}"
    )
    caption = "Median absolute error of the non-zero coefficients against the noise level, one noise seed a level."
    return _finding("How the errors grow with the noise", text, figure="sweep", caption=caption)


def _differencing(result: StudyResult) -> dict:
    rows = result.tables["differencing"]
    best = min(rows, key=lambda row: row["median"])
    chosen = next(row for row in rows if row["derivative"] == "euler" and row["interval"] == "1 s")
    text = (
        f"At the level shown, on the same denoised record and at the evidence maximum: the smallest median error, "
        f"{_n(best['median'])} %, comes from the {best['derivative']} derivative ({best['interval']}); the paper's choice, "
        f"Euler differences and a row each second, which the main tables keep, has {_n(chosen['median'])} %. "
        f"{_denoisers(result)}"
    )
    columns = heads(str, derivative="derivative", interval="rows") | heads(_n, median="median %") | ERROR_COUNTS
    return _finding("How the accelerations are formed", text, table=table(rows, columns))


def _denoisers(result: StudyResult) -> str:
    errors = {row["method"].replace("_", " "): row["median"] for row in result.tables["denoisers"]}
    raw = errors.pop("none")
    sentences = ", ".join(f"{method} {_n(error)} %" for method, error in errors.items())
    return (
        f"With these differences the median error depends on the denoiser, too ({sentences}; none {_n(raw)} %), and not as "
        "its signal-to-noise ratio does (section 2)."
    )


def _forecasts(result: StudyResult) -> dict:
    rows = []
    for row in result.tables["errors"]:
        if row["dof"] == "all":
            key = (row["level"], row["family"])
            rows.append(
                {
                    "level": row["level"],
                    "family": row["family"],
                    "coefficients": row["median"],
                    "zigzag": _forecast(result, "zigzag", *key)["error"],
                    "turn": _forecast(result, "turning_circle", *key)["error"],
                    "diverged": _forecast(result, "turning_circle", *key)["diverged"],
                }
            )
    shown = next(row for row in rows if row["level"] == result.level)
    text = (
        f"At the level shown a coefficient is off by {_n(shown['coefficients'])} % in the median, the forecast of a "
        f"10/10 zigzag by {_n(shown['zigzag'])} % of the range of its channels: errors of collinear terms cancel in the "
        f"motion. The 35 deg turn, an extrapolation, is off by {_n(shown['turn'])} %, with "
        f"{_n(shown['diverged'])} % of the draws diverged."
    )
    columns = heads(number(3), level="noise level") | heads(str, family="family")
    columns |= heads(_n, coefficients="coefficient error %", zigzag="zigzag RMSE/range %", turn="turn RMSE/range %")
    columns |= heads(fixed_point(1), diverged="turn diverged %")
    return _finding("Forecasts can be good where coefficients are not", text, table=table(rows, columns))


def _coverage(result: StudyResult) -> dict:
    rows = [row for row in result.tables["errors"] if row["dof"] == "all"]
    row = next(row for row in rows if row["level"] == result.level and row["family"] == "conjugate")
    zigzag = _forecast(result, "zigzag", result.level, "conjugate")
    text = (
        f"At the level shown the 90 % intervals of the conjugate family cover {_n(row['coverage'])} % of the reference "
        f"coefficients, and the 90 % bands of the 10/10 zigzag {_n(zigzag['coverage'])} % of its instants. The "
        "samplers agree with the exact posterior (section 6), so a difference from 90 % is due to the model: the "
        f"regression assumes independent denoised rows and exact columns. {_coverage_of_draws(result)}"
    )
    return _finding("Coverage of the regression's intervals", text)


def _coverage_of_draws(result: StudyResult) -> str:
    rows, sentences = result.tables["drawn_coefficients"], []
    for derivative in dict.fromkeys(row["derivative"] for row in rows):
        mine = [row for row in rows if row["derivative"] == derivative]
        wider, before, after = (_range(mine, key) for key in ("widened", "coverage", "coverage_pooled"))
        sentences.append(
            f"{derivative} intervals become {wider} times as wide and cover {after} % by degree of freedom, {before} % before"
        )
    return f"With draws of the denoised record in the rows, {'; '.join(sentences)} (section 5)."


def _range(rows: list[dict], key: str) -> str:
    return f"{_n(min(row[key] for row in rows))} to {_n(max(row[key] for row in rows))}"


def _prior_ships(result: StudyResult) -> dict:
    after = [row for row in result.tables["prior_ships"] if row["choice"] == POSTERIOR]
    before = [row for row in result.tables["prior_ships"] if row["choice"] != POSTERIOR]
    text = (
        f"Of the ships drawn from the priors {_range(before, 'diverged')} % diverge in a standard manoeuvre, and at most "
        f"{_n(max(row['complete'] for row in before))} % neither diverge nor turn the wrong way nor are course-unstable "
        f"(section 4). Of the ships drawn from the posteriors {_range(after, 'diverged')} % diverge within 40 L/U; the "
        "forecasts of section 7 end earlier, so fewer diverge there."
    )
    return _finding("Ships drawn from the priors", text)


def _eq15(result: StudyResult) -> dict:
    rows = result.tables["full_conditional"]
    slip = min(abs(row["z_full_conditional"]) for row in rows)
    right = max(abs(row["z_marginal"]) for row in rows)
    text = (
        "Eq. 15 of the paper, offered as the marginal of the noise variance, has the shape A + (n + c)/2 of its full "
        "conditional; the marginal has A + n/2. NUTS uses neither formula: against the marginal its means of "
        f"sigma2 lie within |z| = {right:.1f}, against the other shape at least {slip:.1f} Monte-Carlo errors away."
    )
    columns = heads(str, dof="DOF") | heads(number(5), mcmc="NUTS mean of sigma2") | heads(_n, mcse="MCSE")
    columns |= heads(fixed_point(2), z_marginal="z, shape A + n/2")
    columns |= heads(fixed_point(1), z_full_conditional="z, shape A + (n + c)/2")
    return _finding("Slip: the shape of the noise variance", text, table=table(rows, columns))


def _printed_errors(result: StudyResult) -> dict:
    rows = result.tables["printed_errors"]
    surge = rows[0]
    rest = ", ".join(
        f"{row['dof']} ({row['fit_other']} against {row['fit_own']} of {row['printed']})" for row in rows[1:]
    )
    text = (
        "Recomputing the printed errors from the printed estimates and references: in surge "
        f"{surge['fit_other']} of {surge['printed']} fit the estimate of the other family and {surge['fit_own']} the one "
        f"beside them; in {rest} it is the other way round, so the two error columns of surge are exchanged in the print. "
        "Both published estimates of Xv are 24.0e-5 against a printed reference of 41.0e-5, "
        "so that reference may be a misprint."
    )
    columns = heads(str, dof="DOF", printed="printed errors", fit_own="fit the estimate beside them")
    columns |= heads(str, fit_other="fit the other family's")
    return _finding("Slip: two columns of errors", text, table=table(rows, columns))


def _other_slips(result: StudyResult) -> dict:
    text = (
        "The inverse gamma of the paper has density proportional to x^(-A-1) exp(-1/(B x)), so its B is the reciprocal of "
        "the scale that PyMC and scipy use; here scale = 1/B throughout. The words independent and dependent are exchanged "
        "between the two priors: the family that ties beta to sigma2 is the conjugate one, and it is under that reading "
        f"that exact posterior and NUTS agree ({count_agreeing(result)} comparisons above). Which channel carries the "
        "factor 1.0 in the noise is contradictory in the print; it is sway velocity here. The signs of the coefficients "
        "are lost in the print; every one carries the source of its sign."
    )
    return _finding("Slips settled by reading", text)


def optimisation_gain(result: StudyResult) -> str:
    """Sentence on the gain of Bayesian optimisation over the evidence maximum."""
    every = [one for by_dof in result.identifications[result.level].tuned.values() for one in by_dof.values()]
    gains, errors = [one.score - one.evidence_score for one in every], [one.score_se for one in every]
    return (
        f"What the optimisation gained over the evidence maximum: between {min(gains):.4f} and {max(gains):.4f} nats per "
        f"row over degrees of freedom and families, where the standard error over folds is {min(errors):.2f} or more."
    )
