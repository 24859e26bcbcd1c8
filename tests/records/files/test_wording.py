"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import gzip
import re
import zipfile
from functools import partial

import numpy as np
import scipy.io

import pymc_ship as ps
from pymc_ship.records.files.columns import matched_columns
from pymc_ship.records.files.format import load_format
from pymc_ship.records.files.sides import check_one_side
from tests.records.files.cases import columns, written
from tests.records.files.test_columns import matched
from tests.records.files.test_instruments import ramp
from tests.records.files.test_tables import rows_of, sheets
from tests.records.files.test_time_base import regularised, signal
from tests.sentences import wording

SIDES = {"a.csv": "port", "b.csv": "starboard", "c.csv": "port"}
FAULT = "missing, found others in "


def without_a_channel(run, read, frame, lacks):
    table = columns(run)
    del table[lacks]
    read(written(table), format={"frame": frame})


def with_lines_before_the_header(tmp_path):
    path = tmp_path / "run.txt"
    path.write_text("Basin; run 7\nL, B, T\n0 1\n1 2\n")
    ps.read_trial(path)


def read_format(tmp_path, text):
    path = tmp_path / "format.toml"
    path.write_text(text)
    load_format(path)


def polluted_with_a_gap(zigzag_trial):
    gap = zigzag_trial.copy(deep=True)
    gap["r"][100] = np.nan
    ps.pollute(gap, level=0.1, rng=np.random.default_rng(13))


def without_a_side(run, read, n_time=15, dropped=(), **changed):
    table = {name: values for name, values in columns(run.isel(time=slice(n_time))).items() if name not in dropped}
    table |= {name: np.full(n_time, value) for name, value in changed.items()}
    read(written(table).replace("# rudder_positive", "# note"))


def of_volts(read):
    zigzag = ps.simulate("kvlcc2", ps.zigzag(20, 20), duration=600, step=1.0)
    table = {**columns(zigzag), "delta": np.deg2rad(2.5 + 3.0 * zigzag["delta"].values)}
    read(written(table).replace("# rudder_positive", "# note"))


def of_two_sides(run):
    check_one_side({name: run.assign_attrs(rudder_positive=side) for name, side in SIDES.items()})


def of_two_structs(run, tmp_path):
    table = columns(run)
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, {**table, "circle": {"u": 2.0 * table["u"]}})
    ps.read_trial(path)


def of_two_sheets(run, tmp_path):
    sheets(tmp_path / "run.xlsx", {name: rows_of(columns(run)) for name in ("a", "b")})
    ps.read_trial(tmp_path / "run.xlsx")


def of_an_archive(tmp_path):
    with zipfile.ZipFile(tmp_path / "run.zip", "w") as archive:
        archive.writestr("gps.csv", "")
    ps.read_trial(tmp_path / "run.zip")


def of_minutes(read):
    read("Time;u;psi\n" + "".join(f"08:{k // 9:02d};7;0.1\n" for k in range(300)))


def of_two_clocks(tmp_path):
    for name, begin in (("u", 0), ("psi", 3600)):
        text = "".join(f"{begin + k},{k}\n" for k in range(9))
        (tmp_path / f"{name}.csv").write_text(f"time [s],{name}\n{text}")
    ps.read_trial(tmp_path)


test_trial_errors = wording(
    ps.TrialError,
    (
        r"psi.csv: the clocks .* overlap, found its first row 3600 s after that of u.csv, which ends before; set both",
        of_two_clocks,
    ),
    (
        r"column 'Time': .*, found '08:00' and none that show it; state it, \[columns\] time = \{ column",
        of_minutes,
    ),
    (
        r"run.mat: u is to be read from one column, found the file and circle; write each run to a file, or each ",
        of_two_structs,
    ),
    (
        r"has one table, found one in each of the sheets a, b; save each as a workbook\.$",
        of_two_sheets,
    ),
    (r'must be stated, .*the line \[frame\], below it rudder_positive = "starboard" \(or "port"\)', without_a_side),
    (r"csv: delta moves about 2\.\d+ deg as read, not about 0: .*signal .*; write the rudder angle into its", of_volts),
    ("stated, since the record has 15 samples, fewer than 20; ", without_a_side),
    ("no yaw rate and no heading; ", partial(without_a_side, dropped=("r", "psi"))),
    ("the rudder never moves from 5.73 deg; ", partial(without_a_side, delta=0.1)),
    (r"by 0 of 5 standard errors; ", partial(without_a_side, n_time=60, r=0.0)),
    (
        r"columns 'HDT', 'RSA': their units are not stated; state them, such as 'HDT \[deg\]', 'RSA \[deg\]'",
        lambda: matched("HDT", "RSA"),
    ),
    (r"cannot be read as Parquet: .*; write it anew, or as CSV", lambda read: read(b"PAR1" + bytes(40), "run.parquet")),
    (
        r"cannot be read as MAT: .*; write it anew, or as CSV",
        lambda read: read(b"MATLAB 5.0 MAT-file" + bytes(90), "a.mat"),
    ),
    (
        r"run.mcap: a bag of ROS 2 has a file metadata.yaml in its folder, found none; copy the folder\.$",
        lambda read: read(b"\x89MCAP0\r\n" + bytes(40), "run.mcap"),
    ),
    ("found an archive of 'gps.csv'; unpack it", of_an_archive),
    (r"cannot be read as xlsx: File is not a zip file", lambda read: read(b"PK\x03\x04" + bytes(40), "run.xlsx")),
    (
        r"column 'Heading \(M\)': .*, found a magnetic one; state the declination, \[columns\] psi = \{ column = ",
        lambda: matched("u", "Heading (M)"),
    ),
    (
        r"line 2, column time: a number is needed, found '0,0' beside points in x; write one decimal mark\.$",
        lambda read: read("time;u;x\n0,0;0,5;1.002\n1,0;0,5;1.003\n2,0;0,5;1.004\n"),
    ),
    (
        r"a latitude is within 90 deg .*, found up to 95, 2 deg; correct the cells, or state their unit\.$",
        lambda read: read("time,lat [deg],lon [deg]\n0,1,2\n1,95,2\n2,1,2\n"),
    ),
    (r"lies within 100 km, found positions 1", lambda read: read("time,lat [deg],lon [deg]\n0,1,2\n1,2,2\n2,1,2\n")),
    (
        r"column 'Course \[deg\]': a course over ground turns with the ship, .* by 10 deg; rename a set course",
        lambda read: read("time,SOG [kn],Course [deg],HDT [deg]\n0,9,45,40\n1,9,45,45\n2,9,45,50\n"),
    ),
    (r"positive angles that turn to port, but to starboard in b.csv; check", of_two_sides),
    *(
        (
            rf"run.csv, column '{heading}': its unit is not stated; state it, such as '{heading} \[",
            lambda heading=heading: matched("phi", heading),
        )
        for heading in ["heading", "Rudder", "yaw rate", "surge", "Northing", "propeller"]
    ),
    (r"column 'psi \[grad\]': the unit of psi is one of rad, .*, found 'grad'", lambda: matched("psi [grad]")),
    (r"column 'u': the unit of u is one of m/s, .*, found 'furlong'", lambda: matched("u", units=["furlong"])),
    (
        r"psi is to be read from one column, found 'Heading \[deg\]', 'yaw_deg'; name",
        lambda: matched("Heading [deg]", "yaw_deg"),
    ),
    ("found 'u', 'u'; rename one of them, or take it out", lambda: matched("u", "u")),
    (
        "tells the rows of a trial apart, found 2 different stamps in 50 rows; write the time with more digits",
        lambda: regularised(np.repeat([0.0, 1.0], 25), signal(np.arange(50.0))),
    ),
    *(
        (
            r"run.csv: columns are time and any of u, v, .*; rename one or name it",
            lambda headings=headings: matched_columns(headings, [""] * len(headings), {}, "run.csv"),
        )
        for headings in [["u", "v"], ["time"], ["time", "engine"], ["time|u|v"]]
    ),
    (
        r"reads v from one column 'sway', found 0 of this name among time, u",
        lambda run, read: read(written(columns(run)), format={"columns": {"v": "sway"}}),
    ),
    *(
        (rf"run.csv: {sentence}", partial(without_a_channel, frame=frame, lacks=lacks))
        for frame, lacks, sentence in [
            ({"velocities": "earth"}, "psi", "velocities = 'earth' needs the channels u, v, psi; psi missing"),
            ({"wind": "relative"}, "psi", "wind = 'relative' needs the channels wind_speed, wind_direction, u, v, psi"),
            ({"reference": 3.5}, "r", "reference = 3.5 needs the channels v, r; r missing"),
            ({"antenna": 3.5}, "psi", "antenna = 3.5 needs the channels x, y, psi; psi missing"),
        ]
    ),
    (r"run.txt, line 2: the header has 2 columns, found 1", with_lines_before_the_header),
    *(
        (f"format.toml.*{sentence}", partial(read_format, text=text))
        for text, sentence in [
            ("frames = 1", "unknown key frames; known here are columns, frame, scale, delimiter, skip_rows"),
            ("columns = 3", "columns must be a table, found 3"),
            ("[columns]\nw = 'heave'", "unknown key columns.w; known here are time, u, v"),
            ("[columns]\nu = 3", "columns.u must be the heading of a column, found 3"),
            ("[columns]\nu = ' '", "columns.u must be the heading of a column, found ' '"),
            ("[columns]\nu = { unit = 'kn' }", "columns.u must be the heading of a column, found None"),
            (
                "[columns]\nu = { column = 'U', scale = 2 }",
                "unknown key columns.u.scale; known here are column, unit, sign",
            ),
            ("[columns]\nu = { column = 'U', unit = 'deg' }", "columns.u.unit must be a unit like m/s, found 'deg'"),
            ("[columns]\nu = { column = 'U', unit = 1 }", "columns.u.unit must be a unit like m/s, found 1"),
            ("[columns]\nu = { column = 'U', sign = 2 }", "columns.u.sign must be 1 or -1, found 2"),
            ("[columns]\nu = { column = 'U', sign = true }", "columns.u.sign must be a finite number, found True"),
            ("[columns]\nu = { column = 'U', offset = nan }", "columns.u.offset must be a finite number, found nan"),
            (
                "[frame]\nvelocity = 'earth'",
                "unknown key frame.velocity; known here are convention, velocities, heading",
            ),
            ("[frame]\nvelocities = 'ground'", "frame.velocities is one of body, earth; found 'ground'; choose one"),
            ("[frame]\nheading = ['compass']", "frame.heading is one of .*; found \\['compass'\\]"),
            (
                "[frame]\nrudder_positive = 'left'",
                "frame.rudder_positive is one of auto, port, starboard; found 'left'",
            ),
            ("[frame]\nreference = 'G'", "frame.reference must be a finite number, found 'G'"),
            ("[scale]\nfroude = 0", "scale.froude must be positive, found 0"),
            ("[scale]\nfroude = '1:45'", "scale.froude must be a finite number, found '1:45'"),
            ("[scale]\nlength = 2", "unknown key scale.length; known here are froude"),
            ("delimiter = '|'", "delimiter is one of ',', ';'"),
            ("skip_rows = -1", "skip_rows must be a whole number from 0 up, found -1"),
            ("skip_rows = true", "skip_rows must be a whole number from 0 up, found True"),
            ("skip_rows = ", "is not valid TOML"),
        ]
    ),
    (
        r"none.toml cannot be read: No such file or directory; check the path",
        lambda tmp_path: load_format(tmp_path / "none.toml"),
    ),
    *(
        (
            re.escape(sentence),
            lambda arguments=arguments: ps.pollute(ramp(100), rng=np.random.default_rng(1), **arguments),
        )
        for arguments, sentence in [
            ({"noise": b"gnss"}, "An instrument is one of gnss, mems_gyro, mru, fluxgate_compass; found b'gnss'"),
            ({"noise": "sextant"}, "An instrument is one of gnss, mems_gyro, mru, fluxgate_compass; found 'sextant'"),
            *(
                ({"noise": lambda clean, rng, change=change: clean.assign(u=change(clean["u"]))}, f"{FAULT}u; correct")
                for change in (
                    lambda u: u * np.nan,
                    lambda u: u.where(u.time > 0, np.inf),
                    lambda u: u + 1j,
                    lambda u: u.expand_dims("run"),
                    lambda u: u.astype(str),
                )
            ),
            ({"noise": lambda clean, rng: clean.drop_vars("psi")}, f"{FAULT}psi; correct"),
            ({"noise": ["gnss", ps.Instrument(sd={"u": 1.0})]}, "A channel has one instrument, found two for u"),
            ({"noise": lambda clean, rng: None}, "returns the trial, a Dataset over the same times, found NoneType"),
            ({"noise": lambda clean, rng: clean.isel(time=slice(5))}, "a Dataset over the same times, found Dataset"),
            ({"noise": "gnss", "level": 0.1}, "by a level (with factors) or by kinds of noise"),
            ({}, "by a level (with factors) or by kinds of noise"),
            ({"noise": "gnss", "factors": {"u": 1.0}}, "by a level (with factors) or by kinds of noise"),
        ]
    ),
    *(
        (r"^An instrument has an sd", lambda settings=settings: ps.Instrument(**settings))
        for settings in [
            {"sd": {}},
            {"sd": {"speed": 1.0}},
            {"sd": {"u": 1.0}, "resolution": {"v": 1.0}},
            {"sd": {"u": -1.0}},
            {"sd": {"u": np.nan}},
            {"sd": {"u": 1.0}, "missing": 1.0},
            {"sd": {"u": 1.0}, "jitter": np.inf},
            {"sd": {"u": 1.0}, "run": 0.5},
        ]
    ),
    *(
        (
            r"a number from 0 up or 'literal', found",
            lambda zigzag_trial, level=level: ps.pollute(zigzag_trial, level=level, rng=np.random.default_rng(13)),
        )
        for level in [-0.1, np.nan, np.inf, "loud", "0.1"]
    ),
    (
        "found heel, n; rename",
        lambda zigzag_trial: ps.pollute(
            zigzag_trial, level=0.1, rng=np.random.default_rng(13), factors={"heel": 1.0, "u": 1.0, "n": 1.0}
        ),
    ),
    ("Channel r must be finite", polluted_with_a_gap),
    *(
        (
            f"cannot be read: it is {encoding.upper()} text; save it as UTF-8",
            lambda read, encoding=encoding: read("time,u\n0,5\n1,5\n".encode(encoding)),
        )
        for encoding in ["utf-16", "utf-32"]
    ),
    (r"line 3, column x: a number is needed, found '1,02\.5'", lambda read: read("time;x\n0;0.5\n1;1,02.5\n2;2.5\n")),
    (
        r"run.csv.gz cannot be read: its gzip data are damaged .*copy it again",
        lambda run, read: read(gzip.compress(written(columns(run)).encode())[:-1000], "run.csv.gz"),
    ),
    (r"a header before its numbers, found '0,1'; add", lambda read: read("0,1\n1,2\n2,3\n3,4\n")),
    (r"run.csv, line 3: the header has 2 columns, found 1; mend it", lambda read: read("time,u\n0,1\n1\n2,3\n")),
    *(
        (
            r"line 4, column u: a number is needed, found '",
            lambda read, cell=cell: read(f"time;u\n0;1.5\n1;1.5\n2;{cell}\n"),
        )
        for cell in ["1_0", "0x1f", "12:01:05", "٣", "1,5", "fast"]
    ),
    (r"run.csv: a trial has at least two complete rows, found 0", lambda read: read("time,u\n,1\n,2\n,3\n")),
    (
        r"run.csv: the sampling is too uneven to be resampled, found steps from 1e-06",
        lambda: regularised(np.cumsum(np.tile([1e-6, 1e-6, 1e-6, 0.7], 100)), signal(np.arange(400.0))),
    ),
    (
        "time of a trial must increase, found 3 s in every row",
        lambda: regularised(np.full(50, 3.0), signal(np.arange(50.0))),
    ),
    (
        "at least two complete rows, found 1; check its cells",
        lambda: regularised([0.0, np.nan, np.nan], signal(np.arange(3.0))),
    ),
)
