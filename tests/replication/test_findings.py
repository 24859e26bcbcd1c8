"""What the page says of tables, in words, on tables of a few rows."""

from types import SimpleNamespace

from pymc_ship.replication import findings


def test_what_other_denoisers_do_is_said():
    medians = {"none": 110.4, "wavelet": 62.95, "low_pass": 44.58}
    rows = [{"method": method, "median": median} for method, median in medians.items()]
    said = findings._denoisers(SimpleNamespace(tables={"denoisers": rows}))
    assert "(wavelet 63 %, low pass 45 %; none 110 %)" in said


def test_what_draws_of_the_record_do_is_said_by_derivative():
    numbers = {"euler": [(67.5, 92.9, 100.0), (281.1, 88.9, 96.4)], "savgol": [(2.17, 53.6, 82.1), (3.31, 64.3, 85.7)]}
    rows = [
        {"derivative": derivative, "widened": wider, "coverage": before, "coverage_pooled": after}
        for derivative, dofs in numbers.items()
        for wider, before, after in dofs
    ]
    said = findings._coverage_of_draws(SimpleNamespace(tables={"drawn_coefficients": rows}))
    assert "savgol intervals become 2.2 to 3.3 times as wide and cover 82 to 86 % by degree of freedom, 54 to" in said


def test_ships_of_priors_and_of_posteriors_are_told_apart():
    numbers = [("chosen", 92.0, 0.5), ("published", 100.0, 0.0), ("posterior", 0.0, 80.0), ("posterior", 58.5, 33.0)]
    rows = [{"choice": choice, "diverged": away, "complete": complete} for choice, away, complete in numbers]
    said = findings._prior_ships(SimpleNamespace(tables={"prior_ships": rows}))["text"]
    assert "the priors 92 to 100 % diverge" in said
    assert "at most 0.5 % neither diverge" in said
    assert "the posteriors 0 to 58 % diverge" in said
