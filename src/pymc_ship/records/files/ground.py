"""Velocity over ground and position of a satellite receiver as earth-fixed velocity and local plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pymc_ship.machine.errors import TrialError
from pymc_ship.records.files.format import TrialFormat
from pymc_ship.trial.record import OVER_GROUND

Channels = dict[str, np.ndarray]

_EARTH = 6.371e6  # m
_FARTHEST = 1e5  # m, where the plane is off by 4 m


def with_ground(channels: Channels, layout: TrialFormat, where: str) -> tuple[Channels, TrialFormat, list[str]]:
    """Channels with u, v and x, y of the ground where the file has no others, format and sentences.

    The velocities are earth-fixed, which the format then states. TrialError for positions that are none.
    """
    channels, notes = dict(channels), []
    sog, cog, latitude, longitude = (channels.pop(name, None) for name in ("sog", "cog", "latitude", "longitude"))
    if sog is not None and cog is not None and "psi" in channels and not {"u", "v"} & set(channels):
        channels |= {"u": sog * np.cos(cog), "v": sog * np.sin(cog)}
        layout = replace(layout, velocities="earth", speeds=OVER_GROUND)
        notes.append("u, v from speed and course over ground: each trial has an unknown current.")
    if latitude is not None and longitude is not None and not {"x", "y"} & set(channels):
        north, east, note = _local_plane(latitude, longitude, where)
        channels |= {"x": north, "y": east}
        notes.append(note)
    return channels, layout, notes


def _local_plane(latitude: np.ndarray, longitude: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Metres north and east of the first fix in the plane that touches the ellipsoid WGS 84 there, and a sentence."""
    try:
        from pymap3d import geodetic2enu
    except ImportError:
        raise TrialError(
            f"{where}: latitude and longitude need the package pymap3d, found none; "
            "pip install 'pymc-ship[formats]', or give x and y."
        ) from None
    fixes = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))
    if not fixes.size or np.abs(latitude[fixes]).max() > 0.5 * np.pi or np.abs(longitude[fixes]).max() > 2.0 * np.pi:
        raise TrialError(f"{where}: a latitude is within 90 deg and a longitude within 360 deg; correct the unit.")
    first = (latitude[fixes[0]], longitude[fixes[0]], 0.0)
    east, north, _ = geodetic2enu(latitude, longitude, 0.0, *first, deg=False)
    far = float(np.nanmax(np.hypot(east, north)))
    if far > _FARTHEST:
        raise TrialError(
            f"{where}: a trial lies within {_FARTHEST / 1e3:g} km, found positions {far / 1e3:.4g} km apart; "
            "leave out wrong fixes, or give x and y."
        )
    error = far**3 / (6.0 * _EARTH**2)
    origin = f"{np.rad2deg(first[0]):.6f}, {np.rad2deg(first[1]):.6f} deg"
    return north, east, f"x, y from latitude and longitude, origin {origin}; flat to {max(error, 1e-3):.1g} m."
