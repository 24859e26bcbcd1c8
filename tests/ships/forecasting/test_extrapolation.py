from itertools import product

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import linprog

import pymc_ship as ps
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.motion.prime_record import prime_record
from pymc_ship.ships.forecasting.extrapolation import extrapolation, sentence

CHANNELS = ("u", "v", "r", "p", "phi", "delta")
CENTRE = np.array([-0.4, 0.02, -0.1, 0.05, 0.01, 0.03])
RANGE = np.array([0.5, 0.2, 0.8, 0.3, 0.4, 0.6])


def prime_motion(vessel, trial):
    """Prime motion of a record, dims (row, symbol)."""
    motion, _, _ = prime_record(vessel, {name: trial[name].values for name in CHANNELS})
    return as_motion(np.array([motion[symbol] for symbol in SYMBOLS]).T)


def as_motion(values):
    return xr.DataArray(values, {"symbol": list(SYMBOLS)}, ("row", "symbol"))


def si(vessel, prime):
    """Ship whose prime motion has the given rows."""
    u_a, v, r, p, phi, delta = np.atleast_2d(prime).T
    U = vessel.particulars.nominal_speed / (1.0 - u_a)
    values = (U * np.sqrt(1.0 - v**2), U * v, U / vessel.particulars.L * r, U / vessel.particulars.L * p, phi, delta)
    channels = {name: ("time", value) for name, value in zip(CHANNELS, values, strict=True)}
    return xr.Dataset(channels, {"time": np.arange(len(U))})


def box():
    """The corners of a box: its hull is the box, its ranges are RANGE."""
    return as_motion(CENTRE + 0.5 * RANGE * np.array(list(product((-1.0, 1.0), repeat=6))))


def shares(result):
    """Extremes of one draw with the attrs that a sentence needs."""
    outside = result["outside"].values
    distance = float(np.median(result["distance"].values[outside])) if outside.any() else 0.0
    return result.assign_attrs(extrapolated_fraction=float(outside.mean()), median_distance=distance)


def in_hull(points, rows):
    """Whether each point is a convex combination of rows, by linear programming."""
    equations = np.vstack([rows.T, np.ones(len(rows))])
    result = [linprog(np.zeros(len(rows)), A_eq=equations, b_eq=[*point, 1.0]).status for point in points]
    assert set(result) <= {0, 2}
    return np.array(result) == 0


@pytest.fixture(scope="module")
def zigzag_motion(container, zigzag_trial):
    return prime_motion(container, zigzag_trial)


def test_the_record_lies_inside_itself(container, zigzag_trial, zigzag_motion):
    result = extrapolation(container, zigzag_trial, zigzag_motion)
    assert result["distance"].dims == ("time",)
    assert not result["outside"].any()
    assert (result["distance"] == 0.0).all()
    assert not result[["below", "above"]].to_array().any()


def test_half_of_a_record_does_not_contain_the_other_half(container, zigzag_trial, zigzag_motion):
    half = zigzag_motion.isel(row=slice(5000))
    result = extrapolation(container, zigzag_trial, half)
    assert not result["outside"].isel(time=slice(5000)).any()
    assert result["outside"].isel(time=slice(5000, None)).mean() > 0.5


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("symbol", SYMBOLS)
def test_beyond_a_face_the_distance_is_that_to_the_face(container, symbol, side):
    """In units of the range, from the middle of the face of a box; to its margin it counts as inside."""
    k = SYMBOLS.index(symbol)
    steps = side * np.array([0.0, 0.49, 0.505, 0.52, 0.8])
    points = CENTRE + np.outer(steps, RANGE * np.eye(6)[k])
    result = extrapolation(container, si(container, points), box())
    np.testing.assert_allclose(result["distance"], [0.0, 0.0, 0.0, 0.02, 0.3], atol=1e-9)
    np.testing.assert_array_equal(result["outside"].values[[0, 1, 3, 4]], [False, False, True, True])
    leaves, stays = ("above", "below") if side > 0.0 else ("below", "above")
    np.testing.assert_allclose(result[leaves], 0.3 * np.eye(6)[k], atol=1e-12)
    np.testing.assert_allclose(result[stays], 0.0, atol=1e-12)
    np.testing.assert_allclose(result["trained_highest"] - result["trained_lowest"], RANGE)


def test_beyond_an_edge_the_distance_is_that_to_the_edge(container):
    point = CENTRE + 0.7 * RANGE * np.array([1.0, 0.0, 0.0, -1.0, 0.0, 0.0])
    result = extrapolation(container, si(container, point), box())
    np.testing.assert_allclose(result["distance"], 0.2 * np.sqrt(2.0), rtol=1e-9)


def test_a_combination_the_record_lacks_is_outside_though_each_quantity_keeps_to_its_range(container):
    """v and r went up together; (0.7, 0.3) lies off that line by 0.4 / sqrt 2."""
    together = np.outer(np.linspace(0.0, 1.0, 11), RANGE * np.array([0.0, 1.0, 1.0, 0.0, 0.0, 0.0])) + CENTRE
    point = CENTRE + RANGE * np.array([0.0, 0.7, 0.3, 0.0, 0.0, 0.0])
    result = shares(extrapolation(container, si(container, point), as_motion(together)))
    np.testing.assert_allclose(result["distance"], 0.4 / np.sqrt(2.0), rtol=1e-9)
    np.testing.assert_allclose(result[["below", "above"]].to_array(), 0.0, atol=1e-12)
    assert sentence(container, result).endswith(
        "combinations of quantities, each within its range in the median ship. A run with such motion would reduce "
        "the uncertainty."
    )


def test_points_outside_are_outside_the_convex_hull(container, zigzag_trial):
    """Against linear programming, which is exact; the polytope counts some outer points as inside."""
    rows = prime_motion(container, zigzag_trial.isel(time=slice(None, None, 150)))
    ship = ps.simulate(container, ps.zigzag(10.0, 10.0), duration=400.0, record_interval=10.0)
    result = extrapolation(container, ship, rows)["outside"].values
    unit = np.ptp(rows.values, axis=0)
    inside = in_hull(prime_motion(container, ship).values / unit, rows.values / unit)
    assert 5 < result.sum() < result.size - 5
    assert not (result & inside).any()
    assert (result == ~inside).mean() > 0.6


def test_one_draw_has_the_same_distance_as_among_many(container, zigzag_motion):
    reference = np.concatenate([container.coefficients(dof).values for dof in container.dofs])
    draws = reference * (1.0 + 0.01 * np.random.default_rng(1).standard_normal((35, reference.size)))
    settings = {"duration": 100.0, "record_interval": 0.5, "coefficients": draws}
    many = ps.simulate(container, ps.turning_circle(35.0), **settings)
    result = extrapolation(container, many, zigzag_motion)
    assert result["distance"].dims == ("draw", "time")
    assert result["highest"].dims == ("draw", "symbol")
    for draw in (0, 15, 16, 34):
        one = extrapolation(container, many.isel(draw=draw), zigzag_motion)
        xr.testing.assert_allclose(result.isel(draw=draw, drop=True), one, rtol=1e-12)


def test_a_diverged_draw_is_neither_inside_nor_outside(container):
    points = CENTRE + np.outer([0.0, 0.9, 0.0, 2.0], RANGE)
    ship = si(container, points).where(xr.DataArray([True, True, False, False], dims="time"))
    result = extrapolation(container, ship, box())
    np.testing.assert_array_equal(np.isnan(result["distance"]), [False, False, True, True])
    np.testing.assert_array_equal(result["outside"], [False, True, False, False])
    np.testing.assert_allclose(result["above"], 0.4, rtol=1e-9)


def test_a_quantity_that_never_moved_counts_in_its_own_unit(container):
    flat = box()
    flat[:, SYMBOLS.index("phi")] = 0.0
    level, heeled = CENTRE.copy(), CENTRE.copy()
    level[4], heeled[4] = 0.0, 0.25
    result = extrapolation(container, si(container, [level, heeled]), flat)
    np.testing.assert_allclose(result["distance"], [0.0, 0.25], atol=1e-9)


def test_a_turn_to_port_does_not_cover_a_turn_to_starboard(container):
    port, starboard = (
        ps.simulate(container, ps.turning_circle(20.0, side=side), duration=200.0, record_interval=0.5)
        for side in ("port", "starboard")
    )
    motion = prime_motion(container, port)
    assert extrapolation(container, port, motion)["outside"].mean() == 0.0
    assert extrapolation(container, starboard, motion)["outside"].mean() > 0.9


def test_the_sentence_names_quantities_outside_their_range_and_both_ends(container):
    record, ship = (
        ps.simulate(container, manoeuvre, duration=300.0, record_interval=0.5)
        for manoeuvre in (ps.zigzag(10.0, 10.0), ps.turning_circle(35.0))
    )
    result = shares(extrapolation(container, ship, prime_motion(container, record)))
    slowest, trained = (float(np.hypot(trial["u"], trial["v"]).min()) for trial in (ship, record))
    text = sentence(container, result)
    assert f"speed falls to {slowest:.3g} m/s, the record goes down to {trained:.3g} m/s" in text
    assert text.count("the record goes") == 3
    assert text.startswith(
        f"{100.0 * float(result['outside'].mean()):.3g} % of the instants lie outside the motion of "
    )
    beyond = CENTRE + RANGE * np.array([0.0, 0.0, 0.0, 0.0, 0.0, -1.5])
    rudder = sentence(container, shares(extrapolation(container, si(container, beyond), box())))
    least = np.rad2deg(CENTRE[5] - 0.5 * RANGE[5])
    reached = np.rad2deg(beyond[5])
    expected = f"rudder angle falls to {reached:.3g} deg, the record goes down to {least:.3g} deg."
    outside = "100 % of the instants lie outside the motion of the record, typically by 1 times the span that it covers"
    assert rudder == f"{outside}: {expected} A run with such motion would reduce the uncertainty."


def test_the_sentence_on_what_stays_inside(container):
    result = shares(extrapolation(container, si(container, CENTRE), box()))
    assert sentence(container, result) == "Every instant lies inside the motion of the record."


def test_a_single_instant_outside_is_less_than_a_tenth_of_a_percent(container):
    many = np.vstack([np.tile(CENTRE, (4999, 1)), CENTRE + RANGE])
    text = sentence(container, shares(extrapolation(container, si(container, many), box())))
    assert text.startswith("Less than 0.1 % of the instants lie outside")
    assert sentence(container, shares(extrapolation(container, si(container, many[-100:]), box()))).startswith("1 % of")
