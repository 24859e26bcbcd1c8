"""Page of an identification in which every term set was refused: where each of them fails."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pymc_ship.pages.drawing import REFERENCE, styled, subplots
from pymc_ship.pages.page import Content, Page, write_page
from pymc_ship.pages.tables import number, table
from pymc_ship.physics.vessel.term_sets import holds_any_speed
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.checks.verdicts import Check
from pymc_ship.ships.identification.candidates import Refusal
from pymc_ship.ships.identification.page import check_rows
from pymc_ship.ships.identification.soundness import FASTEST, TIGHTEST

PAGE = Page(
    "refused.html",
    Path(__file__).with_name("refusal_page.html.j2"),
    own=("figures/runaways.png", "tables/refusals.csv", "tables/doubts.csv"),
    packages=("pymc-ship", "numpy", "scipy", "xarray", "numba", "matplotlib"),
)
"""The page stands beside that of an identification that succeeded before."""


def write_refusal_page(
    refusals: Sequence[Refusal],
    vessel: Vessel,
    checks: Mapping[str, Sequence[Check]],
    out: str | Path,
    *,
    command: str,
) -> Path:
    """Write the page of refused term sets.

    Parameters
    ----------
    refusals : sequence of Refusal
        Of a :class:`pymc_ship.machine.errors.FitError`.
    vessel : Vessel
    checks : mapping of str to sequence of Check
        Of each run, by its name.
    out : str or Path
        Folder, created where it is missing.
    command : str
        What repeats the page.

    Returns
    -------
    Path
        ``out/refused.html``.

    Raises
    ------
    OutputError
        When the folder cannot be written.
    """
    rows = [_row(refusal) for refusal in refusals]
    doubts = [row for row in check_rows(checks) if row["verdict"] in ("doubtful", "bad")]
    columns = {
        "terms": ("term set", str),
        "manoeuvre": ("fails in", str),
        "time": ("after [s]", number(3)),
        "fault": ("she", str),
    }
    heads = {
        "run": ("run", str),
        "check": ("check", str),
        "verdict": ("verdict", str),
        "sentence": ("what was found", str),
    }
    values = {
        "vessel": vessel,
        "tables": {"refusals": table(rows, columns), "doubts": table(doubts, heads)},
        "sentences": [refusal.sentence for refusal in refusals if refusal.failure is None],
        "command": command,
    }
    shown = [refusal for refusal in refusals if refusal.failure is not None]
    drawn = {"runaways": runaways(shown)} if shown else {}
    return write_page(PAGE, out, Content(values, drawn, {"refusals": rows, "doubts": doubts}))


def _row(refusal: Refusal) -> dict:
    failure = refusal.failure
    if failure is None:
        return {"terms": refusal.name, "manoeuvre": "the fit itself", "time": np.nan, "fault": "cannot be fitted"}
    return {
        "terms": refusal.name,
        "manoeuvre": failure.manoeuvre.label,
        "time": failure.time,
        "fault": failure.fault,
    }


@styled
def runaways(refusals: Sequence[Refusal]) -> Figure:
    """Speed and rate of turn of the ships that run away, against time in L/U, and what a ship may reach.

    Parameters
    ----------
    refusals : sequence of Refusal
        Each with its failure.

    Returns
    -------
    Figure
    """
    fig, axes = subplots(8.0, 4.2, 2, 1, sharex="col")
    speed_axes, turn_axes = axes[:, 0]
    for refusal in refusals:
        ship, particulars = refusal.failure.motion, refusal.vessel.particulars
        speed = np.hypot(ship["u"].values, ship["v"].values)
        time = ship["time"].values / particulars.ship_time
        (line,) = speed_axes.plot(time, speed / particulars.nominal_speed, label=refusal.name)
        turn = ship["r"].values * particulars.L / np.maximum(speed, 1e-3 * particulars.nominal_speed)
        turn_axes.plot(time, turn, color=line.get_color())
    speed_axes.axhline(FASTEST, color=REFERENCE, ls="--", lw=0.9)
    ahead = not all(holds_any_speed(refusal.vessel) for refusal in refusals)
    for side in (1.0, -1.0) if ahead else ():
        turn_axes.axhline(side / TIGHTEST, color=REFERENCE, ls="--", lw=0.9)
    speed_axes.set_ylabel("speed over nominal")
    turn_axes.set(xlabel="time [L/U]", ylabel="rL/U")
    fig.legend(*speed_axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig
