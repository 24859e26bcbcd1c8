import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.diagnostics.tables import agreement_rows, agreement_table
from pymc_ship.pages.tables import number


def test_an_agreement_is_tabled_in_prime_values_times_1e5_with_its_worst_quantile():
    rng = np.random.default_rng(0)
    X = rng.standard_normal((40, 2))
    data = ps.RegressionData.from_arrays(
        X, X @ [1e-3, 0.0] + 1e-4 * rng.standard_normal(40), ("Yv", "Yr"), scaling="zscore"
    )
    prior = ps.ConjugatePrior()
    found = ps.agreement(prior.exact(data), {"gibbs": ps.gibbs_posterior(data, prior, rng=rng)})
    made = agreement_table(found)
    assert made.heads == ["quantity", "exact mean", "exact sd", "gibbs mean", "z", "gibbs sd", "z", "|z| q"]
    assert [cells[0] for cells in made.cells] == ["Yv", "Yr", "σ²"]
    exact = found["exact_mean"].values * [1e5, 1e5, 1e10]
    assert [cells[1] for cells in made.cells] == [number(4)(value) for value in exact]
    worst = np.abs(found["z_quantile"].values).max(axis=(found["z_quantile"].dims.index("probability")))
    assert [float(cells[-1]) for cells in made.cells] == pytest.approx(worst.ravel(), abs=0.006)
    (row,) = agreement_rows(found)
    assert (row["method"], row["agrees"]) == ("gibbs", "yes")
    assert row["largest_z"] == float(found["largest_z"].item())
    assert np.isnan(row["divergences"])
