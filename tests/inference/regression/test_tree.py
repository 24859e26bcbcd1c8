from __future__ import annotations

import json

import arviz as az
import numpy as np
import pytest
import xarray as xr
from scipy import stats

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.regression.tree import draws_tree, exact_posterior, read_posterior, rng_state, write_posterior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.gibbs import gibbs_posterior
from pymc_ship.machine.errors import OutputError
from tests.inference.regression.peers import simulated
from tests.sentences import refused

FORMATS = [".nc", ".zarr"]


def centred_data():
    rng = np.random.default_rng(6)
    X = np.column_stack([rng.normal([3.0, -8.0], 1.0, (30, 2)), np.full(30, 2.0)])
    y = 1e-4 * (X @ [1.0, 2.0, 3.0] + rng.standard_normal(30))
    labels = {"dof": "sway", "vessel": "raft", "derivative": "euler"}
    return RegressionData.from_arrays(X, y, ["Yv", "Yr", "Y0"], scaling="zscore", time=np.arange(30) * 0.5, **labels)


def tree(prior=None, draws=8):
    prior = prior or ConjugatePrior(mean=[0.1, 0.2, 0.3], kappa=[1.0, 2.0, 3.0], shape=4.0, scale=0.5)
    return exact_posterior(centred_data(), prior, draws=draws, rng=np.random.default_rng(1))


class TestLayout:
    @pytest.mark.parametrize("prior", [ConjugatePrior(), SemiConjugatePrior()])
    def test_groups_dims_and_coordinates(self, prior):
        found = exact_posterior(centred_data(), prior, draws=8, rng=np.random.default_rng(1))
        assert set(found.children) == {"posterior", "log_likelihood", "log_prior", "observed_data", "constant_data"}
        assert found["posterior/coefficients"].dims == ("chain", "draw", "coefficient")
        assert found["posterior/noise_variance"].dims == ("chain", "draw")
        assert found["posterior/coefficients"].coords["coefficient"].values.tolist() == ["Yv", "Yr", "Y0"]
        assert found["log_likelihood/response"].dims == ("chain", "draw", "row")
        assert found["constant_data/time"].attrs["units"] == "s"
        assert found["constant_data/time"].values.tolist() == (np.arange(30) * 0.5).tolist()
        np.testing.assert_array_equal(found["constant_data/design_matrix"], centred_data().design_matrix)
        np.testing.assert_array_equal(found["observed_data/response"], centred_data().response)

    def test_the_samplers_share_one_layout(self):
        exact = exact_posterior(centred_data(), SemiConjugatePrior(), draws=8, rng=np.random.default_rng(1))
        sampled = gibbs_posterior(centred_data(), SemiConjugatePrior(), draws=2, rng=np.random.default_rng(1))
        for group in exact.children:
            one, other = exact[group].dataset, sampled[group].dataset
            assert {name: value.dims for name, value in one.items()} == {k: v.dims for k, v in other.items()}
            assert one.sizes == other.sizes

    def test_attrs_hold_prior_labels_scaling_and_citations(self):
        attrs = tree().attrs
        assert json.loads(attrs["prior"])["kappa"] == [1.0, 2.0, 3.0]
        assert (attrs["dof"], attrs["vessel"], attrs["derivative"]) == ("sway", "raft", "euler")
        scaling = json.loads(attrs["scaling"])
        assert scaling["response_scale"] == centred_data().response_scale
        assert scaling["column_center"] == centred_data().column_center.tolist()
        assert "10.1016/j.oceaneng.2019.106612" in attrs["citations"]
        assert {"numpy", "pymc-ship"} <= set(json.loads(attrs["versions"]))

    def test_further_groups_are_kept(self):
        data, prior = centred_data(), ConjugatePrior()
        stats_group = xr.Dataset({"energy": (("chain", "draw"), np.ones((1, 2)))})
        groups = {"sample_stats": stats_group}
        found = draws_tree(data, prior, np.ones((1, 2, 3)), np.ones((1, 2)), method="nuts", rng_state="", groups=groups)
        assert found["sample_stats/energy"].shape == (1, 2)


class TestDensities:
    def test_the_log_likelihood_is_that_of_scipy(self):
        found, data = tree(), centred_data()
        middle = found["posterior/coefficients"].values @ data.design_matrix.T
        sd = np.sqrt(found["posterior/noise_variance"].values)[..., None]
        np.testing.assert_allclose(
            found["log_likelihood/response"], stats.norm.logpdf(data.response, middle, sd), rtol=1e-12
        )

    @pytest.mark.parametrize("prior_type", [ConjugatePrior, SemiConjugatePrior])
    def test_the_log_prior_is_that_of_scipy_with_the_jacobian_of_the_scaling(self, prior_type):
        data = centred_data()
        prior = prior_type(mean=[0.1, 0.2, 0.3], kappa=[1.0, 2.0, 3.0], shape=4.0, scale=0.5)
        rng = np.random.default_rng(2)
        b, s2 = data.to_original(rng.standard_normal((1, 5, 3))), data.response_scale**2 * rng.uniform(0.1, 2.0, (1, 5))
        found = draws_tree(data, prior, b, s2, method="gibbs", rng_state="")
        offset, T = data.transformation
        factor = s2[0] / data.response_scale**2 if prior_type is ConjugatePrior else np.ones(5)
        known = [
            stats.multivariate_normal.logpdf(
                b[0, k], offset + T @ prior.mean, factor[k] * (T * prior.kappa) @ T.T, allow_singular=True
            )
            for k in range(5)
        ]
        np.testing.assert_allclose(found["log_prior/coefficients"][0], known, rtol=1e-8)
        noise = stats.invgamma.logpdf(s2, 4.0, scale=0.5 * data.response_scale**2)
        np.testing.assert_allclose(found["log_prior/noise_variance"], noise, rtol=1e-10)

    def test_arviz_reads_it(self):
        found = tree(draws=400)
        summary = az.summary(found)
        assert summary.index.tolist() == [
            "coefficients[Yv]",
            "coefficients[Yr]",
            "coefficients[Y0]",
            "noise_variance",
        ]
        assert float(az.loo(found, var_name="response").elpd) == pytest.approx(
            float(found["log_likelihood/response"].mean(("chain", "draw")).sum()), abs=5.0
        )


class TestStorage:
    @pytest.mark.parametrize("suffix", FORMATS)
    def test_it_comes_back_identical(self, tmp_path, suffix):
        found, path = tree(), tmp_path / f"surge{suffix}"
        assert write_posterior(found, path) == path
        assert read_posterior(path).identical(found)
        assert [entry.name for entry in tmp_path.iterdir()] == [path.name]

    @pytest.mark.parametrize("suffix", FORMATS)
    def test_a_second_write_takes_the_place_of_the_first(self, tmp_path, suffix):
        path = tmp_path / f"surge{suffix}"
        write_posterior(tree(draws=8), path)
        write_posterior(tree(draws=16), path)
        assert read_posterior(path).identical(tree(draws=16))

    @pytest.mark.parametrize("suffix", FORMATS)
    @pytest.mark.parametrize("before", [False, True], ids=["none before", "one before"])
    def test_an_interrupted_write_leaves_the_final_name_as_it_was(self, tmp_path, monkeypatch, suffix, before):
        path = tmp_path / f"surge{suffix}"
        if before:
            write_posterior(tree(draws=8), path)
        writer = "to_netcdf" if suffix == ".nc" else "to_zarr"
        whole = getattr(xr.DataTree, writer)

        def interrupted(self, *arguments, **options):
            whole(self, *arguments, **options)
            raise KeyboardInterrupt

        monkeypatch.setattr(xr.DataTree, writer, interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_posterior(tree(draws=16), path)
        assert [entry.name for entry in tmp_path.iterdir()] == ([path.name] if before else [])
        if before:
            assert read_posterior(path).identical(tree(draws=8))

    def test_other_endings_are_refused(self, tmp_path):
        with refused(ValueError, "surge.csv"):
            write_posterior(tree(), tmp_path / "surge.csv")
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("suffix", FORMATS)
    def test_a_tree_that_carries_no_checksum_is_read(self, tmp_path, suffix):
        path = tmp_path / f"surge{suffix}"
        tree().to_netcdf(path) if suffix == ".nc" else tree().to_zarr(path, consolidated=False)
        assert read_posterior(path).identical(tree())

    @pytest.mark.parametrize("place", ["zarr.json", "posterior/zarr.json", "posterior/coefficients/c/0/0/0"])
    def test_a_zarr_folder_that_was_changed_is_refused(self, tmp_path, place):
        path = write_posterior(tree(), tmp_path / "surge.zarr")
        before = (path / place).read_bytes()
        for odd in (b"", b"[" * 100_000, b"[]", b'{"attributes": 3}', before[:-1] + b"7"):
            (path / place).write_bytes(odd)
            with refused(ValueError, "checksum"):
                read_posterior(path)
        (path / place).write_bytes(before)
        assert read_posterior(path).identical(tree())
        (path / place).unlink()
        with refused(ValueError, "surge.zarr"):
            read_posterior(path)

    def test_a_full_disk_is_named_in_the_error(self, tmp_path, monkeypatch):
        """As netCDF tells it."""

        def full(*_, **__):
            raise RuntimeError("NetCDF: HDF error")

        monkeypatch.setattr(xr.DataTree, "to_netcdf", full)
        with refused(OutputError, "surge.nc"):
            write_posterior(tree(), tmp_path / "surge.nc")
        assert list(tmp_path.iterdir()) == []


class TestState:
    def test_it_restores_a_generator(self):
        rng = np.random.default_rng(5)
        rng.standard_normal(3)
        state = rng_state(rng)
        expected = rng.standard_normal(4)
        again = np.random.default_rng()
        again.bit_generator.state = json.loads(state)
        np.testing.assert_array_equal(again.standard_normal(4), expected)

    @pytest.mark.parametrize("bits", [np.random.PCG64, np.random.MT19937, np.random.Philox])
    def test_every_bit_generator_has_one(self, bits):
        rng = np.random.Generator(bits(1))
        again = np.random.Generator(bits(2))
        again.bit_generator.state = json.loads(rng_state(rng))
        assert again.integers(1 << 60) == rng.integers(1 << 60)


def test_plain_data_are_named_by_number():
    found = exact_posterior(simulated(5, 2, seed=1), ConjugatePrior(), draws=4, rng=np.random.default_rng(1))
    assert found["posterior"].coords["coefficient"].values.tolist() == ["x1", "x2"]
