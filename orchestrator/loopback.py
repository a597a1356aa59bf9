"""Pages for the browser of one person: a server on the loopback interface, at an address that holds a secret.

No other user of the machine and no other page of the browser can ask it anything.
"""

import secrets
import sys
from functools import cached_property
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

_LOOPBACK = "127.0.0.1"
_SLOWEST_S = 30.0
"""A connection on which nothing comes for so long is closed."""
HTML, TEXT = "text/html; charset=utf-8", "text/plain; charset=utf-8"
_NOTHING = "default-src 'none'"


class Loopback(ThreadingHTTPServer):
    """Server that listens on loopback only.

    answers: class of what answers a request.
    port: 0 for any that is free.
    """

    daemon_threads = True

    def __init__(self, answers: "type[Answers]", port: int = 0) -> None:
        self.secret = secrets.token_urlsafe(16)
        super().__init__((_LOOPBACK, port), answers)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a browser that has gone."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"http://{_LOOPBACK}:{self.server_port}/{self.secret}/"

    @cached_property
    def hosts(self) -> set[str]:
        """Names under which a browser may ask: another name may be another site's, turned to this address."""
        return {f"{name}:{self.server_port}" for name in (_LOOPBACK, "localhost")}


class Answers(BaseHTTPRequestHandler):
    """What all pages share: who may ask, and how an answer is sent."""

    server: Loopback
    server_version = "toppling"
    sys_version = ""
    timeout = _SLOWEST_S

    def asked(self) -> str | None:
        """The address behind the secret; None where the secret is another's or the server has another name."""
        secret, _, asked = self.path.removeprefix("/").partition("/")
        origin = self.headers.get("Origin")
        known = self.headers.get("Host") in self.server.hosts
        known &= origin is None or origin.removeprefix("http://") in self.server.hosts
        known &= secrets.compare_digest(secret.encode(), self.server.secret.encode())
        return asked if known else None

    def refuse(self) -> None:
        """Say that nothing is there."""
        self.send(b"not found", TEXT, status=HTTPStatus.NOT_FOUND)

    def send(
        self, body: bytes, kind: str = HTML, policy: str = _NOTHING, status: HTTPStatus = HTTPStatus.OK
    ) -> None:
        """Send an answer that no one keeps, and that loads nothing but what its policy allows."""
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
        """Say nothing: a page asks all the time."""
