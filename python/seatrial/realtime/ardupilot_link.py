"""ArduPilot's JSON simulator link: the vehicle as physics behind ArduSub.

ArduPilot's simulator (started with ``--model JSON:HOST``) sends a servo packet to UDP port 9002 for each
frame and waits for the state of the vehicle. One packet, one step: the vehicle moves by one over the rate of
the packet, in lock-step with the autopilot. Source: ArduPilot, libraries/SITL/examples/JSON, at 045bdf55; the
format only. Held by ``tests/realtime/test_sitl.py``.
"""

from __future__ import annotations

import json
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial._core import State, Vehicle
from seatrial.ardusub.parameters import Channel, ChannelMap, ParameterFile, map_channels, map_parameters
from seatrial.base.errors import SimulationError, reason
from seatrial.base.plain import Plain
from seatrial.base.report import Reported
from seatrial.base.toml_file import loaded
from seatrial.flight.sensor_channels import sensors_of
from seatrial.realtime.plant import Motion, Plant, Shown, motion_table

if TYPE_CHECKING:
    import polars as pl

    from seatrial.sensors.sensor import Sensor

MAGIC_16, MAGIC_32 = 18458, 29569  # of ArduPilot's servo packets with 16 and with 32 channels

_HEAD = struct.Struct("<HHI")

_SIZES = {MAGIC_16: 16, MAGIC_32: 32}  # channels of a packet, by its magic number


@dataclass(frozen=True)
class SitlSettings:
    """Which packets of ArduPilot are taken."""

    slowest_hz: int = 1  #: Lowest frame rate that ArduPilot can mean, Hz.
    fastest_hz: int = 20_000  #: Highest frame rate that ArduPilot can mean, Hz.
    packet_bytes: int = 2048  #: Bytes of a packet that are read: more than the longest one has.


SETTINGS = SitlSettings()


@dataclass(frozen=True)
class ServoPacket:
    """A packet of ArduPilot: rate in Hz, number of the frame, pulses in us (0: none).

    Little-endian: uint16 magic (18458 for 16 channels, 29569 for 32), uint16 frame_rate (Hz), uint32
    frame_count, uint16 pwm[16 or 32] (us).
    """

    frame_rate: int
    frame_count: int
    pwm: tuple[int, ...]

    @classmethod
    def parse(cls, data: bytes) -> ServoPacket | str:
        """Packet of the bytes, or in a word why they are none.

        Examples
        --------
        >>> ServoPacket.parse(b"hello")
        'short'
        """
        if len(data) < _HEAD.size:
            return "short"
        magic, rate, count = _HEAD.unpack_from(data)
        channels = _SIZES.get(magic)
        if channels is None:
            return "magic"
        length = _HEAD.size + 2 * channels
        if len(data) != length:
            return "short" if len(data) < length else "long"
        pwm = struct.unpack_from(f"<{channels}H", data, _HEAD.size)
        if not SETTINGS.slowest_hz <= rate <= SETTINGS.fastest_hz:
            return "rate"
        if max(pwm) > 3000:  # servo pulses are 800 to 2200 us long
            return "pulse"
        return cls(rate, count, pwm)

    def bytes(self) -> bytes:
        """The packet as ArduPilot sends it."""
        magic = MAGIC_16 if len(self.pwm) == _SIZES[MAGIC_16] else MAGIC_32
        return _HEAD.pack(magic, self.frame_rate, self.frame_count) + struct.pack(
            f"<{len(self.pwm)}H", *self.pwm
        )


def answer(motion: Motion, *, seabed_m: float | None = None) -> bytes:
    """Answer to a servo packet: a line of JSON between line feeds.

    ``timestamp`` (s, of the physics), ``imu`` with ``gyro`` (rad/s) and ``accel_body`` (specific force,
    m/s2), ``position`` and ``velocity`` (NED, m and m/s), ``quaternion`` (body to NED), and ``rng_1`` (m)
    where there is a bottom. Body axes are forward, right, down.

    Above a bottom at depth `seabed_m` the range along the body's down axis is told as ``rng_1``.
    """
    line: dict[str, Any] = {
        "timestamp": motion.t_s,
        "imu": {"gyro": motion.nu[3:].tolist(), "accel_body": motion.specific_force.tolist()},
        "position": motion.position.tolist(),
        "quaternion": motion.attitude.tolist(),
        "velocity": motion.velocity.tolist(),
    }
    if seabed_m is not None:
        down = float(motion.rotation[2, 2])
        altitude = seabed_m - float(motion.position[2])
        if down > 0.1 and altitude >= 0.0:  # beyond 84 degrees of tilt it does not see the bottom
            line["rng_1"] = altitude / down
    return b"\n" + json.dumps(line, separators=(",", ":"), allow_nan=False).encode() + b"\n"


PORT = 9002  # that ArduPilot's JSON interface sends to by default

LOOPBACK = "127.0.0.1"


@dataclass(frozen=True, eq=False, repr=False)
class SitlSession(
    Plain,
    Reported,
    only="vehicle=mapping.vehicle.name ended frames lost resets ignored simulated_s wall_s steps_per_s"
    " slowest_step_s rate_hz channels notes",
):
    """What happened on the link.

    Attributes
    ----------
    mapping
        What flew, and where its pulses came from.
    ended
        "idle", "interrupted", "diverged" or "frames": why it ended.
    frames, lost, resets
        Packets that were answered by a step, frames that were missing between them, new beginnings.
    ignored
        Packets that were passed over, by why: short, long, magic, rate, pulse, late, duplicate, stranger.
    simulated_s, wall_s, busy_s
        Time of the physics, of the clock, and spent on steps and answers.
    slowest_step_s
        Longest time between a packet and its answer.
    rate_hz
        Frames per second that the peer asked for last.
    rows
        Log: time, position, roll pitch yaw, nu, then commands by actuator, SI.
    notes
        What was mapped and what not.
    """

    mapping: ChannelMap
    ended: str
    frames: int
    lost: int
    resets: int
    ignored: Mapping[str, int]
    simulated_s: float
    wall_s: float
    busy_s: float
    slowest_step_s: float
    rate_hz: int
    rows: Sequence[Sequence[float]] = ()
    notes: Sequence[str] = ()

    @property
    def steps_per_s(self) -> float:
        """Steps per second of work: what the peer could at most ask for."""
        return self.frames / self.busy_s if self.busy_s > 0.0 else 0.0

    def table(self) -> pl.DataFrame:
        """Log as the columns of a trial."""
        return motion_table(self.rows, [f"cmd.{channel.actuator}" for channel in self.mapping.channels])

    def channels(self) -> dict[str, int]:
        """Number of the servo's channel by actuator."""
        return {channel.actuator: channel.number for channel in self.mapping.channels}


@dataclass
class _Link:
    """Where the link stands: the peer, its numbers, the last answer."""

    peer: Any = None
    heard: float = 0.0
    count: int | None = None
    rate: int = 0
    sent: bytes = b""
    sent_at: float = 0.0
    frames: int = 0
    lost: int = 0
    resets: int = 0
    ignored: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0
    busy: float = 0.0

    def frames_of(self, packet: ServoPacket, sender: Any, now: float) -> int | str:
        """Frames to step for a packet; 0 begins anew; or in a word why it is passed over."""
        # After two seconds of silence another sender may take the place of the peer.
        if self.peer is not None and sender != self.peer and now - self.heard < 2.0:
            return "stranger"
        if self.count is None or sender != self.peer:
            return 0 if self.count is not None else 1
        gap = packet.frame_count - self.count
        if gap > 0:
            return gap
        if gap == 0:
            return "duplicate"
        # By no more than 32 frames a packet is late; by more, or 0 or 1, the autopilot began anew.
        if packet.frame_count > 1 and -gap <= 32:
            return "late"
        return 0


def listen(host: str = LOOPBACK, port: int = PORT) -> socket.socket:
    """UDP socket that is bound to an address.

    Raises `SimulationError`: the address is not to be had.
    """
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        link.bind((host, port))
    except (OSError, OverflowError) as error:
        link.close()
        why = reason(error) if isinstance(error, OSError) else str(error)
        raise SimulationError(
            f"{host}:{port}: cannot listen ({why}); end what listens there or choose another --port"
        ) from None
    return link


def sitl(
    vehicle: Vehicle | str | Path,
    *,
    parameters: ParameterFile | str | Path | None = None,
    channels: Mapping[str, int] | None = None,
    host: str = LOOPBACK,
    port: int = PORT,
    idle_s: float = 60.0,
    max_frames: int | None = None,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
    seed: int = 0,
    initial: State | None = None,
    current: ArrayLike = (0.0, 0.0, 0.0),
    voltage_v: float | None = None,
    seabed_m: float | None = None,
    imu_position_m: ArrayLike = (0.0, 0.0, 0.0),
    log_hz: float = 0.0,
    ready: Callable[[tuple[str, int]], None] | None = None,
) -> SitlSession:
    """Session as the physics behind ArduPilot's simulator: servo packets in, the state of the vehicle out.

    In lock-step: each frame moves the vehicle by one over the rate of the packet. The vehicle begins anew
    when the number of the frames goes back. It ends when no packet came for `idle_s`, or with Ctrl-C.

    Parameters
    ----------
    vehicle : Vehicle, str or Path
        The physics: an object, a built-in name or a file.
    parameters : ParameterFile, str or Path, optional
        Of ArduSub: directions, ends and channels of the motors are taken from it.
    channels : mapping of str to int, optional
        Servo channel by actuator, from 1; the actuators in their order from channel 1 on when omitted.
    host, port : str, int, optional
        Address to listen on; only this machine when omitted. Port 0 takes a free one.
    idle_s : float, optional
        Silence after which it ends, s.
    max_frames : int, optional
        Frames after which it ends.
    sensors : mapping of str to Sensor, str or Path, optional
        By kind, "typical", or a file; perfect ones when omitted. The accelerometer stays perfect: ArduPilot
        adds the noise of its own.
    seed : int, optional
        Of the sensors' errors.
    initial : State, optional
        Where it begins; at rest in O when omitted.
    current : (3,) array_like, optional
        Velocity of the water, NED, m/s.
    voltage_v : float, optional
        Supply, V, where thrust depends on it.
    seabed_m : float, optional
        Depth of the bottom; the answer has a range finder then.
    imu_position_m : (3,) array_like, optional
        Place of the accelerometer in the body frame from O, m.
    log_hz : float, optional
        Rows of the log per second of motion; 0 keeps none.
    ready : callable, optional
        Called with the address once it listens.

    Raises
    ------
    VehicleError, TrialError, SimulationError
        A file or a number is not usable, or the address is not to be had.
    """
    model: Vehicle = loaded(Vehicle, vehicle)
    if not idle_s > 0.0:
        raise SimulationError(f"idle_s: expected a positive time in s, found {idle_s:g}")
    if parameters is None:
        mapped = map_channels(model, channels)
    else:
        file = parameters if isinstance(parameters, ParameterFile) else ParameterFile.load(parameters)
        mapped = map_parameters(model, file, channels)
    plant = Plant(
        mapped.vehicle, initial=initial, current=current, voltage_v=voltage_v, imu_position_m=imu_position_m
    )
    chosen = sensors_of(sensors, mapped.vehicle)
    shown = None if chosen is None else Shown(chosen, seed)
    notes = list(mapped.sentences)
    notes += [] if shown is None else shown.sentences
    loop = _Loop(plant, mapped.channels, shown, seabed_m, log_hz)
    with listen(host, port) as link:
        # Short waits, so that Ctrl-C and the idle time are seen.
        link.settimeout(min(idle_s, 0.25))
        if ready is not None:
            ready(link.getsockname())
        ended, wall = _serve(link, loop, idle_s, max_frames)
    state = loop.link
    return SitlSession(
        mapping=mapped,
        ended=ended,
        frames=state.frames,
        lost=state.lost,
        resets=state.resets,
        ignored=dict(state.ignored),
        simulated_s=loop.simulated_s,
        wall_s=wall,
        busy_s=state.busy,
        slowest_step_s=state.slowest,
        rate_hz=state.rate,
        rows=loop.rows,
        notes=notes,
    )


class _Loop:
    """The vehicle behind a link."""

    def __init__(
        self,
        plant: Plant,
        channels: tuple[Channel, ...],
        shown: Shown | None,
        seabed_m: float | None,
        log_hz: float,
    ) -> None:
        self.plant, self.channels, self.shown, self.seabed_m = plant, channels, shown, seabed_m
        self.link = _Link()
        self.rows: list[list[float]] = []
        self.simulated_s = 0.0
        self._every_s = np.inf if log_hz <= 0.0 else 1.0 / log_hz
        self._next_s = 0.0
        self._commands: dict[str, float] = {channel.actuator: channel.neutral for channel in channels}

    def take(self, data: bytes, sender: Any, now: float) -> bytes | None:
        """Answer to a packet; None where there is none to give."""
        link = self.link
        packet = ServoPacket.parse(data)
        if isinstance(packet, str):
            link.ignored[packet] += 1
            return None
        frames = link.frames_of(packet, sender, now)
        if isinstance(frames, str):
            link.ignored[frames] += 1
            if frames == "duplicate":
                link.heard = now
                # ArduPilot repeats a packet after 10 s: it gets its answer again, unless that was just given.
                if now - link.sent_at > 1.0:
                    link.sent_at = now
                    return link.sent
            return None
        if frames == 0:
            link.resets += 1
            self._begin_anew()
        first = frames == 0 or link.count is None
        link.peer, link.heard, link.count, link.rate = sender, now, packet.frame_count, packet.frame_rate
        # Frames that were lost on the way are made up for under the commands of before.
        missing = 0 if first else min(frames - 1, 100)  # at most so many are made up for
        link.lost += 0 if first else frames - 1
        dt = 1.0 / packet.frame_rate
        for _ in range(missing):
            if not self.diverged:
                self._step(dt)
        self._commands = {
            channel.actuator: channel.command(float(packet.pwm[channel.number - 1]))
            if channel.number <= len(packet.pwm)
            else channel.neutral
            for channel in self.channels
        }
        motion = self._step(dt)
        link.frames += 1
        if self.diverged:  # JSON has no word for what is no number
            return None
        seen = motion if self.shown is None else self.shown.measure(motion)
        link.sent, link.sent_at = answer(seen, seabed_m=self.seabed_m), now
        return link.sent

    @property
    def diverged(self) -> bool:
        """Whether the motion is no number any more."""
        motion = self.plant.motion
        return not (np.isfinite(motion.nu).all() and np.isfinite(motion.specific_force).all())

    def _step(self, dt: float) -> Motion:
        before = self.plant.motion
        motion = self.plant.advance(self._commands, dt)
        self.simulated_s += dt
        if before.t_s >= self._next_s - 1e-9 and np.isfinite(before.nu).all():
            self._next_s += self._every_s
            commands = [self._commands[channel.actuator] for channel in self.channels]
            self.rows.append([before.t_s, *before.numbers, *commands])
        return motion

    def _begin_anew(self) -> None:
        self.plant.reset()
        self._next_s = 0.0
        self.rows.clear()
        if self.shown is not None:
            self.shown.reset()


def _serve(link: socket.socket, loop: _Loop, idle_s: float, max_frames: int | None) -> tuple[str, float]:
    """Why the loop ended, and how long it took, s."""
    begun = last = time.monotonic()
    try:
        while True:
            try:
                data, sender = link.recvfrom(SETTINGS.packet_bytes)
            except TimeoutError:
                if time.monotonic() - last >= idle_s:
                    return "idle", time.monotonic() - begun
                continue
            except ConnectionError:  # the peer's port is closed: it may come back
                continue
            now = time.monotonic()
            before = loop.link.frames
            reply = loop.take(data, sender, now)
            if loop.diverged:
                return "diverged", time.monotonic() - begun
            if reply is not None:
                last = now
                try:
                    link.sendto(reply, sender)
                except OSError:  # counted, and told with the packets that were passed over
                    loop.link.ignored["unreachable"] += 1
            elif now - last >= idle_s:
                return "idle", now - begun
            if loop.link.frames > before:
                spent = time.monotonic() - now
                loop.link.busy += spent
                loop.link.slowest = max(loop.link.slowest, spent)
            if max_frames is not None and loop.link.frames >= max_frames:
                return "frames", time.monotonic() - begun
    except KeyboardInterrupt:
        return "interrupted", time.monotonic() - begun
