"""Web server for a single user: on the loopback interface, at an address that contains a secret.

No other user of the machine and no other page of the browser has access.
"""

import secrets
import sys
from functools import cached_property
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

_LOOPBACK = "127.0.0.1"
_SLOWEST_S = 30.0
"""Time of inactivity after which a connection is closed, s."""
HTML, TEXT = "text/html; charset=utf-8", "text/plain; charset=utf-8"
_NOTHING = "default-src 'none'"


class Loopback(ThreadingHTTPServer):
    """Server that listens on the loopback interface only.

    answers: class of the request handler.
    port: 0 for any free port.
    """

    daemon_threads = True

    def __init__(self, answers: "type[Answers]", port: int = 0) -> None:
        self.secret = secrets.token_urlsafe(16)
        super().__init__((_LOOPBACK, port), answers)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore errors of closed connections."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)

    @property
    def address(self) -> str:
        """Address to open in a browser."""
        return f"http://{_LOOPBACK}:{self.server_port}/{self.secret}/"

    @cached_property
    def hosts(self) -> set[str]:
        """Allowed host headers: others may come from DNS rebinding by another site."""
        return {f"{name}:{self.server_port}" for name in (_LOOPBACK, "localhost")}


class Answers(BaseHTTPRequestHandler):
    """Base of request handlers: access control and sending of responses."""

    server: Loopback
    server_version = "toppling"
    sys_version = ""
    timeout = _SLOWEST_S

    def asked(self) -> str | None:
        """Path after the secret; None if the secret or the host is wrong."""
        secret, _, asked = self.path.removeprefix("/").partition("/")
        origin = self.headers.get("Origin")
        known = self.headers.get("Host") in self.server.hosts
        known &= origin is None or origin.removeprefix("http://") in self.server.hosts
        known &= secrets.compare_digest(secret.encode(), self.server.secret.encode())
        return asked if known else None

    def refuse(self) -> None:
        """Send a not found response."""
        self.send(b"not found", TEXT, status=HTTPStatus.NOT_FOUND)

    def send(
        self, body: bytes, kind: str = HTML, policy: str = _NOTHING, status: HTTPStatus = HTTPStatus.OK
    ) -> None:
        """Send a response that is not cached and is restricted by a content security policy."""
        self.send_response(status)
        for name, value in (
            ("Content-Type", kind),
            ("Content-Length", str(len(body))),
            ("Content-Security-Policy", policy),
            ("X-Content-Type-Options", "nosniff"),
            ("Referrer-Policy", "no-referrer"),
            ("Cache-Control", "no-store"),
        ):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  (the library's name)
        """Log nothing: a page sends requests continuously."""
