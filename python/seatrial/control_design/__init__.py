"""Design of autopilots from a vehicle's model: trims, start gains by pole placement, linear-quadratic gains.

`trim` is straight level flight, `authority` what the actuators reach and how late, `closed_loop` the
sampled linear motion behind lag and dead time with its margins; `start_gains` and `start_file` make an
autopilot file, `lqr_design` the gains of the regulator.
"""

from seatrial.control_design.closed_loop import STATES, Margins
from seatrial.control_design.lqr_design import LqrGains, Tolerances, design_lqr, lqr_tables
from seatrial.control_design.lqr_file import lqr_autopilot
from seatrial.control_design.start_file import start_autopilot
from seatrial.control_design.start_gains import StartGains, start_gains
from seatrial.control_design.trim import Trim, trim

__all__ = [
    "STATES",
    "LqrGains",
    "Margins",
    "StartGains",
    "Tolerances",
    "Trim",
    "design_lqr",
    "lqr_autopilot",
    "lqr_tables",
    "start_autopilot",
    "start_gains",
    "trim",
]
