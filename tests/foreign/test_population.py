"""Ships of the population: drawn, brought to scale, and what is said of their intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from pymc_ship.forecasting.index_error import BEYOND
from pymc_ship.forecasting.motion_error import GROWTH
from tests.foreign import mmg, population, sailing
from tests.foreign.population import HULLS, TRIALS, drawn, scaled
from tests.foreign.population_page import (
    LEADS,
    STATED,
    Bands,
    Moved,
    Row,
    band_rows,
    borne_out,
    coverage_rows,
    fitted_beyond,
    fitted_growth,
    moved_rows,
    page,
    reliability_figure,
    reliability_rows,
)


@pytest.fixture(scope="module")
def ships():
    return [drawn(number, seed=3) for number in (0, 2, 4, 6)]


@pytest.mark.consistency
def test_each_hull_takes_its_turn_and_no_ship_is_one_of_the_four(ships):
    assert [one.hull for one in ships] == list(HULLS)
    nominal = [mmg.kvlcc2(), mmg.cargo(), *(ship() for ship in (sailing_of("mariner"), sailing_of("s175")))]
    for one, ship in zip(ships, nominal, strict=True):
        own, other = (
            row["tactical_diameter"] / L
            for row, L in ((one.truth["circle 35 port"], one.ship.papers.L), (circle(ship), ship.papers.L))
        )
        assert abs(own / other - 1.0) > 1e-3


def sailing_of(name):
    return {"mariner": population.mariner.Mariner, "s175": population.s175.S175}[name]


def circle(ship):
    trial = sailing.Trial("circle", 35.0, side="port")
    return sailing.indices(sailing.sail(ship, trial, interval=0.1), trial)


@pytest.mark.consistency
def test_a_ship_is_the_same_for_her_number_and_seed(ships):
    again = drawn(2, seed=3)
    assert again == ships[1]
    assert drawn(2, seed=4).truth != again.truth


@pytest.mark.consistency
def test_her_records_are_those_of_her_trials_with_noise(ships):
    one = ships[1]
    records = one.records(3)
    assert len(records) == len(TRIALS[one.trials])
    for record in records:
        assert {"u", "v", "r", "psi", "delta", "n"} <= set(record)
        assert np.abs(np.diff(record["u"], 2)).max() > 0.0


@pytest.mark.consistency
def test_a_scaled_ship_sails_the_same_circle_in_lengths():
    whole, small = mmg.kvlcc2(), scaled(mmg.kvlcc2(), 0.7)
    assert pytest.approx(0.7 * whole.papers.L) == small.papers.L
    quick = sailing.Trial("circle", 35.0)
    found = []
    for ship in (whole, small):
        rate = {"rudder_rate_deg": 2.34 * whole.papers.unit / ship.papers.unit, "rudder_delay": 0.0}
        papers = population.replace(ship.papers, **rate)
        record = sailing.sail(population.replace(ship, papers=papers), quick, interval=0.1)
        found.append(np.array(list(sailing.indices(record, quick).values())) / ship.papers.L)
    np.testing.assert_allclose(*found, rtol=2e-3)


def rows_of(share, n=2000):
    """Rows whose errors have a known sd, and a share of the distance beyond the runs on top."""
    rng = np.random.default_rng(4)
    found = []
    for k in range(n):
        beyond = float(rng.uniform(0.0, 4.0))
        sd = float(np.hypot(0.02, BEYOND * beyond))
        error = float(np.hypot(0.02, share * beyond) * rng.standard_normal())
        what = (k % 40, HULLS[k % 4], "one 20/20", "circle 35 port", "advance")
        ends = {"lower": error - 1.96 * sd, "upper": error + 1.96 * sd}
        known = {"sd": sd, "beyond": beyond, "pit": float(norm.cdf(-error / sd)), "crps": sd}
        found.append(Row(*what, error=error, **ends, **known))
    return found


@pytest.mark.parametrize("share", [0.004, BEYOND, 0.03])
def test_the_growth_is_found_from_the_errors(share):
    assert fitted_beyond(rows_of(share)) == pytest.approx(share, rel=0.15)


def test_coverage_is_that_of_the_rows():
    right, narrow = (coverage_rows(rows_of(share))[0] for share in (BEYOND, 0.03))
    assert right[:3] == ["all", "40", "2000"]
    assert float(right[3].split()[0]) == pytest.approx(95.0, abs=2.0)
    assert float(right[4]) == pytest.approx(50.0, abs=4.0)
    assert float(narrow[3].split()[0]) < 85.0  # broken twin: errors that grow three times as fast


def test_statements_hold_as_often_as_they_say_and_those_of_narrow_intervals_do_not():
    right, narrow = (reliability_rows(rows_of(share))[2] for share in (BEYOND, 0.03))
    assert right[:2] == ["all", "4000"]
    for stated, cell in zip(STATED, right[2:], strict=True):
        share, error = map(float, cell.split(" ± "))
        assert abs(share - 100.0 * stated) < 4.0 * error
    share, error = map(float, narrow[-1].split(" ± "))
    assert share < 99.0 - 4.0 * error


def test_the_figure_has_a_line_within_and_one_beyond():
    fig = reliability_figure(rows_of(BEYOND, 400))
    assert [text.get_text() for text in fig.axes[0].get_legend().get_texts()] == [
        "as stated",
        "within one range of the runs",
        "beyond",
    ]
    stated, within = (line.get_ydata() for line in fig.axes[0].get_lines()[:2])
    assert np.abs(within - stated).max() < 0.1


def test_sure_statements_beyond_the_runs_are_counted():
    rows = rows_of(BEYOND, 400)
    held, made = borne_out(rows)
    assert made == 800
    assert abs(held / made - 0.99) < 4.0 * np.sqrt(0.99 * 0.01 / made)
    assert borne_out([replace(row, beyond=0.0) for row in rows]) == (0, 0)


def test_bands_are_told_by_lead_with_the_worst_ship():
    bands = [Bands(k, lead, 0.9 + 0.1 * (k % 2), 0.8 + 0.1 * (k % 2)) for k in range(20) for lead in LEADS]
    assert [row[0] for row in band_rows(bands)] == ["1", "5", "15"]
    assert band_rows(bands)[0][1:] == ["20", "95 ± 1", "90", "85 ± 1", "80"]


def moved_of(growth, n=3000, seed=3):
    """Errors of every state whose sd grows, beside an sd that counts on the growth of the package."""
    rng, found = np.random.default_rng(seed), []
    for name, counted in GROWTH.items():
        far = rng.choice([0.0, 0.5, 3.0, 20.0], n)
        sd, true = np.hypot(0.01, counted * far), np.hypot(0.01, growth * far)
        found += [
            Moved(k % 20, name, float(e), float(s), float(f), float(f))
            for k, (e, s, f) in enumerate(zip(true * rng.standard_normal(n), sd, far, strict=True))
        ]
    return found


@pytest.mark.parametrize("growth", [0.001, 0.007])
def test_the_growth_of_the_motion_is_found_from_the_errors(growth):
    assert list(fitted_growth(moved_of(growth)).values()) == pytest.approx([growth] * len(GROWTH), rel=0.2)


def test_instants_in_bands_are_told_by_the_distance():
    """Of ships that err three times as much beyond their runs, the broken twin, fewer are held there."""
    u, wild = (moved_rows(moved_of(growth))[0] for growth in (GROWTH["u"], 3.0 * GROWTH["u"]))
    assert u[0] == "u"
    assert [float(cell.split()[0]) for cell in u[1:4]] == pytest.approx([90.0] * 3, abs=3.0)
    assert float(u[4]) < 75.0
    assert float(wild[3].split()[0]) < 70.0


def test_the_page_tells_both_halves_apart_and_who_was_refused():
    text = page(
        rows_of(BEYOND, 80),
        [Bands(k, 5.0, 0.9, 0.9) for k in range(80)],
        [Moved(k, name, 0.01, 0.01, 1.0, 1.0) for k in range(80) for name in GROWTH],
        {7: "No term set can be fitted."},
        "make population",
        "Ships.",
    )
    assert "## Ships that BEYOND was chosen on, numbers below 30" in text
    assert "## Ships that show it, from number 30 on" in text
    assert text.endswith("Ship 7 was refused: No term set can be fitted.\n")
