"""What goes over ArduPilot's JSON simulator link: the servo packet in, the state of the vehicle out.

Packets are little-endian,

    uint16 magic, uint16 frame_rate (Hz), uint32 frame_count, uint16 pwm[16 or 32] (us)

with magic 18458 for 16 channels and 29569 for 32. The answer is a line of JSON between line feeds:
``timestamp`` (s, of the physics), ``imu`` with ``gyro`` (rad/s) and ``accel_body`` (specific force, m/s2),
``position`` and ``velocity`` (NED, m and m/s), ``quaternion`` (body to NED), and ``rng_1`` (m) where there
is a bottom. Body axes are forward, right, down. Source: ArduPilot, libraries/SITL/examples/JSON, at
045bdf55; the format only. Held by ``tests/realtime/test_sitl.py``.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from typing import Any

from seatrial.realtime.plant import Motion

MAGIC_16, MAGIC_32 = 18458, 29569  # of ArduPilot's servo packets with 16 and with 32 channels

_HEAD = struct.Struct("<HHI")

_SIZES = {MAGIC_16: 16, MAGIC_32: 32}  # channels of a packet, by its magic number

_SLOWEST_HZ, _FASTEST_HZ = 1, 20_000  # of a frame rate that ArduPilot can mean


@dataclass(frozen=True)
class ServoPacket:
    """A packet of ArduPilot: rate in Hz, number of the frame, pulses in us (0: none)."""

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
        if not _SLOWEST_HZ <= rate <= _FASTEST_HZ:
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
