"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

import pymc_ship as ps
from pymc_ship.experiments.run import read_study
from pymc_ship.physics.manoeuvre.kinds import Index, ManoeuvreKind
from pymc_ship.physics.manoeuvre.registry import register_manoeuvre
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, standard_manoeuvre, written_manoeuvre
from pymc_ship.physics.manoeuvre.zigzags import ZIGZAG
from tests.physics.manoeuvre.test_indices import sine
from tests.physics.manoeuvre.test_new_manoeuvre import GRID
from tests.sentences import wording


def without_attr(name):
    record = sine(1.0)
    del record.attrs[name]
    ps.indices(record)


def off_course(degrees):
    record = sine(1.0)
    return record.assign(psi=("time", record["psi"].values + np.deg2rad(degrees)))


def with_a_gap():
    record = sine(1.0)
    record["psi"][40] = np.nan
    ps.indices(record)


def a_grid_with_another_manoeuvre(tmp_path):
    path = tmp_path / "grid.toml"
    path.write_text(GRID.format("rudder kick 20"))
    read_study(path)


test_trial_errors = wording(
    ps.TrialError,
    (
        "zigzag, a turning_circle or a pull_out, found 'rudder_programme'",
        lambda container: ps.indices(
            ps.simulate(container, ps.rudder_programme([0.0, 9.0], [0.0, 0.1]), duration=20.0)
        ),
    ),
    *(
        (f"; {name} missing", lambda name=name: ps.indices(sine(1.0).drop_vars(name)))
        for name in ["u", "v", "r", "phi", "psi", "x", "y"]
    ),
    *(
        (f"; {name} missing", lambda name=name: ps.indices(sine(1.0).drop_vars(name).expand_dims("draw")))
        for name in ["u", "v", "r", "phi", "psi", "x", "y"]
    ),
    *(
        ("The attrs of a zigzag need heading_deg, side", partial(without_attr, name=name))
        for name in ["heading_deg", "side"]
    ),
    ("the side is 'starboard' or 'port'", lambda: ps.indices(sine(1.0).assign_attrs(side="left"))),
    ("counts from its base course, found 90 deg at the first sample", lambda: ps.indices(off_course(90.0))),
    ("Channel psi must be finite, found 1 bad values, the first at t = 40 s", with_a_gap),
)

test_manoeuvre_errors = wording(
    ps.SimulationError,
    *(
        (r"An index is of angle, drift.*; found .*; choose one of them", lambda quantity=quantity: Index(quantity))
        for quantity in ["mass", ""]
    ),
    ("A scored index is of angle, time, distance, roll; found 'rate'", lambda: Index("rate", scored=True)),
    *(
        (message, lambda settings=settings: ManoeuvreKind("crash_stop", **settings))
        for settings, message in [
            ({"swings": True}, "The figures of a crash stop show its first_overshoot_angle; add this index"),
            ({"circles": True}, "The figures of a crash stop show its advance; add this index"),
            ({"option": "crash"}, "The option --crash needs angles, an example and a title; give all of them"),
            ({"recognise": lambda helm: None}, "is recognised is compared by its indices, found none; add one"),
            (
                {"second_execute_factor": 0.0},
                "The rudder of a crash stop is moved at a heading; add heading_deg to its angles",
            ),
        ]
    ),
    *(
        ("has its own name and option, found", lambda twin=twin: register_manoeuvre(twin))
        for twin in [replace(ZIGZAG, option=""), replace(ZIGZAG, name="other")]
    ),
    ("found 'rudder_kick'; register this kind", lambda: Manoeuvre("rudder_kick", 20.0, 40.0)),
    ("between 0 and 720 deg, found 800", lambda: standard_manoeuvre("pull_out", 20, 800)),
    ("between 0 and 90 deg, found 100", lambda: ps.zigzag(20, 100)),
    ("rudder_deg is a magnitude", lambda: written_manoeuvre("zigzag 0/20")),
    *(
        (message, lambda kind=kind, angles=angles: standard_manoeuvre(kind, *angles))
        for kind, angles, message in [
            ("zigzag", (20.0,), "A zigzag is made with rudder_deg and heading_deg, found 1 angles"),
            ("rudder_programme", (), "A rudder_programme is made with its own constructor, found 0 angles"),
            (
                "anchor",
                (20.0,),
                "a zigzag, a turning_circle, a pull_out or a rudder_programme; found 'anchor'; register this kind",
            ),
        ]
    ),
    ("found 'anchor'", lambda: Manoeuvre("anchor")),
    *(
        (r"rudder_deg is a magnitude.*found", lambda angle=angle: ps.zigzag(angle, 20.0))
        for angle in [0.0, -20.0, 90.0, np.nan, np.inf]
    ),
    *(
        (r"heading_deg is a magnitude.*found", lambda angle=angle: ps.zigzag(20.0, angle))
        for angle in [0.0, -20.0, 90.0, np.nan, np.inf]
    ),
    *(
        (r"rudder_deg is a magnitude.*found", lambda angle=angle: ps.turning_circle(angle))
        for angle in [0.0, -20.0, 90.0, np.nan, np.inf]
    ),
    (r"one of starboard, port; found 'left'", lambda: ps.zigzag(20.0, 20.0, side="left")),
    (r"one of starboard, port; found 'left'", lambda: ps.turning_circle(20.0, side="left")),
    *(
        ("approach speed must be positive and finite, found", partial(constructor, approach_speed=speed))
        for constructor in [
            partial(ps.zigzag, 20, 20),
            partial(ps.turning_circle, 20),
            partial(ps.rudder_programme, [0], [0]),
        ]
        for speed in [0.0, -1.0, np.nan, np.inf]
    ),
    *(
        (message, lambda time=time, delta=delta: ps.rudder_programme(time, delta))
        for time, delta, message in [
            ([], [], "one angle for each time, found shapes"),
            ([0.0, 1.0], [0.0], "one angle for each time, found shapes"),
            ([[0.0, 1.0]], [[0.0, 1.0]], "one angle for each time, found shapes"),
            ([0.0, 0.0], [0.0, 1.0], "increasing times"),
            ([1.0, 0.0], [0.0, 1.0], "increasing times"),
            ([0.0, np.nan], [0.0, 1.0], "finite, increasing times"),
            ([0.0, 1.0], [0.0, np.inf], "finite angles"),
        ]
    ),
)

test_monte_carlo_errors = wording(
    ps.StudyError, ("'turning circle 35', 'pull out 20/90' or one of them with its side", a_grid_with_another_manoeuvre)
)
