"""Tables in ``reports`` that pages of the documentation quote."""

from __future__ import annotations

import csv
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def table(name: str) -> list[dict[str, str]]:
    """Rows of a table, named by its path in ``reports`` without ``.csv``."""
    with (ROOT / "reports" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def row(name: str, column: str, value: str) -> dict[str, str]:
    """The one row of a table with this value in a column."""
    (match,) = [line for line in table(name) if line[column] == value]
    return match


def interval_summary() -> str:
    """Sentence on all cells and the worst ones."""
    rows = table("intervals/cells")
    hold = {name: [float(line[name]) for line in rows] for name in ("coverage", "coverage_half")}
    worst = {name: min(rows, key=lambda line: float(line[name])) for name in hold}
    parts = [
        f"intervals of {level} % cover {sum(hold[name]) / len(rows):.1f} %, at worst {min(hold[name]):.0f} % "
        f"({worst[name]['ship']}, {worst[name]['manoeuvre'].removesuffix(' port')}, noise "
        f"{100 * float(worst[name]['level']):g} %)"
        for name, level in (("coverage", 90), ("coverage_half", 50))
    ]
    return f"Over {len(rows)} cells {' and '.join(parts)}."


def foreign_text() -> str:
    """Report of ``make foreign``."""
    return (ROOT / "reports" / "foreign" / "foreign.md").read_text(encoding="utf-8")


def foreign_summary() -> dict[str, str]:
    """Cases, indices inside their intervals, and the error and half width of a tactical diameter [%]."""
    pattern = (
        r"(?P<cases>\d+) of \d+ cases identified; (?P<inside>\d+ of \d+) indices inside \((?P<share>\d+) %.*"
        r"\|error\| (?P<error>\S+) %, median half width (?P<half_width>\S+) %"
    )
    match = re.search(pattern, foreign_text())
    assert match
    return match.groupdict()


def foreign_diameters() -> dict[str, list[tuple[float, float, float]]]:
    """Median and ends of the 95 % interval less the truth [%], of both tactical diameters by case."""
    diameters: dict[str, list[tuple[float, float, float]]] = {}
    for line in foreign_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 10 and cells[2] == "tactical diameter":
            truth, _, lower, upper = map(float, cells[3:7])
            ends = float(cells[7]), 100.0 * (lower / truth - 1.0), 100.0 * (upper / truth - 1.0)
            diameters.setdefault(cells[0], []).append(ends)
    return diameters


def left_out_rows() -> list[str]:
    """Rows kind, trials, ships, and mean percentages of indices in intervals of 95 and 50 %, of the kinds left out."""
    cells: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for line in table("left_out/tables/ships"):
        held = float(line["hold_95"]), float(line["hold_50"])
        cells.setdefault((line["hull"], line["trials"]), []).append(held)
    return [
        f"| {kind} | {trials} | {len(held)} | {sum(h for h, _ in held) / len(held):.0f} | "
        f"{sum(h for _, h in held) / len(held):.0f} |"
        for (kind, trials), held in sorted(cells.items())
    ]
