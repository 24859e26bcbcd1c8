"""The formulas of docs/reference/equations.md, written again in plain numpy, move a ship as ``ps.simulate`` does."""

from __future__ import annotations

import importlib.util
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.forces.terms import evaluate
from pymc_ship.physics.vessel.parts import ship_dimensions, with_parts
from pymc_ship.physics.vessel.term_sets import TERM_SETS
from pymc_ship.physics.vessel.vessel import Windage

REFERENCE = Path(__file__).parents[3] / "docs" / "reference"
_SPEC = importlib.util.spec_from_file_location("equations", REFERENCE / "equations.py")
EQUATIONS = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(EQUATIONS)

STATES = ("u", "v", "r", "p", "phi", "psi", "x", "y", "delta")
TANKER = "kvlcc2"


def constants(vessel):
    """Constants of a vessel by the names that the formulas use."""
    s, propeller = vessel.particulars, vessel.propeller
    ship = {name: getattr(s, name) for name in ("L", "B", "d", "volume", "nominal_speed", "GM", "BM")}
    ship |= {name: getattr(vessel, name) for name in ("m", "x_G", "z_G", "I_zz", "I_xx", "added_mass")}
    ship["rolls"] = "roll" in vessel.dofs
    if propeller is not None:
        ship |= {name: getattr(propeller, name) for name in ("k_0", "k_1", "k_2", "eta", "kappa")}
        ship["J"] = (1.0 - propeller.wake_fraction) * s.nominal_speed / (propeller.n * propeller.D)
    return ship


def constants_of_parts(vessel):
    known = ship_dimensions(vessel)
    names = ("k_0", "k_1", "k_2", "eta", "rudder_area", "frontal", "lateral")
    return constants(vessel) | {name: getattr(known, name) for name in names} | {"J_s": known.J}


def rates_of(vessel, **inputs):
    """Accelerations of a vessel by the formulas of the page."""
    if vessel.modular:
        q = {c.name: c.value for c in vessel.parameters}
        return partial(
            EQUATIONS.rates_of_parts, ship=constants_of_parts(vessel), q=q, parts=set(vessel.parts), **inputs
        )
    coefficients = {c.name: c.value for force in vessel.forces.values() for c in force}
    return partial(EQUATIONS.rates_of_terms, ship=constants(vessel), coefficients=coefficients)


def motion_by_the_page(vessel, command, *, heading=np.inf, factor=1.0, start=None, step=0.5, n_steps=800, **inputs):
    s = vessel.particulars
    rate, delay = np.deg2rad(s.rudder_rate_deg), round(s.rudder_delay / step)
    follow = EQUATIONS.steered(np.deg2rad(command), rate, step, np.deg2rad(heading), factor, delay)
    begin = [s.nominal_speed, *np.zeros(7)] if start is None else start
    return EQUATIONS.euler(rates_of(vessel, **inputs), begin, follow, step, n_steps)


def assert_same_motion(run, expected):
    """Every channel to 1e-9 of its largest value."""
    assert not run["diverged"]
    for name, row in zip(STATES, expected.T, strict=True):
        assert run[name].values == pytest.approx(row, rel=0.0, abs=1e-9 * max(1.0, np.abs(row).max())), name


def tanker(*parts):
    vessel = ps.with_terms(ps.load_vessel(TANKER), "modular")
    return with_parts(vessel, ("added mass", "propeller", "rudder", *parts))


def with_values(vessel, **values):
    """A vessel whose parameters are moved from their typical values, so that none of them is 0."""
    moved = {c.name: values.get(c.name, c.value + 0.3 * c.sd) for c in vessel.parameters}
    return replace(vessel, parameters=tuple(replace(c, value=moved[c.name]) for c in vessel.parameters))


VESSELS = {
    "container, 4 degrees of freedom": lambda: ps.load_vessel("container"),
    "tanker with loading": lambda: ps.load_vessel(TANKER),
    "manoeuvring hull": lambda: with_values(tanker("hull")),
    "low-speed hull": lambda: with_values(tanker("low-speed hull")),
    "roll": lambda: with_values(tanker("hull", "roll")),
    "current and constant force": lambda: with_values(tanker("hull", "current", "constant force")),
}


@pytest.mark.parametrize("name", VESSELS)
def test_the_formulas_make_a_zigzag_as_the_simulator_does(name):
    vessel = VESSELS[name]()
    run = ps.simulate(vessel, ps.zigzag(20, 20), duration=400, step=0.5)
    assert_same_motion(run, motion_by_the_page(vessel, 20.0, heading=20.0, factor=-1.0))


def test_the_formulas_turn_in_wind_as_the_simulator_does():
    areas = replace(tanker("hull"), windage=Windage(1200.0, 3600.0), parts=())
    vessel = with_values(with_parts(areas, ("added mass", "hull", "propeller", "rudder", "wind")))
    run = ps.simulate(vessel, ps.turning_circle(35), duration=400, step=0.5, wind=(15.0, 90.0))
    air = np.array([0.0, -15.0]) / vessel.particulars.nominal_speed
    assert_same_motion(run, motion_by_the_page(vessel, 35.0, wind=tuple(air)))


@pytest.mark.parametrize("n", [-1.0, 0.8])
def test_the_formulas_go_astern_as_the_simulator_does(n):
    vessel = with_values(tanker("low-speed hull"))
    start = [-0.5, 0.1, 1e-3, 0.0, 0.0, 0.3, 0.0, 0.0]
    run = ps.simulate(vessel, ps.turning_circle(20), duration=400, step=0.5, n=n, initial_state=start)
    assert_same_motion(run, motion_by_the_page(vessel, 20.0, start=start, n=n / vessel.propeller.n))


@pytest.mark.parametrize("name", ["quadratic", "cubic", "loading", "hull and loading", "hull and loading, cubic"])
def test_every_term_of_a_set_is_spelled_as_the_evaluator_does(name):
    motion = {"u": -0.2, "v": -0.1, "r": 0.4, "p": 0.1, "phi": 0.05, "delta": -0.3, "g": 1.3, "T": 0.4}
    terms = tuple(dict.fromkeys((*TERM_SETS[name].surge, *TERM_SETS[name].lateral, "v|v|", "pu|pu|", "0u")))
    expected = evaluate(terms, {key: np.array([value]) for key, value in motion.items()})[0]
    full = motion | {"sin": np.sin(-0.3), "cos": np.cos(-0.3)}
    assert [EQUATIONS.term(one, full) for one in terms] == pytest.approx(expected, rel=1e-14)


def test_another_sign_of_one_formula_is_seen():
    vessel = ps.load_vessel(TANKER)
    run = ps.simulate(vessel, ps.turning_circle(35), duration=100, step=0.5)
    expected = motion_by_the_page(vessel, -35.0, n_steps=200)
    with pytest.raises(AssertionError):
        assert_same_motion(run, expected)


def test_the_script_has_every_equation_of_the_page():
    page = (REFERENCE / "equations.md").read_text(encoding="utf-8")
    numbers = [int(number) for number in re.findall(r"\\tag\{(\d+)\}", page)]
    assert numbers == list(range(1, len(numbers) + 1))
    script = (REFERENCE / "equations.py").read_text(encoding="utf-8")
    coded = set()
    for first, _, last in re.findall(r"Eq\. (\d+)( to | and )?(\d+)?", script):
        coded |= set(range(int(first), int(last or first) + 1))
    assert coded == set(numbers)
