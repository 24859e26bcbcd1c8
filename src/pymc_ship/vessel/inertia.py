"""Mass, moment of inertia and added masses that a vessel file leaves out, from the ship's particulars.

A floating ship has the mass of the water she displaces. Her radius of gyration is near a quarter of her length (ITTC
Recommended Procedure 7.5-02-07-02.1). Her added masses are those of Motora's charts (1959) in the regression of Zhou,
Sheng & Feng (1983), which comes within 6 % of those of the KVLCC2 (Yasukawa & Yoshimura 2015,
doi:10.1007/s00773-014-0293-y). The formulae of Clarke, Gedling & Hine (1983) have none for surge, and beamy hulls such
as tugs get a negative added moment of inertia from them.
"""

from __future__ import annotations

from pymc_ship.vessel.vessel import Particulars, VesselError

K_ZZ = 0.25
"""Radius of gyration of the yaw moment of inertia about the centre of gravity, over L."""

DIAGONAL = ("Xudot", "Yvdot", "Nrdot")
"""Added masses that are derived where a file leaves them out; couplings that it leaves out are 0."""

_LEAST = 0.01  # a prolate spheroid of L/B = 14 has this added mass in surge (Lamb 1932)


def displaced_mass(s: Particulars) -> float:
    """Prime mass of the displaced water, 2 volume/L^3."""
    return 2.0 * s.volume / s.L**3


def yaw_inertia(s: Particulars, m: float) -> float:
    """Prime moment of inertia in yaw about the origin of a ship of the prime mass ``m``."""
    return (K_ZZ**2 + (s.x_G / s.L) ** 2) * m


def motora_added_mass(s: Particulars, m: float) -> dict[str, float]:
    """Added masses from block coefficient, B/d and L/B.

    Parameters
    ----------
    s : Particulars
        With the draught d.
    m : float
        Prime mass.

    Returns
    -------
    dict of str to float
        Prime values of Xudot, Yvdot and Nrdot, about midship.

    Raises
    ------
    VesselError
        For a hull out of the charts' reach, or without a draught.
    """
    if s.d <= 0.0:
        raise VesselError("The added masses of Motora's charts need the draught; add d to [particulars].")
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
