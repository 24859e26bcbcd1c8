"""The diagnostic page of posteriors: an overview, then a section for each."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from pymc_ship.diagnostics import posterior_statistics as statistics
from pymc_ship.diagnostics.agreement import Comparison, check_trees, comparisons
from pymc_ship.diagnostics.posterior_statistics import CI_PROB, PSENSE_LIMIT, WHITENESS_LEVEL
from pymc_ship.diagnostics.regression_subsections import REGRESSION
from pymc_ship.diagnostics.subsections import PosteriorKind, determination_counts
from pymc_ship.diagnostics.trajectory import METHODS
from pymc_ship.diagnostics.trajectory_subsections import TRAJECTORIES
from pymc_ship.inference.regression.calibration import LEVEL
from pymc_ship.machine.arguments import check_callables, check_counts
from pymc_ship.machine.errors import VesselError
from pymc_ship.machine.files import writable_folder
from pymc_ship.pages import drawing
from pymc_ship.pages.page import Content, Page, write_page
from pymc_ship.pages.tables import Table, heads, percent, table
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, check_same_vessel

PAGE = Page(
    "diagnostics.html",
    Path(__file__).with_name("page.html.j2"),
    packages=("pymc-ship", "arviz", "numpy", "scipy", "xarray"),
)
"""The diagnostic page, which has no files beside it."""

SOURCES = (
    "Vehtari, Gelman, Simpson, Carpenter & Buerkner (2021), Bayesian Analysis 16(2):667, doi:10.1214/20-BA1221",
    "Betancourt (2018), A conceptual introduction to Hamiltonian Monte Carlo, arXiv:1701.02434",
    "Vehtari, Gelman & Gabry (2017), Statistics and Computing 27:1413, doi:10.1007/s11222-016-9696-4",
    "Kallioinen, Paananen, Buerkner & Vehtari (2024), Statistics and Computing 34:57, doi:10.1007/s11222-023-10366-5",
    "Ljung & Box (1978), Biometrika 65(2):297, doi:10.1093/biomet/65.2.297",
)

_DEFAULTS = (
    f"Intervals are equal-tailed (ci_kind eti) of {percent(CI_PROB)} (ci_prob {CI_PROB:g}). Limits of convergence: "
    f"R-hat < {statistics.R_HAT_LIMIT:g}, bulk and tail ESS > {statistics.ESS_LIMIT:g}, no divergence, E-BFMI > "
    f"{statistics.E_BFMI_LIMIT:g}. Agreement: |z| within the two-sided normal quantile at {LEVEL:g} over the "
    f"number of comparisons. Whiteness at the {percent(WHITENESS_LEVEL)} level, sensitivity above {PSENSE_LIMIT:g}."
)

POSTERIOR_KINDS = dict.fromkeys(METHODS, TRAJECTORIES)
"""Kind of posterior by the method of its draws; a method that is not named here draws that of a regression."""


def diagnostic_report(
    trees: Mapping[str, xr.DataTree],
    out: str | Path,
    vessel: VesselLike | None = None,
    *,
    seed: int = 2020,
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write the diagnostic report of saved posteriors.

    Parameters
    ----------
    trees : mapping of str to DataTree
        Posteriors by the name of their section, from
        :func:`~pymc_ship.inference.regression.tree.read_posterior` or a function that draws one. Draws of the data and
        prior of an exact posterior are compared with it in one section.
    out : str or Path
        Folder of the page; created where it is missing.
    vessel : Vessel, str or Path, optional
        Vessel of the posteriors, a shipped one's name or a TOML file; adds its reference and published values.
    seed : int, optional
        Root of the predictive and prior draws; the same seed gives the same page.
    progress : callable, optional
        Called with a short text before each section.

    Returns
    -------
    Path
        The page, ``out/diagnostics.html``; it names a convergence diagnostic that fails.

    Raises
    ------
    ValueError
        When there is no tree, or one is no posterior of this package.
    VesselError
        For a vessel that cannot be read or is another than that of a posterior.
    OutputError
        When the folder cannot be written.
    """
    check_callables(progress=progress)
    check_counts(least=0, seed=seed)
    ship = None if vessel is None else as_vessel(vessel)
    check_posteriors(trees, ship)
    compared, folder = comparisons(trees), writable_folder(out)
    return write_page(PAGE, folder, diagnostic_content(compared, ship, seed=seed, progress=progress))


def diagnostic_content(
    compared: Sequence[Comparison], ship: Vessel | None, *, seed: int, progress: Callable[[str], None], back: str = ""
) -> Content:
    """Content of the page, one section for each comparison; ``back`` is the page it belongs to."""
    images: dict[str, str] = {}
    sections = []
    for k, one in enumerate(compared):
        progress(f"diagnosing {one.name}")
        sections.append(_section(f"posterior-{k + 1}", one, ship, np.random.default_rng(seed), images))
    kinds = list(dict.fromkeys(posterior_kind(one.posterior) for one in compared))
    values = {
        "title": f"Diagnostics of {len(sections)} posterior{'s' * (len(sections) > 1)}",
        "defaults": " ".join(filter(None, (_DEFAULTS, *(kind.defaults for kind in kinds)))),
        "back": back,
        "overview": _overview(compared),
        "sections": sections,
    }
    sources = (*SOURCES, *(source for kind in kinds for source in kind.sources))
    return Content(values, images, sources=sources)


def _overview(compared: Sequence[Comparison]) -> Table:
    rows = []
    for one in compared:
        contraction = posterior_kind(one.posterior).contraction(one.posterior)
        counts = ("not known",) * 3 if contraction is None else determination_counts(contraction)
        agreement = "disagrees" if one.disagreements else "agrees"
        row = {"posterior": one.name, "convergence": "fails" if one.failed_diagnostics else "passes"}
        row["agreement"] = agreement if one.agreement is not None else "not compared"
        rows.append(row | dict(zip(("determined", "prior", "zero"), counts, strict=True)))
    columns = heads(str, posterior="posterior", convergence="convergence", agreement="exact posterior")
    columns |= heads(str, determined="determined by the data", prior="follow the prior", zero="interval includes zero")
    return table(rows, columns)


def check_posteriors(trees: Mapping[str, xr.DataTree], vessel: Vessel | None) -> None:
    """Raise a ValueError when there is no tree, one is no posterior, or one is of another vessel."""
    check_trees("A diagnostic report", trees)
    for name, tree in trees.items():
        posterior_kind(tree).check(tree, name)
        if vessel is None:
            continue
        check_same_vessel("The posterior", tree.attrs, vessel, f" in {name}")
        names = [str(value) for value in tree["posterior"].dataset["coefficient"].values]
        if names != posterior_kind(tree).coefficient_names(vessel, tree):
            raise VesselError(
                f"The posterior is to hold the {tree.attrs['dof']} coefficients of {vessel.name!r} in order, found "
                f"{', '.join(names)} in {name}; use the vessel it was made with."
            )


def posterior_kind(tree: xr.DataTree) -> PosteriorKind:
    """Kind of posterior that a tree holds."""
    return POSTERIOR_KINDS.get(tree.attrs.get("method", ""), REGRESSION)


def _section(
    identifier: str, one: Comparison, ship: Vessel | None, rng: np.random.Generator, images: dict[str, str]
) -> dict:
    kind, shown = posterior_kind(one.posterior), []
    for subsection in kind.subsections(one, ship, rng):
        captions = []
        for name, figure, caption in subsection.images:
            images[f"{identifier}-{name}"] = drawing.html_image(figure, subsection.title)
            captions.append((f"{identifier}-{name}", caption))
        shown.append({key: getattr(subsection, key) for key in ("title", "text", "tables")} | {"figures": captions})
    failed = ["a convergence diagnostic fails"] * bool(one.failed_diagnostics) + ["methods disagree"] * bool(
        one.disagreements
    )
    return {
        "id": identifier,
        "name": one.name,
        "failed": ", ".join(failed),
        "verdict": kind.verdict(one),
        "origin": kind.origin(one),
        "parts": shown,
    }
