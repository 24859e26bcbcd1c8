from __future__ import annotations

import os
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.trial.record import check_trial, named_trials, run_names, trial_list
from tests.sentences import refused

CHANNELS = ("u", "v", "r", "p", "phi", "psi", "x", "y", "delta")


def record(n=50, step=0.1):
    """Random channels over uniform time, with numbers of every size and many digits."""
    rng = np.random.default_rng(6)
    channels = {name: ("time", rng.standard_normal(n) * 10.0 ** rng.integers(-12, 6, n)) for name in CHANNELS}
    return xr.Dataset(channels, {"time": np.arange(n) * step})


def test_every_run_has_a_name_of_its_own():
    assert run_names("A score", None, 2) == ("1", "2")
    assert run_names("A score", [1, "b"], 2) == ("1", "b")
    for names, named in ((["a", "a"], "a"), ("ab", "ab"), (["a"], 1), ([], 0)):
        with refused(ps.TrialError, named):
            run_names("A score", names, 2)
    with refused(ps.TrialError, "1"):
        named_trials({1: record(), "1": record()})


class TestCheck:
    def test_a_good_trial_comes_back_itself(self):
        trial = record()
        assert check_trial(trial, CHANNELS) is trial
        assert check_trial(trial, []) is trial

    def test_times_rounded_to_the_nanosecond_are_uniform(self):
        time = np.round(np.arange(20_000) / 3.0, 9)
        trial = xr.Dataset({"u": ("time", np.ones(20_000))}, {"time": time})
        check_trial(trial, ["u"])

    @pytest.mark.parametrize("step", [0.02, 1.0 / 30.0, 0.1352644, 1.0])
    def test_times_rounded_to_the_microsecond_are_uniform(self, step):
        time = np.round(np.arange(20_000) * step, 6)
        trial = xr.Dataset({"u": ("time", np.ones(20_000))}, {"time": time})
        check_trial(trial, ["u"])


class TestRoundTrip:
    def test_values_come_back_to_the_last_digit(self, tmp_path):
        trial = record()
        path = ps.write_trial(trial, tmp_path / "trial.csv")
        assert path == tmp_path / "trial.csv"
        back = ps.read_trial(path)
        assert list(back.data_vars) == list(CHANNELS)
        for name in ("time", *CHANNELS):
            np.testing.assert_array_equal(back[name], trial[name])

    def test_a_simulated_trial_comes_back_with_its_units(self, tmp_path, container):
        trial = ps.simulate(container, ps.zigzag(20, 20), duration=20.0)
        back = ps.read_trial(ps.write_trial(trial, tmp_path / "trial.csv"))
        for name in CHANNELS:
            np.testing.assert_array_equal(back[name], trial[name])
            assert back[name].attrs == trial[name].attrs
        assert back["time"].attrs == {"units": "s"}

    def test_channels_that_are_not_there_stay_away(self, tmp_path):
        back = ps.read_trial(ps.write_trial(record()[["r", "u"]], tmp_path / "trial.csv"))
        assert list(back.data_vars) == ["u", "r"]

    def test_comments_blank_lines_and_spaces_are_read_over(self, tmp_path):
        path = tmp_path / "trial.csv"
        path.write_text("# a trial\n\ntime, u ,v\r\n0, 1.5,2\n  \n# pause\n1,2.5 ,-3e-2\n")
        back = ps.read_trial(path)
        assert back["u"].values.tolist() == [1.5, 2.5]
        assert back["v"].values.tolist() == [2.0, -0.03]


class TestInterruptedWriting:
    @pytest.fixture(params=[KeyboardInterrupt, OSError(28, "No space left on device")])
    def interrupted(self, request, monkeypatch):
        """Nothing can be moved into place; the exception that write_trial lets out."""

        def replace(*_):
            raise request.param

        monkeypatch.setattr(os, "replace", replace)
        return KeyboardInterrupt if request.param is KeyboardInterrupt else ValueError

    def test_nothing_is_left_behind(self, tmp_path, interrupted):
        with pytest.raises(interrupted):
            ps.write_trial(record(), tmp_path / "trial.csv")
        assert list(tmp_path.iterdir()) == []

    def test_a_good_file_survives(self, tmp_path, monkeypatch, interrupted):
        path = tmp_path / "trial.csv"
        path.write_text("what stood here before")
        with pytest.raises(interrupted):
            ps.write_trial(record(), path)
        assert path.read_text() == "what stood here before"
        assert list(tmp_path.iterdir()) == [path]
        monkeypatch.undo()
        ps.write_trial(record(), path)
        assert ps.read_trial(path).sizes == {"time": 50}
        assert list(tmp_path.iterdir()) == [path]

    def test_an_exception_while_rows_are_written(self, tmp_path, monkeypatch):
        """A write that breaks off half way through leaves the old file whole."""
        path = ps.write_trial(record(), tmp_path / "trial.csv")
        before = path.read_bytes()

        def rows():
            yield [0.0] * 10
            raise KeyboardInterrupt

        monkeypatch.setattr(np, "column_stack", lambda _: SimpleNamespace(tolist=rows))
        with pytest.raises(KeyboardInterrupt):
            ps.write_trial(record(), path)
        assert path.read_bytes() == before
        assert list(tmp_path.iterdir()) == [path]

    def test_a_folder_that_is_not_there(self, tmp_path):
        with refused(ValueError, "trial.csv"):
            ps.write_trial(record(), tmp_path / "absent" / "trial.csv")
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda trial: trial.drop_vars("time"), "time"),
        (lambda trial: trial[["time"]], "channels"),
        (lambda trial: trial.expand_dims(draw=2), "draw"),
        (lambda trial: trial.assign(u=3.0), "u"),
        (lambda trial: trial.assign_attrs(facility='tank "B"'), "facility"),
        (lambda trial: trial.assign_attrs(facility="tank\nB"), "facility"),
        (lambda trial: trial.assign_attrs(speeds='over "ground"'), "speeds"),
    ],
)
def test_what_a_file_cannot_hold_is_refused_before_it_is_written(tmp_path, change, named):
    with refused(ps.TrialError, named):
        ps.write_trial(change(record()), tmp_path / "trial.csv")
    assert list(tmp_path.iterdir()) == []


class TestUnits:
    @pytest.mark.parametrize(
        ("name", "units"), [("delta", "deg"), ("u", "kn"), ("r", "deg/s"), ("u", "furlong"), ("time", "min")]
    )
    def test_other_units_than_si_are_refused(self, name, units):
        trial = record()
        trial[name].attrs["units"] = units
        for use in (
            lambda: ps.pollute(trial, level=0.1, rng=1),
            lambda: check_trial(trial, ["u"]),
            lambda: trial_list(trial),
            lambda: trial_list([trial]),
        ):
            with refused(ps.TrialError, name):
                use()

    @pytest.mark.parametrize(
        ("name", "units"), [("delta", "radian"), ("r", "rad s-1"), ("u", ""), ("time", "seconds since 2020")]
    )
    def test_si_units_pass(self, name, units):
        trial = record()
        trial[name].attrs["units"] = units
        assert check_trial(trial, ["u"]) is trial

    def test_units_that_arithmetic_passed_on_are_not_those_of_the_channel(self):
        trial = record()
        trial["psi"] = ("time", np.zeros(trial.sizes["time"]), {"units": "rad"})
        turning = trial["psi"].differentiate("time").assign_attrs(units="rad")
        assert check_trial(trial.assign(r=turning, x=trial["time"] * 5.0), ["u"])


def test_a_file_keeps_what_its_speeds_are_and_its_facility(tmp_path):
    """A format file has precedence."""
    settings = {"speeds": "over ground", "facility": "basin"}
    path = ps.write_trial(record().assign_attrs(settings), tmp_path / "trial.csv")
    assert settings.items() <= ps.read_trial(path).attrs.items()
    assert ps.read_trial(path, format={"facility": "pond"}).attrs["facility"] == "pond"
    assert not settings.keys() & ps.read_trial(ps.write_trial(record(), tmp_path / "trial.csv")).attrs.keys()
