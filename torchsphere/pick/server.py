"""The server of a page: this machine alone, one address with a token, standard library only.

Every request names the token in its path and this machine in its Host header: a page of another origin knows neither
the token nor, by a name that is made to point here, the right Host.
"""

from __future__ import annotations

import contextlib
import errno
import hmac
import json
import os
import secrets
import socketserver
import sys
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qsl, unquote, urlsplit

from torchsphere.pick import routes
from torchsphere.pick.routes import Answer, refused
from torchsphere.pick.session import Session

#: The only address that the server listens at.
HOST = "127.0.0.1"

#: Largest body of a request, bytes; a page with many polygons sends some kilobytes.
MOST_BYTES = 2**20

#: Headers of every answer.
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class PickServer(ThreadingHTTPServer):
    """Serves one session at `address`."""

    daemon_threads = True
    # Elsewhere than on Windows the option only leaves out a wait after an earlier program has ended.
    allow_reuse_address = os.name != "nt"

    def __init__(self, session: Session, port: int = 0) -> None:
        """Listen at a ``port``, 0 for a free one; raises OSError for one that cannot be had."""
        self.session, self.token = session, secrets.token_urlsafe(24)
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            raise _port_error(port, error) from error

    def server_bind(self) -> None:
        """Bind without asking for this machine's name, which may take seconds."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = HOST, int(self.server_address[1])

    @property
    def address(self) -> str:
        """The address of the page."""
        return f"http://{HOST}:{self.server_port}/{self.token}/"

    @property
    def hosts(self) -> tuple[str, str]:
        """Values of the Host header that mean this server."""
        return f"{HOST}:{self.server_port}", f"localhost:{self.server_port}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that breaks a connection off is no error; all else is shown as usual."""
        if not isinstance(sys.exc_info()[1], (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)


def _port_error(port: int, error: Exception) -> OSError:
    if isinstance(error, OverflowError):
        return OSError(f"--port {port}: expected 1 to 65535; leave it out for a free port")
    number = getattr(error, "errno", None)
    why = {errno.EADDRINUSE: "is used by another program", errno.EACCES: "may not be used by this user"}
    reason = why.get(number or 0, f"cannot be used ({error})")
    return OSError(f"--port {port}: {reason}; give another port, or leave it out for a free one")


class _Handler(BaseHTTPRequestHandler):
    """One connection."""

    server: PickServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "torchsphere", ""
    # Idle connections are closed after so many seconds.
    timeout = 60

    def do_GET(self) -> None:
        """Answer a GET."""
        self._answer("GET")

    def do_POST(self) -> None:
        """Answer a POST."""
        self._answer("POST")

    def log_message(self, *_: Any) -> None:
        """No line per request: the terminal shows the address."""

    def _answer(self, method: str) -> None:
        with contextlib.suppress(ConnectionError, TimeoutError):
            found = self._refusal()
            if found is None:
                found = self._found(method)
            else:
                # A body that was not read would be taken for the next request.
                self.close_connection = True
            self._send(found)

    def _refusal(self) -> Answer | None:
        """The refusal of a request that is not from the page; None for one that is."""
        if self.headers.get("Host", "").lower() not in self.server.hosts:
            return refused("this server answers to 127.0.0.1 alone", 403)
        origin = self.headers.get("Origin")
        if origin is not None and origin.lower() not in {f"http://{host}" for host in self.server.hosts}:
            return refused("this server answers to its own page alone", 403)
        given = urlsplit(self.path).path.removeprefix("/").partition("/")[0]
        if not hmac.compare_digest(given.encode("utf-8", "replace"), self.server.token.encode()):
            return refused("the address lacks the token that 'torchsphere pick' printed; open that address", 403)
        return None

    def _found(self, method: str) -> Answer:
        parts = urlsplit(self.path)
        token, slash, path = parts.path.removeprefix("/").partition("/")
        if not slash:
            return Answer(b"", status=308, headers={"Location": f"/{token}/"})
        sent: Mapping[str, Any] = {}
        if method == "POST":
            try:
                sent = self._body()
            except ValueError as error:
                self.close_connection = True
                return refused(str(error))
        return routes.answer(self.server.session, method, unquote(path), dict(parse_qsl(parts.query)), sent)

    def _body(self) -> Mapping[str, Any]:
        """The JSON object of a POST; raises ValueError for anything else."""
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > MOST_BYTES:
            raise ValueError(f"the request is not of a stated length of up to {MOST_BYTES} bytes; load the page again")
        if self.headers.get_content_type() != "application/json":
            raise ValueError("the request is no JSON; load the page again")
        try:
            sent = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError) as error:
            raise ValueError("the request is no JSON; load the page again") from error
        if not isinstance(sent, dict):
            raise ValueError("the request is no JSON object; load the page again")
        return sent

    def _send(self, found: Answer) -> None:
        self.send_response(found.status)
        for name, value in {**HEADERS, **found.headers}.items():
            self.send_header(name, value)
        self.send_header("Content-Type", found.kind)
        self.send_header("Content-Length", str(len(found.body)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(found.body)
