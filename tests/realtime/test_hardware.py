"""Hardware in the loop: the layout, loss, delay, forged packets, the watchdog, and hardware that begins
anew.
"""

from __future__ import annotations

import math
import select
import socket
import struct
import zlib
from collections import deque
from typing import Any

import numpy as np
import pytest

from seatrial.base.errors import SimulationError
from seatrial.realtime.hardware import Hardware, command_packet, udp_hardware
from seatrial.realtime.plant import Motion
from seatrial.report.results.links import link_sentence

PEER = ("192.168.2.2", 14660)
MOTION = Motion(
    1.25, np.array([1.0, 2.0, 3.0]), np.array([1.0, 0, 0, 0]), np.arange(6.0), np.array([0.0, 0.5, -9.81])
)


class Wire:
    """A link whose packets the test delivers, with a clock of its own."""

    def __init__(self, **options: Any) -> None:
        self.now = 10.0
        self.out: list[bytes] = []
        self.incoming: deque[tuple[bytes, Any]] = deque()
        self.hardware = Hardware(
            ("a", "b"),
            {"a": 0.0, "b": 1500.0},
            self.out.append,
            lambda: self.incoming.popleft() if self.incoming else None,
            clock=lambda: self.now,
            **options,
        )

    def give(self, sequence: int, values: tuple[float, ...] = (1.0, 1600.0), sender: Any = PEER) -> None:
        acknowledged = struct.unpack_from("<I", self.out[-1], 8)[0] if self.out else 0
        self.incoming.append((command_packet(values, sequence, acknowledged), sender))

    def tick(self, seconds: float = 0.1) -> dict[str, float]:
        self.now += seconds
        return self.hardware.exchange(MOTION)


def test_the_packet_is_as_the_page_says() -> None:
    """Unpacked here field by field from the table of the how-to page."""
    wire = Wire()
    wire.hardware.exchange(MOTION, voltage_v=16.5)
    (data,) = wire.out
    assert len(data) == 4 + 2 + 2 + 4 + 8 + 3 * 8 + 14 * 4 + 4 == 104
    magic, version, flags, sequence, time_us = struct.unpack_from("<IHHIQ", data, 0)
    assert (magic, version, flags, sequence, time_us) == (0x31535453, 1, 1, 1, 1_250_000)
    assert data[:4] == b"STS1"
    assert struct.unpack_from("<3d", data, 20) == (1.0, 2.0, 3.0)
    assert struct.unpack_from("<3f", data, 44) == (0.0, 0.0, 0.0)
    assert struct.unpack_from("<6f", data, 56) == (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    assert struct.unpack_from("<3f", data, 80) == pytest.approx((0.0, 0.5, -9.81))
    altitude, voltage = struct.unpack_from("<2f", data, 92)
    assert math.isnan(altitude)
    assert voltage == 16.5
    assert struct.unpack_from("<I", data, 100)[0] == zlib.crc32(data[:100])


def test_commands_act_and_round_trips_are_measured() -> None:
    wire = Wire()
    assert wire.tick() == {"a": 0.0, "b": 1500.0}
    for k in range(1, 6):
        wire.give(k, (float(k), 1500.0 + k))
        assert wire.tick() == {"a": float(k), "b": 1500.0 + k}
    facts = wire.hardware.facts()
    assert (facts.sent, facts.taken, facts.lost, facts.expired) == (6, 5, 0, 0)
    np.testing.assert_allclose(facts.round_trip_s, 0.1)
    assert facts.neutral_periods == 1


def test_lost_late_and_repeated_packets_are_counted_and_the_newest_acts() -> None:
    wire = Wire()
    wire.tick()
    for sequence in (1, 2, 5, 4, 5, 3, 7):
        wire.give(sequence, (float(sequence), 1500.0))
    assert wire.tick()["a"] == 7.0
    facts = wire.hardware.facts()
    assert facts.lost == 3  # 3, 4 and 6: the late ones do not count as come
    assert facts.ignored == {"old": 3}


def test_the_watchdog_rests_the_actuators_and_they_come_back() -> None:
    wire = Wire(watchdog_s=0.5)
    wire.tick()
    wire.give(1)
    assert wire.tick()["a"] == 1.0
    for _ in range(5):
        commands = wire.tick()
    assert commands["a"] == 1.0  # 0.5 s of silence are allowed
    assert wire.tick() == {"a": 0.0, "b": 1500.0}
    assert struct.unpack_from("<H", wire.out[-1], 6)[0] == 1
    wire.give(9, (2.0, 1700.0))
    assert wire.tick() == {"a": 2.0, "b": 1700.0}
    assert struct.unpack_from("<H", wire.out[-1], 6)[0] == 0
    assert wire.hardware.facts().expired == 1


def test_hardware_that_begins_anew_is_taken_again() -> None:
    wire = Wire()
    wire.tick()
    wire.give(5000)
    wire.tick()
    wire.give(1, (3.0, 1500.0))
    assert wire.tick()["a"] == 3.0
    # Numbers of 32 bits go round.
    wire = Wire()
    wire.tick()
    for sequence in (0xFFFFFFFF, 0, 1):
        wire.give(sequence, (float(sequence & 0xF), 1500.0))
        wire.tick()
    assert wire.hardware.facts().lost == 0
    assert wire.hardware.facts().taken == 3


def _forged(**change: Any) -> bytes:
    fields: dict[str, Any] = {
        "magic": 0x31435453,
        "version": 1,
        "count": 2,
        "values": (1.0, 2.0),
        "crc": None,
    } | change
    body = struct.pack("<IHHIIQ", fields["magic"], fields["version"], fields["count"], 1, 1, 0)
    body += struct.pack(f"<{len(fields['values'])}f", *fields["values"])
    crc = zlib.crc32(body) if fields["crc"] is None else fields["crc"]
    return body + struct.pack("<I", crc)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "short"),
        (b"x" * 27, "short"),
        (b"x" * 40, "magic"),
        (_forged(magic=0x31535453), "magic"),
        (_forged(version=2), "version"),
        (_forged(count=3), "count"),
        (_forged(values=(1.0,)), "count"),
        (_forged(values=(1.0, 2.0, 3.0)), "count"),
        (_forged(crc=7), "checksum"),
        (_forged(values=(math.nan, 1.0)), "number"),
        (_forged(values=(math.inf, 1.0)), "number"),
    ],
)
def test_forged_packets_move_nothing_and_are_counted(data: bytes, why: str) -> None:
    wire = Wire()
    wire.incoming.append((data, PEER))
    assert wire.tick() == {"a": 0.0, "b": 1500.0}
    assert wire.hardware.facts().ignored == {why: 1}


def test_a_stranger_cannot_steer_and_a_flood_does_not_stop_the_loop() -> None:
    wire = Wire()
    wire.tick()
    wire.give(1)
    wire.tick()
    wire.give(2, (9.0, 9.0), sender=("10.0.0.9", 1))
    assert wire.tick()["a"] == 1.0
    assert wire.hardware.facts().ignored == {"stranger": 1}
    wire.incoming.extend((b"flood", PEER) for _ in range(10_000))
    wire.tick()
    assert len(wire.incoming) == 10_000 - 256


def _bound(host: str = "127.0.0.1") -> socket.socket:
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind((host, 0))
    link.settimeout(2.0)
    return link


def test_over_udp_only_the_address_that_was_given_steers() -> None:
    """A stranger who speaks before the hardware, after it, and after its silence moves nothing."""
    with _bound() as board, _bound() as stranger:
        now = [10.0]
        hardware, link = udp_hardware(board.getsockname(), ("a",), {"a": 0.0}, watchdog_s=0.5)
        hardware.clock = lambda: now[0]
        with link:
            own = link.getsockname()
            assert own[0] == "127.0.0.1"

            def steered(sender: socket.socket, value: float, sequence: int) -> float:
                sender.sendto(command_packet([value], sequence, 1), own)
                select.select([link], [], [], 2.0)
                return hardware.exchange(MOTION)["a"]

            assert steered(stranger, 9.0, 1) == 0.0
            assert board.recvfrom(2048)[1] == own
            assert steered(board, 1.0, 1) == 1.0
            assert steered(stranger, 9.0, 2) == 1.0
            now[0] += 1.0
            assert steered(stranger, 9.0, 3) == 0.0
            assert steered(board, 2.0, 4) == 2.0
        assert hardware.facts().ignored == {"stranger": 3}


def test_the_link_leaves_the_machine_for_a_peer_elsewhere_or_says_that_no_network_leads_there() -> None:
    """192.0.2.1 is an address for documentation (RFC 5737): nothing is sent to it here."""
    try:
        _, link = udp_hardware(("192.0.2.1", 14660), ("a",), {"a": 0.0})
    except SimulationError as error:
        assert "cannot open the link" in str(error)  # noqa: PT017 - a machine without a network
        return
    with link:
        assert not link.getsockname()[0].startswith("127.")


def test_packets_that_the_system_does_not_send_are_counted_and_told() -> None:
    def broken(data: bytes) -> None:
        raise OSError(101, "Network is unreachable")

    hardware = Hardware(("a",), {"a": 0.0}, broken, lambda: None)
    for _ in range(3):
        assert hardware.exchange(MOTION) == {"a": 0.0}
    facts = hardware.facts()
    assert facts.unsent == {"Network is unreachable": 3}
    assert "3 were not sent: Network is unreachable" in link_sentence(facts)
    assert facts.to_dict()["unsent"] == {"Network is unreachable": 3}


def test_numbers_of_the_link_are_checked() -> None:
    with pytest.raises(SimulationError, match="watchdog_s: expected a positive time"):
        Wire(watchdog_s=0.0)
