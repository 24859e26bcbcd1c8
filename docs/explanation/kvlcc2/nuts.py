"""NUTS beside the normal approximation of an identification by parts, on windows of the zigzags that are named.

    python3 docs/explanation/kvlcc2/nuts.py hsva/z20_10_s.csv hsva/z20_10_p.csv

Each window of 5 L/U is a run with an initial state of its own; the noise is what the identification leaves of each
channel, times the root of its dispersion. Both posteriors have that density and the priors of the parameters.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import pymc_ship as ps
from pymc_ship.ship.candidates import stated_prior
from pymc_ship.trajectory.windows import prepared_windows, thinned, window_records

SET = "modular, wake by side"
FORMAT = Path(__file__).with_name("hsva.toml")


def indices(vessel, tree):
    """Medians and ends of 95 % of the indices of a circle and a zigzag."""
    found = {}
    for manoeuvre in (ps.turning_circle(35), ps.zigzag(20, 20)):
        bands = ps.forecast(vessel, tree, manoeuvre, draws=400, duration=1600, step=0.5, rng=5)["index_bands"]
        for name in ("advance", "tactical_diameter", "first_overshoot_angle", "second_overshoot_angle"):
            if name in bands:
                found[name] = bands[name].values
    return found


def main(paths):
    """Fit, sample, compare."""
    trials = [ps.judged_trial(ps.read_trial(path, format=FORMAT), "kvlcc2") for path in paths]
    ship = ps.identify_ship(trials, "kvlcc2", terms=[SET], draws=200, rng=1)
    (candidate,) = ship.candidates
    vessel, fit = candidate.vessel, candidate.fit
    prior = stated_prior(trials, vessel, "hull_database")
    prior = replace(prior, tuned=np.zeros_like(prior.tuned))
    short = [thinned(trial, vessel) for trial in trials]
    windows = [window for trial in short for window in window_records(trial, vessel)]
    block = prepared_windows(short[0], vessel)[0].run.block
    noise_sd = {name: sd * np.sqrt(block) for name, sd in fit.spread.items()}
    settings = {"channels": list(noise_sd), "noise_sd": noise_sd, "noise": "white", "offsets": False}
    trees = {
        "normal": ps.trajectory_posterior(windows, vessel, prior, draws=4000, rng=2, **settings),
        "NUTS": ps.trajectory_nuts_posterior(windows, vessel, prior, draws=500, chains=4, tune=500, rng=3, **settings),
    }
    print(f"{len(windows)} windows; {trees['NUTS'].attrs['verdict']}")
    mean, sd = (
        {k: getattr(tree["posterior"]["coefficients"], of)(("chain", "draw")) for k, tree in trees.items()}
        for of in ("mean", "std")
    )
    shift = ((mean["NUTS"] - mean["normal"]) / sd["normal"]).to_series()
    ratio = (sd["NUTS"] / sd["normal"]).to_series()
    free = [p.name for p in vessel.parameters if p.sd > 1e-6]
    print(f"shift of the mean, in sd: median {shift[free].abs().median():.2f}, largest {shift[free].abs().max():.2f}")
    print(f"ratio of the sd: median {ratio[free].median():.2f}, {ratio[free].min():.2f} to {ratio[free].max():.2f}")
    found = {kind: indices(vessel, tree) for kind, tree in trees.items()}
    for name in found["NUTS"]:
        print(name.replace("_", " "), *(np.round(found[kind][name], 2) for kind in trees))


if __name__ == "__main__":
    main(sys.argv[1:])
