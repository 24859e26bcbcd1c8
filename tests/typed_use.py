"""What a type checker sees of the public names: ``make lint`` runs mypy on this file, and nothing runs the file itself.

Each ``assert_type`` fails where a name is missing from ``pymc_ship/__init__.pyi`` or has lost its annotations, because
the type of such a name is ``Any``.
"""

from __future__ import annotations

from pathlib import Path
from typing import assert_type

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.regression.identify import Identification
from pymc_ship.physics.vessel.reading import shipped_vessels
from pymc_ship.ships.identification.model import ShipIdentification

rng = np.random.default_rng(1)
vessel = ps.load_vessel("container")
manoeuvre = ps.zigzag(20.0, 20.0)
trial = ps.simulate(vessel, manoeuvre, duration=100.0)
noisy = ps.pollute(trial, level=0.01, rng=rng)
smooth = ps.denoise(noisy)
data = ps.regression_data(smooth, vessel, "sway", interval=1.0)
prior, log_evidence = ps.maximise_evidence(data)
tree = ps.exact_posterior(data, ps.ConjugatePrior(), rng=rng)
found = ps.identify(smooth, vessel)
known = ps.Ship.from_posterior(vessel, tree, rng=rng)
forecast = ps.forecast(known, ps.turning_circle(35.0), rng=rng)
identified = ps.identify_ship([trial], vessel, rng=rng)

named = ps.simulate("container", manoeuvre, duration=100.0)
rows = ps.predict(ps.exact_posterior(data, ps.ConjugatePrior(), rng=1), data.design_matrix, rng=1)

assert_type(ps.__version__, str)
assert_type(vessel, ps.Vessel)
assert_type(vessel.particulars.L, float)
assert_type(manoeuvre, ps.Manoeuvre)
assert_type(trial, xr.Dataset)
assert_type(noisy, xr.Dataset)
assert_type(smooth, xr.Dataset)
assert_type(data, ps.RegressionData)
assert_type(prior, ps.Prior)
assert_type(log_evidence, float)
assert_type(tree, xr.DataTree)
assert_type(found, Identification)
assert_type(forecast, xr.DataTree)
assert_type(named, xr.Dataset)
assert_type(rows, xr.Dataset)
assert_type(ps.write_trial(trial, "trial.csv"), Path)
assert_type(known, ps.Ship)
assert_type(identified, ShipIdentification)
assert_type(identified.ship, ps.Ship)
assert_type(ps.forecast(vessel, manoeuvre, rng=1), xr.DataTree)
assert_type(shipped_vessels(), tuple[str, ...])
