from __future__ import annotations

import os
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps

CHANNELS = ("u", "v", "r", "p", "phi", "psi", "x", "y", "delta")


def record(n=50, step=0.1):
    """Random channels over uniform time, with numbers of every size and many digits."""
    rng = np.random.default_rng(6)
    channels = {name: ("time", rng.standard_normal(n) * 10.0 ** rng.integers(-12, 6, n)) for name in CHANNELS}
    return xr.Dataset(channels, {"time": np.arange(n) * step})


class TestCheck:
    def test_a_good_trial_comes_back_itself(self):
        trial = record()
        assert ps.check_trial(trial, CHANNELS) is trial
        assert ps.check_trial(trial, []) is trial

    @pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
    def test_bad_values_are_counted_and_placed(self, bad):
        trial = record()
        trial["v"][[7, 9, 30]] = bad
        with pytest.raises(
            ps.TrialError, match=r"Channel v must be finite, found 3 bad values, the first at t = 0\.7 s"
        ):
            ps.check_trial(trial, CHANNELS)
        ps.check_trial(trial, ["u", "r"])

    def test_missing_channels_are_named(self):
        with pytest.raises(ps.TrialError, match="needs the channels u, p, phi; p, phi missing"):
            ps.check_trial(record().drop_vars(["p", "phi"]), ["u", "p", "phi"])

    def test_a_trial_without_time(self):
        with pytest.raises(ps.TrialError, match="over the coordinate time"):
            ps.check_trial(record().drop_vars("time"), ["u"])

    @pytest.mark.parametrize("uniform", [True, False])
    @pytest.mark.parametrize("bad", [0.9, 0.5, np.nan, np.inf])
    def test_times_must_increase(self, uniform, bad):
        time = np.arange(50) * 0.1
        time[10] = bad  # sample 10 at or before sample 9, or nowhere
        with pytest.raises(ps.TrialError, match="must be finite and increase"):
            ps.check_trial(record().assign_coords(time=time), ["u"], uniform=uniform)

    def test_sampling_must_be_uniform_where_it_matters(self):
        time = np.arange(50) * 0.1
        time[10:] += 1e-4
        trial = record().assign_coords(time=time)
        with pytest.raises(ps.TrialError, match=r"must be uniform, found steps of 0\.1 to 0\.1001 s"):
            ps.check_trial(trial, ["u"])
        ps.check_trial(trial, ["u"], uniform=False)

    def test_times_rounded_to_the_nanosecond_are_uniform(self):
        time = np.round(np.arange(20_000) / 3.0, 9)
        trial = xr.Dataset({"u": ("time", np.ones(20_000))}, {"time": time})
        ps.check_trial(trial, ["u"])

    @pytest.mark.parametrize("step", [0.02, 1.0 / 30.0, 0.1352644, 1.0])
    def test_times_rounded_to_the_microsecond_are_uniform(self, step):
        time = np.round(np.arange(20_000) * step, 6)
        trial = xr.Dataset({"u": ("time", np.ones(20_000))}, {"time": time})
        ps.check_trial(trial, ["u"])

    @pytest.mark.parametrize("step", [1e-4, 0.02, 1.0])
    def test_a_hundredth_of_a_step_is_not_uniform(self, step):
        time = np.arange(100) * step
        time[50:] += 0.01 * step
        with pytest.raises(ps.TrialError, match="must be uniform"):
            ps.check_trial(xr.Dataset({"u": ("time", np.ones(100))}, {"time": time}), ["u"])

    def test_a_batch_is_not_a_trial(self):
        batch = xr.concat([record(), record()], "draw")
        with pytest.raises(ps.TrialError, match=r"function of time alone, found dims \('draw', 'time'\)"):
            ps.check_trial(batch, ["u"])


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


class TestBrokenFiles:
    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("time,u\n0,1\n1,x\n", r"line 3, column u: a number is needed, found 'x'"),
            ("# note\ntime,u\n0,1\n\nlate,1\n", r"line 5, column time: a number is needed, found 'late'"),
            ("time,u\n0,1\n1,\n", r"at least two complete rows, found 1"),
            ("time,u\n0,1\n1,2,3\n", r"line 3: the header has 2 columns, found 3"),
            ("time,u\n0,1\n1\n2,3\n", r"line 3: the header has 2 columns, found 1"),
            ("time,u\n0,1\n1\n", r"at least two rows, found 1 complete"),
            ("time,u,heel\n0,1,2\n1,2,3\n", r"column 'heel': its unit is not stated; call it 'heel \[deg\]' or"),
            ("u,v\n0,1\n1,2\n", r"found 'u, v' without time"),
            ("time,u,u\n0,1,1\n1,2,2\n", r"u is to be read from one column, found 'u', 'u'"),
            ("time|u\n0|1\n1|2\n", r"found 'time\|u' without time"),
            ("time,u\n0,1\n", r"at least two rows, found 2 lines"),
            ("", r"at least two rows, found 0 lines"),
        ],
    )
    def test_the_place_is_named(self, tmp_path, text, message):
        path = tmp_path / "broken.csv"
        path.write_text(text)
        with pytest.raises(ps.TrialError, match=message) as error:
            ps.read_trial(path)
        assert str(path) in str(error.value)
        assert "\n" not in str(error.value)

    def test_files_that_cannot_be_read(self, tmp_path):
        with pytest.raises(ps.TrialError, match=r"absent.csv cannot be read: No such file"):
            ps.read_trial(tmp_path / "absent.csv")
        with pytest.raises(ps.TrialError, match="cannot be read: Is a directory"):
            ps.read_trial(tmp_path)
        (tmp_path / "latin.csv").write_bytes(b"time,u\n# 3\xb0\n0,1\n")
        with pytest.raises(ps.TrialError, match="cannot be read: it is not UTF-8 text"):
            ps.read_trial(tmp_path / "latin.csv")


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
        with pytest.raises(ValueError, match=r"trial.csv cannot be written: No such file or directory"):
            ps.write_trial(record(), tmp_path / "absent" / "trial.csv")
        assert list(tmp_path.iterdir()) == []
