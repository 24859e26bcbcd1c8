"""Term sets that are refused: a page of their own, or a section on the page of the ship, says where each fails."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.machine.errors import FitError
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.records.checks.verdicts import Check
from pymc_ship.ships.ensemble.feasibility import FASTEST, TIGHTEST, first_failure, is_feasible
from pymc_ship.ships.identification.candidates import Refusal
from pymc_ship.ships.identification.page import write_refusals, write_ship_report
from tests.ships.identification.three_zigzags import model, runs


@pytest.fixture(scope="module")
def tanker():
    return ps.load_vessel("kvlcc2")


def changed(vessel, name, factor):
    """Coefficients of a vessel, one of them multiplied."""
    row = reference_coefficients(vessel).copy()
    row[list(coefficient_names(vessel)).index(name)] *= factor
    return row


@pytest.fixture(scope="module")
def spinning(tanker):
    """The rudder turns the ship thirty times as hard."""
    return changed(tanker, "Ngsincos", 30.0)


def test_a_sound_ship_has_no_failure(tanker):
    assert first_failure(tanker, reference_coefficients(tanker)) is None


def test_the_first_failure_is_where_the_motion_leaves_what_a_ship_can_do(tanker, spinning):
    failure = first_failure(tanker, spinning)
    assert not is_feasible(tanker, spinning[None])[0]
    assert "in the zigzag 10/10 port the ship " in str(failure)
    ship = failure.motion
    assert float(ship["time"][-1]) == failure.time
    speed = np.hypot(ship["u"], ship["v"])
    within = (np.abs(ship["r"]) * tanker.particulars.L * TIGHTEST <= speed) & (
        speed <= FASTEST * tanker.particulars.nominal_speed
    )
    assert bool(within[:-1].all())
    assert not bool(within[-1]) or failure.fault == "leaves the model's range"


@pytest.fixture(scope="module")
def refusals(tanker, spinning):
    return (
        Refusal("quadratic", "The quadratic terms were left out: no minimum.", None, None),
        Refusal("cubic", "The cubic terms run away.", tanker, first_failure(tanker, spinning)),
    )


def test_the_page_shows_every_refused_set_and_the_doubts(tanker, refusals, tmp_path):
    checks = {"run": (Check("approach", "doubtful", "On the approach r is +25%."), Check("gaps", "good", "None."))}
    page = write_refusals(refusals, tanker, checks, tmp_path, command="pymc-ship identify run.csv")
    assert page == tmp_path / "refused.html"
    text = page.read_text(encoding="utf-8")
    for words in (
        "no minimum",
        "zigzag 10/10 port",
        "On the approach",
        "pymc-ship identify run.csv",
        "diverging_motion",
    ):
        assert words in text
    with (tmp_path / "tables" / "refusals.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["terms"] for row in rows] == ["quadratic", "cubic"]
    assert float(rows[1]["time"]) == pytest.approx(refusals[1].failure.time)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_a_ship_of_other_sets_has_a_section_on_those_that_were_refused(refusals, tmp_path):
    """And none where no set was refused."""
    found, text = model(), {}
    for name, refused in (("some", refusals), ("none", ())):
        settings = {"command": "", "seed": 1}
        page = write_ship_report(replace(found, refusals=refused), runs(), {}, tmp_path / name, **settings)
        text[name] = page.read_text(encoding="utf-8")
        assert (page.parent / "tables" / "refusals.csv").exists() == bool(refused)
        assert (page.parent / "figures" / "diverging_motion.png").exists() == bool(refused)
    section = text["some"][text["some"].index('<section id="refusals">') :]
    assert "zigzag 10/10 port" in section[: section.index("</section>")]
    assert 'id="refusals"' not in text["none"]


def test_sets_that_are_all_refused_carry_their_refusals(tanker):
    refusals = [Refusal("cubic", "The cubic terms run away.")]
    error = FitError("No term set can be fitted.", refusals=refusals)
    assert error.refusals == tuple(refusals)
    assert "The cubic terms run away." in str(replace(error.refusals[0]).sentence)
