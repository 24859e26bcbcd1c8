"""Derivatives of sampled signals."""

import math

import numpy as np
import scipy
from numpy.typing import ArrayLike

from pymc_ship.machine.arguments import check_choice, real_array
from pymc_ship.machine.errors import ShipError

DERIVATIVES = ("euler", "central", "savgol")


def derivative(
    values: ArrayLike, step: float, method: str = "savgol", *, window: float = 5.0, order: int = 3
) -> np.ndarray:
    """Derivative of a uniformly sampled signal along its last axis, per second, in its shape.

    ``step`` and ``window`` are in s. "euler": forward difference, the last one repeated. "central": second-order
    differences, one-sided at the ends. "savgol": local least-squares polynomial over an odd number of samples
    (Savitzky & Golay, Anal. Chem. 36:1627, 1964). ValueError for an unknown method, a number out of range, a
    signal not finite or too short.
    """
    signal = real_array("The signal of a derivative", values)
    check_choice("The method", method, DERIVATIVES)
    if not (0.0 < step < math.inf and 0.0 < window < math.inf and order >= 1):
        raise ShipError(
            f"Step and window must be positive and the order at least 1, found {step:g} s, {window:g} s and {order}; "
            "correct them."
        )
    length = 2 * max(round(0.5 * window / step), (order + 2) // 2) + 1
    needed = {"euler": 2, "central": 3, "savgol": length}[method]
    n_time = signal.shape[-1] if signal.ndim else 1
    if n_time < needed:
        raise ShipError(f"The method {method} needs {needed} samples, found {n_time}; give more or another window.")
    if not np.isfinite(signal).all():
        raise ShipError("A derivative needs finite values, found NaN or infinity; fill or cut the gaps first.")
    if method == "euler":
        return np.diff(signal, axis=-1, append=2.0 * signal[..., -1:] - signal[..., -2:-1]) / step
    if method == "central":
        return np.gradient(signal, step, axis=-1, edge_order=2)
    return scipy.signal.savgol_filter(signal, length, order, deriv=1, delta=step, axis=-1)
