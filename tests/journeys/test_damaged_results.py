"""Damaged results: each is read as it was or refused in a sentence, and so is each trial with its format file."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pymc_ship.cli.main import main
from pymc_ship.machine.errors import ShipError, StudyError, VesselError
from tests.experiments.cases import TOML
from tests.journeys.damaged import damage
from tests.journeys.results import AGAIN, kinds
from tests.physics.vessel.cases import toml
from tests.records.files.mutated import mutated
from tests.ships.ensemble.cases import write_index

FORMAT = """[columns]
u = { column = "U", unit = "kn" }
v = "v"
psi = { column = "Heading", unit = "deg" }
delta = { column = "rudder", unit = "deg", sign = -1, offset = 0.5 }

[frame]
heading = "compass"
rudder_positive = "starboard"
"""


@pytest.fixture(scope="module")
def whole(small, tmp_path_factory):
    """Folder and reader of each result."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "small.toml").write_text(toml(small))
    (folder / "study.toml").write_text(TOML)
    return kinds(small, folder / "study.toml", folder)


def fuzz(whole, place, seeds):
    """Damage a result for each seed; count how it is read."""
    counts, known = Counter(), {name: read(folder) for name, (folder, read) in whole.items()}
    for seed in seeds:
        rng = np.random.default_rng(seed)
        name = sorted(whole)[rng.integers(len(whole))]
        folder, read = whole[name]
        copy = Path(shutil.copytree(folder, place / f"{name}-{seed}"))
        path = damage(copy, rng)
        found, error = tried(read, copy)
        if error is None:
            assert found in (known[name], AGAIN), (seed, path)
        else:
            assert type(error) in (VesselError, StudyError, ShipError), (seed, path, repr(error))
            assert str(copy) in str(error), (seed, path, error)
            assert str(error).endswith("."), (seed, path, error)
        counts[name, "read" if error is None else "refused"] += 1
        shutil.rmtree(copy)
    return counts


def tried(read, folder):
    """What is read of a folder and None, or None and what was raised."""
    try:
        return read(folder), None
    except Exception as error:
        return None, error


def test_damaged_results_are_read_as_they_were_or_refused_in_a_sentence(whole, tmp_path):
    counts = fuzz(whole, tmp_path, range(120))
    assert sum(counts.values()) == 120
    assert min(counts[name, "refused"] for name in whole) > 10, counts


@pytest.mark.parametrize(
    ("command", "name", "file", "remark"),
    [
        ("forecast {at} --turn 35 --out {out}", "ship", "model/ship.json", "cannot be read|checksum does not fit"),
        ("forecast {at} --turn 35 --out {out}", "ship", "model/one-two.nc", "checksum does not fit"),
        ("report {at}/trajectory.nc --out {out}", "posteriors", "trajectory.nc", "checksum does not fit|NetCDF: "),
        ("report {at}/trajectory.zarr --out {out}", "posteriors", "trajectory.zarr/zarr.json", "is no posterior"),
    ],
)
@pytest.mark.parametrize("how", ["flipped", "nested"])
def test_a_command_refuses_a_damaged_result_with_status_2(whole, tmp_path, capsys, command, name, file, remark, how):
    at = Path(shutil.copytree(whole[name][0], tmp_path / "at"))
    raw = bytearray((at / file).read_bytes())
    raw[len(raw) // 2] ^= 4
    (at / file).write_bytes(raw if how == "flipped" else b"[" * 200_000)
    assert main(command.format(at=at, out=tmp_path / "out").split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert any(words in line for words in remark.split("|")), line
    assert not (tmp_path / "out").exists()


def trial_and_format(made):
    """Text of a trial that needs a format file."""
    header, *lines = [line for line in (made / "trial.csv").read_text().splitlines() if line[0] != "#"][:120]
    names = {"u": "U", "psi": "Heading", "delta": "rudder"}
    return "\n".join([",".join(names.get(name, name) for name in header.split(",")), *lines]) + "\n"


def fuzz_trials(text, place, seeds):
    """Check mutated trials by mutated format files on the command line; count its statuses."""
    trial, layout, counts = place / "trial.csv", place / "format.toml", Counter()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        trial.write_bytes(mutated(text, rng) if rng.random() < 0.7 else text.encode())
        layout.write_bytes(mutated(FORMAT, rng) if rng.random() < 0.5 else FORMAT.encode())
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                status = main(["check", str(trial), "--format", str(layout), "--quiet"])
            except Exception as error:
                raise AssertionError((seed, repr(error))) from error
        assert status in (0, 2, 3, 4), seed
        if status:
            (line,) = err.getvalue().splitlines()
            assert line.startswith("pymc-ship: "), seed
            assert line.endswith("."), seed
        counts[status] += 1
    return counts


def test_mutated_trials_with_mutated_formats_are_checked_or_refused(made, tmp_path):
    counts = fuzz_trials(trial_and_format(made), tmp_path, range(200))
    assert {2, 3} <= set(counts) <= {0, 2, 3, 4}, counts
    assert counts[2] > 20


@pytest.mark.parametrize("change", ["facilities", "gear", "prior", "readings", "motion"])
def test_a_ship_of_another_version_is_refused_with_status_2(whole, tmp_path, capsys, change):
    at = Path(shutil.copytree(whole["ship"][0], tmp_path / "at"))
    index = json.loads((at / "model" / "ship.json").read_text(encoding="utf-8"))
    if change == "gear":
        index["facilities"] = {"": {"rudder_rate_deg": 2.0}}
    elif change == "prior":
        path = (at / "model" / index["terms"][0]["file"]).with_suffix(".nc")
        with xr.open_datatree(path) as file:
            tree = file.load()
        tree["constant_data"] = tree["constant_data"].to_dataset().drop_vars("prior_mean")
        tree.to_netcdf(path)
    elif change == "readings":
        index["held_out_indices"] = [{"kind": "angle", "measured": 10.0, "forecast": 9.0}]
    elif change == "motion":  # by lead
        index["motion_error"] = xr.Dataset({"u": ("lead", [0.1])}, {"lead": [0.5]}).to_dict()
    else:
        del index["facilities"]
    write_index(at / "model", index)
    assert main(["forecast", str(at), "--turn", "35", "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "was written by another version of pymc_ship" in line
