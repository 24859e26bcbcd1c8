"""The grid of a study: what is read, and one sentence where it cannot be."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pymc_ship.cli.main import main
from pymc_ship.experiments.run import read_study
from tests.experiments.folders import ROOT, changed, run, tables

TUTORIAL = ROOT / "docs" / "tutorials" / "your_ship" / "my_ship.toml"


def test_the_shipped_grid_is_five_levels_four_methods_and_a_hundred_seeds():
    grid = read_study(ROOT / "studies" / "container.toml")
    assert (len(grid.noise["white"]), len(grid.methods), grid.seeds, grid.n_tasks) == (5, 4, 100, 2000)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("seeds = 4", "sedes = 4", "unknown key sedes; known here are title, ships"),
        ("seeds = 4", "", "seeds is missing; add it."),
        ("seeds = 4", "seeds = 0", "seeds must be a whole number from 1 up, found 0; correct it."),
        ("seeds = 4", "seeds = true", "seeds must be a whole number from 1 up, found True; correct it."),
        ("root_seed = 7", "root_seed = 1.5", "root_seed must be a whole number from 0 up, found 1.5; correct it."),
        ("duration = 60.0", "duration = 0", "duration must be a number from 0.02 up, found 0; correct it."),
        ("duration = 60.0", "duration = inf", "duration must be a number from 0.02 up, found inf; correct it."),
        ('title = "small"', "title = 3", "title must be a text, found 3; put it in quotes."),
        ('["small.toml"]', "[]", "ships must be a list of at least one text, found []; correct it."),
        (
            '["small.toml"]',
            '"small.toml"',
            "ships must be a list of at least one text, found 'small.toml'; correct it.",
        ),
        ('["small.toml"]', '["small"]', "ships cannot have 'small': A vessel is one of container"),
        (
            '["small.toml"]',
            f'["{TUTORIAL}"]',
            "my_ship.toml': The model of 'my_ship' needs coefficients of sway, found none",
        ),
        ('["small.toml"]', '["none.toml"]', "ships cannot have 'none.toml': The vessel file"),
        ('["small.toml"]', '["small.toml", "./small.toml"]', "different names, found 'small' twice; rename one."),
        ('"weak form"', '"weak"', "a method is one of paper's pipeline, central difference at 1 s"),
        ('"weak form"', '"paper\'s pipeline"', 'methods must name everything once, found "paper\'s pipeline" twice'),
        (
            '"zigzag 20/20"',
            '"zigzag 20"',
            "a manoeuvre is 'zigzag 20/20', 'turning circle 35', 'pull out 20/90' or one of them with",
        ),
        ('"zigzag 20/20"', '"zig 20/20"', "found 'zig 20/20'; write it so."),
        ('"zigzag 20/20"', '""', "found ''; write it so."),
        ('"zigzag 20/20"', '"zigzag 20/-20"', "manoeuvres cannot have 'zigzag 20/-20': heading_deg is a magnitude"),
        ('"zigzag 20/20"', '"zigzag 20/20", "zigzag 20/20 port"', "manoeuvres must name everything once"),
        ("[noise]", "[[noise]]", "noise must be a table such as white = [0.01]"),
        ("white = [0.01, 0.05]", "", "noise must be a table such as white = [0.01], found {}; correct it."),
        ("white =", "pink =", "a kind of noise is one of white, correlated 0.2 s"),
        ("[0.01, 0.05]", "0.01", "noise.white must be a list of levels, found 0.01; write [0.01]."),
        ("[0.01, 0.05]", "[-0.01]", "noise.white must be a number from 0 up, found -0.01; correct it."),
        ("[0.01, 0.05]", '["0.01"]', "noise.white must be a number from 0 up, found '0.01'; correct it."),
        ("[0.01, 0.05]", "[0.01, 0.01]", "noise.white must name everything once, found 0.01 twice; leave one out."),
        ("[0.01, 0.05]", "[0.01", "is not valid TOML"),
    ],
)
def test_a_study_that_cannot_be_read_is_one_sentence(study, tmp_path, capsys, old, new, sentence):
    assert main(["montecarlo", str(changed(study, (old, new))), "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert sentence in printed.err
    assert not (tmp_path / "out").exists()


def test_a_study_may_be_a_table(study, plain, tmp_path):
    table = {"ships": [str(study.with_name("small.toml"))], "manoeuvres": ["zigzag 20/20 port"], "seeds": 4}
    table |= {"methods": ["weak form", "paper's pipeline"], "root_seed": 7, "noise": {"white": [0.01, 0.05]}}
    run(table | {"duration": 60}, tmp_path)
    assert tables(tmp_path) == tables(plain)


def test_how_a_number_of_a_ship_came_about_does_not_change_it(study, small):
    grid = read_study(study)
    told = replace(grid, ships={"small": replace(grid.ships["small"], derived={"inertia.m": "0.0075"})})
    assert told.record() == grid.record()


def test_a_ship_that_changes_is_seen(study, small):
    grid = read_study(study)
    assert grid.difference(grid.record()) == ""
    other = small.with_coefficients({"yaw": small.coefficients("yaw").values * 1.01})
    changed_ship = replace(grid, ships={"small": other})
    assert changed_ship.difference(grid.record()) == "'small' of ships is not what it was"
