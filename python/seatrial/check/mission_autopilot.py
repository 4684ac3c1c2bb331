"""What an autopilot does not ask of a vehicle though a mission does: slopes, speeds, rates.

The mode at the speed of a leg decides: with the depth by pitch a slope is held up to ``pitch_max_deg``; with
the depth by heave the desired depth changes at ``depth_rate_max_m_s`` at most. Held by
tests/test_check_mission.py.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from seatrial._core import Autopilot
    from seatrial.check.legs import LegRow
    from seatrial.mission import Mission

__all__ = ["autopilot_warnings"]

_ROUNDING = 1e-6


def autopilot_warnings(mission: Mission, rows: Sequence[LegRow], autopilot: Autopilot) -> list[str]:
    """Sentences about what the autopilot does not do as the mission is written."""
    tables: dict[str, Any] = tomllib.loads(autopilot.to_toml())
    guidance = tables["guidance"]
    hovers = any(mode["depth_by"] == "heave" for mode in tables["modes"])
    sentences = []
    fastest = guidance["speed_max_m_s"]
    if fast := [row for row in rows if row.speed_m_s > fastest]:
        sentences.append(
            f'leg {fast[0].number} "{fast[0].label}" asks for {fast[0].speed_m_s:g} m/s, and speed_max_m_s of'
            f" the autopilot is {fastest:g}; it flies that"
        )
    slowest = tables["schedule"]["speeds_m_s"][0]
    if slow := [row for row in rows if row.speed_m_s < slowest]:
        sentences.append(
            f'leg {slow[0].number} "{slow[0].label}" asks for {slow[0].speed_m_s:g} m/s, below the first'
            f" supporting point of the gains at {slowest:g} m/s; fly faster"
        )
    if not hovers and (held := [row for row in rows if row.hold_s]):
        sentences.append(
            f'leg {held[0].number} "{held[0].label}" asks for station-keeping, and no mode of the autopilot'
            f" keeps the depth by heave: it circles at loiter_radius_m = {guidance['loiter_radius_m']:g} m"
        )
    return [*sentences, *_steep(mission, tables, hovers=hovers)]


def _steep(mission: Mission, tables: dict[str, Any], *, hovers: bool) -> list[str]:
    """Ways that are steeper than the mode at their speed flies them, the worst of each kind."""
    points, guidance = mission.waypoints, tables["guidance"]
    slopes, speeds = np.asarray(points["slope"]), np.asarray(points["speed_m_s"])
    by = np.array([_depth_by(tables["modes"], float(speed)) for speed in speeds])
    sentences = []
    angles = np.rad2deg(np.abs(slopes))
    largest = guidance["pitch_max_deg"]
    steep = np.flatnonzero((by == "pitch") & (angles > largest + _ROUNDING))
    if len(steep):
        k = int(steep[np.argmax(angles[steep])])
        end = "on the spot" if hovers else f"in circles of {guidance['loiter_radius_m']:g} m"
        sentences.append(
            f'the way to "{points["label"][k]}" is {angles[k]:.0f} deg steep, more than pitch_max_deg ='
            f" {largest:g}{_further(steep)}: the rest of its depth is made {end}; begin earlier or"
            " lengthen the leg"
        )
    rates = np.where(angles < 90.0 - _ROUNDING, speeds * np.abs(np.sin(slopes)), 0.0)
    limit = guidance["depth_rate_max_m_s"]
    quick = np.flatnonzero((by == "heave") & (rates > limit + _ROUNDING))
    if len(quick):
        k = int(quick[np.argmax(rates[quick])])
        sentences.append(
            f'the way to "{points["label"][k]}" changes the depth at {rates[k]:.2f} m/s, faster than'
            f" depth_rate_max_m_s = {limit:g}{_further(quick)}; it lags, fly slower or lengthen the leg"
        )
    return sentences


def _depth_by(modes: Sequence[dict[str, Any]], speed: float) -> str:
    at_work = [mode for mode in modes if mode.get("from_speed_m_s", 0.0) <= speed]
    return str((at_work or modes)[-1]["depth_by"])


def _further(found: Any) -> str:
    more = len(found) - 1
    return f" (and {more} further {'way' if more == 1 else 'ways'})" if more else ""
