"""Report of the frontier: tables as CSV, one figure and one HTML page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from pymc_ship.machine.files import writable_folder
from pymc_ship.pages.page import Content, Page, write_page
from pymc_ship.pages.tables import Table, fixed_point, number, percent, table
from pymc_ship.physics.vessel.reading import load_vessel
from pymc_ship.physics.vessel.vessel import Vessel
from studies.frontier.figures import from_the_bound_down
from studies.frontier.measure import Measurement, frontier
from studies.frontier.tables import aim_rows, bound_down_rows, coefficient_rows, measurement_rows, noise_rows

PAGE = Page("index.html", Path(__file__).with_name("page.html.j2"), own=("figures/*.png", "tables/*.csv"), digits=6)
"""The page of the frontier, alone in its folder."""


def reported_frontier(
    out: str | Path, *, seeds: int = 25, seed: int = 2020, progress: Callable[[str], None] = lambda _: None
) -> tuple[str, Path]:
    """Measure the frontier on the container ship and report it.

    Parameters
    ----------
    out : str or Path
        Folder of the report; created where it is missing. An earlier report is replaced when the run is complete.
    seeds : int, optional
        Data sets of each kind and noise level.
    seed : int, optional
        Root of every random number; the same seed gives the same tables.
    progress : callable, optional
        Called with a short text after each data set.

    Returns
    -------
    str, Path
        The table with the aims as Markdown, and the page, ``out/index.html``.

    Raises
    ------
    ValueError
        For fewer than two seeds.
    OutputError
        For a folder that cannot be written.
    """
    vessel, out = load_vessel("container"), writable_folder(out)
    found = frontier(vessel, seeds=seeds, seed=seed, progress=progress)
    return markdown(aim_table(aim_rows(found))), write_frontier(found, vessel, out, seeds=seeds, seed=seed)


def write_frontier(found: Sequence[Measurement], vessel: Vessel, out: Path, *, seeds: int, seed: int) -> Path:
    """Write tables, figure and page to a folder when all are complete.

    Parameters
    ----------
    found : sequence of Measurement
        With the bound, both fits and the regressions of the cell ``white``.
    vessel : Vessel
    out : Path
    seeds, seed : int
        What it was measured with.

    Returns
    -------
    Path
        ``out/index.html``, which is moved into place last.

    Raises
    ------
    OutputError
        When the folder cannot be written.
    """
    rows = {
        "aims": aim_rows(found),
        "from_the_bound_down": bound_down_rows(found),
        "fits": noise_rows(found),
        "coefficients": coefficient_rows(found, vessel),
        "measurements": measurement_rows(found),
    }
    figures = {"from_the_bound_down": from_the_bound_down(rows["from_the_bound_down"])}
    return write_page(PAGE, out, Content(_values(rows) | {"seeds": seeds, "seed": seed}, figures, rows))


def aim_table(rows: Sequence[Mapping]) -> Table:
    """One line for each measure: at every level the value, its standard error and, where there is one, the aim."""
    levels = sorted({row["level"] for row in rows})
    lines: dict[str, dict] = {}
    for row in rows:
        line = lines.setdefault(row["measure"], {"measure": row["measure"], "unit": row["unit"]})
        line[row["level"]] = f"{number(3)(row['value'])} ± {number(1)(row['se'])}"
        line[f"aim {row['level']}"] = f"{_limits(row)} {_VERDICTS[row['met']]}".strip()
    columns = {"measure": ("20/20 zigzag, white noise at level", str), "unit": ("", str)}
    for level in levels:
        columns |= {level: (percent(level), str), f"aim {level}": ("aim", str)}
    return table([dict.fromkeys(columns, "") | line for line in lines.values()], columns)


_VERDICTS = {"yes": "met", "no": "NOT MET", "": ""}


def _limits(row: Mapping) -> str:
    """Limits of an aim in words; nothing where there is none."""
    least, greatest = (f"{row[key]:g}" for key in ("least", "greatest"))
    if not row["met"]:
        return ""
    if row["least"] == row["greatest"]:
        return least
    if not np.isfinite(row["least"]):
        return f"≤ {greatest}"
    return f"{least} to {greatest}" if np.isfinite(row["greatest"]) else f"≥ {least}"


def markdown(shown: Table) -> str:
    """Table as Markdown."""
    lines = [shown.heads, ["---"] * len(shown.heads), *shown.cells]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _values(rows: Mapping[str, Sequence[Mapping]]) -> dict:
    """What the template shows of the rows: aims met and missed, and tables."""
    judged = [row for row in rows["aims"] if row["met"]]
    missed = [row for row in judged if row["met"] == "no"]
    n, level = number(3), ("noise level", number(3))
    down = {"level": level, "method": ("method", str), "by": ("by", str), "median_error": ("median error %", n)}
    down |= {"se": ("± se", number(1)), "times_bound": ("times the bound", n)}
    fits = {"cell": ("data", str), "level": level, "estimator": ("fit", str), "median_error": ("median error %", n)}
    fits |= {"coverage": ("coverage %", fixed_point(1)), "se": ("± se", fixed_point(1))}
    fits |= {
        key: (head, fixed_point(0))
        for key, head in {
            "white": "chose white %",
            "ar1": "AR(1) %",
            "student_t": "Student-t %",
            "offsets": "offsets %",
            "failed": "failed %",
        }.items()
    }
    return {
        "judged": len(judged),
        "missed": [f"{r['measure']}, level {r['level']:g}: {n(r['value'])} {r['unit']} ({_limits(r)})" for r in missed],
        "tables": {
            "aims": aim_table(rows["aims"]),
            "down": table(rows["from_the_bound_down"], down),
            "fits": table(rows["fits"], fits),
        },
    }
