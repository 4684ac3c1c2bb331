"""What the water holds: its background, plumes of effluent in it, its density and conductivity.

Effluent mixes in proportion: at a share f of it, nitrate, salinity and temperature are
``ambient + f (effluent - ambient)``. A steady plume of a source Q in a current U drifts along x and spreads
across it,

f = Q / (2 pi U s_y s_z) exp(-y^2 / 2 s_y^2) (exp(-(z - z_0)^2 / 2 s_z^2) + exp(-(z + z_0)^2 / 2 s_z^2))

with s_y^2 = width^2 + 2 K_h x / U, s_z^2 = height^2 + 2 K_v x / U and the surface as a mirror. Diffusion
along the current and the bottom are left out; upstream of the source the plume falls off over its width.

Sources: Fischer and others, Mixing in Inland and Coastal Waters (1979), chapter 2; density: Millero and
Poisson, Deep-Sea Research 28A (1981), at one atmosphere; conductivity: the Practical Salinity Scale 1978
(Fofonoff and Millard, UNESCO Technical Papers in Marine Science 44, 1983). Held by
``tests/flight/test_payload.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.toml_file import NotNegative, Number, Positive, Section

CHANNELS = {
    "nitrate_mg_l": "mg/L",
    "density_kg_m3": "kg/m3",
    "conductivity_s_m": "S/m",
    "salinity_pss": "PSS-78",
}
"""What the payload measures, and the unit of each."""

SLOWEST_M_S = 0.01
"""Slowest current in which a plume is steady within hours."""


class Profile(Section):
    """Nitrate in mg/L, practical salinity and temperature in deg C at the surface, and their change per m of
    depth.
    """

    nitrate_mg_l: NotNegative
    salinity: NotNegative
    temperature_c: Number
    nitrate_per_m: Number = 0.0
    salinity_per_m: Number = 0.0
    temperature_per_m: Number = 0.0

    def at(self, depth: Array) -> Array:
        """Nitrate, salinity and temperature, (n, 3), at depths (n,) in m."""
        surface = np.array([self.nitrate_mg_l, self.salinity, self.temperature_c])
        slope = np.array([self.nitrate_per_m, self.salinity_per_m, self.temperature_per_m])
        return np.asarray(surface + np.maximum(depth, 0.0)[:, None] * slope)


class Plume(Section):
    """A source of effluent.

    `north_m`, `east_m`, `depth_m`: where it is. `discharge_m3_s`: effluent let out, m3/s. `nitrate_mg_l`,
    `salinity`, `temperature_c`: of the effluent. `width_m`, `height_m`: standard deviation of the plume at
    the source, across the current and in depth, m. `horizontal_m2_s`, `vertical_m2_s`: turbulent
    diffusivities, m2/s.
    """

    north_m: Number
    east_m: Number
    depth_m: NotNegative
    discharge_m3_s: Positive
    nitrate_mg_l: NotNegative
    salinity: NotNegative
    temperature_c: Number
    width_m: Positive = 2.0
    height_m: Positive = 1.0
    horizontal_m2_s: NotNegative = 0.05
    vertical_m2_s: NotNegative = 1e-3

    def share(self, places: Array, current: ArrayLike) -> Array:
        """Share of effluent in the water, (n,), 0 to 1, at places (n, 3), m, NED.

        The current north and east is at least `SLOWEST_M_S` together.
        """
        flow = np.asarray(current, float)[:2]
        speed = float(np.hypot(*flow))
        along = flow / speed
        away = places[:, :2] - [self.north_m, self.east_m]
        x, y = away @ along, away @ [-along[1], along[0]]
        z = places[:, 2]
        drifted = np.maximum(x, 0.0) / speed
        s_y = np.sqrt(self.width_m**2 + 2.0 * self.horizontal_m2_s * drifted)
        s_z = np.sqrt(self.height_m**2 + 2.0 * self.vertical_m2_s * drifted)
        across = np.exp(-0.5 * (y / s_y) ** 2 - 0.5 * (np.minimum(x, 0.0) / self.width_m) ** 2)
        mirrored = (-0.5 * ((z + sign * self.depth_m) / s_z) ** 2 for sign in (-1.0, 1.0))
        down = np.sum([np.exp(exponent) for exponent in mirrored], axis=0)
        return np.asarray(
            np.minimum(self.discharge_m3_s * across * down / (2.0 * np.pi * speed * s_y * s_z), 1.0)
        )


def properties(profile: Profile, plumes: Sequence[Plume], places: Array, current: ArrayLike) -> Array:
    """`CHANNELS` of the water at places (n, 3), north, east, down in m, as columns (n, 4)."""
    mixed = profile.at(places[:, 2])
    for plume in plumes:
        effluent = np.array([plume.nitrate_mg_l, plume.salinity, plume.temperature_c])
        mixed = mixed + plume.share(places, current)[:, None] * (effluent - mixed)
    nitrate, salinity, temperature = mixed.T
    return np.column_stack([
        nitrate,
        density(salinity, temperature),
        conductivity(salinity, temperature, np.maximum(places[:, 2], 0.0)),
        salinity,
    ])


def density(salinity: Array, temperature: Array) -> Array:
    """Density of sea water in kg/m3 at one atmosphere, of practical salinity and deg C, (n,).

    Examples
    --------
    >>> density(np.array([0.0, 35.0, 35.0]), np.array([5.0, 5.0, 25.0])).round(5).tolist()
    [999.96675, 1027.67547, 1023.34306]
    """
    s, t = np.asarray(salinity, float), np.asarray(temperature, float)
    fresh = polyval(t, [999.842594, 6.793952e-2, -9.09529e-3, 1.001685e-4, -1.120083e-6, 6.536332e-9])
    a = polyval(t, [8.24493e-1, -4.0899e-3, 7.6438e-5, -8.2467e-7, 5.3875e-9])
    b = polyval(t, [-5.72466e-3, 1.0227e-4, -1.6546e-6])
    return np.asarray(fresh + a * s + b * s**1.5 + 4.8314e-4 * s**2)


def conductivity(salinity: Array, temperature: Array, depth: Array) -> Array:
    """Conductivity of sea water in S/m, of practical salinity, deg C and depth in m, (n,).

    The scale gives salinity from conductivity; this is its inverse, by Newton's method in the square root of
    the ratio.

    Examples
    --------
    >>> zero = np.zeros(1)
    >>> conductivity(zero + 35.0, zero + 15.0, zero).round(4).tolist()
    [4.2914]
    """
    s, t = np.asarray(salinity, float), np.asarray(temperature, float)
    warm = (t - 15.0) / (1.0 + 0.0162 * (t - 15.0))
    a = np.array([0.0080, -0.1692, 25.3851, 14.0941, -7.0261, 2.7081])
    b = np.array([0.0005, -0.0056, -0.0066, -0.0375, 0.0636, -0.0144])
    root = np.sqrt(np.maximum(s, 1e-6) / 35.0)
    orders = np.arange(1, 6)
    for _ in range(10):
        value = polyval(root, a) + warm * polyval(root, b)
        slope = polyval(root, orders * a[1:]) + warm * polyval(root, orders * b[1:])
        root = np.maximum(root - (value - s) / slope, 1e-4)
    by_temperature = polyval(t, [0.6766097, 2.00564e-2, 1.104259e-4, -6.9698e-7, 1.0031e-9])
    ratio = root**2 * by_temperature
    # The pressure in dbar is close to the depth in m; its term needs the ratio that it changes.
    pressure = polyval(np.asarray(depth, float), [0.0, 2.070e-5, -6.370e-10, 3.989e-15])
    whole = ratio
    for _ in range(5):
        below = 1.0 + 3.426e-2 * t + 4.464e-4 * t**2 + (4.215e-1 - 3.107e-3 * t) * whole
        whole = ratio * (1.0 + pressure / below)
    return np.asarray(4.2914 * whole)  # S/m at practical salinity 35, 15 deg C and the surface
