"""Kinds of posterior, and the subsections of the diagnostic page that they share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymc_ship.diagnostics import figures
from pymc_ship.diagnostics import posterior_statistics as statistics
from pymc_ship.diagnostics.agreement import Comparison
from pymc_ship.diagnostics.posterior_statistics import CI_PROB, CONTRACTION_LIMIT, ENVELOPE, SD_LIMIT
from pymc_ship.diagnostics.tables import ENDS
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.machine.errors import VesselError
from pymc_ship.pages.tables import Table, fixed_point, heads, number, percent, table
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.draws import coefficient_draws
from pymc_ship.ships.forecasting.prior_ships import (
    STANDARD,
    RegressionPrior,
    index_row,
    prior_ships,
    simulate_draws,
    status_row,
)

if TYPE_CHECKING:
    from arviz_stats.utils import ELPDData

SHIPS = 200
"""Ships of the prior, and of the posterior, in each manoeuvre of a section: a share of a half is known to 3.5 %."""

SHIPS_TITLE = "Ships of the prior and of the posterior"  # title of the subsection on ships drawn from the prior
_OUTCOMES = heads(str, manoeuvre="manoeuvre", of="ships of the") | ENDS
_BANDS = heads(str, index="index", manoeuvre="manoeuvre", prior="prior") | heads(
    fixed_point(1), prior_reached="reached %"
)
_BANDS |= heads(str, posterior="posterior") | heads(fixed_point(1), posterior_reached="reached %")

DETERMINATION_TEXT = (
    f"Determined: contraction > {CONTRACTION_LIMIT:g} and |mean| > {SD_LIMIT:g} sd; prior: contraction not above "
    f"{CONTRACTION_LIMIT:g}; includes zero: narrowed by the data, but zero lies within {SD_LIMIT:g} sd of the mean."
)
"""Meaning of :data:`pymc_ship.diagnostics.posterior_statistics.DETERMINATIONS`."""


@dataclass(frozen=True)
class PosteriorKind:
    """A kind of posterior and the sections of its page, listed in :data:`.POSTERIOR_KINDS`."""

    check: Callable[[xr.DataTree, str], None]  # ValueError for a tree of another kind
    coefficient_names: Callable[[Vessel, xr.DataTree], list[str]]  # in order
    verdict: Callable[[Comparison], list[str]]  # sentences at the head
    origin: Callable[[Comparison], str]  # sentence on the origin of the draws
    subsections: Callable[[Comparison, Vessel | None, np.random.Generator], list["Subsection"]]  # in order
    contraction: Callable[[xr.DataTree], xr.Dataset | None] = lambda _: None  # None where prior or data are missing
    defaults: str = ""  # limits of such a section, beyond those of all sections
    sources: tuple[str, ...] = ()  # literature, likewise


@dataclass
class Subsection:
    """One subsection of a section of the page: title, text, tables and figures with their captions."""

    title: str
    text: str = ""
    tables: list[tuple[Table, str]] = field(default_factory=list)
    images: list[tuple[str, Figure, str]] = field(default_factory=list)


def record_remarks(tree: xr.DataTree) -> list[str]:
    """Remarks of the checks on the records of a posterior."""
    return tree.attrs.get("record_remarks", "").splitlines()


def convergence_sentence(one: Comparison) -> str:
    """Sentence on the convergence diagnostics of all methods."""
    if failed := one.failed_diagnostics:
        return f"A convergence diagnostic fails: {'; '.join(failed)}. Do not rely on the numbers below."
    return "All convergence diagnostics pass."


def published_estimates(ship: Vessel | None, dof: str) -> dict[str, np.ndarray]:
    """Published estimates of a degree of freedom by prior family; families without any are left out."""
    estimates = {family: ship.published_estimates(dof, family) for family in FAMILIES} if ship else {}
    return {family: values for family, values in estimates.items() if np.isfinite(values).any()}


def missing_sentence(tree: xr.DataTree, *wanted: str) -> str:
    """Sentence on the missing variables; empty where all are there."""
    lacking = statistics.missing(tree, *wanted)
    return f"the tree has no {' and no '.join(lacking)}." if lacking else ""


def diagnostics_table(one: Comparison) -> Table:
    """Worst value of every convergence diagnostic of each method, and its limit."""
    columns = heads(str, method="method") if len(one.trees) > 1 else {}
    columns |= heads(str, diagnostic="diagnostic") | heads(number(4), value="value")
    columns |= heads(str, where="of", limit="limit", passes="passes")
    rows = [
        {"method": method, **row, "passes": "yes" if row["passes"] else "no"}
        for method, diagnostics in one.convergence_diagnostics.items()
        for row in diagnostics
    ]
    return table(rows, columns)


def determination_counts(contraction: xr.Dataset) -> tuple[int, ...]:
    """How many coefficients the data determine, how many follow the prior, and how many intervals include zero."""
    labels = statistics.determination_labels(contraction).tolist()
    return tuple(map(labels.count, statistics.DETERMINATIONS))


def determination_sentence(contraction: xr.Dataset) -> str:
    """Sentence on what determines the coefficients."""
    determined, prior, zero = determination_counts(contraction)
    rest = [f"{prior} follow{'s' * (prior == 1)} the prior"] if prior else []
    verb = "has an interval that includes" if zero == 1 else "have intervals that include"
    rest += [f"{zero} {verb} zero"] if zero else []
    text = f"{determined} of {contraction.sizes['coefficient']} coefficients are determined by the data"
    return f"{text}; {' and '.join(rest)}." if rest else f"{text}."


def chain_images(tree: xr.DataTree, names: list[str]) -> list[tuple[str, Figure, str]]:
    """Traces, ranks where there are two chains, and growth of the effective sample size of some quantities."""
    ranked = (
        "Fractional ranks, each chain's distribution function minus the uniform one, with the p-value of uniformity "
        f"(black: where it fails at the {100 * (1 - ENVELOPE):.0f} % level; envelope_prob {ENVELOPE:g})."
    )
    growth = (
        f"Bulk (blue) and tail ESS (orange) against the number of draws at {figures.ESS_POINTS} points; "
        f"dashed: {statistics.ESS_LIMIT:g}."
    )
    images = [("trace", figures.trace(tree, names), "Trace, one colour a chain.")]
    if tree["posterior"].sizes["chain"] > 1:
        images.append(("rank", figures.rank(tree, names), ranked))
    return [*images, ("ess", figures.effective_sample_size(tree, names), growth)]


def energy_subsection(tree: xr.DataTree) -> Subsection:
    """E-BFMI and energies of a Hamiltonian sampler."""
    if lacking := missing_sentence(tree, "sample_stats/energy"):
        return Subsection("Energy", f"Not shown: {lacking}")
    caption = f"E-BFMI of each chain, limit {statistics.E_BFMI_LIMIT:g}; marginal energy and its transitions."
    return Subsection("Energy", "", [], [("energy", figures.energy(tree), caption)])


def correlation_subsection(tree: xr.DataTree, dofs: Sequence[str] = ()) -> Subsection:
    """Strongest posterior correlations, draws of the first pair, and a heat map with lines between ``dofs``."""
    title, pairs = "Correlation of the coefficients", statistics.correlated_pairs(tree)
    if not pairs or pairs[0]["correlation"] == 0.0:
        return Subsection(title, "Not shown: there is no pair of coefficients that vary.")
    columns = heads(str, first="coefficient", second="and") | heads(fixed_point(4), correlation="posterior correlation")
    strongest = table(pairs, columns), f"The {len(pairs)} strongest posterior correlations."
    caption = f"Posterior correlation of all coefficients{', degrees of freedom parted' * bool(dofs)}."
    shown = f"About {figures.PAIR_DRAWS} draws of the most correlated pair, with marginals."
    pair = figures.pair(tree, [pairs[0]["first"], pairs[0]["second"]])
    images = [("pair", pair, shown), ("correlation", figures.correlation(tree, dofs), caption)]
    return Subsection(title, "", [strongest], images)


def pareto_image(loo: "ELPDData", unit: str) -> tuple[str, Figure, str]:
    """Pareto k of every row or block of a leave-one-out cross-validation."""
    return "pareto", figures.pareto_k(loo), f"Pareto k of every {unit}; dashed: limit {loo.good_k:.2f}."


def loo_sentences(loo: "ELPDData", unit: str, digits: int) -> str:
    """The elpd, in so many digits, and how many rows or blocks have too large a Pareto k."""
    k, n = np.ravel(loo.pareto_k.values), number(3)
    worst = int(np.argmax(k))
    return (
        f"elpd {number(digits)(float(loo.elpd))} ± {n(float(loo.se))}, p_loo {n(float(loo.p))}. "
        f"{int(np.sum(k > loo.good_k))} of {k.size} {unit}s have a Pareto k above {loo.good_k:.2f}; the largest is "
        f"{n(float(k[worst]))}, row {worst}."
    )


def ships_subsection(
    tree: xr.DataTree,
    ship: Vessel | None,
    prior: CoefficientPrior | dict[str, RegressionPrior],
    rng: np.random.Generator,
) -> Subsection:
    """Draws of prior and posterior in the standard manoeuvres: how they end, and bands of their indices.

    Degrees of freedom outside the regression have the vessel's reference values under both.
    """
    if ship is None:
        return Subsection(SHIPS_TITLE, "Not shown: the simulation needs a vessel; give it by --vessel.")
    try:
        ship.check_model()
    except VesselError as error:
        return Subsection(SHIPS_TITLE, f"Not shown: {error}")
    posterior = tree if isinstance(prior, CoefficientPrior) else dict.fromkeys(prior, tree)
    outcomes, bands, drawn = [], [], []
    for manoeuvre, names in STANDARD.items():
        rows = coefficient_draws(ship, posterior, SHIPS, rng)
        both = {
            "prior": prior_ships(ship, prior, manoeuvre, draws=SHIPS, rng=rng),
            "posterior": simulate_draws(ship, rows, manoeuvre, rng),
        }
        outcomes += [{"of": of, **status_row(ships)} for of, ships in both.items()]
        for name in names:
            one = {of: index_row(ships, name, ship.particulars.L, ci_prob=CI_PROB) for of, ships in both.items()}
            label = f"{name.replace('_', ' ')} [{one['prior']['unit']}]"
            bands.append({"index": label, "manoeuvre": manoeuvre.label} | _band_cells(one))
            drawn.append((f"{label}\n{manoeuvre.label}", one))
    fixed_dofs = both["prior"].attrs["fixed_dofs"].split()
    fixed_text = f" {', '.join(fixed_dofs).capitalize()} keep the reference values of the vessel." if fixed_dofs else ""
    text = (
        f"One ship for each of {SHIPS} draws. Course-unstable: a small disturbance of the straight course grows. Wrong "
        f"way: the heading changes against the rudder first.{fixed_text}"
    )
    tables = [
        (table(outcomes, _OUTCOMES), "Percentages of the ships; one may count in several of the first three."),
        (table(bands, _BANDS), f"Equal-tailed bands of {percent(CI_PROB)} over the ships that reach the index."),
    ]
    caption = f"Median and equal-tailed {percent(CI_PROB)} of the indices under prior (grey) and posterior (blue)."
    return Subsection(SHIPS_TITLE, text, tables, [("ships", figures.index_bands(drawn), caption)])


def _band_cells(one: dict[str, dict]) -> dict:
    n = number(3)
    cells: dict[str, Any] = {}
    for of, row in one.items():
        band = f"{n(row['median'])} ({n(row['lower'])} to {n(row['upper'])})"
        cells |= {of: band if np.isfinite(row["median"]) else "–", f"{of}_reached": row["reached"]}
    return cells
