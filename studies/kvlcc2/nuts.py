"""NUTS beside the normal approximation of an identification by parts, as it is and carried to the windows.

    python -m studies.kvlcc2.nuts hsva/z20_10_s.csv

Windows of 5 L/U of the runs that are named, each with a start of its own, under the spread with which the windows of an
identification count. All posteriors have this likelihood and the priors of the parameters; the widening by scatter
between windows and runs comes after.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import arviz as az
import numpy as np

import pymc_ship as ps
from pymc_ship.inference.rows.weak_form import weak_form_start
from pymc_ship.inference.sampling.trajectory_model import mode_nuts_posterior
from pymc_ship.inference.trajectory.mode import TrajectoryMode
from pymc_ship.inference.trajectory.noise import NoiseChoice, residual_tests
from pymc_ship.inference.trajectory.posterior import laplace_posterior
from pymc_ship.inference.trajectory.randomize_then_optimize import randomize_then_optimize
from pymc_ship.inference.trajectory.windows import fit_windows, normal_draws, prepared_windows, thin_record
from pymc_ship.physics.vessel.term_sets import with_terms
from pymc_ship.ships.forecasting.forecast import pooled_forecast
from pymc_ship.ships.identification.candidates import window_prior, with_recorded_effects

SET = "modular"
FORMAT = Path(__file__).parents[2] / "docs" / "case_studies" / "kvlcc2" / "hsva.toml"
MANOEUVRES = (ps.turning_circle(35), ps.turning_circle(35, side="starboard"), ps.zigzag(10, 10), ps.zigzag(20, 20))
DRAWS = 500
INDICES = ("advance", "transfer", "tactical_diameter", "first_overshoot_angle", "second_overshoot_angle")


def main(paths: Sequence[str]) -> None:
    """Fit, sample and compare."""
    trials = [ps.validated_trial(ps.read_trial(path, format=FORMAT), "kvlcc2") for path in paths]
    vessel = with_recorded_effects(with_terms("kvlcc2", SET), trials)
    runs = [thin_record(trial, vessel) for trial in trials]
    windows = [window for k, run in enumerate(runs) for window in prepared_windows(run, vessel, k)]
    prior = window_prior(runs, vessel, "hull_database")
    start = weak_form_start(runs, vessel, prior.mean, prior.scale, method="rk4")
    law = fit_windows(windows, vessel, prior, start)
    sentence = f"root mean square residual of each channel times the root of the design effect {law.design_effect:.3g}"
    noise = NoiseChoice(law.mode, "white", False, np.inf, residual_tests(law.mode), f"Noise sd: {sentence}.")
    mode = TrajectoryMode(noise, 1, 1, {})
    law = replace(law, from_windows=law.mode.covariance, from_prior=np.zeros_like(law.from_prior))
    normal = laplace_posterior(mode, draws=2000, chains=2, rng=np.random.default_rng(1))
    nuts = mode_nuts_posterior(mode, draws=300, chains=2, tune=150, rng=np.random.default_rng(2))
    print(f"{len(windows)} windows, {mode.choice.fit.unknowns.size} unknowns, spread: {mode.choice.sentence}")
    print(f"normal approximation: {normal.attrs['verdict']} (k-hat {normal.attrs['pareto_khat']:.2f})")
    print(f"NUTS: {nuts.attrs['verdict']}\n")
    print(f"{'parameter':12s} {'mode':>9s} {'sd':>9s} {'shift/sd':>9s} {'± mc':>6s} {'sd ratio':>9s}")
    found, error = nuts["posterior"]["coefficients"], az.mcse(nuts["posterior"])["coefficients"]
    fit = mode.choice.fit
    for k, name in enumerate(found["coefficient"].values):
        draws, sd = found.sel(coefficient=name), fit.sd[k]
        shift, noise = float(draws.mean() - fit.coefficients[k]) / sd, float(error.sel(coefficient=name)) / sd
        ratio = float(draws.std()) / sd
        print(f"{name:12s} {fit.coefficients[k]:9.4g} {sd:9.2g} {shift:9.2f} {noise:6.2f} {ratio:9.2f}")
    chains = found.stack(sample=("chain", "draw")).transpose("sample", "coefficient").values
    drawn = {
        "normal": normal_draws(law, DRAWS, np.random.default_rng(3)),
        "carried": randomize_then_optimize(law, DRAWS, np.random.default_rng(3)),
        "NUTS": np.random.default_rng(3).permutation(chains)[:DRAWS],
    }
    print(f"\n{'index':44s} " + " ".join(f"{name:>22s}" for name in drawn))
    settings = {"duration": 1600, "ci_prob": 0.95, "step": 0.5, "method": "rk4"}
    for manoeuvre in MANOEUVRES:
        bands = [
            pooled_forecast([(vessel, rows)], manoeuvre, rng=np.random.default_rng(4), **settings)["index_bands"]
            for rows in drawn.values()
        ]
        for index in (name for name in INDICES if name in bands[0]):
            label = f"{manoeuvre.label}, {index.replace('_', ' ')}"
            ends = [[float(one[index].sel(band=b)) for b in ("median", "lower", "upper")] for one in bands]
            print(f"{label:44s} " + " ".join(f"{m:8.4g} ({low:5.4g}, {high:5.4g})" for m, low, high in ends))


if __name__ == "__main__":
    main(sys.argv[1:])
