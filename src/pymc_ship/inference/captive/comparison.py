"""Measured forces of captive tests against those of prior and posterior draws: bands, table and figure."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymc_ship.inference.captive.fit import captive_motion, nominal_revolution_tests
from pymc_ship.inference.captive.table import FORCE_DOFS, FORCES
from pymc_ship.pages.drawing import BLUE, NOISE, REFERENCE, RUST, house_style, subplots
from pymc_ship.pages.tables import fixed_point
from pymc_ship.physics.motion.captive import captive_test_forces
from pymc_ship.physics.vessel.vessel import DOFS, Vessel

BANDS = ("lower", "median", "upper")
_TAILS = (0.025, 0.5, 0.975)
_SERIES = {"beta": "drift angle β [deg]", "r": "yaw rate r'", "delta": "rudder δ [deg]"}
_FEWEST = 3  # tests of a series in the figure
_AT_SPEED = 0.1  # relative deviation of their speed from the median


def captive_bands(
    tests: xr.Dataset, vessel: Vessel, draws: Mapping[str, np.ndarray], *, revolutions: float = 1.0
) -> xr.Dataset:
    """Measured forces of captive tests, and 95 % bands of the forces under one or more sets of draws.

    ``draws``, shape (n_draws, n_coefficients), by the name of their distribution, are the dimension ``drawn`` of
    ``X_band``, ``Y_band`` and ``N_band``. ``revolutions`` are the nominal ones on the carriage over those of the
    vessel; tests at others are left out.
    """
    tests = nominal_revolution_tests(tests, vessel)
    s, motion = vessel.particulars, captive_motion(tests, vessel, revolutions)
    table = tests.assign_coords(drawn=list(draws), band=list(BANDS)).assign_attrs(U_nom=s.nominal_speed, L=s.L)
    forces = [captive_test_forces(vessel, motion, rows) for rows in draws.values()]
    for name in (name for name in FORCES if name in tests):
        row = DOFS.index(FORCE_DOFS[name])
        bands = [np.quantile(one[:, row], _TAILS, axis=0) for one in forces]
        table[f"{name}_band"] = ("drawn", "band", "test"), np.array(bands)
    return table


def comparison_rows(bands: xr.Dataset) -> list[dict]:
    """R2, rms residual (prime at the nominal speed) and fraction of tests inside the bands, by force and draws."""
    weight = (bands["u"].values ** 2 + bands["v"].values ** 2) / bands.attrs["U_nom"] ** 2
    rows = []
    for name in (name for name in FORCES if f"{name}_band" in bands):
        measured = bands[name].values
        for drawn in bands["drawn"].values:
            lower, median, upper = bands[f"{name}_band"].sel(drawn=drawn).values
            residual, deviation = (measured - median) * weight, (measured - measured.mean()) * weight
            rows.append(
                {
                    "force": f"{name}'",
                    "drawn": str(drawn),
                    "tests": measured.size,
                    "R2": float(1.0 - np.sum(residual**2) / np.sum(deviation**2)),
                    "rms": float(np.sqrt(np.mean(residual**2))),
                    "rms_force": float(np.sqrt(np.mean((measured * weight) ** 2))),
                    "half_width": float(np.mean(0.5 * (upper - lower) * weight)),
                    "inside": float(np.mean((measured >= lower) & (measured <= upper))),
                }
            )
    return rows


def comparison_page_table(rows: Sequence[Mapping]) -> tuple[list[dict], dict]:
    """Rows of :func:`comparison_rows` in % of the force, and the columns of a page's table."""
    percentages = []
    for row in rows:
        relative = {key: 100.0 * row[key] / row["rms_force"] for key in ("rms", "half_width")}
        percentages.append(dict(row) | relative | {"inside": 100.0 * row["inside"]})
    columns = {"force": ("force", str), "drawn": ("draws", str), "tests": ("tests", fixed_point(0))}
    columns |= {"R2": ("R²", fixed_point(3)), "rms": ("residual, % of the force", fixed_point(1))}
    columns |= {"half_width": ("half width of the band, %", fixed_point(1)), "inside": ("inside, %", fixed_point(0))}
    return percentages, columns


@house_style
def captive_figure(bands: xr.Dataset) -> Figure:
    """Measured forces and bands against drift, yaw rate and rudder, the others zero, near the median speed."""
    u, v, r, delta = (bands[name].values for name in ("u", "v", "r", "delta"))
    motion = {"beta": np.rad2deg(np.arctan2(-v, u)), "r": r * bands.attrs["L"] / np.hypot(u, v)}
    motion["delta"] = np.rad2deg(delta)
    series = _series(bands, motion)
    forces = [name for name in FORCES if f"{name}_band" in bands]
    columns = max(len(series), 1)
    fig, axes = subplots(3.2 * columns + 1.0, 2.1 * len(forces) + 0.5, len(forces), columns)
    colours = dict(zip(bands["drawn"].values, (NOISE, BLUE, RUST), strict=False))
    for column, (quantity, tests) in enumerate(series.items()):
        for row, name in enumerate(forces):
            ax, at = axes[row, column], motion[quantity][tests]
            for kind, colour in colours.items():
                lower, median, upper = 1e3 * bands[f"{name}_band"].sel(drawn=kind).values[:, tests]
                ax.fill_between(at, lower, upper, color=colour, alpha=0.45, lw=0, label=f"{kind}, 95 % band")
                ax.plot(at, median, color=colour, lw=1.0)
            ax.plot(at, 1e3 * bands[name].values[tests], "o", ms=3.0, color=REFERENCE, label="measured")
            if column == 0:
                ax.set_ylabel(f"{name}' · 10³")
        axes[-1, column].set_xlabel(_SERIES[quantity])
    fig.align_ylabels(axes[:, 0])
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return fig


def _series(bands: xr.Dataset, motion: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Indices, in order of the quantity, of the tests in which one quantity alone varies, by quantity."""
    speed = np.hypot(bands["u"].values, bands["v"].values)
    usual, series = np.abs(speed / np.median(speed) - 1.0) < _AT_SPEED, {}
    for name, values in motion.items():
        others = [np.isclose(motion[other], 0.0) for other in motion if other != name]
        tests = np.flatnonzero(usual & np.all(others, axis=0))
        if tests.size >= _FEWEST and np.ptp(values[tests]) > 0.0:
            series[name] = tests[np.argsort(values[tests])]
    return series
