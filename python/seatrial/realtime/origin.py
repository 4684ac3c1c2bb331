"""A gate before a WebSocket server: pages of other origins are refused, as the server itself does not do.

Any page that a browser shows may open a WebSocket to this machine; the browser tells the page's origin in the
request (RFC 6455, section 10.2). The gate reads the head of the request alone, answers 403 or hands all bytes
on. The server behind it listens on an address of its own in 127.0.0.0/8 where the system has one, so that no
page finds it by trying ports. Held by ``tests/realtime/test_live.py``.
"""

from __future__ import annotations

import contextlib
import secrets
import socket
import threading
from collections.abc import Sequence
from urllib.parse import urlsplit

OWN_ORIGINS = ("https://app.foxglove.dev", "https://app.foxglove.com", "file://")
"""Foxglove in a browser and on the desktop."""

_LOCAL = ("localhost", "127.0.0.1", "::1")

_LONGEST_HEAD, _HEAD_S = 16_384, 5.0  # bytes and time of a request

_MOST = 32  # connections at a time

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

    Parameters
    ----------
    host, port : str, int
        Own address; port 0 takes a free one.
    server : (str, int)
        Address of the server.
    origins : sequence of str
        Origins of pages that may reach it, too: ``https://example.org``.

    Raises
    ------
    OSError
        The address is not to be had.
    """

    def __init__(self, host: str, port: int, server: tuple[str, int], origins: Sequence[str]) -> None:
        self._server, self._origins = server, tuple(origins)
        self._listener = socket.create_server((host, port))
        self.port: int = self._listener.getsockname()[1]
        self._open: set[socket.socket] = set()
        self._free = threading.Semaphore(_MOST)
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
    client.settimeout(_HEAD_S)
    head = b""
    while b"\r\n\r\n" not in head and len(head) < _LONGEST_HEAD and (part := client.recv(4096)):
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
