"""Saved ships: what is written is read, the two formats before this one are migrated, and no other is read."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.ships.ensemble.files import FORMAT, MIGRATIONS
from pymc_ship.ships.ensemble.index_error import extrapolation_growth
from pymc_ship.ships.ensemble.index_table import index_rows, index_table
from pymc_ship.ships.ensemble.motion_error import motion_error
from tests.sentences import refused
from tests.ships.ensemble.cases import motion_of, ship_of, with_likelihoods, write_index
from tests.ships.forecasting.cases import scattered
from tests.ships.identification.cases import tanker, trial


class GONE:
    """For a key that is left out."""


SAVED = Path(__file__).parents[2] / "data" / "ships"
"""Two zigzags of the KVLCC2, identified with 8 draws by the last version that wrote a format."""

ROW = {
    **{"run": "zigzag 10/10", "manoeuvre": "zigzag 10/10 port", "index": "first_overshoot_angle", "kind": "angle"},
    **{"measured": 9.89731009365622, "forecast": 11.062129017656899, "parameter_sd": 0.8983950641682057},
    **{"model_sd": 0.0, "measured_sd": 0.024063652226282508, "scale": 19.89731009365622},
}
"""First held-out index in the version that wrote the files."""


@pytest.fixture(scope="module")
def ship():
    """Two members, every attribute of a ship but the noise of sensors, which no identification finds."""
    members = ((tanker(), scattered(tanker(), draws, seed=draws)) for draws in (8, 5))
    known = {"index_error": {"angle": np.array([0.1, 0.2])}, "motion_error": motion_error([], tanker())}
    known |= {"remarks": ("a", "b"), "prior": "order_damped", "held_out_indices": index_table([ROW])}
    known |= {"harder_indices": index_table([ROW | {"beyond": 0.7}]), "extrapolation_growth": np.array([0.5, 3.0])}
    zigzag = ps.zigzag(10, 10)
    motion = motion_of(tanker(), [trial(zigzag, duration=60.0)])
    return with_likelihoods(ship_of(*members, names=("one, two", "three"), motion=motion, **known))


class TestWrittenAndRead:
    @pytest.fixture(scope="class")
    @classmethod
    def again(cls, ship, tmp_path_factory):
        out = tmp_path_factory.mktemp("ship")
        assert ps.save_ship(ship, out, made_by="me", runs=("run",)) == out / "model"
        return ps.load_ship(out)

    def test_every_member_has_its_draws_and_its_likelihood(self, ship, again):
        assert [one.name for one in again.members] == ["one, two", "three"]
        for one, other in zip(ship.members, again.members, strict=True):
            np.testing.assert_array_equal(other.draws, one.draws)
            np.testing.assert_array_equal(other.estimate, one.estimate)
            assert (other.weight, other.inflation, other.design_effect) == (
                one.weight,
                one.inflation,
                one.design_effect,
            )
            for name in ("names", "log_density", "prior_mean", "prior_scale"):
                np.testing.assert_array_equal(getattr(other.likelihood, name), getattr(one.likelihood, name))
            np.testing.assert_array_equal(other.likelihood.gaussian.design, one.likelihood.gaussian.design)

    def test_laws_motion_and_held_out_indices_are_kept(self, ship, again):
        np.testing.assert_array_equal(again.motion.values, ship.motion.values)
        for name in ("index_error", "motion_error"):
            laws = getattr(again, name)
            assert laws.keys() == getattr(ship, name).keys()
            assert all((laws[key] == values).all() for key, values in getattr(ship, name).items())
        assert again.held_out_indices.identical(ship.held_out_indices)
        assert again.harder_indices.identical(ship.harder_indices)
        np.testing.assert_array_equal(again.extrapolation_growth, ship.extrapolation_growth)
        for name in ("remarks", "prior", "facilities", "uses_captive_tests"):
            assert getattr(again, name) == getattr(ship, name)

    def test_a_saved_ship_forecasts_as_it_did(self, ship, again):
        bands = [ps.forecast(one, ps.turning_circle(35), rng=1)["index_bands"]["advance"] for one in (ship, again)]
        np.testing.assert_array_equal(*bands)

    def test_the_format_is_written(self, ship, tmp_path):
        index = json.loads((ps.save_ship(ship, tmp_path) / "ship.json").read_text(encoding="utf-8"))
        assert index["format"] == FORMAT == max(MIGRATIONS) + 1


@pytest.mark.parametrize("lacking", ["likelihood", "motion"])
def test_a_ship_without_the_likelihood_of_its_runs_is_not_saved(ship, tmp_path, lacking):
    without = {
        "likelihood": replace(ship, members=(ship.members[0], replace(ship.members[1], likelihood=None))),
        "motion": replace(ship, motion=None),
    }[lacking]
    with refused(ps.VesselError, "kvlcc2"):
        ps.save_ship(without, tmp_path)
    assert list(tmp_path.iterdir()) == []


WRONG = [
    *((("terms",), bad) for bad in ([], {}, None, "text")),
    *((("terms", 0, key), GONE) for key in ("name", "file", "weight", "log_density")),
    (("terms", 0, "log_density", 0), "text"),
    *(((key,), bad) for key in ("facilities", "index_error", "motion_error") for bad in (None, 3, ["a"], {"": "text"})),
    (("motion_error", "u", 0), []),
    (("motion_error", "u"), []),
    (("facilities", "", "rudder_delay"), GONE),
    *((("held_out_indices", 0, key), GONE) for key in ("run", "manoeuvre", "index", "kind", "measured_sd")),
    (("held_out_indices", 0, "index"), ["a"]),
    (("held_out_indices", 0, "kind"), "weather"),
    *(((key,), None) for key in ("remarks", "prior", "uses_captive_tests", "format")),
    (("prior",), ["text"]),
    (("extrapolation_growth",), "text"),
    (("harder_indices",), [3]),
]


IMPOSSIBLE = [
    *((("terms", 0, "weight"), bad) for bad in (-1.0, 0.5, 2.0, np.nan, np.inf)),
    *(((key, of, 0), bad) for key, of in (("index_error", "angle"), ("motion_error", "u")) for bad in (-0.1, np.nan)),
    *((("facilities", "", key), -1.0) for key in ("rudder_rate_deg", "rudder_delay", "approach_speed")),
    *((("facilities", "", key), np.inf) for key in ("rudder_delay", "approach_speed")),
    (("held_out_indices", 0, "measured_sd"), -0.1),
]


@pytest.mark.parametrize(("path", "value"), [*WRONG, *IMPOSSIBLE], ids=str)
def test_an_index_of_another_form_is_refused_with_the_key(path, value, tmp_path):
    at = Path(shutil.copytree(SAVED / f"format_{max(MIGRATIONS)}", tmp_path / "at"))
    index = node = json.loads((at / "model" / "ship.json").read_text(encoding="utf-8"))
    for key in path[:-1]:
        node = node[key]
    if value is GONE:
        del node[path[-1]]
    else:
        node[path[-1]] = value
    if path == ("terms", 0, "file"):
        (at / "model" / "ship.json").write_text(json.dumps(index), encoding="utf-8")
    else:
        try:
            write_index(at / "model", index)
        except (TypeError, KeyError, AttributeError):  # no files can be named
            (at / "model" / "ship.json").write_text(json.dumps(index), encoding="utf-8")
    outside = (path, value) in IMPOSSIBLE and path[0] in ("held_out_indices", "facilities")
    with refused(ps.VesselError, "ship.json" if path[0] == "terms" else path[-1] if outside else path[0]):
        ps.load_ship(at)


def test_the_weights_of_a_saved_ship_have_the_sum_1(ship, tmp_path):
    """Also where a term set has no draws, which is left out; the others keep the ratio of their weights."""
    weights = {one.name: 0.5 * one.weight for one in ship.members}
    members = [replace(one, weight=weights[one.name]) for one in ship.members]
    members.append(replace(members[0], name="none", draws=members[0].draws[:0], weight=0.5))
    ps.save_ship(replace(ship, members=tuple(members)), tmp_path)
    again = {one.name: one.weight for one in ps.load_ship(tmp_path).members}
    assert again == pytest.approx({name: 2.0 * weight for name, weight in weights.items()})


@pytest.mark.parametrize("ending", [".toml", ".nc"])
def test_a_missing_file_of_a_ship_is_named(ending, tmp_path):
    at = Path(shutil.copytree(SAVED / f"format_{max(MIGRATIONS)}", tmp_path / "at"))
    (file,) = (at / "model").glob(f"*{ending}")
    file.unlink()
    with refused(ps.VesselError, file.name):
        ps.load_ship(at)


class TestEarlierFormats:
    @pytest.mark.parametrize("number", sorted(MIGRATIONS))
    def test_draws_and_likelihood_are_those_of_the_version_that_wrote_them(self, number):
        ship = ps.load_ship(SAVED / f"format_{number}")
        ((vessel, rows),) = ship.models
        assert (vessel.name, rows.shape) == ("kvlcc2", (8, 29))
        assert rows[:2, 0].tolist() == [0.0009109896081059203, 0.0009161677264715609]
        assert rows.sum() == pytest.approx(-0.413616525729991, rel=1e-14)
        ((name, likelihood),) = ship.likelihoods.items()
        assert name == ship.members[0].name == "hull and loading"
        assert likelihood.log_density.tolist() == [9.989009648832024, 8.596577658306643]
        assert np.linalg.norm(likelihood.gaussian.design) == pytest.approx(576825.7929365315, rel=1e-13)
        assert likelihood.gaussian.response.sum() == pytest.approx(-331.09544008862537, rel=1e-12)
        assert likelihood.prior_mean.sum() == pytest.approx(-0.10847942803775153, rel=1e-14)
        assert likelihood.prior_scale.sum() == pytest.approx(0.23488497698815936, rel=1e-14)

    @pytest.mark.parametrize("number", sorted(MIGRATIONS))
    def test_what_is_known_beside_them_is_read_under_its_present_names(self, number):
        ship = ps.load_ship(SAVED / f"format_{number}")
        assert (ship.prior, ship.uses_captive_tests) == ("hull_database", False)
        assert ship.motion.shape == (200, 6)
        assert ship.motion.values.sum() == pytest.approx(-28.39130790383833, rel=1e-12)
        assert ship.facilities[""].rudder_delay == 2.447955856533735
        assert np.median(ship.index_error["distance"]) == pytest.approx(0.00443343632160599, rel=1e-14)
        rows = list(index_rows(ship.held_out_indices))
        assert len(rows) == 12
        assert rows[0] == ROW
        assert ship.harder_indices.sizes["run"] == 0
        np.testing.assert_array_equal(ship.extrapolation_growth, extrapolation_growth([], {}))
        assert repr(ship) == "Ship(kvlcc2: 1 model, 8 draws, model error from 2 held-out runs)"

    @pytest.mark.parametrize("number", sorted(MIGRATIONS))
    def test_the_error_of_the_motion_is_that_of_the_version_that_wrote_it(self, number):
        ship = ps.load_ship(SAVED / f"format_{number}")
        assert ship.remarks == ()
        expected = {"u": 0.00039709111117237125, "r": 0.0005084025119169836, "x": 0.0024960773299353717}
        for name, size in expected.items():
            assert np.median(ship.motion_error[name]) == pytest.approx(size, rel=1e-14)

    @pytest.mark.parametrize("number", sorted(MIGRATIONS))
    def test_a_migrated_ship_is_forecast_and_saved_in_the_present_format(self, number, tmp_path):
        ship = ps.load_ship(SAVED / f"format_{number}")
        index = json.loads((ps.save_ship(ship, tmp_path) / "ship.json").read_text(encoding="utf-8"))
        assert index["format"] == FORMAT
        bands = [
            ps.forecast(one, ps.zigzag(10, 10), rng=1)["index_bands"]["first_overshoot_angle"].values
            for one in (ship, ps.load_ship(tmp_path))
        ]
        np.testing.assert_array_equal(*bands)

    def test_an_earlier_ship_is_the_prior_of_new_runs(self):
        runs = [trial(ps.zigzag(10, 10, side="starboard"), seed=3, level=0.005)]
        identification = ps.identify_ship(runs, tanker(), prior=ps.load_ship(SAVED / "format_3"), draws=8, rng=1)
        density = identification.ship.likelihoods["hull and loading"].log_density
        assert density.size == 2 + 3  # windows of a lone run are held out in three parts
        assert density[:2].tolist() == [9.989009648832024, 8.596577658306643]
        assert identification.ship.held_out_indices.sizes["run"] == 2


@pytest.mark.parametrize("lacking", ["inflation", "coefficient"])
def test_a_posterior_of_another_form_is_refused_with_its_file(lacking, tmp_path):
    at = Path(shutil.copytree(SAVED / f"format_{max(MIGRATIONS)}", tmp_path / "at"))
    index = json.loads((at / "model" / "ship.json").read_text(encoding="utf-8"))
    path = at / "model" / f"{index['terms'][0]['file']}.nc"
    with xr.open_datatree(path) as file:
        tree = file.load()
    if lacking == "inflation":
        del tree.attrs["inflation"]
    else:
        tree["posterior"] = tree["posterior"].to_dataset().isel(coefficient=slice(2, None))
    tree.to_netcdf(path)
    write_index(at / "model", index)
    with refused(ps.VesselError, path.name):
        ps.load_ship(at)
