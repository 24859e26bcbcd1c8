from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.records.files.noise import LITERAL_LEVEL
from pymc_ship.replication import measurements as replication
from pymc_ship.replication.estimates import Estimate
from pymc_ship.replication.measurements import BOUND, method_rows, published_bound_rows, relative_bound
from pymc_ship.replication.scores import relative_error
from tests.replication.cases import DOFS

NORMAL_MEDIAN = 0.6744897501960817


def bound_of(vessel, percent):
    """Bound that is the same share of every coefficient."""
    return 0.01 * percent * np.abs(reference_coefficients(vessel))


def test_the_relative_bound_is_unknown_for_zeros_only(container):
    found = relative_bound(container, bound_of(container, 3.0))
    zero = reference_coefficients(container) == 0.0
    np.testing.assert_allclose(found[~zero], 3.0)
    assert np.isnan(found[zero]).all()


def test_published_errors_are_counted_against_the_bound_at_the_literal_level(container):
    """With a bound of 5 % at that level, and with one of half of it."""
    reference = reference_coefficients(container)
    for percent in (5.0, 2.5):
        rows = published_bound_rows(container, bound_of(container, percent / LITERAL_LEVEL), tuple(FAMILIES))
        assert [row["family"] for row in rows] == list(FAMILIES)
        for row in rows:
            published = np.concatenate([container.published_estimates(dof, row["family"]) for dof in DOFS])
            errors = relative_error(published, reference)
            assert row["errors"] == np.isfinite(errors).sum() == 93
            assert row["below"] == (errors < percent).sum()
            assert row["median"] == pytest.approx(np.nanmedian(errors))
            assert row["on_bound"] == pytest.approx(NORMAL_MEDIAN * percent)
            assert row["level"] == pytest.approx(LITERAL_LEVEL * row["median"] / (NORMAL_MEDIAN * percent))


@pytest.mark.parametrize(("size", "fits"), [(1.0, True), (0.5, False), (2.0, False)])
def test_errors_on_the_bound_are_placed_at_their_own_level(container, size, fits):
    """Estimates made with errors on the bound at a level, and the broken twins with half and twice these errors."""
    level, reference = 0.002, reference_coefficients(container)
    unit = bound_of(container, 1.0) * np.geomspace(100.0, 1e4, reference.size)
    below, levels, rng = [], [], np.random.default_rng(9)
    for _ in range(40):
        values = reference + size * level * unit * rng.standard_normal(reference.size)
        row = published_bound_rows(printed(container, values), unit * level / LITERAL_LEVEL, ("conjugate",))[0]
        below.append(row["below"] / row["errors"])
        levels.append(row["level"] * level / LITERAL_LEVEL)
    share = 0.6826894921370859
    assert (abs(np.mean(below) - share) < 4.0 * np.sqrt(share * (1.0 - share) / (40 * row["errors"]))) == fits
    assert (abs(np.log(np.median(levels) / level)) < 4.0 * np.std(np.log(levels)) / np.sqrt(40)) == fits


def printed(vessel, values):
    """Vessel with these estimates in print."""
    values = iter(values)
    forces = {
        dof: tuple(replace(c, published={"conjugate": next(values)}) for c in force)
        for dof, force in vessel.forces.items()
    }
    return replace(vessel, forces=forces)


def test_a_vessel_without_published_estimates_has_nothing_to_hold_against_the_bound(container):
    forces = {dof: tuple(replace(c, published={}) for c in force) for dof, force in container.forces.items()}
    assert published_bound_rows(replace(container, forces=forces), bound_of(container, 1.0), tuple(FAMILIES)) == []


def off_by(vessel, percent):
    reference = reference_coefficients(vessel)
    return Estimate((1.0 + 0.01 * percent) * reference, reference - 1.0, reference + 1.0)


@pytest.fixture
def made_up(container, monkeypatch):
    """Methods with known errors: differencing 40 and 30 %, weak form 20 %, the paper's pipeline 50 %, the fit 5 %."""
    found = {
        "differencing_estimates": {"one": off_by(container, 40.0), "two": off_by(container, -30.0)},
        "weak_form_estimate": off_by(container, 20.0),
        "exact_estimate": off_by(container, 50.0),
        "trajectory_estimate": off_by(container, 5.0),
    }
    for name, value in found.items():
        monkeypatch.setattr(replication, name, lambda *arguments, value=value, **settings: value)
    fit = SimpleNamespace(kind="student_t", offsets=True, fit=SimpleNamespace(chi2=1.04))
    mode = SimpleNamespace(choice=fit, n_agreeing=1, n_starts=2)
    identified = SimpleNamespace(exact={"conjugate": {}})
    modes = {"flat": None, "order_damped": mode}
    return method_rows(container, bound_of(container, 10.0), None, None, identified, modes, level=0.01)


def test_method_rows_go_from_the_bound_down_to_the_paper(made_up):
    names = [
        BOUND,
        "trajectory fit, flat prior",
        "trajectory fit, order-damped prior",
        "weak form",
        "best differencing",
        "paper's pipeline",
    ]
    assert [row["method"] for row in made_up] == names
    medians = [row["median"] for row in made_up]
    assert medians == pytest.approx([10.0 * NORMAL_MEDIAN, np.nan, 5.0, 20.0, 30.0, 50.0], nan_ok=True)
    assert {tuple(row) for row in made_up} == {tuple(made_up[0])}
    assert {row["level"] for row in made_up} == {0.01}


def test_method_rows_say_how_each_number_came_about(made_up):
    details = {row["method"]: row["detail"] for row in made_up}
    assert details["best differencing"] == "two"
    assert details["trajectory fit, flat prior"] == "no start converges"
    assert details["trajectory fit, order-damped prior"] == "student-t noise, offsets, chi2 1.04, 1/2 starts"


def test_the_bound_and_a_fit_that_failed_have_no_coverage(made_up):
    coverage = {row["method"]: row["coverage"] for row in made_up}
    assert np.isnan([coverage.pop(BOUND), coverage.pop("trajectory fit, flat prior")]).all()
    assert set(coverage.values()) == {100.0}
