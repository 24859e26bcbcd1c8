"""Data sets of the frontier: which runs, which integrator and which noise, simulated anew for each level and seed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from pymc_ship.inference.identifiability.bound import cramer_rao_bound
from pymc_ship.machine.seeds import generator
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, stepped_rudder_programme, zigzag
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.vessel.vessel import Vessel, reference_coefficients
from pymc_ship.records.files.noise import RECORD_STEP, noisy_trial
from pymc_ship.trial.channels import default_channels

LEVELS = (0.001, 0.01, 0.05)
"""Noise levels, as :func:`pymc_ship.pollute` takes them."""

SLOW_SPEED = 6.0
"""Approach speed [m/s] of the random rudder programme that is added to the zigzag."""

_SMALL_STEP = 0.002


@dataclass(frozen=True)
class Cell:
    """One kind of data set and what is measured on it.

    Attributes
    ----------
    name : str
    estimators : tuple of str
        Keys of :data:`studies.frontier.measure.ESTIMATORS`.
    levels : tuple of float
    method : {"euler", "rk4"}
        Integrator of the fit. The ship itself moves by the same Euler steps of 0.02 s, or by Runge-Kutta steps of
        0.002 s recorded every 0.02 s.
    n_designed : int
        Runs added to the zigzag: random steps of the rudder from 6 m/s, then a 35/35 zigzag.
    noise : str
        Key of :data:`NOISES`.
    """

    name: str
    estimators: tuple[str, ...]
    levels: tuple[float, ...] = LEVELS
    method: str = "euler"
    n_designed: int = 0
    noise: str = "white"


CELLS = (
    Cell("white", ("bound", "flat", "forecasts", "regressions")),
    Cell("one designed run", ("bound", "starts"), n_designed=1),
    Cell("two designed runs", ("bound", "starts"), n_designed=2),
    Cell("small-step truth", ("bound", "default"), method="rk4"),
    Cell("correlated 0.2 s", ("default", "white assumed"), (0.01,), noise="correlated 0.2 s"),
    Cell("correlated 1 s", ("default", "white assumed"), (0.01,), noise="correlated 1 s"),
    Cell("offsets", ("default", "white assumed"), (0.01,), noise="offsets"),
    Cell("Student-t3", ("default", "white assumed"), (0.01,), noise="Student-t3"),
)
"""What the table of the frontier is made from."""


@dataclass(frozen=True)
class DataSet:
    """Runs of one cell, level and seed: clean and as measured, and the Cramer-Rao bound (None until it is computed).

    Every random number is named by purpose, cell, level and seed, so that the order of the work does not matter.
    """

    vessel: Vessel
    cell: Cell
    level: float
    seed: int
    root: int
    clean: tuple[xr.Dataset, ...] = ()
    trials: tuple[xr.Dataset, ...] = ()
    bound: np.ndarray | None = None

    def rng(self, purpose: str) -> np.random.Generator:
        """Generator of one purpose."""
        return generator(self.root, purpose, self.cell.name, self.level, self.seed)

    @property
    def truth(self) -> np.ndarray:
        """Coefficients of the ship that ran, shape (n_coefficients,)."""
        return reference_coefficients(self.vessel)


def data_set(vessel: Vessel, cell: Cell, level: float, seed: int, *, root: int, duration: float = 400.0) -> DataSet:
    """Simulate the runs of a cell and put the noise of a level on them.

    Parameters
    ----------
    vessel : Vessel
    cell : Cell
    level : float
    seed : int
        Number of the data set.
    root : int
        Root of every random number.
    duration : float, optional
        Of each run [s].

    Returns
    -------
    DataSet
        With the bound where the cell asks for it.
    """
    data = DataSet(vessel, cell, level, seed, root)
    settings = {"method": cell.method, "step": RECORD_STEP if cell.method == "euler" else _SMALL_STEP}
    clean = tuple(
        simulate(vessel, manoeuvre, duration=duration, record_interval=RECORD_STEP, **settings)
        for manoeuvre in _manoeuvres(vessel, cell.n_designed, duration, data.rng("rudder"))
    )
    rng = data.rng("noise")
    data = replace(data, clean=clean, trials=tuple(noisy_trial(one, level, cell.noise, rng) for one in clean))
    return replace(data, bound=_bound(data)) if "bound" in cell.estimators else data


def _manoeuvres(vessel: Vessel, n_designed: int, duration: float, rng: np.random.Generator) -> list[Manoeuvre]:
    """A zigzag, and up to two runs more; angles of up to 35 deg are held for 8 to 30 s in the first of these."""
    dwells, angles = [], []
    while sum(dwells) < duration:
        dwells.append(float(rng.integers(8, 31)))
        angles.append(rng.integers(-35, 36))
    steps = stepped_rudder_programme(angles, dwells, approach_speed=SLOW_SPEED)
    return [zigzag(20, 20), steps, zigzag(35, 35)][: 1 + n_designed]


def _bound(data: DataSet) -> np.ndarray:
    """Cramer-Rao bound at the truth: white noise of the true size, unknown initial states."""
    noise = [{name: trial.attrs[f"noise_sd_{name}"] for name in default_channels()} for trial in data.trials]
    return cramer_rao_bound(data.clean, data.vessel, noise, method=data.cell.method).values
