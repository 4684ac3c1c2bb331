"""A flight shown while it flies: Foxglove over a WebSocket, and the same as an MCAP recording.

Frames are those of viewers, as in `seatrial.trial.export`: ``earth`` is east-north-up, ``vehicle``
forward-left-up. Topics: ``/tf`` and ``/pose``, the pose; ``/scene``, the hull and the track; ``/flight``, all
numbers for plots. Needs foxglove-sdk (extra ``live``).

Any page that a browser shows may open a WebSocket to this machine; the browser tells the page's origin in the
request (RFC 6455, section 10.2). A gate before the server reads the head of the request alone, answers 403 to
pages of other origins or hands all bytes on. The server behind it listens on an address of its own in
127.0.0.0/8 where the system has one, so that no page finds it by trying ports.

Held by ``tests/realtime/test_live.py``.
"""

from __future__ import annotations

import contextlib
import json
import secrets
import socket
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import urlsplit

from seatrial._core import Vehicle
from seatrial.base.errors import SimulationError, reason
from seatrial.base.frames import attitude_to_ned
from seatrial.realtime.plant import Motion

_EARTH, _BODY = "earth", "vehicle"


@dataclass(frozen=True)
class LiveSettings:
    """How much the page of a running flight shows and takes."""

    track_points: int = 2000  #: Points of the track that are shown: older ones are thinned.
    request_bytes: int = 16_384  #: Most bytes of a request.
    request_s: float = 5.0  #: Longest time for a request, s.
    most_connections: int = 32  #: Most connections at a time.


SETTINGS = LiveSettings()


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
            from foxglove import channels, messages
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
        typed: Any = channels
        self._tf = typed.FrameTransformChannel("/tf", context=self._context)
        self._pose = typed.PoseInFrameChannel("/pose", context=self._context)
        self._scene = typed.SceneUpdateChannel("/scene", context=self._context)
        schema = foxglove.Schema(
            name="seatrial.Flight",
            encoding="jsonschema",
            data=json.dumps({"title": "seatrial.Flight", "type": "object"}).encode(),
        )
        self._flight = foxglove.Channel(
            "/flight", schema=schema, message_encoding="json", context=self._context
        )
        geometry = vehicle.geometry()
        self._size = (1.0, 0.4, 0.3)  # m: a hull is drawn where the file has no geometry
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
            if len(self._track) > SETTINGS.track_points:  # every second point, and half as many from here on
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


OWN_ORIGINS = ("https://app.foxglove.dev", "https://app.foxglove.com", "file://")
"""Foxglove in a browser and on the desktop."""

_LOCAL = ("localhost", "127.0.0.1", "::1")

_REFUSED = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


def allowed(head: bytes, origins: Sequence[str] = ()) -> bool:
    r"""Whether a request may reach the server: it names no origin, one of this machine, or one of those told.

    Programs name none; "null", which a page of any site can send, is one like others.

    Examples
    --------
    >>> allowed(b"GET / HTTP/1.1\r\nOrigin: http://localhost:8080\r\n\r\n")
    True
    >>> allowed(b"GET / HTTP/1.1\r\norigin: https://example.org\r\n\r\n")
    False
    """
    lines = (line.partition(b":") for line in head.split(b"\r\n")[1:])
    named = [value.strip().decode("latin-1") for name, _, value in lines if name.strip().lower() == b"origin"]
    known = {*OWN_ORIGINS, *(origin.rstrip("/") for origin in origins)}
    return all(origin in known or _is_local(origin) for origin in named)


def _is_local(origin: str) -> bool:
    try:
        return urlsplit(origin).hostname in _LOCAL
    except ValueError:  # no address at all
        return False


def hidden_address() -> str:
    """A loopback address that nobody guesses; the usual one where the system has no other."""
    address = f"127.{secrets.randbelow(254) + 1}.{secrets.randbelow(256)}.{secrets.randbelow(254) + 1}"
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        try:
            probe.bind((address, 0))
        except OSError:  # only 127.0.0.1 is loopback, as on macOS
            return "127.0.0.1"
    return address


class Gate:
    """Listens where the server is said to be, and hands on what may reach it.

    `host`, `port`: own address; port 0 takes a free one; `server`: address of the server; `origins`: origins
    of pages that may reach it, too: ``https://example.org``. Raises `OSError`: the address is not to be had.
    """

    def __init__(self, host: str, port: int, server: tuple[str, int], origins: Sequence[str]) -> None:
        self._server, self._origins = server, tuple(origins)
        self._listener = socket.create_server((host, port))
        self.port: int = self._listener.getsockname()[1]
        self._open: set[socket.socket] = set()
        self._free = threading.Semaphore(SETTINGS.most_connections)
        threading.Thread(target=self._listen, daemon=True).start()

    def close(self) -> None:
        """Listen no more and end all connections."""
        for link in (self._listener, *list(self._open)):
            _end(link)

    def _listen(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:  # closed
                return
            if self._free.acquire(blocking=False):
                threading.Thread(target=self._serve, args=(client,), daemon=True).start()
            else:
                _end(client)

    def _serve(self, client: socket.socket) -> None:
        self._open.add(client)
        server = None
        try:
            head = _head(client)
            if b"\r\n\r\n" not in head:
                return
            if not allowed(head.partition(b"\r\n\r\n")[0], self._origins):
                client.sendall(_REFUSED)
                return
            server = socket.create_connection(self._server)
            self._open.add(server)
            client.settimeout(None)
            server.sendall(head)
            back = threading.Thread(target=_hand_on, args=(server, client), daemon=True)
            back.start()
            _hand_on(client, server)
            back.join()
        except OSError:  # one of the two has gone: a viewer that left ends no flight
            pass
        finally:
            for link in (client, server):
                if link is not None:
                    self._open.discard(link)
                    _end(link)
            self._free.release()


def _head(client: socket.socket) -> bytes:
    """Head of a request, and what came with it."""
    client.settimeout(SETTINGS.request_s)
    head = b""
    while b"\r\n\r\n" not in head and len(head) < SETTINGS.request_bytes and (part := client.recv(4096)):
        head += part
    return head


def _hand_on(source: socket.socket, target: socket.socket) -> None:
    """Bytes from one to the other until either ends."""
    with contextlib.suppress(OSError):  # one of the two has gone
        while part := source.recv(65_536):
            target.sendall(part)
    for link in (source, target):
        with contextlib.suppress(OSError):  # gone already
            link.shutdown(socket.SHUT_RDWR)


def _end(link: socket.socket) -> None:
    with contextlib.suppress(OSError):  # not connected
        link.shutdown(socket.SHUT_RDWR)
    link.close()
