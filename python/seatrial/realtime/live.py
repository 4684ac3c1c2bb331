"""A flight shown while it flies: Foxglove over a WebSocket, and the same as an MCAP recording.

Frames are those of viewers, as in `seatrial.trial.export`: ``earth`` is east-north-up, ``vehicle``
forward-left-up. Topics: ``/tf`` and ``/pose``, the pose; ``/scene``, the hull and the track; ``/flight``, all
numbers for plots. Needs foxglove-sdk (extra ``live``). Held by ``tests/realtime/test_live.py``.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from seatrial._core import Vehicle
from seatrial.base.errors import SimulationError, reason
from seatrial.base.frames import attitude_to_ned
from seatrial.realtime.origin import Gate, hidden_address
from seatrial.realtime.plant import Motion

_EARTH, _BODY = "earth", "vehicle"

_TRACK_POINTS = 2000
"""Points of the track that are shown: older ones are thinned."""

_HULL_M = (1.0, 0.4, 0.3)
"""Size of the hull that is drawn where the vehicle file has no geometry."""


class Live:
    """Viewers of a flight.

    Parameters
    ----------
    vehicle : Vehicle
    host, port : str, int, optional
        Of the WebSocket; no server without a port. 0 takes a free one.
    record : Path, optional
        MCAP file to write.
    origins : sequence of str, optional
        Origins of web pages that may watch, beside Foxglove's own and those of this machine.
    track_every : int, optional
        Samples from one message with the track to the next.

    Raises
    ------
    SimulationError
        foxglove-sdk is not there, the port is taken, or the file cannot be written.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        host: str = "127.0.0.1",
        port: int | None = None,
        record: Path | None = None,
        origins: Sequence[str] = (),
        track_every: int = 10,
    ) -> None:
        try:
            import foxglove
            from foxglove import messages
        except ImportError:
            raise SimulationError(
                "live: needs foxglove-sdk, which is not installed; pip install 'seatrial[live]'"
            ) from None
        self._messages: Any = messages
        self._context = foxglove.Context()
        self._writer = self._server = self._gate = None
        if record is not None and record.exists():
            raise SimulationError(f"{record}: is there already; choose another name")
        if port is not None:
            try:
                hidden = hidden_address()
                self._server = foxglove.start_server(
                    name=f"seatrial {vehicle.name}", host=hidden, port=0, context=self._context
                )
                self._gate = Gate(host, port, (hidden, int(self._server.port)), origins)
            except (OSError, RuntimeError, OverflowError) as error:
                self.close()
                raise SimulationError(
                    f"{host}:{port}: cannot listen ({error}); end what listens there or choose another port"
                ) from None
        if record is not None:
            try:
                self._writer = foxglove.open_mcap(str(record), context=self._context)
            except (OSError, RuntimeError) as error:
                self.close()
                why = reason(error)
                raise SimulationError(f"{record}: cannot be written ({why}); choose another folder") from None
        channel = _typed_channels()
        self._tf = channel["FrameTransformChannel"]("/tf", context=self._context)
        self._pose = channel["PoseInFrameChannel"]("/pose", context=self._context)
        self._scene = channel["SceneUpdateChannel"]("/scene", context=self._context)
        schema = foxglove.Schema(
            name="seatrial.Flight",
            encoding="jsonschema",
            data=json.dumps({"title": "seatrial.Flight", "type": "object"}).encode(),
        )
        self._flight = foxglove.Channel(
            "/flight", schema=schema, message_encoding="json", context=self._context
        )
        geometry = vehicle.geometry()
        self._size = _HULL_M
        if geometry:
            diameter = geometry["diameter"]
            self._size = (geometry["length"], diameter, geometry.get("height", diameter))
        self._round = vehicle.hull_shape == "spheroid"
        self._begin_ns = time.time_ns()
        self._track: list[Any] = []
        self._every, self._count, self._stride = track_every, 0, 1

    @property
    def port(self) -> int | None:
        """Port of the WebSocket; None without a server."""
        return None if self._gate is None else self._gate.port

    def show(self, motion: Motion, numbers: Mapping[str, Any]) -> None:
        """Show a motion, and numbers by name for plots, nested ones by group."""
        ns = self._begin_ns + round(motion.t_s * 1e9)
        m = self._messages
        east, north, up = motion.position[[1, 0, 2]] * [1.0, 1.0, -1.0]
        w, x, y, z = (float(part) for part in attitude_to_ned(motion.attitude, "FLU/ENU", "live"))
        turn = m.Quaternion(x=x, y=y, z=z, w=w)
        at = m.Vector3(x=float(east), y=float(north), z=float(up))
        stamp = m.Timestamp(sec=ns // 1_000_000_000, nsec=ns % 1_000_000_000)
        self._tf.log(
            m.FrameTransform(
                timestamp=stamp, parent_frame_id=_EARTH, child_frame_id=_BODY, translation=at, rotation=turn
            ),
            log_time=ns,
        )
        pose = m.Pose(position=at, orientation=turn)
        self._pose.log(m.PoseInFrame(timestamp=stamp, frame_id=_EARTH, pose=pose), log_time=ns)
        self._flight.log({"t_s": motion.t_s, **numbers}, log_time=ns)
        if self._count % self._stride == 0:
            self._track.append(m.Point3(x=float(east), y=float(north), z=float(up)))
            if len(self._track) > _TRACK_POINTS:  # every second point, and half as many from here on
                self._track, self._stride = self._track[::2], 2 * self._stride
        if self._count % self._every == 0:
            self._scene.log(self._drawn(stamp), log_time=ns)
        self._count += 1

    def close(self) -> None:
        """Stop the server and finish the recording."""
        if self._gate is not None:
            self._gate.close()
            self._gate = None
        if self._server is not None:
            self._server.stop()
            self._server = None
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _drawn(self, stamp: Any) -> Any:
        """Hull and track."""
        m = self._messages
        size = m.Vector3(x=self._size[0], y=self._size[1], z=self._size[2])
        pose = m.Pose(position=m.Vector3(x=0.0, y=0.0, z=0.0), orientation=m.Quaternion(x=0, y=0, z=0, w=1))
        colour = m.Color(r=0.95, g=0.75, b=0.1, a=0.9)
        shape: dict[str, Any] = (
            {"spheres": [m.SpherePrimitive(pose=pose, size=size, color=colour)]}
            if self._round
            else {"cubes": [m.CubePrimitive(pose=pose, size=size, color=colour)]}
        )
        hull = m.SceneEntity(timestamp=stamp, frame_id=_BODY, id="hull", frame_locked=True, **shape)
        line = m.LinePrimitive(
            type=m.LinePrimitiveLineType.LineStrip,
            pose=pose,
            thickness=2.0,
            scale_invariant=True,
            points=list(self._track),
            color=m.Color(r=0.2, g=0.5, b=1.0, a=1.0),
        )
        track = m.SceneEntity(timestamp=stamp, frame_id=_EARTH, id="track", lines=[line])
        return m.SceneUpdate(entities=[hull, track])


def _typed_channels() -> dict[str, Any]:
    """Typed channels of foxglove-sdk by name."""
    from foxglove import channels

    names = ("FrameTransformChannel", "PoseInFrameChannel", "SceneUpdateChannel")
    return {name: getattr(channels, name) for name in names}
