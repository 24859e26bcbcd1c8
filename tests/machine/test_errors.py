import pickle

import pytest

import pymc_ship as ps
from pymc_ship.machine import errors

CLASSES = [value for value in vars(errors).values() if isinstance(value, type) and issubclass(value, ValueError)]


def test_one_root_has_seven_classes_below_it_and_all_are_public():
    assert ps.ShipError.__subclasses__() == [one for one in CLASSES if one is not ps.ShipError]
    assert len(CLASSES) == 8
    assert all(getattr(ps, one.__name__) is one for one in CLASSES)


@pytest.mark.parametrize("error", [ps.TrialError("a", checks=[1]), ps.FitError("a", refusals=[1, 2])])
def test_what_an_error_carries_comes_back_from_a_worker(error):
    back = pickle.loads(pickle.dumps(error))
    assert str(back) == "a"
    assert vars(back) == vars(error)


def test_a_refused_trial_carries_the_bad_checks_that_are_not_overruled():
    trial = ps.simulate("kvlcc2", ps.zigzag(20, 20), duration=600, step=0.5)
    with pytest.raises(ps.TrialError) as refused:
        ps.validated_trial(trial.assign(delta=-trial["delta"]), "kvlcc2")
    assert [check.name for check in refused.value.checks] == ["rudder sign"]
    assert ps.validated_trial(trial, "kvlcc2", overrule=["rudder sign"]).attrs["record_verdict"] == "good"
