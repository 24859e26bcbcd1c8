"""Part of the container ship that is quick to identify, and the file of a vessel."""

from __future__ import annotations

from dataclasses import replace

TERMS = {"surge": ("Xu", "Xuu", "Xvr", "Xdeltadelta"), "sway": ("Yv", "Yr", "Ydelta"), "yaw": ("Nv", "Nr", "Ndelta")}
"""Ten coefficients, none of roll."""


def small_vessel(vessel, terms=TERMS):
    """The vessel with some of its coefficients and no others."""
    forces = {dof: tuple(c for c in vessel.forces[dof] if c.name in names) for dof, names in terms.items()}
    return replace(vessel, name="small", forces=forces)


def toml(vessel):
    """Vessel file of a vessel without roll."""
    s = vessel.particulars
    lines = [
        "[particulars]",
        *(f"{name} = {getattr(s, name)}" for name in ("L", "B", "volume", "nominal_speed", "x_G")),
    ]
    lines += [f"rudder_rate_deg = {s.rudder_rate_deg}", "[inertia]", f"m = {vessel.m}", f"I_zz = {vessel.I_zz}"]
    lines += ["[added_mass]", *(f"{name} = {value}" for name, value in vessel.added_mass.items())]
    for dof, force in vessel.forces.items():
        lines += [f"[coefficients.{dof}]", *(f"{c.name} = {c.value}" for c in force)]
    return "\n".join([f'name = "{vessel.name}"', *lines]) + "\n"
