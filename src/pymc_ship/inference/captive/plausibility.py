"""Plausibility of captive tests: columns that were not measured, wrong units and signs, inertia of the model."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr

from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.forces.hull_database import bare_hull
from pymc_ship.physics.forces.screw import SIDE_FORCE
from pymc_ship.physics.forces.terms import SYMBOLS, evaluate
from pymc_ship.physics.vessel.hull_database import SLENDER_DRAUGHT
from pymc_ship.physics.vessel.vessel import Vessel

_FORCES = ("X", "Y", "N")
_FEWEST = 3  # tests of a series that is compared
_RATIO = 5.0  # largest ratio, either way, of a measured force to that of a similar hull
_USUAL = 1.5  # the same, from which a force of a motion is doubted
_RUDDER_DRAG = 0.25, 1.0  # range of -X' / (Y' tan delta) of a rudder: (1 - t_R) / (1 + a_H) and its own drag
_ERRORS = 5.0  # standard errors of a finding
_OFF_ZERO = np.deg2rad(1.5)  # drift angle of a similar hull with the force of the straight course, a doubt from there
_ASYMMETRY = 5.0  # sd of the side force of a propeller, from which Y' and N' of the straight course are doubted
_LEAST_OFF = np.deg2rad(1.0)  # rudder angle of least resistance, a doubt from there
_MOST_OFF = np.deg2rad(3.0)  # angle, or r', up to which the centre of a table is an offset
_REPEATED, _MOST = 2, 0.05  # number of repeated forces, or fraction of the tests, up to which they are no rounding
_REVOLUTIONS = 10.0  # largest ratio, either way, of the revolutions to the nominal ones
_LEAST_RUDDER = np.deg2rad(1.0)  # a smaller largest rudder angle is probably a value in rad under deg
_MOST_DRIFT = 0.4  # largest drift, v/u, that is compared
_CONTRADICTION = 0.45  # difference of two forces of one motion over the larger, from which they contradict each other
_LEAST_DIFFERENCE = 0.1  # the same, over the largest force of all tests
_LEAST_DRAG = np.deg2rad(9.0)  # rudder angle whose resistance is beyond the noise
_LESS_RESISTANCE = 0.8  # least fraction of these tests with less resistance than straight ahead: X' has another sign
_LEVER, _LEVER_OFF = 0.5, 0.2  # L, of a rudder aft of midship, and the largest difference from it
_SETTINGS = {"u", "n"}  # of a test, with which the resistance changes
_TURNED = 0.2  # least ratio of N' in drift, of the other sign, to that of a similar hull
_FASTER, _POWER = 1.3, 1.0  # least ratio of the speeds of drift tests, and power of the speed by which forces grow
_SMALL = 1e-6  # prime motion that counts as none
_DEGREES = float(np.rad2deg(1.0))


def check_captive_tests(tests: xr.Dataset, vessel: Vessel, path: object, beta: np.ndarray) -> None:
    """Raise TrialError for tests that no ship can have measured.

    ``tests`` are as from :func:`pymc_ship.read_captive`; ``beta`` is the drift angle as read [rad]. Drift and yaw rate
    are compared with the hull database where three tests vary one of them alone; the rudder in sign and lever.
    """
    fault = _columns(tests) or _units(tests, vessel, beta) or _contradictions(tests, vessel)
    fault = fault or _forces(tests, vessel) or _thrust(tests, vessel)
    if fault:
        raise TrialError(f"{path}: {fault}")


def _columns(tests: xr.Dataset) -> str:
    for name in (name for name in _FORCES if name in tests):
        values = tests[name].values
        if not values.any() or (values.size >= _FEWEST and np.allclose(values, values[0], rtol=1e-9, atol=0.0)):
            return (
                f"a measured force differs between tests, found {name}' = {values[0]:g} in all {values.size}; leave "
                "the column out where it was not measured."
            )
    return ""


def _units(tests: xr.Dataset, vessel: Vessel, beta: np.ndarray) -> str:
    if (drift := float(np.abs(beta).max(initial=0.0))) > np.pi:
        return f"the drift angle is at most 180 deg, found {drift:.3g} rad; write its unit as beta [deg]."
    rudder = float(np.abs(tests["delta"].values).max())
    if rudder > 0.5 * np.pi:
        return f"the rudder angle is at most 90 deg, found {rudder:.3g} rad; write its unit as delta [deg]."
    if 0.0 < rudder < _LEAST_RUDDER:
        return f"the largest rudder angle is 1 deg or more, found {np.rad2deg(rudder):.2g} deg; write delta [rad]."
    if "n" in tests and vessel.propeller is not None:
        ratio = float(np.median(np.abs(tests["n"].values))) / vessel.propeller.n
        if ratio and not 1.0 / _REVOLUTIONS < ratio < _REVOLUTIONS:
            return (
                f"the revolutions are near the ship's nominal {vessel.propeller.n:.3g} 1/s, found a median of "
                f"{ratio * vessel.propeller.n:.3g} 1/s at full scale; write n [1/min], or correct scale.froude."
            )
    return ""


def _contradictions(tests: xr.Dataset, vessel: Vessel) -> str:
    """Forces of two tests of one motion, of which one has another sign or is the double of the other."""
    names = [name for name in ("u", "v", "r", "delta", "n") if name in tests]
    scale = {"u": vessel.particulars.nominal_speed, "v": vessel.particulars.nominal_speed}
    scale |= {"r": vessel.particulars.nominal_speed / vessel.particulars.L}
    motions = np.column_stack([tests[name].values / scale.get(name, 1.0) for name in names])
    _, groups = np.unique(np.round(motions, 5), axis=0, return_inverse=True)
    for group in np.flatnonzero(np.bincount(groups.ravel()) > 1):
        at = np.flatnonzero(groups.ravel() == group)
        for name in (name for name in ("Y", "N") if name in tests):
            forces = tests[name].values
            low, high = float(forces[at].min()), float(forces[at].max())
            if high - low > max(_CONTRADICTION * np.abs(forces[at]).max(), _LEAST_DIFFERENCE * np.abs(forces).max()):
                u, v, delta = (float(tests[key].values[at[0]]) for key in ("u", "v", "delta"))
                drift, delta = np.rad2deg([np.arctan2(-v, u) + 0.0, delta])
                return (
                    f"tests of one motion have one force, found {name}' = {low:.3g} and {high:.3g} at beta = "
                    f"{drift:.3g} deg, delta = {delta:.3g} deg; give beta, r and delta their signs, or leave out one."
                )
    return ""


class _Series(NamedTuple):
    """Tests in which one quantity alone varies: its name, rows, prime values, and Y', N' less those ahead."""

    quantity: str
    rows: np.ndarray
    values: np.ndarray
    forces: dict[str, np.ndarray]
    straight: np.ndarray  # rows of the straight course


def _prime_motion(tests: xr.Dataset, vessel: Vessel) -> dict[str, np.ndarray]:
    speed = np.hypot(tests["u"].values, tests["v"].values)
    r = tests["r"].values * vessel.particulars.L / speed
    return {"v": tests["v"].values / speed, "r": r, "delta": tests["delta"].values}


def _all_series(tests: xr.Dataset, vessel: Vessel) -> Iterator[_Series]:
    """Series of :data:`_FEWEST` tests or more."""
    u, motion = tests["u"].values, _prime_motion(tests, vessel)
    ahead = (u > 0.0) & (np.abs(tests["v"].values) < _MOST_DRIFT * u)
    ahead &= tests["n"].values > 0.0 if "n" in tests else True
    # the straight course measures the offset of each force
    straight = np.flatnonzero(np.all([np.abs(values) < _SMALL for values in motion.values()], axis=0))
    for quantity, values in motion.items():
        others = [np.abs(motion[name]) < _SMALL for name in motion if name != quantity]
        rows = np.flatnonzero(np.all(others, axis=0) & ahead & (np.abs(values) > _SMALL))
        forces = {}
        for name in (name for name in ("Y", "N") if name in tests):
            offset = float(tests[name].values[straight].mean()) if straight.size else 0.0
            forces[name] = tests[name].values[rows] - offset
        if rows.size >= _FEWEST:
            yield _Series(quantity, rows, values[rows], forces, straight)


def _forces(tests: xr.Dataset, vessel: Vessel) -> str:
    speed = np.hypot(tests["u"].values, tests["v"].values)
    for one in _all_series(tests, vessel):
        fault = {"v": _drift, "r": _yaw, "delta": _rudder}[one.quantity](one.forces, one.values, vessel)
        if one.quantity == "v":
            fault = fault or _speeds(one.forces, one.values, speed[one.rows])
        if one.quantity == "delta":
            fault = fault or _resistance(tests, one)
        if fault:
            return fault
    return ""


def _rudder_drag(tests: xr.Dataset, rudder: _Series) -> tuple[np.ndarray, np.ndarray]:
    """Rows of large rudder angles, and the change of X' from the straight course at their speed and revolutions."""
    rows, more, X = [], [], tests["X"].values if "X" in tests else np.zeros(0)
    for k in rudder.rows[np.abs(rudder.values) > _LEAST_DRAG] if X.size else ():
        settings = [tests[name].values for name in _SETTINGS & {*tests}]
        same = [np.isclose(values[rudder.straight], values[k], rtol=0.01) for values in settings]
        beside = rudder.straight[np.all(same, axis=0)]
        if beside.size:
            rows.append(k)
            more.append(X[k] - X[beside].mean())
    return np.array(rows, dtype=int), np.array(more)


def _resistance(tests: xr.Dataset, rudder: _Series) -> str:
    _, more = _rudder_drag(tests, rudder)
    if more.size < _FEWEST or np.mean(more > 0.0) < _LESS_RESISTANCE:
        return ""
    return (
        f"a rudder angle adds to the resistance, found X' greater by {more.max():.3g} than on the straight course; "
        "X' is positive forward: change its sign."
    )


def _thrust(tests: xr.Dataset, vessel: Vessel) -> str:
    """X' of one motion and revolutions at several speeds: the thrust over U^2 falls with the speed."""
    if not {"X", "n"} <= {*tests}:
        return ""
    speed, X, n = np.hypot(tests["u"].values, tests["v"].values), tests["X"].values, tests["n"].values
    motion = [tests["v"].values / speed, tests["r"].values * vessel.particulars.L / speed, tests["delta"].values, n]
    _, groups = np.unique(np.round(np.column_stack(motion), 3), axis=0, return_inverse=True)
    same = (groups.ravel()[:, None] == groups.ravel()) & (n > 0.0)
    slow, fast = np.nonzero(same & (speed[:, None] * _FASTER < speed))
    if slow.size < _FEWEST or np.mean(X[slow] < X[fast]) < _LESS_RESISTANCE:
        return ""
    return (
        "a propeller at the same revolutions pulls more at a lower speed, found X' less by "
        f"{max(X[fast] - X[slow]):.3g} there; X' is positive forward: change its sign."
    )


def captive_doubts(tests: xr.Dataset, vessel: Vessel) -> tuple[str, ...]:
    """Sentences on forces that are possible but unusual, or repeat those of the row before.

    ``tests`` are as from :func:`pymc_ship.read_captive`.
    """
    doubts, pairs = [], _mirrored(tests, vessel)
    for one in _all_series(tests, vessel):
        hull = _hull(vessel, one.quantity, one.values) if one.quantity != "delta" else {}
        compared = {name: one.forces[name] for name in ("YN" if one.quantity == "v" else "N") if name in one.forces}
        if hull and compared:
            ratios = np.abs([_ratio(measured, hull[name]) for name, measured in compared.items()])
            doubts.append(_unusual(" and ".join(f"{name}'" for name in compared), one, np.exp(np.log(ratios).mean())))
        elif one.quantity == "delta" and "Y" in tests:
            rows, more = _rudder_drag(tests, one)
            Y = one.forces["Y"][np.isin(one.rows, rows)] * np.tan(tests["delta"].values[rows])
            doubts.append(_unusual_drag(*_line(-more, Y[:, None])) if rows.size >= _FEWEST else "")
        if one.quantity == "v" and len(pairs.motion) < _FEWEST:
            doubts += _off_zero_in_drift(tests, vessel, one)
    return (*filter(None, doubts), *_off_zero(pairs, vessel), *_rudder_off_zero(pairs), *_stale(tests, vessel))


def _line(measured: np.ndarray, columns: np.ndarray) -> tuple[float, float]:
    """Last coefficient of a least-squares fit to columns, (n_tests, n_columns), and five of its standard errors."""
    values = np.linalg.lstsq(columns, measured)[0]
    variance = np.sum((measured - columns @ values) ** 2) / max(len(measured) - values.size, 1)
    return float(values[-1]), float(_ERRORS * np.sqrt(variance * np.linalg.pinv(columns.T @ columns)[-1, -1]))


def _off_zero_in_drift(tests: xr.Dataset, vessel: Vessel, drift: _Series) -> list[str]:
    """Sentences on Y' and N' that tests in drift, none or few of which mirror each other, have straight ahead."""
    rows, sentences = np.concatenate([drift.rows, drift.straight]), []
    v = np.concatenate([drift.values, np.zeros(drift.straight.size)])
    usual = _hull(vessel, "v", np.array([_OFF_ZERO]))
    for name, hull in _hull(vessel, "v", v).items() if rows.size > _FEWEST else ():
        if name not in tests:
            continue
        zero, error = _line(tests[name].values[rows], np.column_stack([hull, np.ones(v.size)]))
        off = _OFF_ZERO * zero / usual[name][0]
        if abs(off) > _OFF_ZERO and abs(zero) > error:
            sentences.append(
                f"{name}' of the captive tests in drift is {zero:.3g} straight ahead, as at a drift angle of "
                f"{np.rad2deg(abs(off)):.2g} deg: check the zeros of the balance and of beta."
            )
    return sentences


class _Mirrored(NamedTuple):
    """Pairs of tests of opposite drift, r' and delta: half sum and difference of their forces, prime at nominal speed.

    They mirror each other about the centre of the table, which is its own mirror.
    """

    motion: np.ndarray  # (n_pairs, 3), from the centre
    centre: np.ndarray  # beta, r', delta; 0 but for an offset
    weight: np.ndarray  # (U / U_nom)^2
    half_sum: dict[str, np.ndarray]
    half_difference: dict[str, np.ndarray]


def _centre(values: np.ndarray) -> float:
    """Small value that a table has twice as often as any other, otherwise 0."""
    rounded, group, counts = np.unique(np.round(values, 4), return_inverse=True, return_counts=True)
    most = int(counts.argmax())
    often = counts[most] >= 2 * np.delete(counts, most).max(initial=1) and abs(rounded[most]) < _MOST_OFF
    return float(values[group.ravel() == most].mean()) if often else 0.0


def _mirrored(tests: xr.Dataset, vessel: Vessel) -> _Mirrored:
    u, v = tests["u"].values, tests["v"].values
    n = tests["n"].values / np.abs(tests["n"].values).max() if "n" in tests else np.ones(u.size)
    ahead = (u > 0.0) & (np.abs(v) < _MOST_DRIFT * u) & (n > 0.0)
    motion = np.column_stack(list((_prime_motion(tests, vessel) | {"v": np.arctan2(-v, u)}).values()))
    centre = np.array([_centre(values) for values in motion.T])
    settings = [motion - centre, np.hypot(u, v) / vessel.particulars.nominal_speed, n]
    motions, group = np.unique(np.round(np.column_stack(settings)[ahead], 3) + 0.0, axis=0, return_inverse=True)
    row, size = {tuple(values): k for k, values in enumerate(motions)}, np.bincount(group.ravel())
    mirrors = np.array([row.get((*(0.0 - values[:3]), *values[3:]), -1) for values in motions], dtype=int)
    first = np.flatnonzero(mirrors >= np.arange(mirrors.size))
    second, weight = mirrors[first], motions[first, 3] ** 2
    means = {name: np.bincount(group.ravel(), tests[name].values[ahead]) / size for name in _FORCES if name in tests}
    sums = {name: 0.5 * weight * (forces[first] + forces[second]) for name, forces in means.items()}
    differences = {name: 0.5 * weight * (forces[first] - forces[second]) for name, forces in means.items()}
    return _Mirrored(motions[first, :3], centre, weight, sums, differences)


def _off_zero(pairs: _Mirrored, vessel: Vessel) -> list[str]:
    """Sentences on Y' and N' of the straight course: a mean of mirrored tests beyond the side force of a propeller."""
    n_pairs, draught_ratio = len(pairs.motion), _draught(vessel) / vessel.particulars.L
    slopes = {name: force[0] / _SMALL for name, force in _hull(vessel, "v", np.array([-_SMALL])).items()}
    zeros = {}
    for name in (name for name in SIDE_FORCE if name in pairs.half_sum and n_pairs >= _FEWEST):
        zero, error = _line(pairs.half_sum[name], np.ones((n_pairs, 1)))
        zeros[name] = zero - slopes[name] * pairs.centre[0], error
    sizes = {name: zero / (SIDE_FORCE[name] * draught_ratio) for name, (zero, _) in zeros.items()}
    if np.hypot(*(sizes.get(name, 0.0) for name in SIDE_FORCE)) < _ASYMMETRY or pairs.centre[1:].any():
        return []
    return [
        f"{name}' of the captive tests is {zero:.3g} straight ahead, as at a drift angle of "
        f"{np.rad2deg(zero / slopes[name]):.2g} deg: check the zeros of the balance, of beta and of delta."
        for name, (zero, error) in zeros.items()
        if abs(zero) > error and abs(sizes[name]) > 1.0
    ]


def _rudder_off_zero(pairs: _Mirrored) -> list[str]:
    """Sentence on the rudder angle of least resistance: X' = -drag sin^2(delta - off), to first order in off."""
    rudder = np.sin(pairs.motion[:, 2])
    alone, moved = np.all(pairs.motion[:, :2] == 0.0, axis=1), np.any(pairs.motion != 0.0, axis=1)
    if "X" not in pairs.half_sum or np.sum(alone & moved) < _FEWEST:
        return []
    steady = np.column_stack([np.ones(alone.sum()), pairs.weight[alone], rudder[alone] ** 2])
    drag, drag_error = _line(-pairs.half_sum["X"][alone], steady)
    if drag < drag_error:
        return []
    rows = moved & (alone | (rudder == 0.0))  # those without rudder add to the error alone
    off, error = _line(pairs.half_difference["X"][rows], 2.0 * drag * rudder[rows, None])
    least = off + pairs.centre[2]
    if abs(least) < max(_LEAST_OFF, error):
        return []
    return [
        f"X' of the captive tests has its least resistance at a rudder angle of {np.rad2deg(least):.2g} deg instead of "
        "0: check the zero of delta."
    ]


def _unusual(forces: str, series: _Series, ratio: float) -> str:
    if 1.0 / _USUAL < ratio < _USUAL:
        return ""
    motion, column = {"v": ("drift", "beta"), "r": ("yaw", "r' = r L / U")}[series.quantity]
    return (
        f"{forces} of the captive tests in {motion} {'are' if ' and ' in forces else 'is'} {ratio:.2g} times as large "
        f"as of a similar hull: check {column}, which may be {'half' if ratio > 1.0 else 'twice'} the true one."
    )


def _unusual_drag(ratio: float, error: float) -> str:
    least, most = _RUDDER_DRAG
    if least - error < ratio < most + error:
        return ""
    return (
        f"X' of the captive tests changes with the rudder by {ratio:.2g} times Y' tan(delta), {least:g} to {most:g} by "
        "other ships: check the scale of X' and of delta."
    )


def _stale(tests: xr.Dataset, vessel: Vessel) -> list[str]:
    """Sentences on forces equal to the row before, at another motion; none for a table rounded so that many are equal.

    Motions that mirror each other count as one, as do their forces.
    """
    motion, sentences = np.abs(np.column_stack(list(_prime_motion(tests, vessel).values()))), []
    moved, n_motions = (np.diff(motion, axis=0) ** 2).sum(axis=1) > _SMALL, len(np.unique(motion.round(6), axis=0))
    for name in (name for name in _FORCES if name in tests):
        values = np.round(np.abs(tests[name].values) / np.abs(tests[name].values).max(), 9)
        stale = np.flatnonzero(moved & (np.diff(values) == 0.0) & (values[1:] > 0.0))
        if max(n_motions - np.unique(values).size, stale.size) <= max(_REPEATED, _MOST * values.size):
            sentences += [
                f"{name}' of captive test {k + 2} is that of the row before, {tests[name].values[k]:.5g}, at another "
                "motion: correct it, or leave the row out."
                for k in stale
            ]
    return sentences


def _hull(vessel: Vessel, quantity: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Y' and N' of a similar hull, at one quantity alone."""
    s = vessel.particulars
    motion = dict.fromkeys(SYMBOLS, np.zeros(values.size)) | {quantity: values}
    forces = {}
    for letter in "YN":
        known = {
            name[1:]: law[0]
            for name, law in bare_hull(s.L, s.B, _draught(vessel), s.volume).items()
            if name[0] == letter and set(name[1:]) == {quantity}
        }
        forces[letter] = evaluate(tuple(known), motion) @ np.array(list(known.values()))
    return forces


def _draught(vessel: Vessel) -> float:
    return vessel.particulars.d or SLENDER_DRAUGHT * vessel.particulars.L


def _ratio(measured: np.ndarray, expected: np.ndarray) -> float:
    """Least-squares factor from the expected to the measured forces."""
    return float(measured @ expected / (expected @ expected))


def _drift(forces: Mapping[str, np.ndarray], v: np.ndarray, vessel: Vessel) -> str:
    hull = _hull(vessel, "v", v)
    for name, measured in forces.items():
        ratio = _ratio(measured, hull[name])
        if ratio < 0.0 and name == "Y":
            return (
                f"Y' opposes the drift of every hull, found {ratio:.2g} times that of a similar hull; beta is "
                "arctan(-v/u), v to starboard: change the sign of beta, or that of Y'."
            )
        if ratio < -_TURNED:
            return (
                f"N' turns the bow away from the course in drift, found {ratio:.2g} times that of a similar hull; give "
                "the moment about midship, positive to starboard: change its sign, or set frame.reference."
            )
        if ratio > 0.0 and not 1.0 / _RATIO < ratio < _RATIO:
            return _scale_sentence(f"{name}' in drift", ratio, vessel, "beta")
    return ""


def _speeds(forces: Mapping[str, np.ndarray], v: np.ndarray, speed: np.ndarray) -> str:
    """Y' of the same drift at several speeds: prime forces do not grow with the speed."""
    known = np.flatnonzero(forces.get("Y", np.zeros(0)))
    if known.size < _FEWEST:
        return ""
    drift, groups = np.unique(np.round(v[known], 3), return_inverse=True)
    sizes, logarithms = np.log(np.abs(forces["Y"][known])), np.log(speed[known])
    for values in (sizes, logarithms):
        values -= (np.bincount(groups, values) / np.bincount(groups))[groups]
    if np.ptp(logarithms) < np.log(_FASTER) or known.size - drift.size < _FEWEST:
        return ""
    power = float(sizes @ logarithms / (logarithms @ logarithms))
    if abs(power) < _POWER:
        return ""
    return (
        f"a prime force is over the square of the speed of its own test, found Y' of one drift as the power "
        f"{power:.2g} of the speed; divide each force by its own speed squared."
    )


def _yaw(forces: Mapping[str, np.ndarray], r: np.ndarray, vessel: Vessel) -> str:
    hull = _hull(vessel, "r", r)
    if "N" in forces and (ratio := _ratio(forces["N"], hull["N"])) < 0.0:
        return (
            f"N' damps the yaw rate of every hull, found {ratio:.2g} times that of a similar hull; r turns the bow to "
            "starboard: change the sign of r, or that of N'."
        )
    if "N" in forces and not 1.0 / _RATIO < ratio < _RATIO:
        return _scale_sentence("N' in yaw", ratio, vessel, "r")
    if "Y" in forces:
        slope, usual = _ratio(forces["Y"], r), _ratio(hull["Y"], r)
        if abs(slope - usual + vessel.m) < abs(slope - usual):
            return (
                f"Y' is without the model's own mass, found Y'/r' = {slope:.3g}, near {usual:.3g} of a similar hull "
                f"less its mass {vessel.m:.3g}; add m' r' to Y' and m' x_G' r' to N'."
            )
    return ""


def _rudder(forces: Mapping[str, np.ndarray], delta: np.ndarray, vessel: Vessel) -> str:
    for name, sign in (("Y", 1.0), ("N", -1.0)):
        if name in forces and sign * _ratio(forces[name], delta) < 0.0:
            return (
                f"a rudder to port pushes the stern to starboard, found {name}' of the other sign; set "
                "frame.rudder_positive in a format file, or change the sign of the force."
            )
    if len(forces) == 2 and abs(lever := _ratio(forces["N"], forces["Y"]) + _LEVER) > _LEVER_OFF:
        return (
            f"a rudder acts about {_LEVER:g} L aft of midship, found N' / Y' = {lever - _LEVER:.2g}; give the moment "
            "about midship, and both forces over the same area."
        )
    return ""


def _scale_sentence(force: str, ratio: float, vessel: Vessel, motion: str) -> str:
    slenderness = vessel.particulars.L / _draught(vessel)
    reasons = {
        slenderness: 'the forces are over L d: set frame.forces = "Ld" in a format file',
        1.0 / slenderness: 'the forces are over L2: set frame.forces = "L2" in a format file',
        _DEGREES: f"{motion} is in rad: write its unit",
        1.0 / _DEGREES: f"{motion} is in deg: write its unit",
    }
    nearest = min(reasons, key=lambda factor: abs(np.log(ratio / factor)))
    return (
        f"{force} is of the order of that of a similar hull, found {ratio:.2g} times as much; perhaps "
        f"{reasons[nearest]}."
    )
