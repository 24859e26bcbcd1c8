"""Mass, moments of inertia, added mass and stability from the particulars, where a vessel file leaves them out.

Radii of gyration: ITTC Recommended Procedure 7.5-02-07-02.1. Added masses: Motora's charts (1959) in the regression of
Zhou, Sheng & Feng (1983); in roll, Bhattacharyya (1978), Dynamics of Marine Vehicles, chapter 4. Waterplane:
Schneekluth & Bertram (1998), Ship Design for Efficiency and Economy, section 1.6.
"""

from dataclasses import replace

from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.vessel.vessel import Particulars, Vessel

K_ZZ = 0.25  # radius of gyration of the yaw moment of inertia about the centre of gravity, over L
DIAGONAL = ("Xudot", "Yvdot", "Nrdot")
"""Added masses that are estimated if a file leaves them out; missing couplings are 0."""

K_XX = 0.375  # radius of gyration of the roll moment of inertia about the centre of gravity, over B
TYPICAL_GM = 0.06  # GM/B of a usual merchant ship; most have 0.02 to 0.1
_ADDED_ROLL = 0.2  # added moment of inertia in roll over I_xx
_LEAST = 0.01  # a prolate spheroid of L/B = 14 has this added mass in surge (Lamb 1932)


def displaced_mass(s: Particulars) -> float:
    """Prime mass of the displaced water, 2 volume/L^3."""
    return 2.0 * s.volume / s.L**3


def yaw_inertia(s: Particulars, m: float) -> float:
    """Prime moment of inertia in yaw about the origin, for the prime mass ``m``."""
    return (K_ZZ**2 + (s.x_G / s.L) ** 2) * m


def motora_added_mass(s: Particulars, m: float) -> dict[str, float]:
    """Prime Xudot, Yvdot and Nrdot about midship from C_B, B/d and L/B, for the prime mass ``m``.

    VesselError for a hull outside the charts, or without a draught.
    """
    if s.d <= 0.0:
        raise VesselError("Motora's charts of added mass need the draught d, found none; add d [m] to [particulars].")
    block, slender, flat = s.volume / (s.L * s.B * s.d), s.L / s.B, s.d / s.B
    surge = 0.01 * (
        0.398
        + 11.97 * block * (1.0 + 3.73 * flat)
        - 2.89 * block * slender * (1.0 + 1.13 * flat)
        + 0.175 * block * slender**2 * (1.0 + 0.541 * flat)
        - 1.107 * slender * flat
    )
    sway = (
        0.882
        - 0.54 * block * (1.0 - 1.6 * flat)
        - 0.156 * slender * (1.0 - 0.673 * block)
        + 0.826 * flat * slender * (1.0 - 0.678 * flat)
        - 0.638 * block * flat * slender * (1.0 - 0.669 * flat)
    )
    radius = 0.01 * (33.0 - 76.85 * block * (1.0 - 0.784 * block) + 3.43 * slender * (1.0 - 0.63 * block))
    if min(surge, sway, radius) < _LEAST:
        raise VesselError(
            f"Motora's charts have no hull with L/B = {slender:.3g}, B/d = {1.0 / flat:.3g} and a block coefficient of "
            f"{block:.3g}; state Xudot, Yvdot and Nrdot in [added_mass]."
        )
    return {"Xudot": -surge * m, "Yvdot": -sway * m, "Nrdot": -(radius**2) * m}


def with_stability(vessel: Vessel) -> Vessel:
    """Vessel with GM, BM, I_xx and Kpdot; those that the file leaves out are estimated and recorded in ``derived``."""
    s, derived = vessel.particulars, dict(vessel.derived)
    if not s.GM:
        s = replace(s, GM=TYPICAL_GM * s.B)
        derived["particulars.GM"] = f"{s.GM:.3g} m ({TYPICAL_GM} B)"
    if not s.BM:
        waterplane = (1.0 + 2.0 * s.volume / (s.L * s.B * s.d)) / 3.0
        s = replace(s, BM=waterplane**2 * s.L * s.B**3 / (11.7 * s.volume))
        derived["particulars.BM"] = f"{s.BM:.3g} m (inertia of the waterplane over volume)"
    I_xx = vessel.I_xx
    if not I_xx:
        I_xx = ((K_XX * s.B / s.L) ** 2 + (s.z_G / s.L) ** 2) * vessel.m
        derived["inertia.I_xx"] = f"{I_xx:.3g} (a radius of gyration of {K_XX} B)"
    added_mass = vessel.added_mass
    if not added_mass["Kpdot"]:
        added_mass = added_mass | {"Kpdot": -_ADDED_ROLL * I_xx}
        derived["added_mass.Kpdot"] = f"{added_mass['Kpdot']:.3g} ({_ADDED_ROLL:.0%} of I_xx)"
    return replace(vessel, particulars=s, I_xx=I_xx, added_mass=added_mass, derived=derived)
