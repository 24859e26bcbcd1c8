"""Captive tests beside the forces of ships: before anything was fitted, and after, as bands, table and figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymc_ship.inference.captive.fit import held_motion, known_tests
from pymc_ship.inference.captive.table import FORCES
from pymc_ship.pages.drawing import BLUE, NOISE, REFERENCE, RUST, house_style, subplots
from pymc_ship.pages.tables import fixed_point
from pymc_ship.physics.motion.captive import captive_test_forces
from pymc_ship.physics.vessel.vessel import DOFS, Vessel

BANDS = ("lower", "median", "upper")
_TAILS = (0.025, 0.5, 0.975)
_DOF = {"X": "surge", "Y": "sway", "N": "yaw"}
_SERIES = {"beta": "drift angle β [deg]", "r": "yaw rate r'", "delta": "rudder δ [deg]"}
_FEWEST = 3  # tests of a series that is drawn
_AT_SPEED = 0.1  # share by which the speed of a drawn test is off the most usual one


def captive_bands(
    tests: xr.Dataset, vessel: Vessel, draws: Mapping[str, np.ndarray], *, revolutions: float = 1.0
) -> xr.Dataset:
    """Measured forces of captive tests beside the bands of 95 % of ships, drawn in one way or more.

    Parameters
    ----------
    tests : Dataset, dims (test,)
        From :func:`pymc_ship.read_captive`; those that the vessel's forces do not stand for are left out.
    vessel : Vessel
    draws : mapping of str to ndarray, shape (n_draws, n_coefficients)
        By how they were drawn.
    revolutions : float, optional
        Nominal ones on the carriage over those of the vessel.

    Returns
    -------
    Dataset, dims (test,), (drawn, band, test)
        Motion and measured forces of the tests; ``X_band``, ``Y_band`` and ``N_band``, as far as they were measured.
    """
    tests = known_tests(tests, vessel)
    s = vessel.particulars
    found = tests.assign_coords(drawn=list(draws), band=list(BANDS)).assign_attrs(U_nom=s.nominal_speed, L=s.L)
    forces = [captive_test_forces(vessel, held_motion(tests, vessel, revolutions), rows) for rows in draws.values()]
    for name in (name for name in FORCES if name in tests):
        row = DOFS.index(_DOF[name])
        bands = [np.quantile(one[:, row], _TAILS, axis=0) for one in forces]
        found[f"{name}_band"] = ("drawn", "band", "test"), np.array(bands)
    return found


def comparison_rows(found: xr.Dataset) -> list[dict]:
    """R2, root mean square of what is left, and share of tests inside the bands, by force and kind of draws.

    Squares count at the scale of the nominal speed, as in the fit; ``rms`` and ``rms_force`` are prime at it.
    """
    weight = (found["u"].values ** 2 + found["v"].values ** 2) / found.attrs["U_nom"] ** 2
    rows = []
    for name in (name for name in FORCES if f"{name}_band" in found):
        measured = found[name].values
        for drawn in found["drawn"].values:
            lower, median, upper = found[f"{name}_band"].sel(drawn=drawn).values
            left, whole = (measured - median) * weight, (measured - measured.mean()) * weight
            rows.append(
                {
                    "force": f"{name}'",
                    "drawn": str(drawn),
                    "tests": measured.size,
                    "R2": float(1.0 - np.sum(left**2) / np.sum(whole**2)),
                    "rms": float(np.sqrt(np.mean(left**2))),
                    "rms_force": float(np.sqrt(np.mean((measured * weight) ** 2))),
                    "half_width": float(np.mean(0.5 * (upper - lower) * weight)),
                    "inside": float(np.mean((measured >= lower) & (measured <= upper))),
                }
            )
    return rows


def comparison_page_table(rows: Sequence[Mapping]) -> tuple[list[dict], dict]:
    """Rows of :func:`comparison_rows` in % of the force, and the columns in which a page shows them."""
    shown = []
    for row in rows:
        relative = {key: 100.0 * row[key] / row["rms_force"] for key in ("rms", "half_width")}
        shown.append(dict(row) | relative | {"inside": 100.0 * row["inside"]})
    columns = {"force": ("force", str), "drawn": ("ships drawn from", str), "tests": ("tests", fixed_point(0))}
    columns |= {"R2": ("R²", fixed_point(3)), "rms": ("left, % of the force", fixed_point(1))}
    return shown, columns | {
        "half_width": ("half width of the band, %", fixed_point(1)),
        "inside": ("inside, %", fixed_point(0)),
    }


@house_style
def captive_figure(found: xr.Dataset) -> Figure:
    """Measured forces and the bands of ships against drift, yaw and rudder, the others zero, at the usual speed."""
    motion, drawn = _shown(found), _series(found)
    forces = [name for name in FORCES if f"{name}_band" in found]
    columns = max(len(drawn), 1)
    fig, axes = subplots(3.2 * columns + 1.0, 2.1 * len(forces) + 0.5, len(forces), columns)
    colours = dict(zip(found["drawn"].values, (NOISE, BLUE, RUST), strict=False))
    for column, (quantity, places) in enumerate(drawn.items()):
        for row, name in enumerate(forces):
            ax, at = axes[row, column], motion[quantity][places]
            for kind, colour in colours.items():
                lower, median, upper = 1e3 * found[f"{name}_band"].sel(drawn=kind).values[:, places]
                ax.fill_between(at, lower, upper, color=colour, alpha=0.45, lw=0, label=f"{kind}, 95 % band")
                ax.plot(at, median, color=colour, lw=1.0)
            ax.plot(at, 1e3 * found[name].values[places], "o", ms=3.0, color=REFERENCE, label="measured")
            if column == 0:
                ax.set_ylabel(f"{name}' · 10³")
        axes[-1, column].set_xlabel(_SERIES[quantity])
    fig.align_ylabels(axes[:, 0])
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return fig


def _series(found: xr.Dataset) -> dict[str, np.ndarray]:
    """Places of the tests that differ in one quantity alone, in its order, at the usual speed, by that quantity."""
    motion, speed = _shown(found), np.hypot(found["u"].values, found["v"].values)
    usual, series = np.abs(speed / np.median(speed) - 1.0) < _AT_SPEED, {}
    for name, values in motion.items():
        others = [np.isclose(motion[other], 0.0) for other in motion if other != name]
        places = np.flatnonzero(usual & np.all(others, axis=0))
        if places.size >= _FEWEST and np.ptp(values[places]) > 0.0:
            series[name] = places[np.argsort(values[places])]
    return series


def _shown(found: xr.Dataset) -> dict[str, np.ndarray]:
    """Drift angle and rudder [deg] and prime yaw rate of the tests."""
    u, v, r, delta = (found[name].values for name in ("u", "v", "r", "delta"))
    yaw = r * found.attrs["L"] / np.hypot(u, v)
    return {"beta": np.rad2deg(np.arctan2(-v, u)), "r": yaw, "delta": np.rad2deg(delta)}
