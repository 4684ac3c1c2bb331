"""What Foxglove gets: a WebSocket client that is not ours, and the recording by the mcap library."""

from __future__ import annotations

import asyncio
import json
import socket
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import SimulationError
from seatrial.realtime.live import Live
from seatrial.realtime.plant import Plant

pytest.importorskip("foxglove")

VEHICLE = st.Vehicle.load("cwolf")


def _messages(path: Path) -> dict[str, list[tuple[int, bytes]]]:
    from mcap.reader import make_reader

    found: dict[str, list[tuple[int, bytes]]] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            found.setdefault(channel.topic, []).append((message.log_time, message.data))
    return found


def test_a_recording_holds_pose_track_and_plots(tmp_path: Path) -> None:
    path = tmp_path / "dive.mcap"
    plant = Plant(VEHICLE, initial=st.State([10.0, 20.0, 5.0], [0.0, 0.0, np.pi / 2], [1.0, 0, 0, 0, 0, 0]))
    with Live(VEHICLE, record=path, track_every=5) as live:
        for _ in range(20):
            live.show(plant.motion, {"depth_m": float(plant.motion.position[2]), "cmd": {"PU": 1.5}})
            plant.advance({}, 0.1)
    found = _messages(path)
    assert {topic: len(rows) for topic, rows in found.items()} == {
        "/tf": 20,
        "/pose": 20,
        "/flight": 20,
        "/scene": 4,
    }
    stamps = [stamp for stamp, _ in found["/pose"]]
    assert np.diff(stamps) == pytest.approx(1e8, abs=2)
    plots = json.loads(found["/flight"][0][1])
    assert plots == {"t_s": 0.0, "depth_m": 5.0, "cmd": {"PU": 1.5}}
    # Protobuf of /pose: 64-bit numbers of east, north, up behind their field numbers 1, 2, 3.
    pose = found["/pose"][0][1]
    place = b"\x09" + struct.pack("<d", 20.0) + b"\x11" + struct.pack("<d", 10.0)
    assert place + b"\x19" + struct.pack("<d", -5.0) in pose


def test_a_websocket_client_sees_the_topics_and_their_messages() -> None:
    """Client: Tornado. Subprotocol and messages as Foxglove publishes them (foxglove.sdk.v1)."""
    from tornado.httpclient import HTTPRequest
    from tornado.websocket import websocket_connect

    plant = Plant(VEHICLE)

    async def watch(live: Live) -> tuple[dict[str, Any], dict[int, bytes]]:
        client = await websocket_connect(
            HTTPRequest(f"ws://127.0.0.1:{live.port}/"), subprotocols=["foxglove.sdk.v1"]
        )
        topics: dict[str, Any] = {}
        while len(topics) < 4:
            message = await client.read_message()
            assert isinstance(message, str)
            told = json.loads(message)
            if told["op"] == "advertise":
                topics |= {one["topic"]: one for one in told["channels"]}
        wanted = [{"id": k, "channelId": one["id"]} for k, one in enumerate(topics.values())]
        await client.write_message(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        seen: dict[int, bytes] = {}
        while len(seen) < 4:
            live.show(plant.advance({"PU": 1000.0}, 0.1), {"depth_m": 1.0})
            try:
                message = await asyncio.wait_for(client.read_message(), 0.05)
            except TimeoutError:
                continue
            if isinstance(message, bytes) and message[0] == 1:  # a message of a subscription
                seen[struct.unpack_from("<I", message, 1)[0]] = message[13:]
        client.close()
        return topics, seen

    with Live(VEHICLE, port=0, track_every=1) as live:
        topics, seen = asyncio.run(asyncio.wait_for(watch(live), 20.0))
    names = {topic: one["schemaName"] for topic, one in topics.items()}
    assert names == {
        "/tf": "foxglove.FrameTransform",
        "/pose": "foxglove.PoseInFrame",
        "/scene": "foxglove.SceneUpdate",
        "/flight": "seatrial.Flight",
    }
    plots = json.loads(seen[list(topics).index("/flight")])
    assert plots["depth_m"] == 1.0


def _answer(live: Live, origin: str) -> bytes:
    """First line of the answer to a browser's request from a page of an origin."""
    request = (
        "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
        f"Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n{origin}\r\n"
    )
    with socket.create_connection(("127.0.0.1", live.port or 0), timeout=10.0) as link:
        link.sendall(request.encode())
        return link.recv(4096).partition(b"\r\n")[0]


def test_pages_of_other_origins_are_refused_unless_told() -> None:
    with Live(VEHICLE, port=0, origins=["https://lab.example.org"]) as live:
        for origin in ("https://evil.example", "null", "https://127.0.0.1.evil.example", "https://["):
            assert _answer(live, f"Origin: {origin}\r\n") == b"HTTP/1.1 403 Forbidden", origin
        for origin in ("https://lab.example.org", "http://localhost:8080", "https://app.foxglove.dev"):
            assert _answer(live, f"Origin: {origin}\r\n").startswith(b"HTTP/1.1 101 "), origin
        assert _answer(live, "").startswith(b"HTTP/1.1 101 ")
        port = live.port or 0
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", port), timeout=1.0)


def test_files_and_ports_that_cannot_be_had_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "dive.mcap"
    path.write_bytes(b"mine")
    with pytest.raises(SimulationError, match="is there already"):
        Live(VEHICLE, record=path)
    assert path.read_bytes() == b"mine"
    with pytest.raises(SimulationError, match="cannot be written"):
        Live(VEHICLE, record=tmp_path / "none" / "dive.mcap")
    with Live(VEHICLE, port=0) as first, pytest.raises(SimulationError, match="cannot listen"):
        Live(VEHICLE, port=first.port)
