"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.regression.calibration import simulation_based_calibration
from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.cross_validation import cross_validation, fold_rows
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.regression.identify import SELECTIONS, identify
from pymc_ship.inference.regression.prior_table import (
    hold_fixed,
    informed_prior,
    order_damped_prior,
    restore_fixed,
    sister_ship_table,
)
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.regression.tree import (
    exact_posterior,
    read_posterior,
    write_posterior,
)
from pymc_ship.inference.regression.tune import maximise_evidence, tune_prior
from pymc_ship.inference.sampling.gibbs import gibbs_posterior
from pymc_ship.machine.errors import InferenceError, OutputError
from tests.inference.regression.cases import case
from tests.inference.regression.peers import exact_of, simulated
from tests.inference.regression.plain_algebra import HELD, NAMES, base, ship
from tests.inference.regression.test_identify_draws import PRIOR, rows
from tests.inference.regression.test_new_prior import root, scaled
from tests.inference.regression.test_prior_table import TABLE
from tests.inference.regression.test_tree import FORMATS, tree
from tests.inference.regression.test_tune import tuned
from tests.sentences import wording


class Vague(ps.Prior):
    box: ClassVar = {"kappa": (1.0, 2.0)}


RNG = np.random.default_rng(1)


def held_tree():
    data = hold_fixed(ship(), HELD)
    return gibbs_posterior(data, base("semiconjugate", 4), draws=5, chains=2, rng=np.random.default_rng(1))


def noted(value, of):
    """Posterior with a note of a value in the attrs of a group or of a variable."""
    found = tree()
    (found["posterior"]["coefficients"] if of == "coefficients" else found[of]).attrs["note"] = value
    return found


def with_posterior(change):
    found = tree()
    found["posterior"] = xr.DataTree(change(found["posterior"].to_dataset()))
    return found


def stacked():
    return with_posterior(lambda posterior: posterior.stack(sample=("chain", "draw")))


def of_complex_draws():
    return with_posterior(lambda posterior: posterior.astype(complex))


def of_gaps():
    return with_posterior(lambda posterior: posterior.assign(note=("chain", np.array(["a", None, "b", "c"], object))))


def of_objects():
    return with_posterior(lambda posterior: posterior.assign(note=("chain", np.array([{}] * posterior.sizes["chain"]))))


def something_else(tmp_path, suffix):
    path = tmp_path / f"surge{suffix}"
    path.write_text("no posterior") if suffix == ".nc" else path.mkdir()
    read_posterior(path)


def another_record(tmp_path, suffix, write):
    write(xr.DataTree(xr.Dataset({"u": ("time", np.ones(3))})), tmp_path / f"trial{suffix}")
    read_posterior(tmp_path / f"trial{suffix}")


def plainly(trial, path):
    trial.to_netcdf(path) if path.suffix == ".nc" else trial.to_zarr(path, mode="w", consolidated=False)


def changed(tmp_path, content):
    path = write_posterior(tree(), tmp_path / "surge.zarr")
    (path / "zarr.json").write_bytes(content)
    read_posterior(path)


def on_a_full_disk(tmp_path, monkeypatch):
    def full(*_, **__):
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr(xr.DataTree, "to_netcdf", full)
    write_posterior(tree(), tmp_path / "surge.nc")


test_value_errors = wording(
    ValueError,
    (
        "simulations must be a whole number from 1 up, found 0; correct",
        partial(simulation_based_calibration, *case(), simulations=0, rng=RNG),
    ),
    *(
        (
            sentence,
            lambda draws=draws, chains=chains: exact_posterior(
                case()[0], ConjugatePrior(), draws=draws, chains=chains, rng=np.random.default_rng(1)
            ),
        )
        for draws, chains, sentence in [
            (10, 4, "found 10 for 4; give a multiple"),
            (0, 4, "draws must be a whole number from 1 up, found 0"),
            (4, 0, "chains must be a whole number from 1 up, found 0"),
            (-4, 2, "draws must be a whole number from 1 up, found -4"),
        ]
    ),
    *(
        (
            sentence,
            lambda trial, small, selection=selection: identify(trial, small, selection=selection),
        )
        for selection, sentence in [
            ("guess", "is one of evidence, bayesian_optimisation; found 'guess'"),
            (SELECTIONS[1], "by bayesian_optimisation needs a generator, found none; give rng"),
        ]
    ),
    *(
        (
            sentence,
            lambda draws=draws, chains=chains: exact_posterior(
                *case(), draws=draws, chains=chains, rng=np.random.default_rng(1)
            ),
        )
        for draws, chains, sentence in [
            (10, 4, "found 10 for 4; give a multiple"),
            (0, 4, "draws must be a whole number from 1 up, found 0"),
            (4, 0, "chains must be a whole number from 1 up, found 0"),
        ]
    ),
    (
        r"ending in .nc or .zarr, found 'surge.csv'; rename it",
        lambda tmp_path: write_posterior(tree(), tmp_path / "surge.csv"),
    ),
    *(
        (
            f"found {found} in 'note' of {of}; convert it, such as by",
            lambda tmp_path, value=value, of=of, suffix=suffix: write_posterior(
                noted(value, of), tmp_path / f"surge{suffix}"
            ),
        )
        for suffix in FORMATS
        for of, value, found in [
            ("/", True, "True"),
            ("/", None, "None"),
            ("/posterior", {"a": 1}, "{'a': 1}"),
            ("/posterior", [1, None], r"\[1, None\]"),
            ("coefficients", np.True_, "np.True_"),
            ("coefficients", 1j, "1j"),
            ("coefficients", 10**30, "10+"),
            ("/", Path("a"), r"\w+Path\(.a.\)"),
        ]
    ),
    *(
        (sentence, lambda tmp_path, change=change, suffix=suffix: write_posterior(change(), tmp_path / f"a{suffix}"))
        for suffix in FORMATS
        for sentence, change in [
            ("without stacked dims, found sample in /posterior; unstack it", stacked),
            ("found the type complex128 in coefficients of /posterior; convert it", of_complex_draws),
            ("real numbers and texts, found None or NaN among texts in note of /posterior; convert it", of_gaps),
            ("has contents that files keep, found: .*; convert them", of_objects),
        ]
    ),
    ("found nothing at", lambda tmp_path: read_posterior(tmp_path / "surge.nc")),
    *(("is no posterior written by this package", partial(something_else, suffix=suffix)) for suffix in FORMATS),
    *(
        (
            "is no posterior written by this package: it has no group posterior",
            partial(another_record, suffix=suffix, write=write),
        )
        for suffix in FORMATS
        for write in [write_posterior, plainly]
    ),
    ("is no posterior written by this package: its checksum", partial(changed, content=b"[]")),
)

test_errors_of_priors = wording(
    InferenceError,
    *(
        (
            f"The prior's {name} is one value or 3, one for each term; found 2",
            lambda name=name: ConjugatePrior(**{name: [1.0, 2.0]}).exact(case()[0]),
        )
        for name in ["mean", "kappa"]
    ),
    ("found 'flat'", lambda trial, small: identify(trial, small, families=("flat",))),
    (
        r"found its power 0\.5 in the root family; use nuts_posterior\.$",
        lambda: ps.gibbs_posterior(scaled(), root(), rng=np.random.default_rng(8)),
    ),
    (r"found no noise_power and no exact in Vague; add it to the class\.$", lambda: ps.register_family(Vague)),
    (
        r"found 'conjugate' beside conjugate, semiconjugate; set the",
        lambda: ps.register_family(type("Second", (ConjugatePrior,), {})),
    ),
    (
        r"The constant Y0 of centred columns .*; leave it out of the table",
        lambda: informed_prior(ship(), base("conjugate"), TABLE | {"Y0": (4.0, 0.3)}),
    ),
    *(
        (sentence, lambda table=table: informed_prior(ship(), base("conjugate"), table))
        for table, sentence in [
            ({"Yx": (0.0, 1.0)}, "The coefficients are Y0, .*; found Yx; correct"),
            ({"Yv": (0.0, 0.0)}, "The sd of Yv must be positive, found 0.0; use hold_fixed"),
            ({"Yv": (0.0, -1.0)}, "The sd of Yv must be positive, found -1.0"),
            ({"Yv": (np.nan, 1.0)}, "The value given for Yv must be a finite number, found nan"),
            ({"Yv": (0.0, np.inf)}, "The value given for Yv must be a finite number, found inf"),
            ({"Yv": (0.0, "3")}, "The value given for Yv must be a finite number, found '3'"),
            ({"Yv": 3.0}, r"A table gives \(mean, sd\) for each coefficient, found 3.0 for Yv"),
            ({"Yv": (1.0, 2.0, 3.0)}, r"A table gives \(mean, sd\) for each coefficient"),
        ]
    ),
    (
        r"needs a shape above 1, found 1.0; raise the shape or use a Semi",
        lambda: informed_prior(ship(), ConjugatePrior(shape=1.0), TABLE),
    ),
    *(
        (
            rf"The damping lies in \(0, 1\], found {damping}",
            lambda damping=damping: order_damped_prior(ship(), ConjugatePrior(), damping=damping),
        )
        for damping in [0.0, -1.0, 1.5]
    ),
    (
        r"Order damping needs names of a letter and a term .* found '1'",
        lambda: order_damped_prior(simulated(6, 2, seed=1), ConjugatePrior()),
    ),
    *(
        (sentence, lambda container, settings=settings: sister_ship_table(container, "yaw", **settings))
        for settings, sentence in [
            ({"names": ["Nr", "Nrr_typo"]}, "The coefficients are .*; found Nrr_typo; correct the names"),
            ({"floor": 0.0}, r"An sd must be positive, found 0 for Nr\|r\|, .*; give a floor above 0"),
            ({"relative_sd": -0.1}, "must not be negative, found -0.1 and None"),
            ({"floor": -1.0}, "must not be negative, found 0.3 and -1.0"),
            ({"floor": np.nan}, "The value given for floor must be a finite number"),
        ]
    ),
    *(
        (
            rf"^The prior's {name} must be finite, found .*; give a plain number\.$",
            lambda value=value, name=name: ConjugatePrior(**{name: value}),
        )
        for name in ["mean", "kappa", "shape", "scale"]
        for value in [
            np.ma.masked_greater([1.0, 9.0], 5.0),
            "wide",
            "3",
            None,
            [1.0, "a"],
            [[1.0], [1.0, 2.0]],
            1j,
            {},
            10**400,
            np.nan,
        ]
    ),
    *(
        (
            rf"^The prior's {name} has no labels, found \['r', 'v'\]; put it into the order of the terms and give it",
            lambda name=name: ConjugatePrior(**{name: xr.DataArray([1.0, 2.0], {"term": ["r", "v"]}, "term")}),
        )
        for name in ["mean", "kappa"]
    ),
    *(
        (
            f"The prior's {name} is one value or 3, one for each term; found 2",
            lambda name=name: SemiConjugatePrior(**{name: [1.0, 2.0]}).exact(case()[0]),
        )
        for name in ["mean", "kappa"]
    ),
    ("A prior family is one of conjugate, semiconjugate; found 'flat'", lambda: tuned("flat")),
    ("A prior family is one of conjugate, semiconjugate; found 'flat'", lambda: maximise_evidence(scaled(), "flat")),
)

test_errors_of_rows = wording(
    InferenceError,
    *(
        (
            r"New rows are finite, of shape \(rows, 3\), found",
            lambda rows=rows: ConjugatePrior().exact(case()[0]).predict(rows),
        )
        for rows in [np.ones((2, 4)), np.ones(3), np.full((2, 3), np.nan)]
    ),
    *(
        (
            "one finite value for each of 2 rows",
            lambda response=response: (
                ConjugatePrior().exact(case()[0]).log_predictive_density(np.ones((2, 3)), response)
            ),
        )
        for response in [np.ones(3), np.ones((2, 1)), np.array([1.0, np.inf])]
    ),
    ("The rudder of a trial must move", lambda trial, small: identify(trial.assign(delta=0.0 * trial["delta"]), small)),
    (
        "need a trial with the dimension draw, found none",
        lambda container, drawn: ps.regression_draws(drawn.isel(draw=0), container, "yaw"),
    ),
    (
        re.escape("found 1 with 1 sets of coefficients"),
        lambda: ps.pooled_coefficients(
            rows(np.random.default_rng(3).standard_normal((2, 30)), np.arange(30.0))[:1],
            PRIOR,
            rng=np.random.default_rng(1),
        ),
    ),
    (
        re.escape("found 2 with 2 sets of coefficients"),
        lambda: ps.pooled_coefficients(
            [
                rows(np.random.default_rng(3).standard_normal((2, 30)), np.arange(30.0))[0],
                ps.RegressionData.from_arrays(np.ones((30, 1)), np.arange(30.0), ["other"], scaling="none"),
            ],
            PRIOR,
            rng=np.random.default_rng(1),
        ),
    ),
    *(
        (sentence, lambda values=values: hold_fixed(ship(), values))
        for values, sentence in [
            ({"Yx": 1.0}, "The coefficients are Y0, .*; found Yx; correct"),
            ({"Yv": np.nan}, "The value given for Yv must be a finite number, found nan"),
            ({"Yv": "fast"}, "The value given for Yv must be a finite number, found 'fast'"),
            ({"Yv": None}, "The value given for Yv must be a finite number, found None"),
            (dict.fromkeys(NAMES, 0.0), "At least one coefficient must stay free, found all of them fixed"),
        ]
    ),
    *(
        (
            sentence,
            lambda values=values, names=names: restore_fixed(
                gibbs_posterior(
                    hold_fixed(ship(), HELD), base("semiconjugate", 4), draws=5, chains=2, rng=np.random.default_rng(1)
                ),
                values,
                names,
            ),
        )
        for values, names, sentence in [
            ({"Yv": 1.0}, None, "found draws of Yv; leave it out"),
            ({"Yv|v|": np.inf}, None, "The value given for Yv|v| must be a finite number, found inf"),
            ({"Yv|v|": 0.8}, None, "^The fixed values are those of the fit, found Yv.v. = 0.8 for 0.7; correct"),
            (HELD, NAMES[:4], "found a mismatch in Ydelta"),
            (HELD, (*NAMES, "Yx"), "found a mismatch in Yx"),
            (HELD, (*NAMES, "Yv"), "must differ, found Yv more than once; rename"),
        ]
    ),
    *(
        (r"New rows are finite, of shape \(rows, 3\), found", lambda rows=rows: exact_of(*case()).predict(rows))
        for rows in [np.ones((2, 4)), np.ones(3), np.full((2, 3), np.nan)]
    ),
    *(
        (
            "one finite value for each of 2 rows",
            lambda response=response: exact_of(*case()).log_predictive_density(np.ones((2, 3)), response),
        )
        for response in [np.ones(3), np.ones((2, 1)), np.array([1.0, np.inf])]
    ),
)

test_cross_validation_errors = wording(
    InferenceError,
    *(
        (
            f"The 13 rows make 2 to 13 folds, found {folds}; change",
            lambda folds=folds: cross_validation(simulated(13, 3, seed=1), folds),
        )
        for folds in [1, 0, 14]
    ),
    ("A split is one of blocks, random; found 'odd'; choose", lambda: fold_rows(13, split="odd")),
    ("A random split needs a generator, found none; give rng", lambda: fold_rows(13, split="random")),
    ("The 60 rows make 2 to 60 folds, found 61", lambda: tuned(folds=61)),
)

test_vessel_errors = wording(
    ps.VesselError,
    ("found 'heave'", lambda container: sister_ship_table(container, "heave")),
)

test_output_errors = wording(
    OutputError,
    (r"surge\.nc cannot be written: NetCDF: HDF error, the disk may be full; ch", on_a_full_disk),
)

test_tuning_errors = wording(
    InferenceError,
    (
        "at least 6 points, found 5; raise evaluations",
        lambda: tune_prior(scaled(), evaluations=5, rng=np.random.default_rng(1)),
    ),
    *(
        ("A box bounds shape, noise_variance, kappa, found", lambda box=box: maximise_evidence(scaled(), box=box))
        for box in [{}, {"shape": (1.0, 2.0), "scale": (1.0, 2.0), "kappa": (1.0, 2.0)}]
    ),
    *(
        (
            "Bounds are pairs that rise and lie above 0, found",
            lambda pair=pair: maximise_evidence(scaled(), box=FAMILIES["conjugate"].box | {"kappa": pair}),
        )
        for pair in [(2.0, 1.0), (0.0, 1.0), (-1.0, 1.0), (np.nan, 1.0), (1.0, 1.0)]
    ),
)
