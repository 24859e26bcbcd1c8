"""Parts of a ship's force: mirror, rest, balance, damping, and a part made elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.forces.expressions import Trace
from pymc_ship.physics.forces.modular import PARTS, part_parameters
from pymc_ship.physics.forces.part import INPUTS, STATES, Force, Motion, Parameter, Part
from pymc_ship.physics.forces.programs import execute, set_parameters
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.vessel.parts import force_program, part_program, ship_dimensions, with_parts
from pymc_ship.physics.vessel.vessel import Windage, coefficient_names, reference_coefficients

AHEAD = ("added mass", "hull", "propeller", "rudder")
ANY_SPEED = ("added mass", "low-speed hull", "propeller", "rudder", "wind")
ROLLING = (*AHEAD, "roll")
BY_SIDE = ("dC2", "dgamma_R", "Y_P", "N_P", "Y_nn", "N_nn", "x_C")


def tanker(names):
    """The KVLCC2 by parts."""
    vessel = ps.load_vessel("kvlcc2")
    bare = replace(vessel, forces=dict.fromkeys(vessel.forces, ()), windage=Windage(1000.0, 3000.0))
    return with_parts(bare, names)


def forces(vessel, motion, parameters=None):
    """X, Y, N, K of many instants, (4, n); ``motion`` by name, others 0, revolutions nominal."""
    program = force_program(vessel)
    values = reference_coefficients(vessel) if parameters is None else parameters
    n = np.size(motion["u"])
    work = np.zeros((program.n_rows, n))
    set_parameters(program, np.repeat(values[:, None], n, axis=1), work)
    given = {"n": np.ones(n)} | motion
    for row, name in enumerate((*STATES, *INPUTS)):
        work[row] = given.get(name, 0.0)
    execute(program, work)
    return work[program.results]


def motions(lowest=0.3):
    rng = np.random.default_rng(1)
    n = 50
    drawn_motion = {"u": rng.uniform(lowest, 1.1, n), "v": rng.uniform(-0.3, 0.3, n), "r": rng.uniform(-0.7, 0.7, n)}
    drawn_motion |= {"delta": rng.uniform(-0.6, 0.6, n), "n": rng.uniform(lowest, 1.2, n)}
    return drawn_motion | {"p": rng.uniform(-0.5, 0.5, n), "phi": rng.uniform(-0.3, 0.3, n)}


def mirrored(motion):
    other = ("v", "r", "p", "phi", "delta", "psi", "wind_y")
    return {name: -value if name in other else value for name, value in motion.items()}


@pytest.mark.parametrize(("names", "lowest"), [(AHEAD, 0.3), (ANY_SPEED, -0.6), (ROLLING, 0.3)])
def test_a_ship_in_a_mirror_has_the_mirrored_forces(names, lowest):
    """The screw turns to the other side."""
    vessel, motion = tanker(names), motions(lowest)
    if "wind" in names:
        motion |= {"wind_x": np.full(50, -0.5), "wind_y": np.full(50, 0.8), "psi": np.linspace(-2.0, 2.0, 50)}
    X, *sideways = forces(vessel, motion)
    other = reference_coefficients(vessel)
    other[[k for k, name in enumerate(coefficient_names(vessel)) if name in BY_SIDE]] *= -1.0
    mirror_image = forces(vessel, mirrored(motion), other)
    np.testing.assert_allclose(mirror_image, [X, *np.negative(sideways)], rtol=1e-12, atol=1e-15)
    assert np.any(sideways[-1]) == ("roll" in names)


@pytest.mark.parametrize("name", [name for name in BY_SIDE if name not in ("Y_nn", "N_nn", "x_C")])
def test_what_differs_by_side_breaks_the_mirror(name):
    vessel, motion = tanker(AHEAD), motions()
    values = reference_coefficients(vessel)
    values[coefficient_names(vessel).index(name)] = 0.1
    asymmetry = forces(vessel, motion, values)[1:3] + forces(vessel, mirrored(motion), values)[1:3]
    assert np.abs(asymmetry).max() > 1e-5


def test_at_rest_with_the_propeller_stopped_nothing_acts():
    still = {name: np.zeros(1) for name in ("u", "n")}
    np.testing.assert_allclose(forces(tanker(ANY_SPEED), still), 0.0, atol=1e-9)


@pytest.mark.parametrize("names", [AHEAD, ANY_SPEED[:-1], ROLLING])
def test_a_straight_course_at_nominal_speed_and_revolutions_is_in_balance(names):
    np.testing.assert_allclose(forces(tanker(names), {"u": np.ones(1)}), 0.0, atol=1e-12)


def test_thrust_grows_as_the_ship_slows_down_and_with_the_revolutions():
    vessel = tanker(AHEAD)
    base, slow, fast = (
        forces(vessel, {"u": np.array([u]), "n": np.array([n])})[0, 0] + reference_coefficients(vessel)[3] * u**2
        for u, n in ((1.0, 1.0), (0.7, 1.0), (1.0, 1.2))
    )
    assert slow > 1.05 * base
    assert fast > 1.3 * base


def test_revolutions_astern_stop_the_ship_and_leave_the_rudder_without_a_race():
    vessel = tanker(ANY_SPEED)
    ahead, astern = (
        forces(vessel, {"u": np.array([0.3]), "n": np.array([n]), "delta": np.array([0.4])}) for n in (1.0, -1.0)
    )
    assert astern[0, 0] < 0.0 < ahead[0, 0]
    assert abs(astern[2, 0]) < 0.3 * abs(ahead[2, 0])


def test_a_positive_rudder_turns_to_port_and_slows_down():
    X, _, N, _ = forces(tanker(AHEAD), {"u": np.ones(1), "delta": np.array([0.3])})
    assert X < 0.0
    assert N < 0.0


@pytest.mark.parametrize(
    ("wind", "pushed"), [((-1.0, 0.0), (-1, 0)), ((1.0, 0.0), (1, 0)), ((0.0, -1.0), (0, -1)), ((0.0, 1.0), (0, 1))]
)
def test_wind_pushes_where_it_blows(wind, pushed):
    still = {name: np.zeros(1) for name in ("u", "n")} | {"wind_x": np.array(wind[:1]), "wind_y": np.array(wind[1:])}
    vessel = tanker((*AHEAD, "wind"))
    values = reference_coefficients(vessel)
    values[coefficient_names(vessel).index("k_drift")] = 0.0
    X, Y, _, _ = forces(vessel, still, values)
    assert (np.sign(np.round([X[0], Y[0]], 12)) == pushed).all()


def test_cross_flow_drag_takes_energy_from_every_sideways_motion():
    vessel = tanker(ANY_SPEED)
    names, values = coefficient_names(vessel), reference_coefficients(vessel)
    for name in ("Xvv", "Xvr", "Xrr", "Yv", "Yr", "Nv", "Nr"):
        values[names.index(name)] = 0.0
    rng = np.random.default_rng(2)
    v, r = rng.uniform(-1.0, 1.0, (2, 200))
    motion = {"u": np.zeros(200), "v": v, "r": r, "n": np.zeros(200)}
    values[names.index("f_alpha")] = 0.0
    _, Y, N, _ = forces(vessel, motion, values)
    assert (Y * v + N * r).max() < 0.0


@pytest.mark.parametrize("names", [AHEAD, ANY_SPEED])
def test_nearly_every_ship_of_the_prior_is_damped(names):
    """Pure drift and pure yaw ahead take energy: the signs of Yv and Nr over the range of the prior."""
    vessel, rng = tanker(names), np.random.default_rng(3)
    sd = np.array([parameter.sd for parameter in vessel.parameters])
    draws = reference_coefficients(vessel) + sd * rng.standard_normal((2000, sd.size))
    drift = {"u": np.ones(1), "v": np.array([0.05])}
    turn = {"u": np.ones(1), "r": np.array([0.1])}
    damped = [forces(vessel, drift, row)[1, 0] < 0.0 and forces(vessel, turn, row)[2, 0] < 0.0 for row in draws]
    assert np.mean(damped) > 0.99


def test_heel_is_righted_and_roll_is_damped():
    vessel = tanker(ROLLING)
    for name, way in (("phi", -1.0), ("p", -1.0)):
        K = forces(vessel, {"u": np.ones(2), name: np.array([0.1, -0.1])})[3]
        assert np.sign(K).tolist() == [way, -way], name


@pytest.mark.parametrize("deeper", [0.0, 0.01])
def test_forces_and_masses_of_one_height_do_not_heel(deeper):
    """Lateral forces act on hull and rudder, masses at their centres: at one depth they make no roll."""
    vessel = tanker(ROLLING)
    depth = 0.02
    vessel = replace(vessel, particulars=replace(vessel.particulars, x_G=0.0, z_G=depth * vessel.particulars.L))
    heights = {"z_H": depth, "z_R": depth, "z_Y": depth + deeper}
    values = [heights.get(parameter.name, parameter.value) for parameter in vessel.parameters]
    program, motion = part_program(vessel), motions() | {"p": np.zeros(50), "phi": np.zeros(50)}
    work = np.zeros((program.n_rows, 50))
    set_parameters(program, np.repeat(np.array(values)[:, None], 50, axis=1), work)
    for row, name in enumerate((*STATES, *INPUTS)):
        work[row] = motion.get(name, 0.0)
    execute(program, work)
    _, sway, _, roll = np.abs(work[program.results])
    assert (roll.max() < 1e-9 * sway.max()) == (deeper == 0.0)


def test_a_coupling_of_sway_and_roll_that_is_stated_places_the_added_mass():
    vessel = tanker(ROLLING)
    stated = replace(vessel, added_mass=vessel.added_mass | {"Ypdot": -0.03 * vessel.added_mass["Yvdot"]})
    depth = {parameter.name: parameter.value for parameter in part_parameters(ship_dimensions(stated), ROLLING)}["z_Y"]
    assert depth == pytest.approx(0.03)


def _thruster(ship, motion: Motion, p, shared):
    return Force(0.0, p["T_bow"] * abs(motion.n), 0.45 * p["T_bow"] * abs(motion.n))


def test_a_part_made_elsewhere_is_read_simulated_and_differentiated(monkeypatch, tmp_path):
    """A bow thruster: one entry of the table."""
    known = (Parameter("T_bow", 1e-4, 3e-5, "catalogue"),)
    part = Part("bow thruster", "a side force at the bow", lambda ship: known, _thruster, "bow thruster")
    monkeypatch.setitem(PARTS, part.name, None)  # it is gone after the test
    del PARTS[part.name]
    ps.register_part(part)
    lines = ['name = "ferry"', f"parts = {[*AHEAD, part.name]}", "[particulars]", "L = 100.0", "B = 16.0", "d = 5.0"]
    lines += ["volume = 5000.0", "nominal_speed = 7.0", "rudder_rate_deg = 3.0", "x_G = 0.0"]
    path = tmp_path / "ferry.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    ferry = ps.load_vessel(path)
    assert coefficient_names(ferry)[-1] == "T_bow"
    straight = ps.simulate(ferry, ps.rudder_programme([0.0, 100.0], [0.0, 0.0]), duration=60, step=0.5, method="rk4")
    assert straight["r"].values[-1] > 1e-4
    start = [7.0, 0.0, 0.0, 0.0, 0.0]
    _, jacobian = sensitivities(ferry, np.zeros(100), start, interval=0.5)
    assert jacobian[2, -1, len(ferry.parameters) - 1] > 0.0


def test_a_part_that_is_written_anew_takes_effect_at_once(monkeypatch):
    """A part registered anew under the same name has its own program."""
    vessel, still = tanker(AHEAD), {"u": np.ones(1), "delta": np.array([0.3])}
    before = forces(vessel, still)[2, 0]
    plain = PARTS["rudder"]
    monkeypatch.setitem(PARTS, "rudder", replace(plain, force=lambda *given: Force(N=0.5 * plain.force(*given).N)))
    propeller_alone = forces(vessel, {"u": np.ones(1)})[2, 0]
    assert forces(vessel, still)[2, 0] - propeller_alone == pytest.approx(0.5 * before, rel=1e-9)


def test_names_of_parameters_are_different():
    vessel = tanker(ANY_SPEED)
    names = [
        p.name
        for part in PARTS
        if part != "hull"
        for p in part_parameters(ship_dimensions(vessel)._replace(rolls=True), [part])
    ]
    assert len(set(names)) == len(names)


def test_a_tape_has_every_parameter_once():
    trace = Trace(("u",), ("a", "b"))
    assert list(trace.parameters) == ["a", "b"]
