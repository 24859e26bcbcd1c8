"""Whether a file shows its axes, or may as well be the mirror image of its motion.

A motion and its mirror image, with y, psi, v, r, phi, p and delta reversed, agree with themselves equally well.
"""

from __future__ import annotations

from collections.abc import Mapping

import xarray as xr

from pymc_ship.records.files.columns import Column, plain_name
from pymc_ship.records.files.format import TrialFormat
from pymc_ship.trial.record import AXES

MIRROR_IMAGE = (
    'a mirror image (ROS: x east, y north, psi counterclockwise, v to port): for that, state axes = "enu-flu"'
)

_OF_THE_EARTH = ("north", "northing", "east", "easting")  # headings of x and y
_OF_THE_COMPASS = ("hdt", "ths", "hdg", "true heading", "heading true", "gyro", "gyro heading")  # of psi
_OF_THE_BRIDGE = ("rot", "rate of turn")  # of r, positive to starboard


def shows_axes(columns: Mapping[str, Column], layout: TrialFormat) -> bool:
    """Whether the format or the headings show to which side heading and rate of turn are positive."""
    if layout.axes or layout.heading != "clockwise":
        return True
    names = {channel: plain_name(column.heading.split("[")[0]) for channel, column in columns.items()}
    if names.get("psi") in _OF_THE_COMPASS or names.get("r") in _OF_THE_BRIDGE:
        return True
    earth = {names.get("x"), names.get("y")} & {*_OF_THE_EARTH} or {"latitude", "longitude", "cog"} & {*columns}
    return bool(earth) and "psi" in columns


def mirror_remarks(trials: Mapping[str, xr.Dataset]) -> list[str]:
    """Sentence on the runs, by name, whose port and starboard rest on assumed axes."""
    runs = [name for name, trial in trials.items() if trial.attrs.get(AXES)]
    if not runs:
        return []
    which = f"Run {runs[0]} does" if len(runs) == 1 else f"Runs {', '.join(runs)} do"
    sides = 'port and starboard are those of axes = "ned-frd"'
    return [f"{which} not show the axes of the file: {sides}, or the record is {MIRROR_IMAGE}."]
