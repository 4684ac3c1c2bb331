"""Open loops of an autopilot as a page draws them: Bode, Nyquist, and the margins, which follow the gains.

Each loop is opened alone, the others closed. Its response is linear in its own gains: what the feed-forward
leaves and one part per K_P, K_I and K_D, which a page adds up with the factors of its sliders, exactly.
Gains of other loops stay as in the file. A part is carried as logarithm of its size and angle in 16 bits.
Held by ``tests/report/test_page_loops.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.errors import SeatrialError
from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.report.page.evidence import packed

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle

_KEYS = ("K_P", "K_I", "K_D")

_NOTHING = 1e-9
"""Of the largest size of a loop: a part that never exceeds it is left out."""

_LEAST = 1e-12
"""Size at which a response counts as zero, where its logarithm would be none."""


def open_loops(vehicle: Vehicle, autopilot: Autopilot) -> dict[str, Any]:
    """Open loops of an autopilot at its breakpoints, or why there are none.

    ``points`` has per mode and desired speed (m/s) and per loop the parts of L by gain, ``rest`` for what
    no gain scales; ``omega`` is the first and the last of the frequencies in rad/s, even by their logarithm,
    and their count. ``said`` tells why nothing is drawn; else it is empty.

    Examples
    --------
    >>> import seatrial as st
    >>> found = open_loops(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"))
    >>> sorted(found["points"][0]["loops"][1]["parts"])  # heave
    ['K_D', 'K_I', 'K_P']
    """
    try:
        constraint = MarginConstraint(vehicle, autopilot)
        own = {name: float(value) for name, value in autopilot.gains().items()}
        names = {loop: [name for name in own if name.startswith(f"{loop}.K_")] for loop in _loops(own)}
        whole, margins = constraint.open_loops({}), constraint.margins({})
        without = {
            (loop, key): constraint.open_loops({
                name: 0.0 for name in given if name.startswith(f"{loop}.{key}.")
            })
            for loop, given in names.items()
            for key in _KEYS
        }
    except (SeatrialError, np.linalg.LinAlgError) as error:
        return {"points": [], "omega": [1.0, 1.0, 0], "said": f"The margins cannot be drawn: {error}"}
    points = []
    for k, ((_, responses), point) in enumerate(zip(whole, margins, strict=True)):
        loops = []
        for i, loop in enumerate(point.loops):
            response = responses[0, i]
            parts = {key: response - without[loop, key][k][1][0, i] for key in _KEYS}
            parts["rest"] = response - sum(parts.values())
            least = _NOTHING * np.abs(response).max()
            loops.append({
                "loop": loop,
                "parts": {key: _polar(part) for key, part in parts.items() if np.abs(part).max() > least},
            })
        stable = float(point.growth_per_s[0]) == 0.0
        points.append({"mode": point.mode, "speed": point.speed_m_s, "stable": stable, "loops": loops})
    omega = whole[0][0]
    return {"points": points, "omega": [float(omega[0]), float(omega[-1]), len(omega)], "said": ""}


def _loops(gains: dict[str, float]) -> list[str]:
    return list(dict.fromkeys(name.split(".")[0] for name in gains if ".K_" in name))


def _polar(response: NDArray[np.complex128]) -> list[dict[str, Any]]:
    """Natural logarithm of the size and angle in rad without jumps of a response."""
    size = np.log(np.maximum(np.abs(response), _LEAST))
    return [packed(size), packed(np.unwrap(np.angle(response)))]
