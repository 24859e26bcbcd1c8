"""Clocks of loggers: each is read as the seconds that passed, and a sentence says how."""

from __future__ import annotations

from datetime import UTC, datetime, time, timedelta

import numpy as np
import pytest

import pymc_ship as ps
from tests.records.files.cases import written
from tests.sentences import refused

BEGIN = datetime(2024, 2, 28, 23, 58, 30, tzinfo=UTC)
STEP, COUNT = 0.5, 400  # past midnight, to the 29th


def stamps(form, begin=BEGIN, step=STEP, count=COUNT):
    """Stamps as text, by a function of the date."""
    return [form(begin + timedelta(seconds=step * k)) for k in range(count)]


def dated(pattern, decimals=1):
    """Function that prints a date, %f with some decimals."""
    return lambda date: date.strftime(pattern.replace("%f", f"{date.microsecond:06d}"[:decimals]))


def epoch(factor):
    return lambda date: f"{round((date - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds() * factor)}"


def days(first, digits=8):
    return lambda date: f"{(date - first).total_seconds() / 86400.0:.{digits}f}"


def motion(time):
    """Speed, track, heading and yaw rate that agree."""
    rate = 0.02 * np.sin(0.05 * time)
    psi = 0.4 * (1.0 - np.cos(0.05 * time))
    step = np.diff(time, prepend=time[0])
    return {
        "u": np.full(time.size, 7.0),
        "r": rate,
        "psi": psi,
        "x": np.cumsum(7.0 * np.cos(psi) * step),
        "y": np.cumsum(7.0 * np.sin(psi) * step),
    }


def table(cells, heading="time", channels=None, delimiter=";"):
    """Text of a trial file with such stamps."""
    channels = motion(STEP * np.arange(len(cells))) if channels is None else channels
    lines = written(channels, delimiter).splitlines()
    return "\n".join([heading + delimiter + lines[0], *map(delimiter.join, zip(cells, lines[1:], strict=True))]) + "\n"


def without_midnight(pattern, decimals=1):
    """As :func:`dated`, without the time at midnight."""
    return lambda date: dated(pattern if date.time() != time.min else pattern.split(" ")[0], decimals)(date)


def without_zeros(pattern):
    """As :func:`dated`, without a fraction that is zero."""
    return lambda date: dated(pattern)(date).replace(".0", "", 1) if not date.microsecond else dated(pattern)(date)


def ended(pattern):
    """As :func:`dated`, midnight as 24:00 of the day before."""
    day = timedelta(days=1)
    return lambda date: (
        dated(pattern)(date - day).replace("00:00:00", "24:00:00") if date.time() == time.min else dated(pattern)(date)
    )


EXCEL = datetime(1899, 12, 30, tzinfo=UTC)

CLOCKS = {
    "ISO 8601": (dated("%Y-%m-%dT%H:%M:%S.%fZ"), "dates and times, counted from 2024-02-28 23:58:30 UTC"),
    "with a zone": (dated("%Y-%m-%d %H:%M:%S.%f+05:30"), "dates and times, counted from 2024-02-28 18:28:30 UTC"),
    "decimal comma": (dated("%Y-%m-%d %H:%M:%S,%f"), "dates and times"),
    "basic": (dated("%Y%m%dT%H%M%S.%fZ"), "dates and times"),
    "slashes": (dated("%Y/%m/%d %H:%M:%S.%f"), "dates and times"),
    "day first": (dated("%d.%m.%Y %H:%M:%S.%f"), "dates and times"),
    "month first": (dated("%m/%d/%Y %I:%M:%S.%f %p"), "dates and times"),
    "zone name": (dated("%Y-%m-%d %H:%M:%S.%f UTC"), "dates and times"),
    "24:00": (ended("%d.%m.%Y %H:%M:%S.%f"), "from 2024-02-28 23:58:30 UTC"),
    "ISO 8601 with 24:00": (ended("%Y-%m-%dT%H:%M:%S.%f"), "from 2024-02-28 23:58:30 UTC"),
    "time of day with 24:00": (ended("%H:%M:%S.%f"), "hours, minutes and seconds, counted from 23:58:30.0"),
    "year of two digits": (dated("%y/%m/%d %H:%M:%S.%f"), "from 2024-02-28 23:58:30 UTC"),
    "time of day in UTC": (dated("%H:%M:%S.%f UTC"), "hours, minutes and seconds, counted from 23:58:30.0"),
    "time of day with Z": (dated("%H:%M:%S.%fZ"), "hours, minutes and seconds, counted from 23:58:30.0"),
    "time of day with an offset": (dated("%H:%M:%S.%f+01:00"), "hours, minutes and seconds, counted from 23:58:30.0"),
    "time of day": (dated("%H:%M:%S.%f"), "hours, minutes and seconds, counted from 23:58:30.0"),
    "am and pm": (dated("%I:%M:%S.%f %p"), "hours, minutes and seconds"),
    "minutes": (dated("%M:%S.%f"), "minutes and seconds, counted from 58:30.0"),
    "hhmmss": (dated("%H%M%S.%f"), "hhmmss, as a step of 40.5 at a full minute are 0.5 s; counted from 235830.00"),
    "yyyymmddhhmmss": (dated("%Y%m%d%H%M%S.%f"), "dates as yyyymmddhhmmss, counted from 2024-02-28 23:58:30"),
    "epoch ms": (epoch(1e3), "ms since 1970, counted from 2024-02-28 23:58:30 UTC"),
    "epoch us": (epoch(1e6), "us since 1970"),
    "epoch ns": (epoch(1e9), "ns since 1970"),
    "spreadsheet": (days(EXCEL), "days as in a spreadsheet"),
    "days since year 1": (days(datetime(1, 1, 1, tzinfo=UTC)), "days as in a spreadsheet"),
}


@pytest.mark.parametrize("name", CLOCKS)
def test_a_clock_counts_from_its_first_stamp(read, name):
    form, sentence = CLOCKS[name]
    trial = read(table(stamps(form)))
    np.testing.assert_allclose(trial["time"], STEP * np.arange(COUNT), atol=2e-3)
    np.testing.assert_allclose(trial["r"], motion(STEP * np.arange(COUNT))["r"], atol=1e-5)
    assert sentence in trial.attrs["reading"]


@pytest.mark.parametrize(
    "form",
    [
        without_midnight("%d.%m.%Y %H:%M:%S.%f"),
        without_midnight("%m/%d/%Y %H:%M:%S.%f"),
        without_zeros("%d/%m/%Y %H:%M:%S.%f"),
        dated("%d/%m/%y %H:%M:%S.%f"),
    ],
)
def test_days_and_months_that_could_change_places_at_midnight(read, form):
    trial = read(table(stamps(form, datetime(2026, 2, 5, 23, 58, 30, tzinfo=UTC))))
    np.testing.assert_allclose(trial["time"], STEP * np.arange(COUNT), atol=2e-3)
    assert "from 2026-02-05 23:58:30 UTC" in trial.attrs["reading"]


def test_seconds_since_1970_without_and_with_nanoseconds(read):
    seconds = np.array(stamps(epoch(2.0)), dtype=float) / 2.0
    trial = read(table([f"{second:.1f}" for second in seconds], "Timestamp"))
    np.testing.assert_allclose(trial["time"], STEP * np.arange(COUNT), atol=1e-6)
    cells = [f"{second // 1:.0f};{second % 1 * 1e9:.0f}" for second in seconds]
    trial = read(table(cells, "header.stamp.secs;header.stamp.nsecs"))
    np.testing.assert_allclose(trial["time"], STEP * np.arange(COUNT), atol=1e-6)
    assert "'header.stamp.nsecs' added to 'header.stamp.secs'." in trial.attrs["reading"]


@pytest.mark.parametrize(
    ("unit", "size"), [("ms", 1e-3), ("us", 1e-6), ("min", 60.0), ("h", 3600.0), ("days", 86400.0)]
)
def test_track_and_speed_tell_the_unit(read, unit, size):
    time = STEP * np.arange(COUNT)
    trial = read(table([repr(second / size) for second in time.tolist()]))
    np.testing.assert_allclose(trial["time"], time, rtol=1e-9, atol=1e-9)
    assert f"read in {unit}, in which track and speed agree; if not, state [columns] time" in trial.attrs["reading"]


def test_heading_and_yaw_rate_tell_it_without_a_track(read):
    channels = {name: motion(STEP * np.arange(COUNT))[name] for name in ("psi", "r")}
    trial = read(table([str(500 * k) for k in range(COUNT)], channels=channels))
    assert trial["time"].values[-1] == pytest.approx(STEP * (COUNT - 1))
    assert "read in ms, in which heading and yaw rate agree" in trial.attrs["reading"]


def test_without_both_the_sampling_does_and_the_format_decides(read):
    channels = {"u": motion(STEP * np.arange(COUNT))["u"]}
    text = table([str(500 * k) for k in range(COUNT)], channels=channels)
    trial = read(text)
    assert trial["time"].values[-1] == pytest.approx(STEP * (COUNT - 1))
    assert "read in ms: in s there were 500 s between samples; if not, state [columns] time" in trial.attrs["reading"]
    stated = read(text, format={"columns": {"time": {"column": "time", "unit": "s"}}})
    assert stated["time"].values[-1] == 500.0 * (COUNT - 1)
    assert read(text.replace("time;", "time [s];"))["time"].values[-1] == 500.0 * (COUNT - 1)


@pytest.mark.parametrize(
    ("begin", "period", "unit"), [(86300.0, 86400.0, "s"), (604700.0, 604800.0, "s"), (4294800, 4294967.296, "ms")]
)
def test_a_counter_that_starts_again_goes_on(read, begin, period, unit):
    cells = [f"{(begin + STEP * k) % period:.4f}" for k in range(COUNT)]
    cells = cells if unit == "s" else [f"{1e3 * float(cell):.0f}" for cell in cells]
    trial = read(table(cells, f"time [{unit}]"))
    np.testing.assert_allclose(trial["time"], begin + STEP * np.arange(COUNT), atol=1e-3)
    assert f"the clock starts again 1 time, as at midnight; {period:g} s added" in trial.attrs["reading"]


@pytest.mark.parametrize("back", [3.0, 3600.0])
def test_a_clock_set_back_is_named(read, back):
    begin = datetime(2024, 10, 27, 2, 59, 0)
    cells = [f"{begin + timedelta(seconds=k - back * (k >= 250)):%Y-%m-%d %H:%M:%S}" for k in range(COUNT)]
    trial = read(table(cells))
    assert trial.sizes["time"] == 250
    assert "Time goes back 1 time, the first at t = 249 s" in trial.attrs["reading"]


@pytest.mark.parametrize("step", [20.0, 100.0])
def test_round_stamps_in_seconds_are_no_hhmmss(read, step):
    time = step * np.arange(COUNT)
    trial = read(table([f"{second:.0f}" for second in time], channels=motion(time)))
    np.testing.assert_array_equal(trial["time"], time)
    assert trial.attrs["reading"] == ""


def test_a_file_with_two_clocks_takes_one(read):
    cells = [f"{STEP * k};{stamp}" for k, stamp in enumerate(stamps(dated("%H:%M:%S")))]
    trial = read(table(cells, "Time [s];UTC"))
    np.testing.assert_array_equal(trial["time"], STEP * np.arange(COUNT))
    assert "Columns left out: UTC." in trial.attrs["reading"]


def test_a_stamp_that_is_none_is_named(read):
    cells = stamps(dated("%Y-%m-%dT%H:%M:%SZ"))
    cells[7] = "soon"
    with refused(ps.TrialError, 9, "soon"):
        read(table(cells))
    cells[7] = ""
    assert "1 row without a time left out." in read(table(cells)).attrs["reading"]


OF_TWO_NUMBERS = {"hours and minutes": (60.0, "%H:%M", 0.02), "minutes and seconds": (1.0, "%M:%S", 0.2)}
"""Unit of the last number [s], form, and time between the rows in that unit."""


class TestStampsOfTwoNumbers:
    """A column such as 08:00, to the minute or to the second."""

    def text(self, kind, names, every=None, count=300):
        """Stamps that each stand ``1 / every`` times."""
        unit, form, usual = OF_TWO_NUMBERS[kind]
        every = every or usual
        channels = motion(unit * every * np.arange(count))
        cells = stamps(dated(form), datetime(2024, 2, 28, 8, 8, tzinfo=UTC), unit * every, count)
        return table(cells, channels={name: channels[name] for name in names})

    @pytest.mark.parametrize("names", [("x", "y", "u"), ("psi", "r")])
    @pytest.mark.parametrize("kind", OF_TWO_NUMBERS)
    def test_channels_that_agree_tell(self, read, kind, names):
        trial = read(self.text(kind, names))
        unit, _, every = OF_TWO_NUMBERS[kind]
        assert float(np.diff(trial["time"]).mean()) == pytest.approx(every * unit, rel=0.02)
        assert f"time from 'time': {kind}, counted from 08:" in trial.attrs["reading"]
        other = {1.0: "min", 60.0: "s"}[unit]
        assert f'state [columns] time = {{ column = "time", unit = "{other}" }}.' in trial.attrs["reading"]

    def test_the_format_states_it_where_nothing_tells(self, read):
        text = self.text("hours and minutes", ("u", "psi"))
        with refused(ps.TrialError, "time", "min"):
            read(text)
        for unit, seconds in (("min", 60.0), ("s", 1.0)):
            trial = read(text, format={"columns": {"time": {"column": "time", "unit": unit}}})
            assert float(np.diff(trial["time"]).mean()) == pytest.approx(0.02 * seconds, rel=0.05)

    def test_stamps_that_do_not_repeat_are_seconds_and_it_is_said(self, read):
        trial = read(self.text("minutes and seconds", ("u", "psi"), every=1.0, count=60))
        np.testing.assert_allclose(np.diff(trial["time"]), 1.0)
        assert 'unit = "min" }' in trial.attrs["reading"]

    def test_am_and_pm_are_hours(self, read):
        cells = stamps(dated("%I:%M PM"), datetime(2024, 2, 28, 13, 8, tzinfo=UTC), 6.0, 300)
        assert float(np.diff(read(table(cells))["time"]).mean()) == pytest.approx(6.0, rel=0.02)

    def test_dates_to_the_minute_are_rounded_stamps(self, read):
        cells = stamps(dated("%d.%m.%Y %H:%M"), datetime(2024, 2, 28, 8, 0, tzinfo=UTC), 1.0, 600)
        trial = read(table(cells, channels=motion(np.arange(600.0))))
        assert trial.sizes["time"] == 600
        assert float(np.diff(trial["time"]).mean()) == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize("coarse", [dated("%H:%M"), dated("%d.%m.%Y %H:%M"), dated("%Y-%m-%d"), lambda date: "5"])
@pytest.mark.parametrize("name", ["Time", "time"])
def test_an_exact_clock_precedes_a_coarse_one(read, coarse, name):
    cells = [f"{cell};{STEP * k}" for k, cell in enumerate(stamps(coarse))]
    trial = read(table(cells, f"{name};t [s]"))
    np.testing.assert_allclose(trial["time"], STEP * np.arange(COUNT), atol=1e-9)
    assert f"Columns left out: {name}." in trial.attrs["reading"]
    assert "time from 't [s]'" not in read(table(stamps(dated("%H:%M:%S.%f")), name)).attrs["reading"]


@pytest.mark.parametrize(
    ("heading", "form"),
    [
        ("Year;Month;Day;Hour;Min;Sec", dated("%Y;%m;%d;%H;%M;%S.%f")),
        (
            "day;month;year;hour;minute;second",
            lambda date: f"{date.day};{date.month};{date:%y;%H};{date.minute};{date:%S,%f}",
        ),
        ("Hour [h];Minutes [min];Seconds [s]", lambda date: f"{date.hour};{date.minute};{date.second}.{date:%f}"),
    ],
)
def test_parts_of_a_date_make_a_stamp(read, heading, form):
    trial = read(table(stamps(form), heading))
    np.testing.assert_allclose(trial["time"], STEP * np.arange(COUNT), atol=1e-6)
    assert trial.attrs["reading"].startswith("Stamps of '")


def test_stamps_that_do_not_tell_the_rows_apart_are_refused(read):
    begin = (BEGIN - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()
    with refused(ps.TrialError, "time", COUNT):
        read(table([f"{begin + STEP * k:.7E}" for k in range(COUNT)]))


@pytest.mark.parametrize(("unit", "seconds"), [("min", 60.0), ("h", 3600.0), ("days", 86400.0)])
def test_a_clock_in_which_no_ship_could_turn_is_stated(container, read, unit, seconds):
    """Speed and heading alone do not show the unit, but a turn of more than 3 m/s2 is none of a ship."""
    zigzag = ps.simulate(container, ps.zigzag(20, 20), duration=300.0, record_interval=1.0)
    columns = [zigzag[name].values for name in ("u", "psi")]
    rows = [",".join(map(repr, map(float, row))) for row in zip(*columns, strict=True)]
    for factor in (1.0, seconds):
        text = "\n".join(["Time,u,psi", *(f"{k / factor:.8f},{row}" for k, row in enumerate(rows))])
        words = read(text).attrs["reading"]
        assert ("in which samples are" in words) == (factor > 1.0)
        assert (f'unit = "{unit}"' in words) == (factor > 1.0)


@pytest.mark.parametrize("heading", ["ms", "msec", "Milliseconds"])
@pytest.mark.parametrize(("clock", "stamp"), [("Time", "09:59:{:02d}"), ("sec", "{:d}"), ("Hour,Min,Sec", "9,59,{:d}")])
def test_milliseconds_beside_a_stamp_are_its_decimals(read, heading, clock, stamp):
    rows = [f"{stamp.format(k // 4)},{250 * (k % 4)},{0.01 * k:.2f}" for k in range(40)]
    trial = read("\n".join([f"{clock},{heading},u", *rows]))
    np.testing.assert_allclose(np.diff(trial["time"]), 0.25)
    assert trial.sizes["time"] == 40
    assert f"'{heading}' added to" in trial.attrs["reading"]


@pytest.mark.parametrize("cell", ["1250", "-250", "2.5"])
def test_a_column_that_is_no_fraction_stays(read, cell):
    trial = read("\n".join(["Time,ms,u", *(f"09:59:{k:02d},{cell},5" for k in range(9))]))
    assert "Columns left out: ms" in trial.attrs["reading"]
