"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import pickle
import re
from functools import partial

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.regression.cross_validation import cross_validation
from pymc_ship.inference.regression.families import FAMILIES, prior_family
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.rows.weak_form import coefficient_scales, weak_form, weak_form_start
from pymc_ship.machine.errors import InferenceError
from tests.inference.rows.frames import motion
from tests.inference.rows.test_data_scaling import plain_arrays
from tests.inference.rows.test_frames import FORMULA, uneven
from tests.sentences import wording


def with_a_gap(container, zigzag_trial, name):
    trial = zigzag_trial.copy(deep=True)
    trial[name][500] = np.nan
    ps.regression_data(trial, container, "sway", interval=1.0)


def unmodelled_roll_text(container):
    run = ps.simulate(container, ps.zigzag(20.0, 20.0), duration=100.0)
    ps.regression_data(run.assign(p=0.0 * run["p"], phi=0.0 * run["phi"]), container, "sway", interval=1.0)


def arrays(change):
    X, y = plain_arrays()
    RegressionData.from_arrays(**{"design_matrix": X, "response": y, "scaling": "zscore"} | change)


def columns_that_are_not_finite():
    X, y = plain_arrays()
    X[3, 1], X[5, 2] = np.nan, np.inf
    RegressionData.from_arrays(X, y, scaling="none")


def columns_that_do_not_vary(idle, second):
    X, y = plain_arrays()
    X[:, 1], X[:, 2], X[:, 3] = idle, 1.0, second
    RegressionData.from_arrays(X, y, ["a", "idle", "constant", "second"], scaling="zscore")


def formula_of_a_gap(frame):
    frame.loc[3, "v"] = np.nan
    ps.RegressionData.from_formula(FORMULA, frame, scaling="none")


def predicted(frame, new):
    ps.ConjugatePrior().exact(ps.RegressionData.from_formula(FORMULA, frame, scaling="none")).predict(new(frame))


def predicted_by_centred_rows(frame):
    data = ps.RegressionData.from_formula("Y ~ I(v - np.mean(v))", frame)
    ps.ConjugatePrior().exact(data).predict(frame)


def pickled_with_a_local_function(frame):
    def own(values):
        return values

    pickle.dumps(ps.RegressionData.from_formula("Y ~ own(v)", frame))


def short(trial):
    return trial.isel(time=slice(0, 500))


test_errors_of_rows = wording(
    ps.InferenceError,
    (
        "The rudder of a trial must move",
        lambda container: ps.regression_data(
            ps.simulate(container, ps.rudder_programme([0.0], [0.0]), duration=60.0), container, "sway", interval=1.0
        ),
    ),
    *(
        (
            f"multiple of the sampling interval, found {interval} s at 0.02 s",
            lambda container, zigzag_trial, interval=interval: ps.regression_data(
                zigzag_trial, container, "sway", interval=interval
            ),
        )
        for interval in [0.03, 0.01, 0.0, -1.0, np.nan, np.inf]
    ),
    (
        "The yaw of 'container' has 28 terms and needs as many rows, found 27",
        lambda container, zigzag_trial: ps.regression_data(
            zigzag_trial.isel(time=slice(0, 27 * 50)), container, "yaw", interval=1.0
        ),
    ),
    (
        "The yaw of 'container' has 28 terms and needs as many rows, found 27",
        lambda container, zigzag_trial: ps.regression_data(zigzag_trial.isel(time=slice(0, 28)), container, "yaw"),
    ),
    (r"Yp, Yppp, Ypu, Ypu\|pu\|, Yphi, Yvphi, Yvphiphi, Yphivv did not", unmodelled_roll_text),
    *(
        (message, partial(arrays, change=change))
        for change, message in [
            ({"response": np.ones(39)}, "The response has one value for each of 40 rows, found shape"),
            ({"response": np.ones((40, 1))}, "The response has one value for each of 40 rows, found shape"),
            ({"design_matrix": np.ones(40)}, r"A design matrix has shape \(rows, terms\), found \(40,\); reshape it"),
            ({"design_matrix": np.ones((0, 2))}, r"A design matrix has shape \(rows, terms\), found \(0, 2\)"),
            ({"coefficients": ["a", "b"]}, "Each of the 4 columns has one name, found 2 names"),
            ({"coefficients": ["a", "b", "a", "c"]}, "Coefficient names must differ, found a more than once"),
            ({"scaling": "minmax"}, "The scaling is one of zscore, none; found 'minmax'; choose one of them"),
            ({"time": np.ones(3)}, r"The time has one value for each of 40 rows, found shape \(3,\)"),
            ({"response": np.r_[np.nan, np.ones(39)]}, "must be finite, found NaN or infinity in the response"),
            (
                {"response": np.full(40, 1e6 / 7.0)},
                "response must vary over the rows, found a constant; check it or take scaling='none'",
            ),
        ]
    ),
    ("NaN or infinity in x2, x3; clean the trial", columns_that_are_not_finite),
    (
        "must vary over the rows; idle did not: leave the terms out",
        partial(columns_that_do_not_vary, idle=0.0, second=np.arange(40.0)),
    ),
    *(
        (
            "must vary over the rows; second did not: leave the terms out",
            partial(columns_that_do_not_vary, idle=np.arange(40.0), second=second),
        )
        for second in [0.0, 5.0]
    ),
    (
        r"^The rows need the columns v, each of them once; found Y, v, v,",
        lambda frame: ps.RegressionData.from_arrays(
            frame.rename(columns={"r": "v"}), frame["Y"], ["v"], scaling="none"
        ),
    ),
    (
        r"^The table and the response must have one index, found two",
        lambda frame: ps.RegressionData.from_arrays(frame[["v", "r"]], frame["Y"].iloc[::-1], scaling="none"),
    ),
    *(
        (
            f"^The table and the {what} must have one index, found two",
            lambda frame, what=what: ps.RegressionData.from_arrays(
                frame[["v", "r"]], frame["Y"], **{what: frame["r"].iloc[::-1]}
            ),
        )
        for what in ("time", "run")
    ),
    (
        "^The formula 'Y ~ v' must hold for the table, found: a column of Python objects, neither numbers nor texts; ",
        lambda frame: ps.RegressionData.from_formula("Y ~ v", frame.assign(v=frame["v"].astype(object))),
    ),
    (
        "^Rows held out must not reach a fit, found a response that depends on all rows in 'center.Y. ~ v'; take a",
        lambda frame: cross_validation(ps.RegressionData.from_formula("center(Y) ~ v", frame)),
    ),
    *(
        (
            f"^Regression data have magnitudes from 1e-100 to 1e.100, whose squares are numbers, found {found}; take",
            lambda frame, X=X, y=y: ps.RegressionData.from_arrays(
                X * frame[["v"]].to_numpy(), y * frame["Y"].to_numpy()
            ),
        )
        for X, y, found in [(1e-200, 1.0, r"\S+ in x1"), (1.0, 1e160, r"\S+ in the response")]
    ),
    *(
        (
            f"^Rows are given by integers or a mask, one or more, found {found}; choose some",
            lambda frame, index=index: ps.RegressionData.from_arrays(frame[["v"]], frame["Y"]).rows(index),
        )
        for index, found in [
            ([], "0 of type float64"),
            ([1.0], "1 of type float64"),
            (np.zeros(60, dtype=bool), "0 of type bool"),
            (slice(0, 0), "0 of type int64"),
        ]
    ),
    (
        "^New rows need the columns x1, found p; rename them",
        lambda: (
            ps.ConjugatePrior()
            .exact(ps.RegressionData.from_arrays([[1.0], [2.0]], [1.0, 3.0]))
            .predict(xr.DataArray([[1.0]], {"coefficient": ["p"]}, ("row", "coefficient")))
        ),
    ),
    (
        "^New rows of a formula need all of its coefficients, found v held fixed; predict by the posterior of",
        lambda frame: (
            ps.ConjugatePrior()
            .exact(ps.hold_fixed(ps.RegressionData.from_formula("Y ~ v", frame), {"v": 2.0}))
            .predict(frame)
        ),
    ),
    *(
        (
            f"^The table and the {what} must have one index, found two",
            lambda frame, what=what: ps.RegressionData.from_formula("Y ~ v", frame, **{what: frame["r"].iloc[::-1]}),
        )
        for what in ("time", "run")
    ),
    *(
        (
            "^Regression data must be finite, found NaN or infinity in the time; clean",
            lambda frame, odd=odd: ps.RegressionData.from_arrays(
                frame[["v", "r"]], frame["Y"], time=np.r_[odd, np.arange(1.0, len(frame))]
            ),
        )
        for odd in (np.nan, np.inf)
    ),
    *(
        (
            f"^The run must be labels, found 1 {found}; fill the gaps or leave them out",
            lambda frame, one=one: ps.RegressionData.from_arrays(
                frame[["v", "r"]], frame["Y"], run=[one, *["a"] * (len(frame) - 1)]
            ),
        )
        for one, found in ((None, "missing"), (np.nan, "missing"), (np.ma.masked, "masked"))
    ),
    *(
        (
            reason,
            lambda frame, formula=formula: ps.RegressionData.from_formula(
                formula, frame.assign(side=["port", "starboard"] * 30, digits=["1", "2.5", "-3"] * 20), scaling="none"
            ),
        )
        for formula, reason in [
            (
                "Y ~ v + u",
                "^The formula 'Y ~ v [+] u' must hold for the table, found: no variable 'u'; correct one of th",
            ),
            ("Y ~ v +* r", r"must hold for the table, found: Don't know how to parse '\*'; correct"),
            *(
                (f"Y ~ v + r{join}offset({x})", f"A formula has only terms .*, found offset[(]{x}[)]; write the")
                for join, x in [(" + ", "delta"), (" + ", "2"), (":", "delta")]
            ),
            ("Y - r ~ v", "found r in no term in 'Y - r ~ v'; change it."),
            ("Y ~ v + digits", "^Texts are categories in a formula, found numbers stored as text in digits; convert"),
            *(
                (
                    f"Y ~ {text} {end}",
                    f"must hold for the table, found: a term ends before '{re.escape(end)}'; correct one",
                )
                for text, end in [("v", "| r"), ("v", "== 2"), ("v", "% 2"), ("r + v", "2"), ("v", ") + r")]
            ),
            ("Y ~ np.array(v)[::2]", "found: a term ends before '"),
            ("Y ~ v + Y", "found the response among the terms in 'Y ~ v [+] Y'; change it."),
            ("Y ~ np.ma.masked_greater(v, 0)", "found masked values in 'Y ~ np.*'; change it."),
            (
                "np.ma.masked_greater(Y, 0) ~ v",
                "^The response must be real numbers, found [0-9]+ masked; fill the gaps",
            ),
            ("Y ~ v.rank()", "found: a method of 'v', in place of a function; correct one"),
            ("Y**2 ~ v", "found: Exponentiation on an individual variable .* the math power; correct"),
            ("Y ~ v**2", r"found: Exponentiation .* Use {v\*\*2} or I.* to compute the math power; correct"),
            ("Y ~ v + (1|side)", "found terms that vary by group in "),
            ("side ~ v", "found a response that is no number in 'side ~ v'; change it."),
            ("v + r", "found no response in 'v [+] r'; change it."),
            ("Y ~ 0", "found no term in 'Y ~ 0'; change it."),
            (3, "The formula 3 must hold for the table, found: 'formula' must be a string; correct"),
        ]
    ),
    (
        "found: 'data' contains 1 incomplete rows; correct one of them",
        formula_of_a_gap,
    ),
    (
        r"^A formula needs a table, found <class 'dict'>; give a DataFrame",
        lambda: ps.RegressionData.from_formula(FORMULA, motion(), scaling="none"),
    ),
    *(
        (sentence, partial(predicted, new=new))
        for new, sentence in [
            (lambda f: f[["v", "r"]], "^New rows need the columns v, r, delta, each of them once; found v, r; add"),
            (
                lambda f: f.assign(v=np.nan),
                r"^New rows are finite, of shape \(rows, 5\), found NaN or infinity in v, v:r",
            ),
            (
                lambda f: f.assign(v="fast"),
                "^The formula 'Y ~ v .*' must hold for the new rows, found: .*; correct one",
            ),
        ]
    ),
    (
        r"^Fitted rows must keep their terms, also without the other rows, found other values of I\(v .* restore the",
        predicted_by_centred_rows,
    ),
    (
        "^A formula is written to a file with its variables and functions, found own, which pickle cannot write; ",
        pickled_with_a_local_function,
    ),
    (
        "28 terms and needs as many rows, found 19",
        lambda container, zigzag_trial: ps.regression_data(
            zigzag_trial, container, "sway", interval=20.0, derivative="weak"
        ),
    ),
)

test_trial_errors = wording(
    ps.TrialError,
    *(
        (
            f"Channel {name} must be finite, found 1 bad values, the first at t = 10 s",
            partial(with_a_gap, name=name),
        )
        for name in ["u", "v", "r", "p", "phi", "delta"]
    ),
    *(
        (
            f"; {name} missing",
            lambda container, zigzag_trial, name=name: ps.regression_data(
                zigzag_trial.drop_vars(name), container, "surge", interval=1.0
            ),
        )
        for name in ["u", "v", "r", "p", "phi", "delta"]
    ),
    *(
        (
            message,
            lambda container, zigzag_trial, time=time: ps.regression_data(
                zigzag_trial.assign_coords(time=time(zigzag_trial["time"].values)), container, "sway", interval=1.0
            ),
        )
        for time, message in [
            (
                lambda t: t + 0.001 * (t > 100.0),
                r"sampling of a trial must be uniform, found steps of 0\.02 to 0\.021 s",
            ),
            (lambda t: t[::-1], "must be finite and increase"),
            (lambda t: np.where(t == t[7], np.nan, t), "must be finite and increase"),
        ]
    ),
    *(
        (
            f"; {name} missing",
            lambda container, zigzag_trial, name=name: weak_form(zigzag_trial.drop_vars(name), container),
        )
        for name in ["u", "v", "r", "p", "phi", "delta"]
    ),
    (
        r"test function of 10 s, found 500 samples over 9\.98 s; use a longer",
        lambda container, zigzag_trial: weak_form(short(zigzag_trial), container),
    ),
    (
        "needs a record longer",
        lambda container, zigzag_trial: ps.regression_data(short(zigzag_trial), container, "yaw", derivative="weak"),
    ),
    (
        r"needs 4 samples in L/U, at most 5 s apart, found 6 s; sample faster",
        lambda container, zigzag_trial: weak_form(zigzag_trial.isel(time=slice(None, None, 300)), container),
    ),
    ("at least one trial, found none", lambda container: coefficient_scales([], container)),
    (
        "vphi, phi, phiphi, pp, ppu of the surge stay 0: leave them out",
        lambda container, zigzag_trial: coefficient_scales(
            zigzag_trial.assign(p=0.0 * zigzag_trial["p"], phi=0.0 * zigzag_trial["phi"]), container
        ),
    ),
)

test_vessel_errors = wording(
    ps.VesselError,
    (
        "surge, sway, yaw, roll, found 'pitch'",
        lambda container, zigzag_trial: ps.regression_data(zigzag_trial, container, "pitch", interval=1.0),
    ),
)

test_value_errors = wording(
    ValueError,
    (
        "'spline'",
        lambda container, zigzag_trial: ps.regression_data(
            zigzag_trial, container, "sway", interval=1.0, derivative="spline"
        ),
    ),
    (
        "one of euler, rk4; found 'heun'",
        lambda container, zigzag_trial: weak_form(zigzag_trial, container, method="heun"),
    ),
    (
        "euler, central, savgol, weak, weak_euler; found 'strong'",
        lambda container, zigzag_trial: ps.regression_data(zigzag_trial, container, "sway", derivative="strong"),
    ),
    *(
        (
            "for each of 102 coefficients, found shapes",
            lambda container, zigzag_trial, change=change: weak_form_start(
                zigzag_trial, container, np.zeros(102), change(np.zeros(102))
            ),
        )
        for change in [lambda a: a[:-1], lambda a: a * np.nan, lambda a: a - 1.0]
    ),
)

test_errors_of_priors = wording(
    InferenceError,
    *(
        (message, lambda family=family, change=change: prior_family(family)(**change))
        for change, message in [
            ({"kappa": -1.0}, r"The prior's kappa must be positive, found -1.0; raise it above 0"),
            ({"kappa": [1.0, 0.0]}, r"The prior's kappa must be positive, found \[1.0, 0.0\]; raise it above 0"),
            ({"shape": 0.0}, "The prior's shape must be positive, found 0.0; raise it above 0"),
            ({"scale": -2.0}, "The prior's scale must be positive, found -2.0; raise it above 0"),
            ({"scale": np.inf}, "The prior's scale must be finite, found inf; give a plain number"),
            ({"mean": np.nan}, "The prior's mean must be finite, found nan; give a plain number"),
            ({"shape": [1.0, 2.0]}, r"The prior's shape must be finite, found \[1.0, 2.0\]; give a plain number"),
        ]
        for family in FAMILIES
    ),
    ("A prior family is one of conjugate, semiconjugate; found 'flat'", lambda: prior_family("flat")),
)

test_warnings = wording(
    UserWarning,
    (
        "^The columns must be of one size where all have the same prior, found v of .* and r of .*; take scaling=",
        lambda: ps.ConjugatePrior().exact(uneven(1000.0)),
    ),
)
