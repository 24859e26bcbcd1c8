"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

from functools import partial

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.trial.record import check_trial, named_trials, run_names
from pymc_ship.trial.units import METRE
from tests.sentences import wording
from tests.trial.test_record import CHANNELS, record


def with_bad_values(bad):
    trial = record()
    trial["v"][[7, 9, 30]] = bad
    check_trial(trial, CHANNELS)


def with_a_bad_time(uniform, bad):
    time = np.arange(50) * 0.1
    time[10] = bad
    check_trial(record().assign_coords(time=time), ["u"], uniform=uniform)


def with_a_late_half():
    time = np.arange(50) * 0.1
    time[10:] += 1e-4
    check_trial(record().assign_coords(time=time), ["u"])


def with_a_hundredth_of_a_step(step):
    time = np.arange(100) * step
    time[50:] += 0.01 * step
    check_trial(xr.Dataset({"u": ("time", np.ones(100))}, {"time": time}), ["u"])


def read(tmp_path, content):
    path = tmp_path / "broken.csv"
    path.write_bytes(content)
    ps.read_trial(path)


test_trial_errors = wording(
    ps.TrialError,
    ("Trials must be a dict of Datasets by name, found <class 'int'>; give each trial a name", lambda: named_trials(3)),
    (
        "^A score needs one trial or more and a name for each, found 2 trials and 1 names; correct",
        lambda: run_names("A score", ["a"], 2),
    ),
    (
        "^A record to be written needs channels such as u, v and r, found none; add them",
        lambda tmp_path: ps.write_trial(record()[["time"]], tmp_path / "trial.csv"),
    ),
    (
        "^The attr facility must be one line without quotes, found 'tank \"B\"'; change it",
        lambda tmp_path: ps.write_trial(record().assign_attrs(facility='tank "B"'), tmp_path / "trial.csv"),
    ),
    ("Trials must be a dict .* found 2 in a list", lambda: named_trials([record(), record()])),
    (
        "The name of a channel must be new, found 'u' among time, u, v",
        lambda: ps.register_channel(ps.Channel("u", METRE, "speed")),
    ),
    (
        "The name of a channel must be new, found 'time' among time, u",
        lambda: ps.register_channel(ps.Channel("time", METRE, "time")),
    ),
    *(
        (
            r"Channel v must be finite, found 3 bad values, the first at t = 0\.7 s",
            partial(with_bad_values, bad=bad),
        )
        for bad in [np.nan, np.inf, -np.inf]
    ),
    (
        "needs the channels u, p, phi; p, phi missing",
        lambda: check_trial(record().drop_vars(["p", "phi"]), ["u", "p", "phi"]),
    ),
    *(
        (
            rf"^Channel {name} must be in {unit}, found the units '{stated}'; {remedy}\.$",
            lambda name=name, stated=stated: check_trial(
                record().assign({name: record()[name].assign_attrs(units=stated)}), ["u"]
            ),
        )
        for name, unit, stated, remedy in [
            ("delta", "rad", "deg", "multiply the values by 0.0174532925 and state this unit"),
            ("u", "m/s", "furlong", "correct it"),
        ]
    ),
    ("have the coordinate time", lambda: check_trial(record().drop_vars("time"), ["u"])),
    *(
        ("must be finite and increase", partial(with_a_bad_time, uniform=uniform, bad=bad))
        for bad in [0.9, 0.5, np.nan, np.inf]
        for uniform in [True, False]
    ),
    (r"must be uniform, found steps of 0\.1 to 0\.1001 s", with_a_late_half),
    *(("must be uniform", partial(with_a_hundredth_of_a_step, step=step)) for step in [1e-4, 0.02, 1.0]),
    (
        r"function of time alone, found dims \('draw', 'time'\)",
        lambda: check_trial(xr.concat([record(), record()], "draw"), ["u"]),
    ),
    *(
        (rf"broken\.csv.*{message}", partial(read, content=text.encode()))
        for text, message in [
            ("time,u\n0,1\n1,x\n", r"line 3, column u: a number is needed, found 'x'"),
            ("# note\ntime,u\n0,1\n\nlate,1\n", r"line 5, column time: a number is needed, found 'late'"),
            ("time,u\n0,1\n1,\n", r"at least two complete rows, found 1"),
            ("time,u\n0,1\n1,2,3\n", r"line 3: the header has 2 columns, found 3"),
            ("time,u\n0,1\n1\n2,3\n", r"line 3: the header has 2 columns, found 1"),
            ("time,u\n0,1\n1\n", r"at least two rows, found 1 complete"),
            ("time,u,heel\n0,1,2\n1,2,3\n", r"column 'heel': its unit is not stated; state it, such as 'heel \[deg\]'"),
            ("u,v\n0,1\n1,2\n", r"found 'u, v' without time"),
            ("time,u,u\n0,1,1\n1,2,2\n", r"u is to be read from one column, found 'u', 'u'"),
            ("time|u\n0|1\n1|2\n", r"found 'time\|u' without time"),
            ("time,u\n0,1\n", r"at least two rows, found 2 lines"),
            ("", r"at least two rows, found 0 lines"),
        ]
    ),
    (r"absent.csv cannot be read: No such file", lambda tmp_path: ps.read_trial(tmp_path / "absent.csv")),
    ("has two files or more, found 0", lambda tmp_path: ps.read_trial(tmp_path)),
    ("cannot be read: it is not UTF-8 text", partial(read, content=b"time,u\n# 3\xb0\n0,1\n")),
)

test_value_errors = wording(
    ValueError,
    (
        r"trial.csv cannot be written: No such file or directory",
        lambda tmp_path: ps.write_trial(record(), tmp_path / "absent" / "trial.csv"),
    ),
)
