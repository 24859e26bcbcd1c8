"""Simulate the trials of the tutorial, and write them in the format of a ship's logger.

    python docs/tutorials/your_ship/make_trials.py [FOLDER]

The ship is the shipped `kvlcc2` with forces that no term set contains: a rudder that stalls, and drift to the fourth
power in surge. The logger writes one line a second in degrees, knots and degrees a minute, with an offset of
the rate gyro (0.9 deg/min) and of the rudder sensor (0.6 deg, positive to starboard). One run has a gap.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import pymc_ship as ps

RUNS = {
    "zigzag_10_10_starboard": (ps.zigzag(10, 10, side="starboard"), 900, 247.0, None),
    "zigzag_10_10_port": (ps.zigzag(10, 10, side="port"), 900, 68.0, None),
    "zigzag_20_20_port": (ps.zigzag(20, 20, side="port"), 900, 245.0, (412, 416)),
    "zigzag_20_10_starboard": (ps.zigzag(20, 10, side="starboard"), 900, 71.0, None),
    "turning_circle_35_starboard": (ps.turning_circle(35, side="starboard"), 1200, 70.0, None),
}
"""Manoeuvre, duration [s], base course [deg] and missing lines."""

BEFORE = 20
"""Seconds on the straight course before the rudder is put over."""

HEAD = "MT TUTORIAL;manoeuvring trials\nwind;2 Bft\ndepth;120 m\nlogger;1 Hz\n"
COLUMNS = ("time [s]", "NORTH [m]", "EAST [m]", "GYRO [deg]", "ROT [deg/min]", "SOG long [kn]", "SOG trans [kn]")


def true_ship() -> ps.Vessel:
    """The shipped tanker with forces that no term set contains."""
    ship = ps.load_vessel("kvlcc2")
    values = {"Xvvvv": 0.03, "Ygdeltadeltadelta": -0.0025, "Ngdeltadeltadelta": 0.0009}
    forces = {}
    for dof, force in ship.forces.items():
        own = {name: value for name, value in values.items() if name[0] == _LETTERS[dof]}
        forces[dof] = (*force, *(replace(force[0], name=name, value=value) for name, value in own.items()))
    return replace(ship, forces=forces)


_LETTERS = {"surge": "X", "sway": "Y", "yaw": "N"}


def simulated_motion(ship: ps.Vessel, manoeuvre: ps.Manoeuvre, duration: int) -> dict[str, np.ndarray]:
    """Motion at every second, with the straight approach."""
    run = ps.simulate(ship, manoeuvre, duration=duration + 0.5, step=0.05, method="rk4", record_interval=1.0)
    motion = {
        name: np.concatenate([np.full(BEFORE, run[name].values[0]), run[name].values])
        for name in run.data_vars
        if run[name].ndim
    }
    motion["x"][:BEFORE] = ship.particulars.nominal_speed * np.arange(-BEFORE, 0)
    return motion


def log_columns(motion: dict[str, np.ndarray], course: float, rng: np.random.Generator) -> np.ndarray:
    """Columns of the file: noisy, rotated to the base course, in the logger's units and with its offsets."""
    n, c, s = motion["x"].size, np.cos(np.deg2rad(course)), np.sin(np.deg2rad(course))
    x, y = motion["x"], motion["y"]
    knots, noise = 1852.0 / 3600.0, rng.normal(0.0, 1.0, (7, n))
    columns = [
        np.arange(n),
        5000.0 + c * x - s * y + 1.0 * noise[0],
        -2000.0 + s * x + c * y + 1.0 * noise[1],
        np.mod(np.rad2deg(motion["psi"]) + course + 0.05 * noise[2], 360.0),
        60.0 * np.rad2deg(motion["r"]) + 0.9 + 0.3 * noise[3],
        (motion["u"] + 0.02 * noise[4]) / knots,
        (motion["v"] + 0.02 * noise[5]) / knots,
        -np.rad2deg(motion["delta"]) + 0.6 + 0.05 * noise[6],
    ]
    return np.column_stack(columns)


def main(folder: Path) -> None:
    """Write every run."""
    ship = true_ship()
    for number, (name, (manoeuvre, duration, course, gap)) in enumerate(RUNS.items()):
        table = log_columns(simulated_motion(ship, manoeuvre, duration), course, np.random.default_rng(number))
        rows = [
            ";".join(f"{value:.{digits}f}" for value, digits in zip(row, (0, 1, 1, 2, 1, 2, 2, 1), strict=True))
            for row in table
        ]
        if gap:
            del rows[gap[0] : gap[1]]
        text = HEAD + ";".join((*COLUMNS, "RUDDER [deg]")) + "\n" + "\n".join(rows) + "\n\n"
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent))
