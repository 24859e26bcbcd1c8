"""The page of the study, with tables as CSV and posteriors as NetCDF."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pymc_ship.diagnostics.page import PAGE as DIAGNOSTICS
from pymc_ship.diagnostics.page import diagnostic_content
from pymc_ship.inference.regression.families import prior_family
from pymc_ship.inference.regression.tree import CITATIONS, write_posterior
from pymc_ship.inference.trajectory.posterior import KHAT_LIMIT
from pymc_ship.machine.arguments import check_callables, check_counts
from pymc_ship.machine.files import writable_folder
from pymc_ship.pages import drawing
from pymc_ship.pages.page import Content, Page, render_page, write_page
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.records.files.noise import LITERAL_LEVEL, noise_sd
from pymc_ship.replication import bound_chapter, figures, findings
from pymc_ship.replication.measurements import PAPER_FAMILIES
from pymc_ship.replication.study import DURATION, STEP, StudyResult, run_study
from pymc_ship.replication.tables import agreement_blocks, csv_tables, dof_block, page_tables

PAGE = Page(
    "index.html",
    Path(__file__).with_name("page.html.j2"),
    own=("figures/*.png", "tables/*.csv", "posteriors/*.nc"),
    packages=("pymc-ship", "pymc", "arviz", "numpy", "scipy", "xarray", "numba"),
    digits=6,
)
"""The page of the study, with its posteriors and their diagnostic page in the folder."""

_ARVIZ_PLOTS = {
    "trace": ({}, "trace of the coefficient of each degree of freedom with the largest |z|, one colour a chain."),
    "rank": (
        {"envelope_prob": 0.99},
        "fractional ranks of the same draws, each chain's distribution function minus the uniform one, with the "
        "p-value of uniformity (black: where it fails at the 1 % level).",
    ),
}


def study(
    out: str | Path,
    *,
    vessel: VesselLike = "container",
    level: float = 0.01,
    seed: int = 2020,
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
    """Run the paper's study and write its report.

    Parameters
    ----------
    out : str or Path
        Folder of the report; created where it is missing. An earlier report is replaced when the run is complete.
    vessel : str or Path, optional
        Shipped vessel or TOML file.
    level : float, optional
        Noise level shown in detail.
    seed : int, optional
        Root of every random number; the same seed gives the same report.
    progress : callable, optional
        Called with a short text before each step.

    Returns
    -------
    Path
        The page, ``out/index.html``; it and ``out/diagnostics.html`` name a convergence diagnostic that fails.

    Raises
    ------
    VesselError, OutputError
        For a vessel that cannot be read or a folder that cannot be written.
    """
    return reported_study(out, vessel=vessel, level=level, seed=seed, progress=progress)[1]


def reported_study(
    out: str | Path, *, vessel: VesselLike, level: float, seed: int, progress: Callable[[str], None]
) -> tuple[StudyResult, Path]:
    """Result and page of :func:`study`."""
    check_callables(progress=progress)
    check_counts(least=0, seed=seed)
    ship, level = as_vessel(vessel), noise_sd(level)  # before the folder is made
    out = writable_folder(out)
    result = run_study(ship, level=level, seed=seed, progress=progress)
    return result, write_study(result, out, progress=progress)


def write_study(result: StudyResult, out: Path, *, progress: Callable[[str], None] = lambda _: None) -> Path:
    """Write pages, figures, tables and posteriors to a folder; ``index.html`` last, when all are complete."""
    content = diagnostic_content(result.comparisons, result.vessel, seed=result.seed, progress=progress, back=PAGE.file)
    diagnosed = render_page(DIAGNOSTICS, content)
    progress("report")
    return write_page(PAGE, out, study_content(result, diagnosed))


def study_content(result: StudyResult, diagnosed: str) -> Content:
    """Content of the page, from the result and the diagnostic page as text."""
    exact, trace = result.identifications[result.level].exact, _trace_figures(result)
    values = {
        "title": f"{result.vessel.name.capitalize()} ship: coefficients and forecasts from a noisy 20/20 zigzag",
        "subtitle": (
            f"Noise level shown {result.level:g}, seed {result.seed}. Bayesian regression of {result.bound.size} "
            "coefficients, exact and by Markov chains, after Xue, Liu, Ji & Xue (2020)."
        ),
        "short": findings.short(result),
        "vessel_title": result.vessel.title,
        "duration": f"{DURATION:g}",
        "step": f"{STEP:g}",
        "side": result.trial.attrs["side"],
        "signs": _signs(result),
        "level": f"{result.level:g}",
        "rows": next(iter(result.identifications[result.level].data.values())).n_rows,
        "optimisation_gain": findings.optimisation_gain(result),
        "printed_level": f"{LITERAL_LEVEL:.3f}",
        "published_text": bound_chapter.published_text(result),
        "khat_limit": f"{KHAT_LIMIT:g}",
        "dofs": [dof_block(result, dof, exact) for dof in result.vessel.dofs],
        "tables": page_tables(result),
        "trace_figures": [(name, caption) for name, _, caption in trace],
        "diagnostics": DIAGNOSTICS.file,
        "comparisons": next(iter(result.agreement[PAPER_FAMILIES[0]].values())).attrs["comparisons"],
        "n_agreeing": findings.count_agreeing(result),
        "agreement_blocks": agreement_blocks(result),
        "findings": findings.all_findings(result),
        "bound": bound_chapter.chapter(result),
        "command": f"pymc-ship study --vessel {result.vessel.name} --level {result.level:g} --seed {result.seed}",
    }
    figures = _figures(result) | {name: image for name, image, _ in trace}
    paper, *methods = CITATIONS.values()
    families = filter(None, (prior_family(family).citation for family in PAPER_FAMILIES))
    sources = [*result.vessel.sources, paper, *families, *methods, *findings.SOURCES]
    return Content(values, figures, csv_tables(result), _files(result, diagnosed), sources)


def _files(result: StudyResult, diagnosed: str) -> dict[str, Callable[[Path], object]]:
    posteriors = {
        f"posteriors/{dof}-{family}-{method}.nc": partial(write_posterior, tree)
        for family, methods in result.draws.items()
        for method, trees in methods.items()
        for dof, tree in trees.items()
    }
    return posteriors | {DIAGNOSTICS.file: lambda path: path.write_text(diagnosed, encoding="utf-8")}


def _signs(result: StudyResult) -> str:
    sources = [str(s) for dof in result.vessel.dofs for s in result.vessel.coefficients(dof)["sign_source"].values]
    return ", ".join(f"{sources.count(name)} {name}" for name in dict.fromkeys(sources))


def _figures(result: StudyResult) -> dict[str, Figure]:
    level = result.level
    identification = result.identifications[level]
    return {
        "denoising": figures.denoising(result.trial, result.noisy[level], result.smooth[level], (100.0, 130.0)),
        "noise_variance": figures.noise_variance(
            {family: identification.exact[family]["surge"] for family in PAPER_FAMILIES}, "surge"
        ),
        "tuning": figures.tuning(identification.tuned["conjugate"]),
        "sample_paths": _sample_paths(result),
        "sweep": findings.sweep_figure(result),
        "methods": bound_chapter.figure(result),
    } | {
        f"forecast_{name}": figures.forecast_channels(result.references[name], trees)
        for name, trees in result.forecasts.items()
    }


def _sample_paths(result: StudyResult) -> Figure:
    names = {dof: list(result.vessel.coefficients(dof)["coefficient"].values) for dof in result.vessel.dofs}
    wanted = {name: dof for name, dof in {"Xu": "surge", "Kv|v|": "roll"}.items() if name in names.get(dof, ())}
    wanted = wanted or {names[dof][0]: dof for dof in ("surge", "sway")}
    return figures.sample_paths(
        {
            name: (
                result.draws["semiconjugate"]["gibbs"][dof],
                float(result.vessel.coefficients(dof).sel(coefficient=name)),
            )
            for name, dof in wanted.items()
        }
    )


def _trace_figures(result: StudyResult) -> list[tuple[str, str, str]]:
    """Name, image and caption of trace and rank plots of NUTS: for each DOF the coefficient with the largest |z|."""
    panels = []
    for family, by_dof in result.agreement.items():
        worst = {}
        for dof, dataset in by_dof.items():
            score = np.abs(dataset["z_mean"].sel({"method": "nuts"}).values[:-1])
            worst[dof] = str(dataset["quantity"].values[int(score.argmax())])
        trees = {dof: result.draws[family]["nuts"][dof] for dof in by_dof}
        for kind, (settings, caption) in _ARVIZ_PLOTS.items():
            image = drawing.html_image(figures.arviz_panels(f"plot_{kind}", trees, worst, **settings), caption)
            panels.append((f"{kind}_{family}", image, f"NUTS, {family} family: {caption}"))
    return panels
