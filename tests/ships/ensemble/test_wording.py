"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np

import pymc_ship as ps
from pymc_ship.ships.ensemble.draws import coefficient_draws
from pymc_ship.ships.ensemble.files import FORMAT, MIGRATIONS
from tests.sentences import wording
from tests.ships.ensemble.cases import ship_of, write_index
from tests.ships.ensemble.test_files import SAVED
from tests.ships.forecasting.posteriors import joint, posterior
from tests.ships.identification.cases import tanker


def edited(at, out, **changes):
    """Copy of a saved ship with another index."""
    folder = Path(shutil.copytree(at, out)) / "model"
    write_index(folder, json.loads((folder / "ship.json").read_text(encoding="utf-8")) | changes)
    return out


def of_posterior(**settings):
    tree = joint(tanker(), 4, np.random.default_rng(1))
    ps.Ship.from_posterior(**{"vessel": "kvlcc2", "posteriors": tree, "rng": 1} | settings)


def of_draws(vessel, posteriors):
    coefficient_draws(vessel, posteriors, 4, np.random.default_rng(1))


def lacking(vessel, dof, count=2):
    """Posterior of a degree of freedom without its first coefficients."""
    names = vessel.coefficients(dof)["coefficient"].values[count:]
    return posterior(names, np.zeros((4, names.size)))


def jointly_lacking(vessel):
    return joint(vessel, 4, np.random.default_rng(17)).isel(coefficient=slice(2, None))


def first_two(dof):
    return ", ".join(sorted(ps.load_vessel("container").coefficients(dof)["coefficient"].values[:2]))


def changed_by_hand(tmp_path, number):
    at = Path(shutil.copytree(SAVED / f"format_{number}", tmp_path / "at"))
    path = at / "model" / "ship.json"
    path.write_text(path.read_text(encoding="utf-8").replace("hull_database", "order_damped"), encoding="utf-8")
    ps.load_ship(at)


def without_a_part(tmp_path, part):
    at = edited(SAVED / "format_3", tmp_path / "at", **{part: None})
    path = at / "model" / "ship.json"
    index = json.loads(path.read_text(encoding="utf-8"))
    del index[part]
    write_index(path.parent, index)
    ps.load_ship(at)


def without_its_checksum(tmp_path, value):
    at = Path(shutil.copytree(SAVED / f"format_{max(MIGRATIONS)}", tmp_path / "at"))
    path = at / "model" / "ship.json"
    index = json.loads(path.read_text(encoding="utf-8")) | {"sha256": value}
    kept = {key: entry for key, entry in index.items() if value != "none" or key != "sha256"}
    path.write_text(json.dumps(kept), encoding="utf-8")
    ps.load_ship(at)


test_ship_errors = wording(
    ps.VesselError,
    ("one joint posterior or posteriors by degree of freedom", lambda: of_posterior(posteriors="posterior.nc")),
    ("lacks .* of 'kvlcc2'; use its own", lambda: of_posterior(posteriors=posterior(["Yv"], np.zeros((2, 1))))),
    (r"none\.toml", lambda tmp_path: ps.Ship.from_vessel(tmp_path / "none.toml")),
    (
        f"The sway posterior lacks {first_two('sway')} of 'container'; use its own terms",
        lambda container: of_draws(container, {"sway": lacking(container, "sway")}),
    ),
    (
        "surge, sway, yaw, roll; found 'heave'",
        lambda container: of_draws(container, {"heave": lacking(container, "sway")}),
    ),
    (
        f"The joint posterior lacks {first_two('surge')} of 'container'; use its own",
        lambda container: of_draws(container, jointly_lacking(container)),
    ),
    (
        "with the likelihood of its runs, found none of 'kvlcc2'; save that of",
        lambda tmp_path: ps.save_ship(ship_of(tanker()), tmp_path),
    ),
    (
        "or write the posterior and keep the vessel file",
        lambda tmp_path: ps.save_ship(ps.Ship.from_vessel("kvlcc2"), tmp_path),
    ),
    *(
        (
            r"was written by another version of pymc_ship: .*; run .* again\.$",
            lambda tmp_path, number=number: ps.load_ship(
                edited(SAVED / f"format_{max(MIGRATIONS)}", tmp_path / "at", format=number)
            ),
        )
        for number in [0, FORMAT + 1, "3", None]
    ),
    *(
        (
            "was damaged or changed, its checksum does not fit",
            lambda tmp_path, number=number: changed_by_hand(tmp_path, number),
        )
        for number in sorted(MIGRATIONS)
    ),
    *(
        ("its checksum does not fit or is missing", lambda tmp_path, value=value: without_its_checksum(tmp_path, value))
        for value in ["none", None, "", 0]
    ),
    *(
        ("was written by another version of pymc_ship", lambda tmp_path, part=part: without_a_part(tmp_path, part))
        for part in ["held_out_indices", "uses_captive_tests", "motion_error", "facilities"]
    ),
    ("holds no identified ship: No such file or directory; run", lambda tmp_path: ps.load_ship(tmp_path)),
)

test_value_errors = wording(
    ValueError,
    ("draws must be a whole number from 2 up, found 1; correct", lambda: of_posterior(draws=1)),
    ("found 1.0 for 'speed'; correct it", lambda: of_posterior(noise_sd={"speed": 1.0})),
    *(
        ("finite and at least 0, for any of u, v, .* found", lambda noise=noise: of_posterior(noise_sd=noise))
        for noise in [{"u": -1.0}, {"u": np.nan}, {"u": np.inf}]
    ),
)
