"""Trials of the container ship, noise, and faults put into their channels."""

from __future__ import annotations

import numpy as np

import pymc_ship as ps

INTERVAL = 0.2


def simulated(vessel, manoeuvre, duration=400.0):
    return ps.simulate(vessel, manoeuvre, duration=duration, record_interval=INTERVAL)


def noisy(trial, seed=1, level=0.01):
    return ps.pollute(trial, level=level, rng=np.random.default_rng(seed))


def steered(vessel, first=0.0, **settings):
    """Straight for 40 s, then the rudder goes to both sides for 50 s at a time; ``first`` [deg] stays until then."""
    time, delta = [0.0, 40.0], np.deg2rad([first, first]).tolist()
    for k, side in enumerate((1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0)):
        time += [40.1 + 50.0 * k, 90.0 + 50.0 * k]
        delta += [side * np.deg2rad(15.0)] * 2
    return simulated(vessel, ps.rudder_programme(time, delta, **settings))


def changed(trial, **channels):
    """Trial with other values of some channels."""
    return trial.assign({name: ("time", np.asarray(values), trial[name].attrs) for name, values in channels.items()})


def with_samples(trial, name, where, values):
    """Trial with other values at some samples of a channel."""
    channel = trial[name].values.copy()
    channel[where] = values
    return changed(trial, **{name: channel})


def checks_by_name(trial, vessel=None):
    return {check.name: check for check in ps.trial_checks(trial, vessel)}


def alarms(checks):
    """Names of the checks that something is the matter with, without excitation, which a single run rarely suffices."""
    wrong = {name for name, check in checks.items() if check.verdict in ("doubtful", "bad")}
    return {name for name in wrong if not name.startswith("excitation")}


def offset(trial):
    return changed(trial, r=trial["r"].values + np.deg2rad(0.005))


def lever(trial):
    return changed(trial, v=trial["v"].values - 20.0 * trial["r"].values)


def units(name, factor):
    return lambda trial: changed(trial, **{name: factor * trial[name].values})


def through_backlash(values, gap):
    """Readings of an indicator with backlash: it moves once the shaft has taken up the gap."""
    read = np.array(values)
    for k in range(1, read.size):
        read[k] = np.clip(read[k - 1], values[k] - 0.5 * gap, values[k] + 0.5 * gap)
    return read
