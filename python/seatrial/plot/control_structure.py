"""Block diagrams of the autopilot: the control loop, and one of its adaptive PID controllers from inside.

Above: from waypoints to commands and back over the sensors (Taubert et al. 2014, figure 13, with the parts
that the core has: mode table, reference filters, safety, inverse characteristic). Below: a loop with its
features: gains scheduled over the desired speed, derivative on the measurement, anti-windup and reset bias
by what the allocation reached (figure 14, equation 54 corrected). Held by `tests/test_control_diagrams.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.plot.diagram import bar, block, connect, dot, page, summing, words
from seatrial.plot.style import SIMULATED, WIDTH_IN, house_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.plot.diagram import Block

__all__ = ["control_structure"]

_HEIGHT_IN, _LOOP_IN = 5.3, 2.76
_MINUS = "\N{MINUS SIGN}"


def control_structure() -> Figure:
    """Figure of the autopilot's structure: (a) the control loop, (b) a loop's adaptive PID controller."""
    with house_style():
        figure, axes = page(WIDTH_IN, _HEIGHT_IN)
        words(axes, (0.02, _HEIGHT_IN - 0.1), "(a) control loop", size_pt=8.5, ha="left", weight="bold")
        _control_loop(axes, _LOOP_IN)
        words(axes, (0.02, _LOOP_IN - 0.32), "(b) one loop of (a)", size_pt=8.5, ha="left", weight="bold")
        _controller(axes)
    return figure


def _control_loop(axes: Axes, foot: float) -> None:
    """Guidance, filter, control law, allocation, vehicle; above what switches, below what is measured."""
    low, main, top = foot + 0.18, foot + 1.1, foot + 1.98
    guidance = block(axes, (0.92, main), (0.86, 0.6), "guidance", ["line of sight", "in both planes"])
    reference = block(axes, (1.98, main), (0.74, 0.6), "reference\nfilters", ["3rd order"])
    error = summing(axes, (2.66, main))
    law = block(axes, (3.3, main), (0.8, 0.6), "adaptive PID", ["decoupled loops,", "see (b)"])
    body = block(axes, (3.985, main), (0.25, 0.28), r"$\mathbf{J}^T$")
    allocation = block(
        axes, (4.72, main), (0.74, 0.6), "allocation", [r"$f = \mathbf{B}^{+}\tau_d$,", "limits"]
    )
    inverse = block(axes, (5.645, main), (0.74, 0.6), "inverse char-\nacteristic", ["inflow, minimum"])
    vehicle = block(axes, (6.535, main), (0.56, 0.6), "vehicle", ["motors,", "6 DOF"])
    words(axes, (0.02, main + 0.1), r"$w_k$, $U_k$", size_pt=8, ha="left")
    words(axes, (0.02, main - 0.1), "mission", ha="left")
    connect(axes, (0.02, main), guidance.left)
    for former, latter, said in (
        (guidance, reference, r"$r$"),
        (reference, error, r"$r_f$"),
        (error, law, r"$e$"),
        (law, body, r"$\tau$"),
        (body, allocation, r"$\tau_d$"),
        (allocation, inverse, r"$f$"),
        (inverse, vehicle, r"$u_A$"),
    ):
        connect(axes, former.right, latter.left)
        words(axes, (0.5 * (former.right[0] + latter.left[0]) - 0.03, main + 0.1), said, size_pt=8)
    connect(axes, vehicle.right, (WIDTH_IN - 0.02, main))
    words(axes, (WIDTH_IN - 0.13, main + 0.1), r"$\eta, \nu$", size_pt=8)
    connect(axes, (vehicle.x, main + 0.62), vehicle.top)
    words(axes, (vehicle.x, main + 0.7), "current, faults")
    _switches(axes, top, (guidance.x, law, allocation))
    _feedback(axes, (low, main), (guidance.x, error.x, law.x, vehicle.right[0]))


def _switches(axes: Axes, top: float, under: tuple[float, Block, Block]) -> None:
    """Safety and mode table, and the wrench that the allocation reached."""
    guided, law, allocation = under
    safety = block(axes, (1.98, top), (1.02, 0.42), "safety", ["hold, surface or abort"])
    modes = block(
        axes, (3.98, top), (1.7, 0.42), "mode table", ["hover, cruise: loops and actuators at work"]
    )
    words(axes, (safety.x, safety.top[1] + 0.2), "limits, stale data, signals, battery")
    connect(axes, (safety.x, safety.top[1] + 0.13), safety.top)
    connect(axes, safety.left, (guided, top), (guided, law.top[1]))
    words(axes, (guided + 0.06, top - 0.3), "reaction", ha="left")
    connect(axes, safety.right, modes.left)
    words(axes, (0.5 * (safety.right[0] + modes.left[0]), top + 0.09), "failed")
    words(axes, (modes.x, modes.top[1] + 0.2), "speed $u$ with hysteresis, holding")
    connect(axes, (modes.x, modes.top[1] + 0.13), modes.top)
    connect(axes, (law.x - 0.1, modes.bottom[1]), (law.x - 0.1, law.top[1]))
    connect(axes, (allocation.x + 0.04, modes.bottom[1]), (allocation.x + 0.04, allocation.top[1]))
    back = law.top[1] + 0.15
    connect(
        axes,
        (allocation.x - 0.14, allocation.top[1]),
        (allocation.x - 0.14, back),
        (law.x + 0.14, back),
        (law.x + 0.14, law.top[1]),
    )
    words(axes, (0.5 * (law.x + allocation.x), back + 0.09), r"reached wrench $\tau_a$")


def _feedback(axes: Axes, rows: tuple[float, float], at: tuple[float, ...]) -> None:
    """Sensors, and the measurement's way to all that need it."""
    low, main = rows
    guided, error, law, out = at
    tap = out + 0.1
    sensors = block(axes, (6.0, low), (0.9, 0.32), "sensors", ["noise, latency, gaps"])
    known = block(
        axes, (4.25, low + 0.4), (1.1, 0.34), "feed-forward", [r"$g(\eta)$, drag, $\mathbf{M}\,\ddot{r}_f$"]
    )
    dot(axes, (tap, main))
    connect(axes, (tap, main), (tap, low), sensors.right)
    connect(axes, sensors.left, (guided, low), (guided, main - 0.3))
    words(axes, (sensors.left[0] - 0.3, low + 0.1), r"$y$, $\dot{y}$", size_pt=8)
    for x, end in ((error, main - 0.08), (law - 0.16, main - 0.3), (known.x, known.bottom[1])):
        dot(axes, (x, low))
        connect(axes, (x, low), (x, end))
    words(axes, (error - 0.09, main - 0.18), _MINUS, size_pt=8)
    words(axes, (law - 0.08, main - 0.42), r"$\dot{y}$", size_pt=8)
    words(axes, (guided + 0.09, main - 0.42), r"$y$", size_pt=8)
    connect(axes, known.left, (law + 0.16, known.y), (law + 0.16, main - 0.3))
    words(axes, (law + 0.27, main - 0.42), r"$\tau_{ff}$", size_pt=8)


def _controller(axes: Axes) -> None:
    """Filter, proportional, integral and derivative lanes with scheduled gains, limit and switch."""
    integral, proportional, derivative, known = 1.62, 1.12, 0.62, 0.19
    reference = block(
        axes,
        (0.98, 0.5 * (proportional + derivative)),
        (0.86, 0.86),
        "reference\nfilter",
        [r"$\omega$, critically", "damped"],
    )
    error, rate = summing(axes, (1.86, proportional)), summing(axes, (1.86, derivative))
    sums = bar(axes, 4.66, known - 0.1, integral + 0.14)
    limit = block(axes, (5.24, proportional), (0.6, 0.5), "", ["limit", r"$\pm\tau_{max}$"], shift=0.1)
    _saturation(axes, limit)
    words(axes, (0.02, proportional + 0.1), r"$r$ desired", size_pt=7.5, ha="left")
    connect(axes, (0.02, proportional), (reference.left[0], proportional))
    words(axes, (0.02, integral + 0.1), r"$y$ measured", size_pt=7.5, ha="left")
    connect(axes, (0.02, integral), (error.x, integral), error.top)
    words(axes, (error.x - 0.09, error.top[1] + 0.09), _MINUS, size_pt=8)
    connect(axes, (reference.right[0], proportional), error.left)
    words(axes, (1.56, proportional + 0.1), r"$r_f$", size_pt=8)
    connect(axes, (reference.right[0], derivative), rate.left)
    words(axes, (1.56, derivative + 0.11), r"$\dot{r}_f$", size_pt=8)
    connect(axes, (rate.x, known - 0.02), rate.bottom)
    words(axes, (rate.x - 0.06, known + 0.1), r"$\dot{y}$ measured", size_pt=7.5, ha="right")
    words(axes, (rate.x - 0.09, rate.bottom[1] - 0.09), _MINUS, size_pt=8)
    words(axes, (2.06, proportional - 0.1), "wrapped", size_pt=6.5, ha="left")
    words(axes, (2.06, proportional + 0.1), r"$e$", size_pt=8)
    fork = (2.28, proportional)
    dot(axes, fork)
    schedule = block(axes, (2.98, 2.16), (1.3, 0.36), "gain schedule", ["six supporting points"])
    words(axes, (schedule.left[0] - 0.32, schedule.y + 0.1), r"$u_d$", size_pt=8)
    connect(axes, (schedule.left[0] - 0.42, schedule.y), schedule.left)
    lanes = ((integral, "T_s K_I"), (proportional, "K_P"), (derivative, "K_D"))
    gains = [block(axes, (schedule.x, y), (0.66, 0.3), rf"${gain}(u_d)$") for y, gain in lanes]
    for former, latter in zip((schedule, *gains), gains, strict=False):
        connect(axes, former.bottom, latter.top)
    memory = block(axes, (4.0, integral), (0.72, 0.34), r"$I(k)$", ["integral part"])
    connect(axes, fork, (fork[0], integral), gains[0].left)
    connect(axes, gains[0].right, memory.left)
    connect(axes, memory.right, (sums.left[0], integral))
    connect(axes, error.right, gains[1].left)
    connect(axes, rate.right, gains[2].left)
    for gain, y in ((gains[1], proportional), (gains[2], derivative)):
        connect(axes, gain.right, (sums.left[0], y))
    ahead = block(
        axes, (schedule.x, known), (1.3, 0.28), "", ["feed-forward: restoring,", "drag, acceleration"]
    )
    connect(axes, ahead.right, (sums.left[0], known))
    words(axes, (ahead.right[0] + 0.3, known + 0.1), r"$\tau_{ff}$", size_pt=8)
    _leaving(axes, (sums, limit, memory), schedule.y)


def _leaving(axes: Axes, blocks: tuple[Block, Block, Block], top: float) -> None:
    """From the sum to the allocation, and what it reached back to the integral part."""
    sums, limit, memory = blocks
    y = limit.y
    connect(axes, (sums.right[0], y), limit.left)
    switch = block(axes, (5.92, y), (0.44, 0.3), "switch")
    connect(axes, limit.right, switch.left)
    allocation = block(axes, (6.68, y), (0.62, 0.36), "allocation")
    connect(axes, switch.right, allocation.left)
    words(axes, (0.5 * (switch.right[0] + allocation.left[0]), y + 0.1), r"$\tau_d$", size_pt=8)
    connect(axes, (switch.x, y - 0.45), switch.bottom)
    words(axes, (switch.x, y - 0.53), "mode table: loop active")
    connect(axes, allocation.top, (allocation.x, top), (memory.x, top), memory.top)
    words(axes, (allocation.x - 0.06, top + 0.1), r"reached: $\tau_a$", size_pt=7.5, ha="right")
    words(axes, (memory.x + 0.08, top - 0.12), r"anti-windup by $\tau_a - \tau_d$;", ha="left")
    words(axes, (memory.x + 0.08, top - 0.25), r"preset where the loop enters (bumpless)", ha="left")


def _saturation(axes: Axes, limit: Block) -> None:
    """Picture of a limit in its box."""
    x, y, a = limit.x, limit.y + 0.13, 0.07
    axes.plot([x - 2 * a, x - a, x + a, x + 2 * a], [y - a, y - a, y + a, y + a], color=SIMULATED, zorder=5)
