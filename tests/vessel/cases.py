"""Part of the container ship that is quick to identify."""

from __future__ import annotations

from dataclasses import replace

TERMS = {"surge": ("Xu", "Xuu", "Xvr", "Xdeltadelta"), "sway": ("Yv", "Yr", "Ydelta"), "yaw": ("Nv", "Nr", "Ndelta")}
"""Ten coefficients, none of roll."""


def small_vessel(vessel, terms=TERMS):
    """The vessel with some of its coefficients and no others."""
    forces = {dof: tuple(c for c in vessel.forces[dof] if c.name in names) for dof, names in terms.items()}
    return replace(vessel, name="small", forces=forces)
