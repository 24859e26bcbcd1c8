"""Captive tests with a wrong unit, sign or scale, with the model's own mass, or without a measurement."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.motion.captive import captive_test_forces
from pymc_ship.physics.vessel.vessel import reference_coefficients

DRIFT, YAW, RUDDER = (
    np.deg2rad([-12.0, -8.0, -4.0, 4.0, 8.0, 12.0]),
    (-0.5, -0.3, 0.3, 0.5),
    np.deg2rad([-20, -10, 10, 20]),
)
HEADER = ("beta [deg]", "delta [deg]", "r", "speed [m/s]", "n [1/s]", "X'", "Y'", "N'")


@cache
def vessel():
    return ps.with_terms(ps.load_vessel("kvlcc2"), "modular")


@cache
def series(beta_off=0.0, delta_off=0.0, rudder=tuple(RUDDER)):
    """Drift, yaw rate and rudder one at a time, and the straight course: columns of HEADER in their units.

    The model has angles off those of the table [deg].
    """
    U, L = vessel().particulars.nominal_speed, vessel().particulars.L
    motions = [(beta, 0.0, 0.0) for beta in DRIFT] + [(0.0, 0.0, r) for r in YAW]
    motions += [(0.0, delta, 0.0) for delta in rudder] + [(0.0, 0.0, 0.0)]
    beta, delta, r = np.array(motions).T
    true = beta + np.deg2rad(beta_off)
    motion = {"u": U * np.cos(true), "v": -U * np.sin(true), "r": r * U / L, "delta": delta + np.deg2rad(delta_off)}
    X, Y, N = captive_test_forces(vessel(), motion, reference_coefficients(vessel())[None])[0, :3]
    columns = (np.rad2deg(beta), np.rad2deg(delta), r, np.full(r.size, U), np.full(r.size, 1.513), X, Y, N)
    return dict(zip(HEADER, columns, strict=True))


def changed(**by_name):
    """The series with some columns replaced, by the first letters of their heading."""
    columns = series()
    return {
        head: by_name.get(head[0] if head[0] != "d" else "d", lambda values: values)(values)
        for head, values in columns.items()
    }


def read(tmp_path, columns, **settings):
    path = tmp_path / "captive.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return ps.read_captive(path, vessel(), **settings)


def test_right_tests_are_read(tmp_path):
    assert read(tmp_path, series()).sizes["test"] == len(DRIFT) + len(YAW) + len(RUDDER) + 1


def test_drift_at_three_speeds_and_one_number_of_revolutions_is_read(tmp_path):
    assert read(tmp_path, overloaded()).sizes["test"] == 3 * len(DRIFT)


def test_drift_at_two_speeds_is_read(tmp_path):
    columns = at_two_speeds(0.1)
    assert read(tmp_path, columns).sizes["test"] == 2 * len(DRIFT)
    columns["Y'"][3] = 0.0  # a force in the noise
    assert read(tmp_path, columns).sizes["test"] == 2 * len(DRIFT)


def unit(old, new):
    return {(new if head == old else head): values for head, values in series().items()}


def again(factor):
    """The series with its first test once more, of other forces."""
    first = {head: values[:1] * (factor if head[0] in "YN" else 1.0) for head, values in series().items()}
    return {head: np.append(values, first[head]) for head, values in series().items()}


def about(point):
    """The series with its moment about a point [L] forward of midship."""
    columns = series()
    return columns | {"N'": columns["N'"] - point * columns["Y'"]}


def drift_alone(force):
    """The tests in drift, with one force of the other sign."""
    return {head: values[: len(DRIFT)] * (-1.0 if head == force else 1.0) for head, values in series().items()}


def at_two_speeds(power):
    """The tests in drift, and again at half the speed, forces as a power of the speed."""
    columns = drift_alone("")
    half = {head: values * (0.5 if head[0] in "sn" else 1.0) for head, values in columns.items()}
    half |= {head: values * 0.5**power for head, values in columns.items() if head[1:] == "'"}
    return {head: np.append(values, half[head]) for head, values in columns.items()}


def overloaded(sign=1.0):
    """Drift alone at three speeds and one number of revolutions, with the sign of X'."""
    beta, speed = (values.ravel() for values in np.meshgrid(DRIFT, np.array([0.6, 0.8, 1.0])))
    U, n = speed * vessel().particulars.nominal_speed, np.full(beta.size, 1.513)
    motion = {"u": U * np.cos(beta), "v": -U * np.sin(beta), "r": 0.0 * U, "delta": 0.0 * U, "n": n}
    X, Y, N = captive_test_forces(vessel(), motion, reference_coefficients(vessel())[None])[0, :3]
    return dict(zip(HEADER, (np.rad2deg(beta), 0.0 * U, 0.0 * U, U, n, sign * X, Y, N), strict=True))


WRONG = [
    (lambda: changed(N=np.zeros_like), r"N' = 0 in all 15; leave the column out"),
    (lambda: changed(X=lambda values: 0.0 * values - 9.0), r"X' = -9 in all 15"),
    (lambda: unit("beta [deg]", "beta"), r"at most 180 deg, found 12 rad; write its unit as beta \[deg\]"),
    (lambda: unit("delta [deg]", "delta"), r"at most 90 deg, found 20 rad; write its unit as delta \[deg\]"),
    (lambda: changed(d=np.deg2rad), r"1 deg or more, found 0.35 deg; write delta \[rad\]"),
    (lambda: changed(b=np.deg2rad), r"Y' in drift .* perhaps beta is in rad"),
    (lambda: changed(n=lambda values: 60.0 * values), r"median of 90.8 1/s at full scale; write n \[1/min\]"),
    (lambda: changed(b=np.negative), "Y' opposes the drift .* change the sign of beta"),
    (lambda: changed(r=np.negative), "N' damps the yaw rate .* change the sign of r"),
    (lambda: changed(d=np.negative), "rudder to port .* frame.rudder_positive"),
    (lambda: changed(Y=lambda values: 320.0 / 20.8 * values, N=lambda values: 320.0 / 20.8 * values), '= "Ld"'),
    (lambda: changed(b=np.abs), "one motion have one force, found Y' = .* at beta = 12 deg, delta = 0 deg; give"),
    (lambda: changed(d=np.abs), "at beta = 0 deg, delta = 10 deg; give beta, r and delta their signs"),
    (lambda: again(-1.0), "one motion have one force"),
    (lambda: again(2.0), "one motion have one force"),
    (lambda: changed(X=np.negative), "found X' greater by .* X' is positive forward: change its sign"),
    (lambda: overloaded(-1.0), "pulls more at a lower speed, found X' less by .* there; X' is positive forward"),
    (lambda: about(0.25), "a rudder acts about 0.5 L aft of midship, found N' / Y' = -0.7"),
    (lambda: drift_alone("N'"), "N' turns the bow away .* found -.* times .* change its sign, or set frame.reference"),
    (lambda: at_two_speeds(2.0), "Y' of one drift as the power 2 of the speed; divide each force by its own"),
    (lambda: about(-0.4), "give the moment about midship"),
    (lambda: changed(Y=lambda values: values - vessel().m * series()["r"]), "without the model's own mass"),
]


@pytest.mark.parametrize("columns", [columns for columns, _ in WRONG])
def test_wrong_tests_are_refused(tmp_path, columns):
    with pytest.raises(ps.TrialError) as raised:
        read(tmp_path, columns())
    assert str(raised.value).endswith(".")


def stale(*forces):
    """The series, noisy, with forces of the eighth test as in the row before."""
    columns, rng = dict(series()), np.random.default_rng(0)
    noisy = {head: values + 0.01 * np.abs(values).max() * rng.standard_normal(15) for head, values in columns.items()}
    for head in (head for head in columns if head[1:] == "'"):
        columns[head] = noisy[head]
        columns[head][7] = noisy[head][6 if head[0] in forces else 7]
    return columns


def tare(force, part=0.2):
    return changed(**{force: lambda values: values + part * np.abs(values).max()})


MORE_RUDDER = tuple(np.deg2rad([-30.0, -20.0, -10.0, 10.0, 20.0, 30.0]))


def rudder_off():
    """The series with rudder angles 2 deg above the true ones."""
    columns = series(rudder=MORE_RUDDER)
    return columns | {"delta [deg]": columns["delta [deg]"] + 2.0}


DOUBTED = [
    (lambda: changed(X=lambda values: 10.0 * values), "X' .* with the rudder by 5.5 times .* check the scale of X'"),
    (lambda: changed(X=lambda values: 0.1 * values), "X' .* with the rudder by 0.055 times"),
    (lambda: changed(X=lambda values: 0.1 * values), r"move t_R by \+5.8 sd of the prior"),
    (lambda: changed(s=lambda values: 0.5 * values), "sd of the prior: check units"),
    (lambda: changed(b=lambda values: 0.5 * values), "Y' and N' .* in drift are 2 times .* beta, which may be half"),
    (lambda: changed(b=lambda values: 2.0 * values), "in drift are 0.4. times .* beta, which may be twice"),
    (lambda: changed(r=lambda values: 0.5 * values), "N' .* in yaw is 2.6 times .* r' = r L / U, which may be half"),
    (lambda: changed(r=lambda values: 2.0 * values), "in yaw is 0.5. times .* r' = r L / U, which may be twice"),
    (lambda: stale("X"), "X' of captive test 8 is that of the row before"),
    (lambda: stale("Y"), "Y' of captive test 8 is that of the row before"),
    (lambda: stale(*"XYN"), "N' of captive test 8 is that of the row before"),
    (lambda: tare("Y"), "Y' .* straight ahead, as at a drift angle of 2.. deg: check the zeros"),
    (lambda: tare("N"), "N' .* straight ahead, as at a drift angle of 3.. deg: check the zeros"),
    (lambda: tare("Y", 0.1), "Y' .* straight ahead, as at a drift angle of 1.. deg: check the zeros of the balance"),
    (lambda: tare("N", 0.1), "N' .* straight ahead, as at a drift angle of 1.. deg: check the zeros of the balance"),
    (lambda: series(beta_off=1.0), "Y' .* straight ahead, as at a drift angle of 1.. deg: .* of beta and of delta"),
    (lambda: series(beta_off=1.0), "N' .* straight ahead, as at a drift angle of 0.9.? deg"),
    (lambda: changed(b=lambda values: values + 1.0), "Y' .* straight ahead, as at a drift angle of -(1|0.9.) deg"),
    (lambda: series(delta_off=2.0, rudder=MORE_RUDDER), "least resistance at a rudder angle of -1.. deg instead of 0"),
    (rudder_off, "least resistance at a rudder angle of 2 deg instead of 0: check the zero of delta"),
]


def remarks(tmp_path, columns):
    return ps.fit_captive(read(tmp_path, columns), vessel(), ps.coefficient_prior([], vessel())).remarks


@pytest.mark.parametrize(("columns", "sentence"), DOUBTED, ids=range(len(DOUBTED)))
def test_unusual_tests_are_named_by_the_fit(tmp_path, columns, sentence):
    assert any(re.search(sentence, remark) for remark in remarks(tmp_path, columns()))


def test_usual_tests_are_not_named(tmp_path):
    """Clean, noisy, and rounded so that forces of several tests are equal."""
    assert remarks(tmp_path, series()) == ()
    assert remarks(tmp_path, stale()) == ()
    assert remarks(tmp_path, {head: np.repeat(values, 2) for head, values in stale().items()}) == ()
    rounded = {head: np.round(values, 4) if head[1:] == "'" else values for head, values in series().items()}
    right_about_1_deg = series(beta_off=-1.0) | {"beta [deg]": series()["beta [deg]"] - 1.0}
    assert remarks(tmp_path, right_about_1_deg) == ()
    for order in (np.arange(15), *(np.random.default_rng(seed).permutation(15) for seed in range(6))):
        found = remarks(tmp_path, {head: values[order] for head, values in rounded.items()})
        assert not any("row before" in remark for remark in found)


@pytest.mark.parametrize("force", ["Y", "N"])
def test_a_balance_off_zero_is_named_without_mirrored_tests(tmp_path, force):
    ahead = {head: np.array(values) for head, values in series().items()}
    one_side = (ahead["beta [deg]"] >= 0.0) & (ahead["r"] >= 0.0) & (ahead["delta [deg]"] >= 0.0)
    right, wrong = ({h: np.array(v)[one_side] for h, v in columns.items()} for columns in (ahead, tare(force)))
    assert remarks(tmp_path, right) == ()
    assert any(f"{force}' of the captive tests in drift is" in remark for remark in remarks(tmp_path, wrong))


def test_a_force_of_another_sign_in_a_short_table_is_named(tmp_path):
    columns = stale()
    columns["Y'"][7] *= -1.0
    (remark,) = remarks(tmp_path, columns)
    assert remark.startswith("The captive test at beta = 0 deg, r' = -0.3 and delta = 0 deg contradicts the others: Y'")


def test_noisy_tests_that_are_repeated_are_read(tmp_path):
    """Small forces of either sign at one motion are noise; the straight course has no others."""
    rng = np.random.default_rng(5)
    twice = {head: np.tile(values, 3) for head, values in series().items()}
    for head, values in twice.items():
        if head[1:] == "'":
            twice[head] = values + 0.02 * np.abs(values).max() * rng.standard_normal(values.size)
    assert read(tmp_path, twice).sizes["test"] == 3 * len(series()["X'"])


@pytest.mark.parametrize("name", ["container", "kvlcc2", "kvlcc2 polynomial"])
def test_other_ships_are_not_refused(tmp_path, name):
    """Forces of each shipped vessel by its own coefficients."""
    ship = ps.load_vessel(name.split()[0]) if name != "kvlcc2" else vessel()
    U, L = ship.particulars.nominal_speed, ship.particulars.L
    zero = np.zeros(6)
    by_motion = [(DRIFT, zero, zero), (zero, np.tile(YAW, 2)[:6], zero), (zero, zero, np.tile(RUDDER, 2)[:6])]
    beta, r, delta = (np.concatenate(parts) for parts in zip(*by_motion, strict=True))
    motion = {"u": U * np.cos(beta), "v": -U * np.sin(beta), "r": r * U / L, "delta": delta}
    motion |= dict.fromkeys(("p", "phi"), np.zeros(r.size))
    _, Y, N, *_ = captive_test_forces(ship, motion, reference_coefficients(ship)[None])[0]
    columns = {"beta [rad]": beta, "delta [rad]": delta, "r": r, "speed [m/s]": np.full(r.size, U), "Y'": Y, "N'": N}
    path = tmp_path / "captive.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    assert ps.read_captive(path, ship).sizes["test"] > 9
