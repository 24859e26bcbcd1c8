"""Diagnostic report of posteriors: one self-contained HTML page, a section for each and the methods that drew it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np
import xarray as xr

from pymc_ship.diagnostics import parts as diagnostic_parts
from pymc_ship.diagnostics import regression as diagnostics
from pymc_ship.diagnostics import trajectory_parts
from pymc_ship.diagnostics.agreement import LEVEL, Comparison, comparisons
from pymc_ship.diagnostics.parts import Part
from pymc_ship.diagnostics.regression import PSENSE_LIMIT, WHITENESS_LEVEL
from pymc_ship.diagnostics.tables import CI_PROB
from pymc_ship.diagnostics.trajectory import check_trajectory, of_trajectories
from pymc_ship.machine.files import staged, writable_folder
from pymc_ship.pages import drawing
from pymc_ship.pages.page import rendered
from pymc_ship.pages.tables import number
from pymc_ship.trajectory.prior import coefficient_names
from pymc_ship.vessel.vessel import Vessel, VesselError, load_vessel

PAGE = "diagnostics.html"
"""Name of the page in its folder."""

SOURCES = (
    "Vehtari, Gelman, Simpson, Carpenter & Buerkner (2021), Bayesian Analysis 16(2):667, doi:10.1214/20-BA1221",
    "Betancourt (2018), A conceptual introduction to Hamiltonian Monte Carlo, arXiv:1701.02434",
    "Vehtari, Gelman & Gabry (2017), Statistics and Computing 27:1413, doi:10.1007/s11222-016-9696-4",
    "Kallioinen, Paananen, Buerkner & Vehtari (2024), Statistics and Computing 34:57, doi:10.1007/s11222-023-10366-5",
    "Ljung & Box (1978), Biometrika 65(2):297, doi:10.1093/biomet/65.2.297",
)

_n = number(3)


def diagnostic_report(
    trees: Mapping[str, xr.DataTree],
    out: str | Path,
    vessel: Vessel | str | Path | None = None,
    *,
    seed: int = 2020,
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write the diagnostic report of saved posteriors.

    Parameters
    ----------
    trees : mapping of str to DataTree
        Posteriors by the name of their section, of regressions or of whole trajectories, from
        :func:`~pymc_ship.regression.tree.read_posterior` or a function that draws one. A part whose groups a tree does
        not have says so in one sentence. Draws of the data and prior of an exact posterior that is given, too, share
        its section and are compared with it.
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
        The page, ``out/diagnostics.html``; a gate that fails is said there and does not stop the report.

    Raises
    ------
    ValueError
        When there is no tree, or one is no posterior of this package.
    VesselError
        For a vessel that cannot be read or is another than that of a posterior.
    OutputError
        When the folder cannot be written.
    """
    ship = load_vessel(vessel) if isinstance(vessel, str | Path) else vessel
    check_trees(trees, ship)
    return write_diagnostics(comparisons(trees), writable_folder(out), ship, seed=seed, progress=progress)


def write_diagnostics(
    compared: Sequence[Comparison], out: Path, ship: Vessel | None, *, seed: int, progress: Callable[[str], None]
) -> Path:
    """Write the report of compared posteriors to a folder; parameters and errors as :func:`diagnostic_report`."""
    page = diagnostic_page(compared, ship, seed=seed, progress=progress)
    with staged(out / PAGE) as partial:
        partial.write_text(page, encoding="utf-8")
    return out / PAGE


def diagnostic_page(
    compared: Sequence[Comparison],
    ship: Vessel | None,
    *,
    seed: int,
    progress: Callable[[str], None],
    back: str = "",
) -> str:
    """The page as text, one section a comparison; ``back`` is the page that it belongs to."""
    images: dict[str, str] = {}
    sections = []
    for k, one in enumerate(compared):
        progress(f"diagnosing {one.name}")
        sections.append(_section(f"posterior-{k + 1}", one, ship, np.random.default_rng(seed), images))
    return _render(sections, images, back, trajectories=any(of_trajectories(one.posterior) for one in compared))


def check_trees(trees: Mapping[str, xr.DataTree], vessel: Vessel | None) -> None:
    """Raise a ValueError when there is no tree, one is no posterior, or one is of another vessel."""
    if not trees:
        raise ValueError("A diagnostic report needs at least one posterior, found none; give trees by name.")
    for name, tree in trees.items():
        (check_trajectory if of_trajectories(tree) else diagnostics.check_posterior)(tree, name)
        if vessel is None:
            continue
        if tree.attrs["vessel"] != vessel.name:
            raise VesselError(
                f"The posterior is to be of {vessel.name!r}, found {tree.attrs['vessel']!r} in {name}; use its vessel."
            )
        names = [str(value) for value in tree["posterior"]["coefficient"].values]
        if names != _names_of(vessel, tree):
            raise VesselError(
                f"The posterior is to hold the {tree.attrs['dof']} coefficients of {vessel.name!r} in order, found "
                f"{', '.join(names)} in {name}; use the vessel it was made with."
            )


def _names_of(vessel: Vessel, tree: xr.DataTree) -> list[str]:
    """Coefficients that a posterior of the vessel holds: those of its DOF, or of all."""
    if of_trajectories(tree):
        return coefficient_names(vessel)
    return [str(value) for value in vessel.coefficients(tree.attrs["dof"])["coefficient"].values]


def verdict(one: Comparison) -> list[str]:
    """What heads a section, of a regression or of whole trajectories."""
    return (trajectory_parts if of_trajectories(one.posterior) else diagnostic_parts).verdict(one)


def parts(one: Comparison, ship: Vessel | None, rng: np.random.Generator) -> list[Part]:
    """Every part of a section, of a regression or of whole trajectories."""
    if of_trajectories(one.posterior):
        return trajectory_parts.parts(one, ship)
    return diagnostic_parts.parts(one, ship, rng)


def _section(
    identifier: str, one: Comparison, ship: Vessel | None, rng: np.random.Generator, images: dict[str, str]
) -> dict:
    shown = []
    for part in parts(one, ship, rng):
        captions = []
        for kind, figure, caption in part.images:
            images[f"{identifier}-{kind}"] = drawing.embedded(figure, part.title)
            captions.append((f"{identifier}-{kind}", caption))
        shown.append({"title": part.title, "text": part.text, "tables": part.tables, "figures": captions})
    failed = ["a gate fails"] * bool(one.failed_gates) + ["methods disagree"] * bool(one.disagreements)
    return {
        "id": identifier,
        "name": one.name,
        "failed": ", ".join(failed),
        "verdict": verdict(one),
        "origin": trajectory_parts.origin(one) if of_trajectories(one.posterior) else _origin(one),
        "parts": shown,
    }


def _origin(one: Comparison) -> str:
    """What was estimated, how the draws were made, and under which prior."""
    tree = one.posterior
    prior, sizes = json.loads(tree.attrs["prior"]), tree["posterior"].sizes
    hyperparameters = ", ".join(f"{key} {_plain(prior[key])}" for key in ("mean", "kappa", "shape", "scale"))
    drawn = "; ".join(
        f"{name if len(one.trees) > 1 else f'method {given.attrs["method"]}'}, "
        f"{given['posterior'].sizes['chain']} chains of {given['posterior'].sizes['draw']} draws"
        for name, given in one.trees.items()
    )
    return (
        f"{tree.attrs['dof'].capitalize()} of {tree.attrs['vessel']}, {drawn}; {sizes['coefficient']} coefficients; "
        f"{prior['family']} prior on the scaled columns: {hyperparameters}."
    )


def _plain(value: float | list) -> str:
    return _n(value) if not isinstance(value, list) else f"{_n(min(value))} to {_n(max(value))}"


def _render(sections: list[dict], images: Mapping[str, str], back: str, *, trajectories: bool) -> str:
    return rendered(
        "diagnostics/page.html.j2",
        title=f"Diagnostics of {len(sections)} posterior{'s' * (len(sections) > 1)}",
        defaults=(
            f"Intervals are equal-tailed (ci_kind eti) of {100 * CI_PROB:g} % (ci_prob {CI_PROB:g}). Gates: R-hat < "
            f"{diagnostics.R_HAT_LIMIT:g}, bulk and tail ESS > {diagnostics.ESS_LIMIT:g}, no divergence, E-BFMI > "
            f"{diagnostics.E_BFMI_LIMIT:g}. Agreement: |z| within the two-sided normal quantile at {LEVEL:g} over the "
            f"number of comparisons. Whiteness at the {100 * WHITENESS_LEVEL:g} % level, "
            f"sensitivity above {PSENSE_LIMIT:g}.{f' {trajectory_parts.DEFAULTS}' if trajectories else ''}"
        ),
        back=back,
        sections=sections,
        figures=images,
        versions=", ".join(f"{name} {version(name)}" for name in ("pymc-ship", "arviz", "numpy", "scipy", "xarray")),
        sources=(*SOURCES, *(trajectory_parts.SOURCES if trajectories else ())),
    )
