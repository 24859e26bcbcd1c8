from __future__ import annotations

from decimal import Decimal

import numpy as np
import pytest
import xarray as xr

from pymc_ship.records.files.interpolation import typical_step
from pymc_ship.records.files.time_base import regular, rounding
from pymc_ship.trial.record import check_trial

STEP = 0.1352644


def signal(time):
    """Two smooth channels."""
    return {"u": 8.0 + np.sin(0.05 * time), "r": 0.01 * np.cos(0.04 * time)}


def significant(values, digits):
    return np.array([float(f"{value:.{digits}g}") for value in values])


def regularised(time, channels):
    """Uniform record of stamps as printed."""
    time = np.asarray(time, dtype=float)
    return regular(time, rounding(time), channels, "run.csv")[:3]


def assert_on_signal(time, channels, atol=1e-4):
    trial = xr.Dataset({name: ("time", values) for name, values in channels.items()}, {"time": time})
    check_trial(trial, channels)
    for name, expected in signal(time).items():
        np.testing.assert_allclose(channels[name], expected, atol=atol, err_msg=name)


class TestRounding:
    @pytest.mark.parametrize(
        ("stamps", "expected"),
        [
            ([0.0, 0.135, 0.27, 12.3, 606.0, 1010.0], [1e-3, 1e-3, 1e-3, 0.1, 1.0, 10.0]),
            ([0.0, 0.02, 0.04, 399.98], [0.01, 0.01, 0.01, 0.01]),
            ([0.0, 100.0, 200.0, 5000.0], [1.0, 1.0, 1.0, 10.0]),
        ],
    )
    def test_the_coarser_of_decimals_and_digits(self, stamps, expected):
        np.testing.assert_allclose(rounding(np.array(stamps)), expected)

    def test_stamps_of_full_precision_are_hardly_rounded(self):
        assert rounding(np.arange(1000) / 3.0).max() < 1e-12

    @pytest.mark.parametrize("decimals", [-3, 0, 2, 9, 11])
    def test_the_numbers_as_printed_give_it(self, decimals):
        rng = np.random.default_rng(0)
        for size in (1, 2, 40):
            values = np.round(rng.normal(0.0, 1e3, size), decimals) * rng.choice([0.1, 1.0, 1e6])
            printed = [Decimal(repr(value)).normalize().as_tuple() for value in values.tolist()]
            last = max(-number.exponent for number in printed)
            digits = max(3, *(len(number.digits) for number in printed))
            first = np.floor(np.log10(np.maximum(np.abs(values), 1e-300)))
            np.testing.assert_array_equal(rounding(values), np.maximum(10.0**-last, 10.0 ** (first + 1 - digits)))


class TestUniformRecords:
    @pytest.mark.parametrize("time", [np.arange(500) * 0.1, np.arange(500) / 3.0, 1.6e9 + np.arange(500) * 0.5])
    def test_they_are_left_alone(self, time):
        channels = signal(time)
        uniform, same, notes = regularised(time, channels)
        np.testing.assert_array_equal(uniform, time)
        assert same.keys() == channels.keys()
        assert notes == []


class TestRoundedStamps:
    @pytest.mark.parametrize("digits", [3, 4, 5])
    def test_the_step_is_found_again(self, digits):
        true = np.arange(9000) * STEP
        time, channels, notes = regularised(significant(true, digits), signal(true))
        assert time.size == 9000
        np.testing.assert_allclose(time, true, atol={3: 0.05, 4: 5e-3, 5: 5e-4}[digits])
        np.testing.assert_array_equal(channels["u"], signal(true)["u"])
        assert len(notes) == 1
        assert ("of 9000 time stamps repeated" in notes[0]) == (digits < 5)
        assert f"replaced by a uniform step of {np.diff(time).mean():.7g} s" in notes[0]

    @pytest.mark.parametrize("decimals", [0, 1, 2, 3])
    def test_fixed_decimals(self, decimals):
        true = np.arange(3000) * STEP
        time, _, (said,) = regularised(np.round(true, decimals), signal(true))
        assert np.diff(time).mean() == pytest.approx(STEP, rel=1e-3)
        np.testing.assert_allclose(time, true, atol=0.5 * 10.0**-decimals)
        assert "probably rounded by the logger" in said

    def test_a_clock_that_ticks_more_slowly_than_the_samples(self):
        true = np.arange(2000) * 0.01
        time, _, (said,) = regularised(np.floor(true / 0.015625) * 0.015625, signal(true))
        assert np.diff(time).mean() == pytest.approx(0.01, rel=1e-3)
        assert "720 of 2000 time stamps repeated" in said

    def test_rounded_stamps_with_a_gap(self):
        true = np.delete(np.arange(3000) * STEP, [700, 701, 702])
        time, channels, (said,) = regularised(np.round(true, 2), signal(true))
        assert time.size == 3000
        assert_on_signal(time, channels, atol=1e-3)
        assert "replaced by a uniform step of 0.13526" in said
        assert "1 gap of up to 3 samples: 3 filled by interpolation" in said


class TestGaps:
    def test_short_ones_are_filled(self):
        every = np.arange(1000) * 0.1
        true = np.delete(every, [*range(300, 305), 600])
        time, channels, notes = regularised(true, signal(true))
        np.testing.assert_allclose(time, every, atol=1e-12)
        assert notes == ["2 gaps of up to 5 samples: 6 filled by interpolation."]
        assert_on_signal(time, channels, atol=0.6**2 / 8.0 * 0.05**2)
        np.testing.assert_allclose(channels["u"][:300], signal(true)["u"][:300], rtol=1e-15)

    def test_whole_seconds_with_one_row_missing_are_a_gap_and_not_rounding(self):
        true = np.delete(np.arange(400.0), 390)
        time, _, notes = regularised(true, signal(true))
        np.testing.assert_array_equal(time, np.arange(400.0))
        assert notes == ["1 gap of up to 1 sample: 1 filled by interpolation."]

    @pytest.mark.parametrize(("begin", "kept"), [(300, slice(340, None)), (700, slice(None, 700))])
    def test_at_long_ones_the_longest_piece_is_kept(self, begin, kept):
        every = np.arange(1000) * 0.1
        true = np.delete(every, np.arange(begin, begin + 40))
        time, _, notes = regularised(true, signal(true))
        np.testing.assert_array_equal(time, every[kept])
        assert len(notes) == 1
        assert f"1 gap of more than 2 s, the longest from {every[begin - 1]:g} to {every[begin + 40]:g} s" in notes[0]
        assert f"the longest piece is used, {time.size} of 960 rows" in notes[0]

    def test_rows_without_a_time_are_gaps(self):
        time = np.arange(200) * 0.5
        time[[50, 51]] = np.nan
        found, _, notes = regularised(time, signal(np.arange(200) * 0.5))
        np.testing.assert_allclose(found, np.arange(200) * 0.5)
        assert notes == ["2 rows without a time left out.", "1 gap of up to 2 samples: 2 filled by interpolation."]


class TestUnevenSampling:
    def test_jitter_is_resampled(self):
        rng = np.random.default_rng(1)
        true = np.arange(1000) * 0.1 + rng.normal(0.0, 0.003, 1000)
        time, channels, (said,) = regularised(true, signal(true))
        assert_on_signal(time, channels)
        assert "resampled to the mean step of" in said
        assert time.size == pytest.approx(1000, abs=1)
        assert np.abs(time - true[: time.size]).max() < 0.02

    def test_steps_that_change(self):
        true = np.cumsum(np.tile([0.4, 0.5, 0.7], 100))
        time, channels, (said,) = regularised(true, signal(true))
        assert said == "steps from 0.4 to 0.7 s: resampled to the mean step of 0.5337793 s by interpolation."
        assert_on_signal(time, channels, atol=1e-3)

    def test_a_repeated_row_is_left_out(self):
        every = np.arange(500) * 0.1
        true = np.insert(every, 200, every[200])
        time, channels, (said,) = regularised(true, signal(true))
        np.testing.assert_allclose(time, every, atol=1e-9)
        assert said.startswith("1 row with repeated time stamps left out")
        assert_on_signal(time, channels)


class TestOrder:
    def test_a_stray_stamp_is_left_out(self):
        time = np.arange(500) * 0.1
        time[100], time[300] = 999.0, -4.0
        found, channels, notes = regularised(time, signal(np.arange(500) * 0.1))
        np.testing.assert_allclose(found, np.arange(500) * 0.1)
        assert notes[0] == "2 rows out of the order of time left out, the first near t = 999 s."
        assert notes[1] == "2 gaps of up to 1 sample: 2 filled by interpolation."
        assert_on_signal(found, channels)

    @pytest.mark.parametrize(("first", "second"), [(300, 500), (500, 300)])
    def test_of_two_runs_in_a_file_the_longer_is_kept(self, first, second):
        time = np.concatenate([np.arange(first), np.arange(second)]) * 0.1
        channels = {"u": np.repeat([1.0, 2.0], [first, second])}
        found, kept, notes = regularised(time, channels)
        assert found.size == 500
        assert set(kept["u"]) == {1.0 if first == 500 else 2.0}
        assert len(notes) == 1
        assert (
            f"Time goes back 1 time, the first at t = {(first - 1) * 0.1:g} s: the longest run is used, 500 of 800"
            in notes[0]
        )


def test_the_typical_step_bears_gaps_and_repeated_stamps():
    every = np.arange(2000) * STEP
    assert typical_step(np.delete(every, np.arange(500, 900))) == pytest.approx(STEP)
    assert typical_step(np.round(every)) == pytest.approx(STEP, rel=0.05)


def test_a_record_whose_newest_row_is_first_is_reversed():
    time = np.arange(200.0)
    found, channels, notes = regularised(time[::-1], {"u": np.cos(0.01 * time)[::-1]})
    assert notes == ["The newest row is first: rows taken in reverse."]
    np.testing.assert_array_equal(found, time)
    np.testing.assert_array_equal(channels["u"], np.cos(0.01 * time))
