"""What a field of a log is taken for, with damaged samples in it."""

from __future__ import annotations

from seatrial.logs.log import Field, Topic
from seatrial.logs.recognise import propose


def test_one_damaged_pulse_width_leaves_a_motor_a_motor() -> None:
    fields = tuple(Field(f"C{k}", "", 2000, 1100.0, 1900.0, 1500.0, 100.0, 0.1) for k in range(1, 8))
    flipped = Field("C8", "", 2000, 1100.0, 34268.0, 1516.0, 740.0, 0.1)
    off = Field("C9", "", 2000, 0.0, 0.0, 0.0, 0.0, 1.0)
    topic = Topic("RCOU", 2000, 0.0, 200.0, 0.1, 0.1, 0, (*fields, flipped, off))
    found = {one.canonical for one in propose("dataflash", [topic], {})}
    assert {f"cmd.thruster_{k}" for k in range(1, 9)} <= found
    assert "cmd.thruster_9" not in found
