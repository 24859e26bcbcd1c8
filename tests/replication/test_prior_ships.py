"""The study's priors judged by their ships, on a small study without sampling."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.regression import identify as identification
from pymc_ship.inference.regression.tune import tune_prior
from pymc_ship.replication.measurements import PUBLISHED_PRIORS
from pymc_ship.replication.prior_ships import prior_ship_rows, study_priors
from pymc_ship.replication.tables import _prior_ship_table


@pytest.fixture(scope="module")
def trial(container, zigzag_trial):
    return ps.pollute(zigzag_trial, level=0.001, rng=np.random.default_rng(1))


@pytest.fixture(scope="module")
def found(container, zigzag_trial):
    """Conjugate family from the clean record by the weak form, tuned in a few evaluations."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(identification, "tune_prior", lambda *args, **kw: tune_prior(*args, evaluations=6, **kw))
        return ps.identify(
            zigzag_trial,
            container,
            families=["conjugate"],
            selection="bayesian_optimisation",
            derivative="weak_euler",
            rng=np.random.default_rng(2),
        )


def test_the_priors_are_those_of_the_study(container, found, trial):
    priors = study_priors(container, found, trial)
    assert list(priors) == [
        ("conjugate", "chosen"),
        ("conjugate", "evidence maximum"),
        ("conjugate", "published"),
        ("trajectory fit", "order-damped, factors 1"),
    ]
    for (_, choice), prior in list(priors.items())[:3]:
        assert tuple(prior) == container.dofs
        data, yaw = prior["yaw"]
        assert data is found.data["yaw"]
        expected = {"chosen": found.priors["conjugate"]["yaw"], "evidence maximum": found.tuned["conjugate"]["yaw"]}
        if choice == "published":
            shape, reciprocal, kappa = PUBLISHED_PRIORS["conjugate"]["yaw"]
            assert (yaw.shape, yaw.scale, yaw.kappa) == (shape, 1.0 / reciprocal, kappa)
        else:
            assert yaw is getattr(expected[choice], "evidence_prior", expected[choice])


def test_a_vessel_without_published_estimates_has_no_published_prior(container, found, trial):
    bare = {dof: tuple(replace(c, published={}) for c in force) for dof, force in container.forces.items()}
    priors = study_priors(replace(container, forces=bare), found, trial)
    assert [choice for _, choice in priors] == ["chosen", "evidence maximum", "order-damped, factors 1"]


def test_fewer_ships_of_the_posterior_run_away_than_of_any_prior(container, found, trial):
    """By three standard errors; the reference ship is in the middle of those that the data leave."""
    rows = prior_ship_rows(container, found, trial, lambda *_: np.random.default_rng(3), ships=40)
    assert [(row["family"], row["choice"]) for row in rows[::2]] == [
        *study_priors(container, found, trial),
        ("conjugate", "posterior"),
    ]
    assert {row["manoeuvre"] for row in rows} == {"zigzag 10/10 port", "turning circle 35 port"}
    for prior, posterior in zip(rows[:-2], rows[-2:] * 4, strict=True):
        assert prior["manoeuvre"] == posterior["manoeuvre"]
        away, fewer = prior["diverged"] / 100.0, posterior["diverged"] / 100.0
        error = np.sqrt((away * (1.0 - away) + fewer * (1.0 - fewer)) / prior["ships"])
        assert away - fewer > 3.0 * error
        assert (posterior["wrong_way"], posterior["reached"]) == (0.0, 100.0)
    reference = ps.simulate(container, ps.turning_circle(35), duration=700.0, step=0.1, method="rk4")
    advance = float(ps.indices(reference)["advance"]) / container.particulars.L
    assert rows[-1]["median"] == pytest.approx(advance, rel=0.02)
    assert (rows[-1]["index"], rows[-1]["unit"]) == ("advance", "L")


def test_a_prior_has_its_own_generator(container, found, trial):
    asked = []

    def rng(*words):
        asked.append(words)
        return np.random.default_rng(4)

    prior_ship_rows(container, found, trial, rng, ships=2)
    assert asked == [*study_priors(container, found, trial), ("conjugate", "posterior")]


def test_the_table_shows_shares_and_bands():
    """A prior of which no ship reaches the index has a dash."""
    outcomes = {"diverged": 100.0, "wrong_way": 0.0, "course_unstable": 50.0, "complete": 0.0, "reached": 0.0}
    row = {"family": "conjugate", "choice": "chosen", "manoeuvre": "turning circle 35 port", "index": "advance"}
    row |= {"unit": "L", "lower": np.nan, "median": np.nan, "upper": np.nan, **outcomes}
    other = row | {"lower": 4.0, "median": 5.0, "upper": 6.0, "reached": 80.0}
    found = _prior_ship_table(SimpleNamespace(tables={"prior_ships": [row, other]}))
    assert [cells[-2:] for cells in found.cells] == [["advance [L]: –", "0.0"], ["advance [L]: 5 (4 to 6)", "80.0"]]
    assert found.cells[0][3:7] == ["100.0", "0.0", "50.0", "0.0"]
