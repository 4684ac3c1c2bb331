"""Added mass of a prolate spheroid (14)-(19), NumPy only.

Source: H. Lamb, Hydrodynamics, chapter V; F. H. Imlay, DTMB report 1528 (1961).
Held by tests/core/test_textbook.py::test_golden_mss_imlay61 and test_golden_lamb_factors_of_cwolf_spheroid.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]


def lamb_factors(a: float, b: float) -> tuple[float, float, float]:
    """Return Lamb's k1 (along the axis), k2 (across) and k' (rotation) of semi-axes a > b in m."""
    e = np.sqrt(1.0 - (b / a) ** 2)
    logarithm = np.log((1.0 + e) / (1.0 - e))
    alpha = 2.0 * (1.0 - e**2) / e**3 * (0.5 * logarithm - e)
    beta = 1.0 / e**2 - (1.0 - e**2) / (2.0 * e**3) * logarithm
    k_rotation = e**4 * (beta - alpha) / ((2.0 - e**2) * (2.0 * e**2 - (2.0 - e**2) * (beta - alpha)))
    return float(alpha / (2.0 - alpha)), float(beta / (2.0 - beta)), float(k_rotation)


def spheroid_added_mass(a: float, b: float, *, rho: float, r44: float = 0.0) -> Array:
    """Return the diagonal of M_A (6,) in kg and kg m2 of a spheroid along x, semi-axes in m, rho in kg/m3.

    ``r44`` is the added roll inertia over the displaced one: a smooth spheroid has none.
    """
    k1, k2, k_rotation = lamb_factors(a, b)
    displaced = 4.0 / 3.0 * np.pi * rho * a * b**2
    inertia = displaced * (a**2 + b**2) / 5.0
    return np.array([
        k1 * displaced,
        k2 * displaced,
        k2 * displaced,
        r44 * 0.4 * displaced * b**2,
        k_rotation * inertia,
        k_rotation * inertia,
    ])
