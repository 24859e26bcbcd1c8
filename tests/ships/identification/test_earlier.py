"""A ship identified run after run, as if all runs had been given at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.trajectory.prior import GaussianLikelihood
from pymc_ship.inference.trajectory.sequential_likelihood import EarlierLikelihood
from pymc_ship.machine.errors import InferenceError
from pymc_ship.ships.ensemble.index_table import index_rows
from tests.sentences import refused
from tests.ships.identification.cases import TRUE_TERMS, tanker, trials

RECORDS = [*trials(0), *trials(1)]
SPLIT = 3


def identified(records, prior=None, seed=1, draws=40, **settings):
    terms = {} if prior is not None else {"terms": [TRUE_TERMS]}
    return ps.identify_ship(records, tanker(), prior=prior, draws=draws, rng=seed, **terms, **settings)


@pytest.fixture(scope="module")
def batch():
    return identified(RECORDS)


@pytest.fixture(scope="module")
def first():
    return identified(RECORDS[:SPLIT])


@pytest.fixture(scope="module")
def second(first, tmp_path_factory):
    """Today's runs after yesterday's ship was saved and read again."""
    out = tmp_path_factory.mktemp("ship")
    ps.save_ship(first.ship, out)
    return identified(RECORDS[SPLIT:], ps.load_ship(out))


def fit_of(ship):
    return ship.candidates[0].fit


def distance(one, other):
    """Root mean square difference of coefficients in sd of the second."""
    sd = np.sqrt(np.diag(fit_of(other).covariance))
    return float(np.sqrt(np.mean(((fit_of(one).coefficients - fit_of(other).coefficients) / sd) ** 2)))


def test_batch_and_sequence_are_one(batch, first, second):
    """To a tenth of an sd; today's or yesterday's runs alone, the broken twins, are off by several tenths."""
    alone = identified(RECORDS[SPLIT:])
    assert distance(second, batch) < 0.1
    assert distance(alone, batch) > 0.3
    assert distance(first, batch) > 0.3
    sds = [np.sqrt(np.diag(fit_of(ship).covariance)) for ship in (second, batch, alone)]
    assert 0.9 < np.median(sds[0] / sds[1]) < 1.25
    assert np.median(sds[2] / sds[1]) > np.median(sds[0] / sds[1])


def test_a_run_that_counts_twice_is_no_sequence(batch, first):
    """The broken twin: yesterday's runs again."""
    twice = identified(RECORDS[:SPLIT], first.ship)
    assert distance(twice, batch) > 0.3


def test_forecasts_are_one(batch, second):
    bands = [
        ps.forecast(one.ship, ps.turning_circle(35), rng=1, duration=900)["index_bands"]["tactical_diameter"].values
        for one in (second, batch)
    ]
    assert bands[0][1] == pytest.approx(bands[1][1], rel=0.005)
    assert np.ptp(bands[0]) == pytest.approx(np.ptp(bands[1]), rel=0.35)


def test_what_earlier_runs_showed_counts_on(first, second):
    known, *added = (list(index_rows(one.held_out_indices)) for one in (second.ship, first, second))
    assert len(known) == sum(map(len, added))
    assert second.ship.held_out_indices.sizes["run"] == 2 * SPLIT
    assert second.ship.likelihoods[TRUE_TERMS].log_density.size == 2 * SPLIT
    assert second.ship.motion.sizes["row"] > first.ship.motion.sizes["row"]
    assert second.candidates[0].discrepancy_scales[0] < 0.05
    assert any("The likelihood of earlier runs is included" in remark for remark in second.ship.remarks)
    assert second.ship.prior == first.ship.prior


def test_a_third_day_takes_the_first_two(second):
    """What was said of the same ship goes on growing."""
    third = identified(trials(2)[:2], second.ship)
    rows = [one.ship.likelihoods[TRUE_TERMS].gaussian.design for one in (second, third)]
    logdet = [np.linalg.slogdet(row.T @ row)[1] for row in rows]
    assert logdet[1] > logdet[0]
    sizes = [one.ship.likelihoods[TRUE_TERMS].log_density.size for one in (second, third)]
    assert sizes[1] == sizes[0] + 2


def test_a_ship_that_has_changed_forgets(first):
    """A fouled hull, damped more: earlier runs count for less than for the same ship, which the forecast shows."""
    scale = {"Yv": 1.6, "Nr": 1.6, "Ygv|v|": 1.6, "Xvv": 1.6}
    fouled = tanker().with_coefficients(
        {dof: [c.value * scale.get(c.name, 1.0) for c in force] for dof, force in tanker().forces.items()}
    )
    today = [
        ps.pollute(
            ps.simulate(fouled, manoeuvre, duration=660, step=0.25, record_interval=1.0, method="rk4"),
            level=0.005,
            rng=k,
        )
        for k, manoeuvre in enumerate((ps.zigzag(10, 10), ps.zigzag(20, 20, side="starboard"), ps.turning_circle(35)))
    ]
    found, same = identified(today, first.ship), identified(RECORDS[SPLIT:], first.ship)
    assert found.candidates[0].discrepancy_scales[0] > max(0.02, 2.0 * same.candidates[0].discrepancy_scales[0])
    truth = ps.indices(ps.simulate(fouled, ps.turning_circle(35), duration=900, step=0.25, method="rk4"))
    lower, _, upper = ps.forecast(found.ship, ps.turning_circle(35), rng=1, duration=900)["index_bands"][
        "tactical_diameter"
    ].values
    assert lower < float(truth["tactical_diameter"]) < upper


def test_coefficients_without_a_place_are_refused_and_constants_of_runs_are_not():
    names = ("Yv", "nothing", "also nothing")
    earlier = EarlierLikelihood(
        names, GaussianLikelihood(np.array([[1.0, 0.0, 0.0]]), np.ones(1)), np.zeros(1), np.zeros(3), np.ones(3)
    )
    found = earlier.for_vessel(tanker())
    assert found.design[0].sum() == 1.0
    with refused(InferenceError, "nothing"):
        replace(earlier, gaussian=GaussianLikelihood(np.array([[1.0, 2.0, 0.0]]), np.ones(1))).for_vessel(tanker())


PARTS = "modular"


def of_parts(changes, *, facility="", draught=None):
    """Two zigzags of the tanker of parts, parameters off their typical values by so many prior sd, at a facility."""
    vessel = tanker() if draught is None else at_draught(draught)
    ship = ps.with_terms(vessel, PARTS)
    row = np.array([c.value + changes.get(c.name, 0.0) * c.sd for c in ship.parameters])
    runs = []
    for k, manoeuvre in enumerate((ps.zigzag(20, 20, side="starboard"), ps.zigzag(10, 10))):
        run = ps.simulate(ship, manoeuvre, duration=660, step=0.25, record_interval=1.0, coefficients=row[None])
        run = run.isel(draw=0, drop=True)
        runs.append(ps.pollute(run, level=0.005, rng=k).assign_attrs(facility=facility))
    return runs, vessel, dict(zip((c.name for c in ship.parameters), row, strict=True))


def at_draught(draught):
    share = draught / tanker().particulars.d
    particulars = replace(tanker().particulars, d=draught, volume=share * tanker().particulars.volume)
    return replace(tanker(), particulars=particulars, m=share * tanker().m, I_zz=share * tanker().I_zz)


HULL = {"Yv": 0.7, "Nr": -0.8, "Nv": 0.6, "a_H": 0.5}


@pytest.fixture(scope="module")
def known_hull():
    runs, vessel, _ = of_parts(HULL, facility="basin")
    return ps.identify_ship(runs, vessel, terms=[PARTS], draws=40, rng=1).ship


def test_another_facility_may_differ_in_what_is_its_own(known_hull):
    """The hull is the same; without a share of their own, the broken twin, all coefficients are let go."""
    runs, vessel, _ = of_parts(HULL | {"dgamma_R": 2.0, "N_P": -2.0}, facility="tank")
    found = ps.identify_ship(runs, vessel, prior=known_hull, draws=40, rng=1)
    shared, own = found.candidates[0].discrepancy_scales
    assert own > max(0.2, 3.0 * shared)
    assert any(
        "that of the facility's coefficients (n_0, w0, dC2, Y_P, N_P, dgamma_R)" in remark
        for remark in found.ship.remarks
    )
    runs = [run.assign_attrs(facility="basin") for run in runs]
    twin = ps.identify_ship(runs, vessel, prior=known_hull, draws=40, rng=1)
    assert twin.candidates[0].discrepancy_scales[0] > max(shared, 0.02)
    assert list(found.ship.facilities) == ["tank", "basin"]


def test_another_draught_keeps_the_distance_from_what_is_typical(known_hull, monkeypatch):
    """The broken twin takes the coefficients as they were, and has to forget them."""
    runs, vessel, true = of_parts(HULL, draught=14.0)
    found = ps.identify_ship(runs[:1], vessel, prior=known_hull, draws=40, rng=1)
    fit = found.candidates[0].fit
    names = [c.name for c in fit.vessel.parameters]
    away = np.array([true[name] - fit.coefficients[names.index(name)] for name in HULL])
    sd = np.array([np.sqrt(fit.covariance[names.index(name), names.index(name)]) for name in HULL])
    assert np.abs(away / sd).max() < 3.5
    assert found.candidates[0].discrepancy_scales[0] < 0.3
    assert any("earlier runs were at another draught" in remark for remark in found.ship.remarks)
    monkeypatch.setattr(EarlierLikelihood, "at_draught", lambda self, *_: self)
    assert (
        ps.identify_ship(runs[:1], vessel, prior=known_hull, draws=40, rng=1).candidates[0].discrepancy_scales[0] > 0.6
    )
