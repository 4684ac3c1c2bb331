"""What a log cannot tell because a channel is not in it, and what that costs."""

from __future__ import annotations

from collections.abc import Mapping

from seatrial.trial.kinematic_series import Series


def missing(series: Mapping[str, Series]) -> tuple[str, ...]:
    """Sentences on channels that are not recorded.

    Examples
    --------
    >>> missing({})[0].partition(":")[0]
    'no attitude'
    """
    said = []
    attitude = [name for name in ("roll", "pitch", "yaw") if name in series]
    if not attitude:
        said.append(
            "no attitude: no channel can be compared with another one, and no restoring moment is seen"
        )
    elif "roll" not in series:
        said.append(
            "no roll: it is taken as zero, so that sway leaks into the depth rate, roll coefficients (K_*)"
            " cannot be identified, and a list of the vehicle looks like a tilt of its sensors"
        )
    if attitude and "pitch" not in series:
        said.append("no pitch: the depth rate cannot be compared with the velocity")
    if attitude and "yaw" not in series:
        said.append("no yaw: neither course nor current can be told")
    rates = [name for name in ("p", "q", "r") if name not in series]
    if rates:
        said.append(
            f"no {' '.join(rates)}: rates are derived from the attitude, which limits them to the attitude's"
            " rate and noise; signs and delay of a gyro cannot be checked"
        )
    if not {"x", "y"} <= set(series):
        said.append(
            "no position: the heading of the compass and the horizontal scale of the velocity are unchecked"
        )
    if "z" not in series:
        said.append("no depth: the pitch tilt of the velocity sensor and its delay are unchecked")
    ground = [name for name in ("u", "v", "w") if name in series]
    if not ground:
        said.append("no velocity over ground: it is derived from the position, if there is one")
    if not {"u_water", "v_water"} <= set(series):
        said.append(
            "no velocity through the water: a current is told only from legs in several headings, and drag is"
            " fitted to speeds that are uncertain by it"
        )
    return tuple(said)
