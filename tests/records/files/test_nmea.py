from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.machine.errors import TrialError
from tests.records.files.test_format import fixes, received
from tests.sentences import refused


def sentence(body):
    """Sentence with its checksum."""
    total = 0
    for letter in body:
        total ^= ord(letter)
    return f"${body}*{total:02X}"


def position(degrees, width, letters):
    whole = int(abs(degrees))
    return f"{whole:0{width}d}{60.0 * (abs(degrees) - whole):010.7f},{letters[int(degrees < 0)]}"


def log(run, stamped):
    """Sentences of a receiver, a gyro, a second gyro, a rudder indicator and a log of speed, at 10 Hz."""
    table, lines = received(run), ["$GPGSV,1,1,00*79"]
    latitude, longitude = fixes(run["x"].values - run["x"].values[0], run["y"].values - run["y"].values[0])
    for k, time in enumerate(run["time"].values):
        clock = f"23:59:{50 + time:08.5f}" if time < 10 else f"00:00:{time - 10:08.5f}"
        utc = clock.replace(":", "")[:9]
        where = f"{position(latitude[k], 2, 'NS')},{position(longitude[k], 3, 'EW')}"
        bodies = [
            f"GPGGA,{utc},{where},1,08,0.9,0.0,M,0.0,M,,",
            f"HEHDT,{table['HDT [deg]'][k]:.4f},T",
            f"GPHDT,{table['HDT [deg]'][k] + 3.0:.4f},T" if k % 2 else "",
            f"TIROT,{60.0 * np.rad2deg(run['r'].values[k]):.4f},A",
            f"AGRSA,{table['RSA [deg]'][k]:.4f},A,,V",
            f"VDVBW,{run['u'].values[k] * 3600 / 1852:.4f},{run['v'].values[k] * 3600 / 1852:.4f},A,,,V",
        ]
        lines += [f"2020-01-01T{clock}Z," * stamped + sentence(body) for body in bodies if body]
    return [line.replace("2020-01-01T00", "2020-01-02T00") for line in lines]


@pytest.mark.parametrize("stamped", [True, False])
def test_a_log_of_sentences_is_the_same_trial(run, read, stamped):
    lines = log(run, stamped)
    lines[100] = lines[100][:-1] + "G"
    trial = read("\n".join([line for k, line in enumerate(lines) if k % 200 != 150]))
    for name, resolution in {"u": 1e-3, "v": 1e-3, "r": 1e-5, "psi": 1e-4, "delta": 2e-3}.items():
        np.testing.assert_allclose(
            np.interp(run["time"], trial["time"] + run["time"].values[0], trial[name]),
            run[name],
            atol=resolution,
            err_msg=name,
        )
    np.testing.assert_allclose(np.ptp(trial["x"].values), np.ptp(run["x"].values), atol=1.0)
    assert "psi of HEHDT" in trial.attrs["reading"]
    assert "Sensors left out: GPGSV, GPHDT." in trial.attrs["reading"]
    assert "damaged sentences left out." in trial.attrs["reading"]


@pytest.mark.parametrize("stamped", [True, False])
def test_damaged_logs_are_read_or_refused_in_a_sentence(run, read, stamped):
    raw, rng = "\n".join(log(run.isel(time=slice(60)), stamped)).encode(), np.random.default_rng(8)
    for _ in range(60):
        spoilt = bytearray(raw[: rng.integers(20, len(raw) + 1)] if rng.random() < 0.3 else raw)
        for place in rng.integers(0, len(spoilt), rng.integers(1, 200)):
            spoilt[place] = rng.integers(32, 127)
        try:
            words = read(bytes(spoilt)).attrs["reading"]
        except TrialError as error:
            words = str(error)
        assert words.endswith(".")


def test_invalid_fields_are_missing(run, read):
    lines = [line.replace(",A*", ",V*") if "ROT" in line else line for line in log(run, stamped=True)]
    lines = [sentence(line[1:-3]) if line.startswith("$") else line for line in lines]
    kept = [line[: line.index("$")] + sentence(line[line.index("$") + 1 : -3]) for line in lines if "$" in line]
    assert "r" not in read("\n".join(kept))


def test_sentences_without_checksums_are_read_and_said(run, read):
    trial = read("\n".join(line.rpartition("*")[0] for line in log(run, stamped=True)))
    np.testing.assert_allclose(np.ptp(trial["psi"].values), np.ptp(run["psi"].values), atol=1e-3)
    assert "no checksum" in trial.attrs["reading"]
    assert "no checksum" not in read("\n".join(log(run, stamped=True))).attrs["reading"]


@pytest.mark.parametrize("tags", ["\\s:VDR1,c:{epoch}*5A\\", "\\g:1-2-3,c:{epoch},s:GP01*00\\", "[{epoch}] "])
def test_the_clock_of_a_tag_block_or_a_bracket_is_the_stamp(run, read, tags):
    """Not the UTC of the fixes, which this log lacks."""
    lines, epochs = [], iter(1000 * 1_777_881_600 + np.round(1000.0 * run["time"].values).astype(int))
    for line in log(run, stamped=False)[1:]:
        if "GGA" in line:
            epoch = next(epochs)
        else:
            lines.append(tags.format(epoch=epoch) + line)
    trial = read("\n".join(lines))
    assert float(trial["time"][-1] - trial["time"][0]) == pytest.approx(
        float(run["time"][-1] - run["time"][0]), abs=0.3
    )


def test_a_port_rudder_alone_is_the_rudder(run, read):
    lines = [line for line in log(run, stamped=True) if "RSA" not in line]
    rudder = [line.partition("$") for line in log(run, stamped=True) if "RSA" in line]
    for stamp, _, body in rudder:
        angle = body.split(",")[1]
        lines.append(stamp + sentence(f"AGRSA,,V,{angle},A"))
    trial = read("\n".join(sorted(lines)))
    both = read("\n".join(log(run, stamped=True)))
    np.testing.assert_allclose(np.ptp(trial["delta"].values), np.ptp(both["delta"].values), atol=1e-3)
    assert "port rudder alone" in trial.attrs["reading"]


def test_a_fix_of_quality_0_is_none(run, read):
    lines = [line if "GGA" not in line else _without_fix(line) for line in log(run, stamped=True)]
    assert "x" not in read("\n".join(lines))


def _without_fix(line):
    stamp, _, body = line.partition("$")
    return stamp + sentence(body.rpartition("*")[0].replace(",1,08,", ",0,00,"))


@pytest.mark.parametrize(("talker", "late"), [("GN", 0.4), ("GN", 1.0), ("GN", -0.3), ("GP", 0.4), ("GP", 1.0)])
def test_the_clock_is_that_of_one_sensor(run, read, late, talker):
    """Else the time went back at each sentence of the second receiver, as at midnight."""
    lines = [*log(run, stamped=False)]
    for k, line in reversed([*enumerate(lines)]):
        if "GGA" in line:
            utc = (10 * round(float(line.split(",")[1]) * 10.0) - round(100 * late)) / 100.0
            lines.insert(k + 2, sentence(f"{talker}GLL,5329.9,N,00805.9,E,{utc:09.2f},A,A"))
    lines = [line for line in lines if "GLL" not in line or line[17:25] > "0"]
    trial, clean = read("\n".join(lines)), read("\n".join(log(run, stamped=False)))
    for name in ("time", "u", "psi", "x"):
        np.testing.assert_array_equal(trial[name], clean[name])


def test_a_heading_of_ths_is_read(run, read):
    lines = [line for line in log(run, stamped=False) if "GPHDT" not in line]
    valid, invalid = (
        [sentence(f"HETHS,{line.split(',')[1]},{mode}") if "HEHDT" in line else line for line in lines] for mode in "AV"
    )
    trial = read("\n".join(valid))
    np.testing.assert_array_equal(trial["psi"], read("\n".join(lines))["psi"])
    assert "psi of HETHS" in trial.attrs["reading"]
    assert "psi" not in read("\n".join(invalid))


def test_whole_sentences_of_other_kinds_are_not_damaged(run, read):
    lines = [*log(run, stamped=False), sentence("PSXN,10,1,2"), sentence("XXABC,1,2"), "$PSXN,10,1,2*00"]
    lines.append("!" + sentence("AIVDM,1,1,,A,13u?etPv2;0n:dDPwUM1U1Cb069D,0")[1:])
    notes = read("\n".join(lines)).attrs["reading"].splitlines()
    assert "Sensors left out: AIVDM, GPGSV, GPHDT, PSXN, XXABC." in notes
    assert "1 damaged sentences left out." in notes


@pytest.mark.parametrize("shaft", [True, False])
def test_the_revolutions_are_those_of_the_shaft(run, read, shaft):
    lines = []
    for line in log(run, stamped=False):
        lines += [line, sentence("ERRPM,E,1,520.0,5.0,A")] if "RSA" in line else [line]
        lines += [sentence("ERRPM,S,1,90.0,5.0,A")] if shaft and "RSA" in line else []
    trial = read("\n".join(lines))
    np.testing.assert_allclose(trial["n"], (90.0 if shaft else 520.0) / 60.0)
    assert ("engine alone" in trial.attrs["reading"]) is not shaft


def extended(run, bodies):
    """The log of a run with sentences of its wind, roll or heading each second; a heading of its own if any."""
    lines = log(run, stamped=True)
    if any("HDG" in body or "HDM" in body for body in bodies(0)):
        lines = [line for line in lines if "HDT" not in line]
    kept = []
    for line in lines:
        kept.append(line)
        if "GPGGA" in line and (k := sum("GPGGA" in one for one in kept) - 1) % 10 == 0:
            kept += [line.split("$")[0] + sentence(body) for body in bodies(k)]
    return "\n".join(kept)


def test_the_true_wind_of_mwd_is_read(run, read):
    for body in ("WIMWD,200.0,T,197.0,M,19.44,N,,", "WIMWD,200.0,T,,,,,10.0,M"):
        trial = read(extended(run, lambda k, body=body: [body]))
        np.testing.assert_allclose(trial["wind_speed"], 10.0, atol=0.01)
        np.testing.assert_allclose(np.rad2deg(trial["wind_direction"]) % 360.0, 200.0, atol=0.01)
    calm = read(extended(run, lambda k: ["WIMWD,200.0,T,,,0.0,N,,"]))
    np.testing.assert_array_equal(calm["wind_speed"], 0.0)
    assert "wind_speed" not in read(extended(run, lambda k: ["WIMWD,,T,197.0,M,19.44,N,10.0,M"]))


@pytest.mark.parametrize(("unit", "factor"), [("M", 1.0), ("N", 3600.0 / 1852.0), ("K", 3.6)])
def test_the_wind_of_mwv_is_relative_to_the_bow(run, read, unit, factor):
    """Air at rest; the theoretical wind between the sentences is left out."""

    def bodies(k):
        u, v = float(run["u"][k]), float(run["v"][k])
        angle, speed = np.rad2deg(np.arctan2(v, u)) % 360.0, factor * np.hypot(u, v)
        return [f"WIMWV,{angle:.3f},R,{speed:.4f},{unit},A", f"WIMWV,77.0,T,55.0,{unit},A"]

    trial = read(extended(run, bodies))
    np.testing.assert_allclose(trial["wind_speed"], 0.0, atol=0.05)
    assert "True wind calculated from relative wind" in trial.attrs["reading"]
    invalid = read(extended(run, lambda k: [body[:-1] + "V" for body in bodies(k)]))
    assert "wind_speed" not in invalid


def test_the_roll_of_a_transducer_is_read(run, read):
    bodies = lambda k: [f"YXXDR,A,{-1.5 + 0.001 * k:.3f},D,PITCH,A,{2.5 + 0.01 * k:.3f},D,ROLL"]  # noqa: E731
    trial = read(extended(run, bodies))
    assert np.rad2deg(float(trial["phi"].max())) == pytest.approx(2.5 + 0.01 * (run.sizes["time"] - 1), abs=0.15)


def test_a_magnetic_heading_is_true_by_its_variation_or_refused(run, read):
    psi = np.rad2deg(run["psi"].values)
    true = read(extended(run, lambda k: [f"HCHDG,{(psi[k] - 3.0 + 1.0) % 360.0:.4f},1.0,W,3.0,E"]))
    expected = np.interp(true["time"] + run["time"].values[0], run["time"], run["psi"])
    assert np.abs(np.angle(np.exp(1j * (true["psi"].values - expected)))).max() < 0.02
    for body in ("HCHDG,{:.4f},,,,", "HCHDM,{:.4f},M"):
        with refused(TrialError, "magnetic"):
            read(extended(run, lambda k, body=body: [body.format(psi[k] % 360.0)]))


def test_a_course_of_a_receiver_without_a_fix_is_missing(run, read):
    with_fix, without = (
        read(extended(run, lambda k, mode=mode: [f"GPVTG,77.0,T,,M,9.0,N,16.7,K,{mode}"])) for mode in "AN"
    )
    assert "sog of GPVTG" in with_fix.attrs["reading"]
    assert "sog" not in without.attrs["reading"]
