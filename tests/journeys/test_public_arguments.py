"""What every public function takes as seed, vessel, trial and prior, and the sentence on anything else."""

from __future__ import annotations

import inspect

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.records.checks.lag import common_lag
from tests.sentences import refused

FUNCTIONS = {name: inspect.signature(getattr(ps, name)) for name in ps.__all__ if name[0].islower()}


def taking(argument):
    """Names of the public functions that have an argument."""
    found = [name for name, signature in FUNCTIONS.items() if argument in signature.parameters]
    assert len(found) > 3
    return found


def called(name, **given):
    """Call a public function; an argument that is needed and not given is 1 or an object that nothing is done with."""
    needed = [
        entry
        for entry in FUNCTIONS[name].parameters.values()
        if entry.default is entry.empty and entry.kind is not entry.VAR_KEYWORD
    ]
    given = {word: value for word, value in given.items() if word in FUNCTIONS[name].parameters}
    filled = {entry.name: 1 if entry.annotation in (int, "int") else object() for entry in needed}
    return getattr(ps, name)(**filled | given)


@pytest.fixture(scope="module")
def trial():
    return ps.simulate("kvlcc2", ps.zigzag(20, 20), duration=300, step=0.5)


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((30, 2))
    return ps.RegressionData.from_arrays(columns, columns @ [1.0, 2.0] + 0.1 * rng.standard_normal(30), scaling="none")


# seeds ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [True, "3", -1, 3.0, "None"])
@pytest.mark.parametrize("name", taking("rng"))
def test_what_is_no_seed_is_refused_with_a_sentence(name, bad):
    optional = FUNCTIONS[name].parameters["rng"].default is None
    bad = None if bad == "None" and not optional else bad
    with refused(ValueError, "rng=1"):
        called(name, rng=bad)


COUNTS = [
    (name, entry.name)
    for name, signature in FUNCTIONS.items()
    for entry in signature.parameters.values()
    if entry.annotation in (int, "int")
]


@pytest.mark.parametrize("bad", [True, "3", -1, 3.0, 2.5, float("nan"), None])
@pytest.mark.parametrize(("name", "count"), COUNTS)
def test_what_is_no_count_is_refused_with_its_name(name, count, bad):
    with refused(ValueError, count):
        called(name, **{count: bad, "rng": 1})


@pytest.mark.parametrize("bad", [True, "0.9", 0.0, 1, 90.0, float("nan"), None])
@pytest.mark.parametrize("name", ["forecast", "replay", "score"])
def test_what_is_no_probability_is_refused_with_its_name(name, bad):
    with refused(ValueError, "ci_prob"):
        called(name, ci_prob=bad, rng=1)


def test_an_integer_and_a_seed_sequence_stand_for_their_generators(trial, data):
    def noisy(rng):
        return ps.pollute(trial, level=0.01, rng=rng)

    assert noisy(3).identical(noisy(np.random.default_rng(3)))
    assert noisy(np.random.SeedSequence(3)).identical(noisy(np.int64(3)))
    assert not noisy(3).identical(noisy(4))
    prior = ps.ConjugatePrior()
    for posterior in (ps.exact_posterior, ps.gibbs_posterior):
        trees = [posterior(data, prior, draws=40, rng=rng) for rng in (3, np.random.default_rng(3))]
        assert trees[0].identical(trees[1])
    exact, (scaled, _) = prior.exact(data), prior.draw(2, 3, (5,))
    np.testing.assert_array_equal(exact.draw(5, 3)[0], exact.draw(5, np.random.default_rng(3))[0])
    np.testing.assert_array_equal(scaled, prior.draw(2, np.random.default_rng(3), (5,))[0])


def test_a_generator_goes_on(trial):
    rng = np.random.default_rng(3)
    first, second = (ps.pollute(trial, level=0.01, rng=rng) for _ in range(2))
    assert not first.identical(second)


# vessels --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", taking("vessel"))
def test_what_is_no_vessel_is_refused_with_a_sentence(name, tmp_path):
    rest = {"rng": 1, "ship": "kvlcc2", "out": tmp_path, "trials": [], "trial": xr.Dataset()}
    rest |= {"manoeuvre": ps.zigzag(20, 20)}
    with refused(ps.VesselError, "kvlcc2", 3):
        called(name, vessel=3, **rest)
    with refused(ps.VesselError, "kvlcc2", "titanic"):
        called(name, vessel="titanic", **rest)


def test_a_vessel_by_its_name_is_the_vessel(trial):
    vessel = ps.load_vessel("kvlcc2")
    assert ps.simulate(vessel, ps.zigzag(20, 20), duration=300, step=0.5).identical(trial)
    assert ps.term_sets("kvlcc2") == ps.term_sets(vessel)
    named, given = (ps.regression_data(trial, ship, "yaw", interval=2.0) for ship in ("kvlcc2", vessel))
    np.testing.assert_array_equal(named.design_matrix, given.design_matrix)
    assert ps.trial_checks(trial, "kvlcc2") == ps.trial_checks(trial, vessel)


# ships ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in taking("ship") if name not in ("save_ship", "sea_trial")])
def test_what_is_no_ship_is_refused_with_a_sentence(name):
    """A vessel is one, too; files keep a ship alone, and a sea trial may do without."""
    rest = {"rng": 1, "trials": [], "trial": xr.Dataset(), "manoeuvre": ps.zigzag(20, 20), "candidates": []}
    for given in (3, "titanic"):
        with refused(ps.VesselError, "kvlcc2", given):
            called(name, ship=given, **rest)


# trials ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", taking("trial"))
def test_a_list_where_one_trial_is_meant_is_refused_with_a_sentence(name, trial):
    """Or accepted, by those that can put several trials together."""
    rest = {
        "vessel": "kvlcc2",
        "ship": "kvlcc2",
        "rng": 1,
        "level": 0.01,
        "dof": "yaw",
        "channels": ["u"],
        "path": "t.csv",
        "checks": [],
    }
    several = "Sequence" in str(FUNCTIONS[name].parameters["trial"].annotation)
    if not several:
        with refused(ps.TrialError, "xarray", 2):
            called(name, trial=[trial, trial], **rest)
    with refused(ps.TrialError, "str"):
        called(name, trial="zigzag.csv", **rest)


@pytest.mark.parametrize("name", taking("trials"))
def test_what_holds_no_trials_is_refused_with_a_sentence(name, trial):
    rest = {"vessel": "kvlcc2", "ship": "kvlcc2", "rng": 1, "mean": np.zeros(29), "scale": np.ones(29)}
    with refused(ps.TrialError, "int"):
        called(name, trials=3, **rest)
    with refused(ps.TrialError, 1):
        called(name, trials=[[trial]], **rest)


def test_one_trial_where_a_list_is_meant_is_a_list_of_it(trial):
    recognised, steering = ps.recognise(trial, "kvlcc2")
    assert (recognised, steering) == ps.recognise([trial], "kvlcc2")
    priors = [ps.coefficient_prior(given, "kvlcc2") for given in (trial, [trial])]
    np.testing.assert_array_equal(priors[0].scale, priors[1].scale)
    with refused(ps.TrialError, "draws", 1):
        ps.identify_ship(trial, "kvlcc2", draws=1, rng=1)
    checks = ps.trial_checks(trial, "kvlcc2")
    assert common_lag(checks) == common_lag([checks])


def test_several_manoeuvres_or_posteriors_are_refused_with_a_sentence(data):
    turns = [ps.zigzag(20, 20), ps.zigzag(10, 10)]
    rest = {"vessel": "kvlcc2", "ship": "kvlcc2", "rng": 1, "duration": 100.0}
    for name in ("simulate", "forecast"):
        for given in (turns, "zigzag"):
            with refused(ps.SimulationError, "zigzag"):
                called(name, manoeuvre=given, **rest)
    tree = ps.exact_posterior(data, ps.ConjugatePrior(), draws=40, rng=1)
    for given in ([tree], {"yaw": "posterior.nc"}, "posterior.nc"):
        with refused(ps.VesselError, "joint"):
            ps.Ship.from_posterior("kvlcc2", given, rng=1)


# priors ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", ["flat", ps.ConjugatePrior, None])
@pytest.mark.parametrize("name", [name for name in taking("prior") if "data" in FUNCTIONS[name].parameters])
def test_what_is_no_prior_of_a_regression_is_refused_with_a_sentence(name, bad, data):
    if bad is None and FUNCTIONS[name].parameters["prior"].default is None:
        bad = "conjugate"
    with refused(ps.InferenceError, "ConjugatePrior"):
        called(name, prior=bad, data=data, rng=1)


@pytest.mark.parametrize("name", ["trajectory_posterior", "trajectory_nuts_posterior", "trajectory_model"])
def test_a_prior_of_a_regression_is_refused_by_a_trajectory_fit(name, trial):
    with refused(ps.InferenceError, "CoefficientPrior"):
        called(name, prior=ps.ConjugatePrior(), trials=ps.pollute(trial, level=0.01, rng=1), vessel="kvlcc2", rng=1)


# data, posteriors and tables ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [np.ones((9, 2)), pd.DataFrame({"v": [1.0, 2.0]}), None])
@pytest.mark.parametrize("name", [name for name in taking("data") if name not in ("horseshoe", "r2d2")])
def test_what_is_no_regression_data_is_refused_with_a_sentence(name, bad, data):
    prior = ps.SemiConjugatePrior()
    given = {"data": data, "prior": prior, "tree": ps.exact_posterior(data, prior, draws=40, rng=1), "rng": 1}
    bad = "table" if bad is None and FUNCTIONS[name].parameters["data"].default is None else bad
    with refused(ps.InferenceError, "RegressionData"):
        called(name, **given | {"data": bad})


def test_priors_and_pooled_draws_need_regression_data_too(data):
    for use in (
        lambda: ps.ConjugatePrior().exact(data.design_matrix),
        lambda: ps.SemiConjugatePrior().exact(data.design_matrix),
        lambda: ps.pooled_coefficients([data.design_matrix, data], ps.ConjugatePrior(), rng=1),
    ):
        with refused(ps.InferenceError, "RegressionData"):
            use()
    with refused(ps.InferenceError, "ConjugatePrior"):
        ps.pooled_coefficients([data, data], None, rng=1)
    assert ps.pooled_coefficients((one for one in (data, data)), ps.ConjugatePrior(), rng=1).sizes["coefficient"] == 2


@pytest.mark.parametrize("group", ["posterior", "log_prior"])
def test_a_group_or_a_tree_without_posterior_is_refused_with_a_sentence(group, data):
    prior = ps.ConjugatePrior()
    tree = ps.exact_posterior(data, prior, draws=40, rng=1)
    for part in (tree[group], tree[group].to_dataset(), None):
        for use in (
            lambda part=part: ps.predict(part, [[1.0, 2.0]], rng=1),
            lambda part=part: ps.restore_fixed(part, {"x3": 1.0}),
            lambda part=part: ps.with_predictive(part, data, prior, rng=1),
        ):
            with refused(ps.InferenceError, "whole"):
                use()
    with refused(ps.InferenceError, "real"):
        ps.predict(tree, xr.Dataset({"x1": ("row", [1.0]), "x2": ("row", [1.0])}), rng=1)
    with refused(ps.InferenceError, "DataTree"):
        ps.posterior_tree({"posterior": 1}, data)


def test_values_by_name_are_a_mapping(data):
    tree = ps.exact_posterior(data, ps.ConjugatePrior(), draws=40, rng=1)
    for use in (
        lambda: ps.hold_fixed(data, ["x1"]),
        lambda: ps.restore_fixed(tree, ["x3"]),
        lambda: ps.informed_prior(data, ps.SemiConjugatePrior(), pd.DataFrame({"x1": [1.0, 2.0]})),
        lambda: ps.coefficient_prior([], "kvlcc2", table=["Nv"]),
        lambda: ps.maximise_evidence(data, box=["kappa"]),
    ):
        with refused(ps.InferenceError, "Mapping", "dict"):
            use()


def test_bounds_and_draws_are_numbers(data):
    box = {"shape": (1.0, 2.0), "noise_variance": (1.0, 2.0), "kappa": (1.0, "a")}
    for bounds in (box, box | {"kappa": 1.0}):
        with refused(ps.InferenceError, "real"):
            ps.maximise_evidence(data, box=bounds)
    for draws in (-1, 2.5):
        with refused(ps.InferenceError, "draws", draws):
            ps.ConjugatePrior().exact(data).draw(draws, 1)


def test_other_kinds_are_named(tmp_path, trial, data):
    for error, word, use in (
        (ps.InferenceError, "CoefficientPrior", lambda: ps.identifiability([trial], "kvlcc2", prior="order_damped")),
        (ps.TrialError, "noise_sd", lambda: ps.trajectory_posterior([trial], "kvlcc2", noise_sd=0.1, rng=1)),
        (ps.TrialError, "Dataset", lambda: ps.fit_captive(None, "kvlcc2", ps.coefficient_prior([], "kvlcc2"))),
        (ps.VesselError, "DataArray", lambda: ps.rescale(np.ones(3), "kvlcc2", "mmg")),
        (ps.VesselError, "None", lambda: ps.load_vessel(None)),
        (ValueError, "posterior", lambda: ps.diagnostic_report([1], tmp_path / "x")),
        (ValueError, "posterior", lambda: ps.agreement(ps.ConjugatePrior().exact(data), {"nuts": None})),
    ):
        with refused(error, word):
            use()
    assert list(tmp_path.iterdir()) == []


def test_coefficients_are_rescaled_by_their_own_vessel():
    prime = ps.load_vessel("kvlcc2").coefficients("yaw")
    with refused(ps.VesselError, "container", "kvlcc2"):
        ps.rescale(prime, "container", "bis")


def test_one_name_is_no_list_of_its_letters(trial, data):
    tree = ps.exact_posterior(data, ps.ConjugatePrior(), draws=40, rng=1)
    for use in (
        lambda: ps.denoise(trial, channels="psi"),
        lambda: ps.denoise_draws(trial, channels="psi", rng=1),
        lambda: ps.trajectory_posterior([trial], "kvlcc2", channels="u,v", rng=1),
        lambda: ps.sister_ship_table("kvlcc2", "yaw", names="Nv"),
        lambda: ps.identify(trial, "kvlcc2", families="conjugate"),
        lambda: ps.identify_ship([trial], "kvlcc2", terms="hull", rng=1),
        lambda: ps.restore_fixed(tree, {"x3": 1.0}, "x1"),
        lambda: ps.RegressionData.from_arrays(data.design_matrix, data.response, "ab"),
        lambda: ps.score("kvlcc2", [trial], names="a"),
    ):
        with refused(ValueError, "list"):
            use()


# paths, numbers and functions -----------------------------------------------------------------------------------------

PATHS = [
    (name, argument)
    for name, argument in (
        *(
            (name, "path")
            for name in ("read_trial", "write_trial", "read_posterior", "write_posterior", "read_captive")
        ),
        *((name, "out") for name in ("load_ship", "study")),
        ("montecarlo", "study"),
    )
]
KINDS = {"None": None, "number": 3, "table": pd.DataFrame({"u": [1.0]}), "list": ["t.csv"], "trial": xr.Dataset()}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("name", "argument"), PATHS)
def test_what_is_no_path_is_refused_with_its_name(name, argument, kind, trial, data):
    tree = ps.exact_posterior(data, ps.ConjugatePrior(), draws=40, rng=1)
    rest = {"vessel": "kvlcc2", "ship": "kvlcc2", "trial": trial, "tree": tree, "trees": {"a": tree}, "command": ""}
    with refused(ps.ShipError, argument):
        called(name, **rest | {argument: KINDS[kind]})


NUMBERS = [
    *(("simulate", name) for name in ("duration", "step", "wind", "current")),
    ("direct_spiral", "hold"),
    ("pollute", "level"),
    ("regression_data", "interval"),
    ("coefficient_prior", "relative_sd"),
    ("stopping", "astern"),
    ("design", "sea_room"),
    *(("replay", name) for name in ("start", "duration")),
    *(("score", name) for name in ("length", "every")),
]


@pytest.mark.parametrize("bad", ["text", [1.0], {"a": 1}, pd.DataFrame({"a": [1.0, 2.0]}), xr.Dataset()], ids=repr)
@pytest.mark.parametrize(("name", "number"), NUMBERS)
def test_what_is_no_number_is_refused_with_a_sentence(name, number, bad, trial):
    rest = {"vessel": "kvlcc2", "ship": "kvlcc2", "trial": trial, "trials": [trial], "manoeuvre": ps.zigzag(20, 20)}
    if name == "stopping":
        rest["ship"] = ps.with_terms("kvlcc2", "modular at any speed")
    with refused(ps.ShipError):
        called(name, **{"duration": 100.0, "rng": 1, "dof": "yaw"} | rest | {number: bad})


@pytest.mark.parametrize(
    ("name", "argument", "kind"),
    [
        ("register_channel", "channel", "Channel"),
        ("register_part", "part", "Part"),
        ("register_manoeuvre", "kind", "ManoeuvreKind"),
        ("register_family", "prior_class", "class"),
        ("corrected_trial", "checks", "Check"),
        ("trial_checks", "lag", "VelocityLag"),
        ("write_forecast_page", "forecasts", "forecasts"),
        ("write_ship_report", "result", "ShipIdentification"),
        ("trial_report", "result", "SeaTrial"),
        ("agreement", "exact", "exact"),
        ("hierarchical_posterior", "groups", "group"),
        ("horseshoe", "given", "given"),
        *((name, "progress", "progress") for name in ("identify", "identify_ship", "design", "sea_trial", "study")),
    ],
)
@pytest.mark.parametrize("bad", [3, "text", xr.Dataset()], ids=["number", "text", "trial"])
def test_what_is_of_another_kind_is_refused_with_its_kind(name, argument, kind, bad, trial, data, tmp_path):
    prior = ps.SemiConjugatePrior()
    rest = {"vessel": "kvlcc2", "ship": "kvlcc2", "trial": trial, "trials": [trial], "rng": 1, "out": tmp_path / "out"}
    rest |= {"data": data, "prior": prior, "checks": [], "forecasts": {}, "command": "", "seed": 1}
    rest |= {"posteriors": {"a": ps.exact_posterior(data, prior, draws=40, rng=1)}}
    rest |= {"trials": {"a": trial}} if name == "write_ship_report" else {}
    with refused(ps.ShipError, kind):
        called(name, **rest | {argument: bad})
    assert not (tmp_path / "out").exists()


def test_swapped_arguments_are_refused_with_a_sentence(trial):
    for use in (
        lambda: ps.corrected_trial(trial, ps.load_vessel("kvlcc2")),
        lambda: ps.simulate(ps.zigzag(20, 20), "kvlcc2", duration=100.0),
        lambda: ps.trial_checks(ps.load_vessel("kvlcc2"), trial),
        lambda: ps.corrected_trial(trial, (), "rudder sign"),
        lambda: ps.corrected_trial(trial, (), 3),
        lambda: ps.sea_trial([], "kvlcc2", rng=1),
    ):
        with refused(ps.ShipError):
            use()
