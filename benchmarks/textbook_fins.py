"""Lift and drag of a movable fin in the textbook model, in terms of the angle of attack.

The fin's own axes at zero deflection: chord e_c to the leading edge, normal e_n. Written with angles and
rotated vectors, unlike the core's form: an independent answer for its tests.

Source: T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, section 9.8.
Held by tests/core/test_textbook_fins.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.textbook_thrusters import Thruster

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Fin:
    """A fin: servo (its command in rad), place (m), unit chord and normal, area (m2), coefficients."""

    servo: Thruster
    place: Array
    chord: Array
    normal: Array
    area: float
    C_La: float
    C_Lmax: float
    C_D0: float
    C_D90: float
    k_i: float
    gain: float = 1.0
    offset: float = 0.0
    """Deflection where the servo stands at zero, rad."""


def fin_wrench(fin: Fin, signal: float, nu_r: Array, rho: float) -> Array:
    """Return the wrench (6,) about O of a fin at its servo's signal (rad) in water of ``rho`` kg/m3."""
    velocity = nu_r[:3] + np.cross(nu_r[3:], fin.place)
    v_c, v_n = float(fin.chord @ velocity), float(fin.normal @ velocity)
    speed = np.hypot(v_c, v_n)
    if speed == 0.0:
        return np.zeros(6)
    # The leading edge at deflection d points d away from the chord; the flow comes from atan2(v_n, v_c).
    alpha = signal + fin.offset - np.arctan2(v_n, v_c)
    C_L = float(np.clip(0.5 * fin.C_La * np.sin(2.0 * alpha), -fin.C_Lmax, fin.C_Lmax))
    C_D = fin.C_D0 + fin.C_D90 * np.sin(alpha) ** 2 + fin.k_i * C_L**2
    ahead = (v_c * fin.chord + v_n * fin.normal) / speed
    # A quarter turn from where it goes, towards the normal when it goes along the chord.
    upwards = (v_c * fin.normal - v_n * fin.chord) / speed
    force = 0.5 * rho * fin.area * fin.gain * speed**2 * (C_L * upwards - C_D * ahead)
    return np.concatenate([force, np.cross(fin.place, force)])
