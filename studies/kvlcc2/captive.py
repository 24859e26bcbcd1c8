"""Captive tests of the KVLCC2 alone: how well the parts follow them, and where its zigzags disagree.

Usage: python -m studies.kvlcc2.captive captive.csv reports/kvlcc2
"""

import sys

import numpy as np

import pymc_ship as ps
from pymc_ship.inference.captive.comparison import captive_bands, comparison_rows
from pymc_ship.physics.vessel.parts import FIXED_SD

FORMAT = {"scale": {"froude": 46.4}}
ship = ps.load_ship(sys.argv[2])
tests = ps.read_captive(sys.argv[1], "kvlcc2", format=FORMAT)
rng = np.random.default_rng(1)
for vessel, draws in ship.models:
    if not vessel.modular:
        continue
    prior = ps.coefficient_prior([], vessel)
    fit = ps.fit_captive(tests, vessel, prior)
    alone = rng.multivariate_normal(fit.coefficients, fit.covariance, 400)
    found = captive_bands(tests, vessel, {"captive tests alone": alone}, revolutions=fit.revolutions)
    print(
        vessel.title.split(";")[-1].strip(), *(f"{row['force']} R2 {row['R2']:.3f}" for row in comparison_rows(found))
    )
    apart = (draws.mean(axis=0) - fit.coefficients) / prior.scale
    known = (draws.std(axis=0) < 0.9 * prior.scale) & (prior.scale > FIXED_SD)
    names = [parameter.name for parameter in vessel.parameters]
    print({name: f"{z:+.1f}" for name, z, sure in zip(names, apart, known, strict=True) if sure and abs(z) > 1.0})
