"""Hardware in the loop over UDP: what sensors show goes out once per period, commands of actuators come in.

All numbers are little-endian. To the hardware goes

    uint32 magic 0x31535453 "STS1", uint16 version 1, uint16 flags, uint32 sequence, uint64 time in us,
    float64 x y z (NED, m), float32 roll pitch yaw (rad), u v w (m/s), p q r (rad/s),
    specific force x y z (m/s2), altitude (m, NaN: none), supply (V, NaN: none), uint32 CRC-32 of all before

and it answers

    uint32 magic 0x31435453 "STC1", uint16 version 1, uint16 count, uint32 sequence, uint32 acknowledged
    sequence, uint64 its own time in us, float32 commands[count] in the order and units of the vehicle file,
    uint32 CRC-32

Flag 1 says that the watchdog has expired: no good packet came for so long that the actuators rest at neutral.
Sequence numbers rise by one; a packet that is not newer than the last good one is passed over. Held by
``tests/realtime/test_hardware.py``.
"""

from __future__ import annotations

import math
import socket
import struct
import time
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from seatrial.base.errors import SimulationError, reason
from seatrial.base.plain import Plain
from seatrial.realtime.plant import Motion

SENSOR_MAGIC, COMMAND_MAGIC = 0x31535453, 0x31435453  # "STS1" and "STC1" in little-endian order

VERSION = 1  # of the layout of both packets

WATCHDOG_FLAG = 1  # bit of the sensor packet's flags: commands are too old

_SENSOR = struct.Struct("<IHHIQ3d14f")

_COMMAND = struct.Struct("<IHHIIQ")

_CRC = struct.Struct("<I")

_LARGEST = 2048  # bytes of a datagram: more than a packet with the most actuators has

_MOST_ACTUATORS = 64  # a command packet stays below 300 bytes, so in one frame


@dataclass(frozen=True)
class HardwareSettings:
    """Which packets of hardware count."""

    packets_per_period: int = 256  #: Packets that are read per period: a flood does not stop the loop.
    restart_drop: int = 1000  #: Drop of the sequence number by more than which hardware began anew.


SETTINGS = HardwareSettings()


def sensor_packet(
    motion: Motion,
    sequence: int,
    *,
    flags: int = 0,
    altitude_m: float = math.nan,
    voltage_v: float = math.nan,
) -> bytes:
    """Packet to the hardware."""
    body = _SENSOR.pack(
        SENSOR_MAGIC,
        VERSION,
        flags,
        sequence & 0xFFFFFFFF,
        round(motion.t_s * 1e6),
        *motion.position,
        *motion.euler,
        *motion.nu,
        *motion.specific_force,
        altitude_m,
        voltage_v,
    )
    return body + _CRC.pack(zlib.crc32(body))


def command_packet(commands: Sequence[float], sequence: int, acknowledged: int, time_us: int = 0) -> bytes:
    """Packet of the hardware, for a peer in Python."""
    body = _COMMAND.pack(
        COMMAND_MAGIC, VERSION, len(commands), sequence & 0xFFFFFFFF, acknowledged & 0xFFFFFFFF, time_us
    ) + struct.pack(f"<{len(commands)}f", *commands)
    return body + _CRC.pack(zlib.crc32(body))


@dataclass(frozen=True)
class _Command:
    sequence: int
    acknowledged: int
    values: tuple[float, ...]


def _parse(data: bytes, count: int) -> _Command | str:
    """Commands of a packet, or in a word why it is none."""
    if len(data) < _COMMAND.size + _CRC.size:
        return "short"
    magic, version, given_count, sequence, acknowledged, _ = _COMMAND.unpack_from(data)
    if magic != COMMAND_MAGIC:
        return "magic"
    if version != VERSION:
        return "version"
    if given_count != count or len(data) != _COMMAND.size + 4 * count + _CRC.size:
        return "count"
    if zlib.crc32(data[: -_CRC.size]) != _CRC.unpack_from(data, len(data) - _CRC.size)[0]:
        return "checksum"
    values = struct.unpack_from(f"<{count}f", data, _COMMAND.size)
    if not all(map(math.isfinite, values)):
        return "number"
    return _Command(sequence, acknowledged, values)


@dataclass(frozen=True)
class HardwareFacts(
    Plain, only="sent taken lost ignored unsent expired neutral_periods round_trip_s=round_trips"
):
    """What went over the link."""

    #: `sent`, `taken`: packets to the hardware, and good ones from it.
    sent: int
    taken: int
    lost: int  #: Numbers that were missing between good packets.
    #: Packets that were passed over, by why: short, magic, version, count, checksum, number, old, stranger.
    ignored: Mapping[str, int]
    expired: int  #: How often the watchdog expired.
    #: Periods with the actuators at neutral because of it, the ones before the first packet included.
    neutral_periods: int
    round_trip_s: tuple[float, ...]  #: From a packet to the answer to it, of each good packet, s.
    #: Packets that the system did not take, by why; they count as sent.
    unsent: Mapping[str, int] = field(default_factory=dict)

    @property
    def round_trips(self) -> dict[str, float | None]:
        """Quantiles of the round trips, s, by share; None without any."""
        trips = self.round_trip_s
        return {
            f"{share:g}": float(np.quantile(trips, share)) if trips else None for share in (0.5, 0.99, 1.0)
        }


@dataclass
class Hardware:
    """Autopilot hardware at the other end of a link."""

    #: `actuators`, `neutral`: names in the order of the packet, and the command of each at rest.
    actuators: Sequence[str]
    neutral: Mapping[str, float]
    send: Callable[[bytes], None]  #: Sends a packet to the hardware.
    #: Gives a packet and its sender, None when there is none.
    receive: Callable[[], tuple[bytes, Any] | None]
    watchdog_s: float = 0.5  #: Time without a good packet after which the actuators rest.
    clock: Callable[[], float] = time.monotonic  #: Monotonic time, s.
    #: The only sender that is obeyed; when omitted the first that sends a good packet, until it is
    #: silent.
    peer: Any = None
    _sequence: int = field(default=0, init=False)
    _last: int | None = field(default=None, init=False)
    _heard: float | None = field(default=None, init=False)
    _heard_from: Any = field(default=None, init=False)
    _unsent: Counter[str] = field(default_factory=Counter, init=False)
    _commands: dict[str, float] = field(default_factory=dict, init=False)
    _sent_at: dict[int, float] = field(default_factory=dict, init=False)
    _ignored: Counter[str] = field(default_factory=Counter, init=False)
    _taken: int = field(default=0, init=False)
    _lost: int = field(default=0, init=False)
    _expired: int = field(default=0, init=False)
    _neutral_periods: int = field(default=0, init=False)
    _resting: bool = field(default=True, init=False)
    _trips: list[float] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        if not self.watchdog_s > 0.0:
            raise SimulationError(f"watchdog_s: expected a positive time in s, found {self.watchdog_s:g}")
        if len(self.actuators) > _MOST_ACTUATORS:
            raise SimulationError(
                f"actuators: expected at most {_MOST_ACTUATORS}, found {len(self.actuators)}"
            )

    def exchange(self, motion: Motion, **shown: float) -> dict[str, float]:
        """Commands for the next period, by actuator, after what came in; then the sensors go out.

        ``altitude_m`` and ``voltage_v`` are shown where they are given.
        """
        now = self.clock()
        for _ in range(SETTINGS.packets_per_period):
            received = self.receive()
            if received is None:
                break
            self._take(*received, now)
        expired = self._heard is None or now - self._heard > self.watchdog_s
        if expired and not self._resting:
            self._expired += 1
        self._resting = expired
        self._neutral_periods += expired
        self._sequence += 1
        self._sent_at[self._sequence] = now
        if len(self._sent_at) > 2 * SETTINGS.packets_per_period:
            del self._sent_at[next(iter(self._sent_at))]
        try:
            self.send(sensor_packet(motion, self._sequence, flags=WATCHDOG_FLAG * expired, **shown))
        except OSError as error:  # the flight goes on by the clock: the watchdog rests the actuators
            self._unsent[reason(error)] += 1
        return dict(self.neutral) if expired else dict(self._commands)

    def facts(self) -> HardwareFacts:
        """What went over the link so far."""
        return HardwareFacts(
            self._sequence,
            self._taken,
            self._lost,
            dict(self._ignored),
            self._expired,
            self._neutral_periods,
            tuple(self._trips),
            dict(self._unsent),
        )

    def _take(self, data: bytes, sender: Any, now: float) -> None:
        silent = self._heard is None or now - self._heard > self.watchdog_s
        obeyed = self.peer if self.peer is not None else None if silent else self._heard_from
        if obeyed is not None and sender != obeyed:
            self._ignored["stranger"] += 1
            return
        command = _parse(data, len(self.actuators))
        if isinstance(command, str):
            self._ignored[command] += 1
            return
        if self._last is not None:
            # Numbers of 32 bits go round.
            step = (command.sequence - self._last) & 0xFFFFFFFF
            behind = 0x100000000 - step
            if step == 0 or (step > 0x7FFFFFFF and behind <= SETTINGS.restart_drop and not silent):
                self._ignored["old"] += 1
                return
            if step <= 0x7FFFFFFF:
                self._lost += step - 1
        self._last, self._heard, self._heard_from = command.sequence, now, sender
        self._taken += 1
        sent = self._sent_at.pop(command.acknowledged, None)
        if sent is not None:
            self._trips.append(now - sent)
        self._commands = dict(zip(self.actuators, command.values, strict=True))


def udp_hardware(
    peer: tuple[str, int],
    actuators: Sequence[str],
    neutral: Mapping[str, float],
    *,
    listen_on: tuple[str, int] | None = None,
    watchdog_s: float = 0.5,
) -> tuple[Hardware, socket.socket]:
    """Hardware at a UDP address, which alone is obeyed, and the socket, which the caller closes.

    Own address is `listen_on`; when omitted the one from which this machine reaches the peer, which is
    loopback for a peer on this machine.

    Raises `SimulationError`: an address is not to be had, or no network leads to the peer.
    """
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        address = socket.getaddrinfo(peer[0], peer[1], socket.AF_INET, socket.SOCK_DGRAM)[0][4]
        link.bind((_own_address(address), 0) if listen_on is None else listen_on)
    except (OSError, OverflowError) as error:
        link.close()
        raise SimulationError(
            f"hardware at {peer[0]}:{peer[1]}: cannot open the link ({error}); check the address and the"
            " network"
        ) from None
    link.setblocking(False)

    def send(data: bytes) -> None:
        link.sendto(data, address)

    def receive() -> tuple[bytes, Any] | None:
        try:
            return link.recvfrom(_LARGEST)
        except BlockingIOError:
            return None
        except ConnectionError:  # the port of the peer is closed: it may come back, and the watchdog tells
            return None

    return Hardware(actuators, neutral, send, receive, watchdog_s, peer=address), link


def _own_address(peer: Any) -> str:
    """Address of this machine on the network that leads to a peer; nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as route:
        route.connect(peer)
        return str(route.getsockname()[0])
