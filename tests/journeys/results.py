"""One result of each kind, small and quickly made, and how it is read back."""

from __future__ import annotations

import numpy as np
import xarray as xr

from pymc_ship.experiments.run import read_study
from pymc_ship.experiments.store import locked_store
from pymc_ship.inference.regression.tree import read_posterior, write_posterior
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.records.steering.recognition import Steering
from pymc_ship.ships.ensemble.files import load_ship, save_ship
from pymc_ship.ships.ensemble.index_table import index_rows, index_table
from pymc_ship.ships.ensemble.motion_error import motion_error
from tests.experiments.folders import run
from tests.ships.ensemble.cases import ship_of, with_likelihoods

AGAIN = "done again"


def write_posteriors(vessel, out):
    """A posterior as NetCDF and one as Zarr."""
    names = coefficient_names(vessel)
    values = np.random.default_rng(1).normal(size=(4, 10, len(names)))
    coords = {"chain": range(4), "draw": range(10), "coefficient": names}
    posterior = xr.Dataset({"coefficients": (("chain", "draw", "coefficient"), values)}, coords)
    root = xr.Dataset(attrs={"dof": " ".join(vessel.dofs), "vessel": vessel.name, "method": "trajectory"})
    tree = xr.DataTree.from_dict({"/": root, "posterior": posterior})
    for ending in (".nc", ".zarr"):
        write_posterior(tree, out / f"trajectory{ending}")


def write_ship(vessel, out):
    """A ship of two term sets."""
    values = reference_coefficients(vessel)
    row = {"run": "a", "manoeuvre": "zigzag 20/20 port", "index": "first_overshoot_angle", "kind": "angle"}
    ship = ship_of(
        *((vessel, values * (1.0 + 0.01 * k + np.zeros((8, 1)))) for k in range(2)),
        names=("one, two", "three"),
        motion=xr.DataArray(np.random.default_rng(2).normal(size=(5, 2)), dims=("row", "symbol")),
        index_error={"angle": np.array([0.1, 0.2])},
        motion_error=motion_error([], vessel),
        facilities={"": Steering(2.3, 1.0, 4)},
        remarks=("b",),
        prior="order_damped",
        held_out_indices=index_table([row | {"measured": 1.0, "measured_sd": 0.1}]),
    )
    save_ship(with_likelihoods(ship), out, runs=("a",))


def _plain(tree):
    return {name: node.to_dict() for name, node in tree.to_dict().items()}


def read_ship(out):
    ship = load_ship(out)
    models = [(vessel.name, reference_coefficients(vessel).tolist(), rows.tolist()) for vessel, rows in ship.models]
    said = [(name, one.gaussian.response.tolist(), one.log_density.tolist()) for name, one in ship.likelihoods.items()]
    return [
        models,
        ship.motion.values.tolist(),
        {kind: sizes.tolist() for kind, sizes in ship.index_error.items()},
        ship.remarks,
        said,
        list(index_rows(ship.held_out_indices)),
    ]


def read_parts(study, out):
    """Results of a study; those that are missing are done again."""
    with locked_store(out, read_study(study)) as store:
        if store.missing():
            return AGAIN
        return [repr(rows.to_pylist()) for _, rows in store.rows()]


def kinds(vessel, study, out):
    """Folder of each result below a folder, by name, and the function that reads it into what can be compared."""
    for name in ("posteriors", "ship"):
        (out / name).mkdir()
    write_posteriors(vessel, out / "posteriors")
    write_ship(vessel, out / "ship")
    run(study, out / "study")
    read = {
        "posteriors": lambda at: [_plain(read_posterior(at / f"trajectory{ending}")) for ending in (".nc", ".zarr")],
        "ship": read_ship,
        "study": lambda at: read_parts(study, at),
    }
    return {name: (out / name, function) for name, function in read.items()}
