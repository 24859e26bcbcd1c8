"""Growth of a small disturbance of a straight course, against the classical criterion and against the simulator."""

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.motion.stability import growth_rates
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients


def criterion(vessel, rows):
    """Yv' (Nr' - m' x_G') - Nv' (Yr' - m') of every ship (Abkowitz 1964), positive for a stable one.

    At the nominal speed the slipstream has its nominal strength, so that Ygv adds to Yv as it is.
    """
    names = coefficient_names(vessel)
    Yv, Yr, Nv, Nr = (
        rows[:, names.index(f"{force}{symbol}")] + rows[:, names.index(f"{force}g{symbol}")]
        for force in "YN"
        for symbol in "vr"
    )
    return Yv * (Nr - vessel.m * vessel.x_G) - Nv * (Yr - vessel.m)


def test_without_roll_the_sign_is_that_of_the_criterion():
    vessel = ps.load_vessel("kvlcc2")
    reference, rng = reference_coefficients(vessel), np.random.default_rng(1)
    rows = reference * (1.0 + 0.2 * rng.standard_normal((300, reference.size)))
    growth, expected = growth_rates(vessel, rows, vessel.particulars.nominal_speed), criterion(vessel, rows)
    np.testing.assert_array_equal(growth > 0.0, expected < 0.0)
    assert 20 < np.sum(growth > 0.0) < 280


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_a_disturbance_of_a_ship_that_rolls_grows_at_the_rate(container, factor):
    """The lateral motion of the simulator, long after a push of 1e-7 m/s, with a surge force of nothing."""
    names, rows = coefficient_names(container), reference_coefficients(container)[None].copy()
    rows[:, [name[0] == "X" for name in names]] = 0.0
    rows[:, [name[1:].startswith("0") for name in names]] = 0.0
    rows[:, names.index("Nv")] *= factor
    speed, unit = container.particulars.nominal_speed, container.particulars.ship_time
    start = np.array([[speed, 1e-7, 0.0, 0.0, 0.0]])
    motion = replay(container, np.zeros(9000), start, rows, interval=0.05)
    r = np.abs(motion[2, 0])
    swing = [np.max(r[end - 2500 : end]) for end in (6000, 9000)]
    rate = float(growth_rates(container, rows, speed)[0])
    assert np.log(swing[1] / swing[0]) == pytest.approx(rate * 0.05 * 3000 / unit, rel=0.02)


def test_an_even_force_does_not_count_and_a_force_that_overflows_is_infinite(container):
    names, reference = coefficient_names(container), reference_coefficients(container)
    even, wild = reference.copy(), reference.copy()
    even[names.index("Y0")] += 1.0
    wild[names.index("Yv")] = 1e300
    wild[names.index("Nv")] = np.inf
    speed = container.particulars.nominal_speed
    growth = growth_rates(container, np.stack([reference, even, wild]), speed)
    assert growth[1] == pytest.approx(growth[0], rel=1e-6)
    assert growth[2] == np.inf
