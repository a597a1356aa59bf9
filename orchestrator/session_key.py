"""Key and certificate for authentication in a cluster of containers, created once in a shared folder.

The compose file first runs `python -m toppling.orchestrator.session_key FOLDER`.
"""

import os
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from distributed.security import Security

_KEY, _CERTIFICATE = "key.pem", "certificate.pem"
_LEAST_LEFT = timedelta(days=60)
"""Validity left at which a start of the containers replaces a certificate, which is valid for a year."""


def write_key(folder: Path) -> Security:
    """Write a key and a self-signed certificate, readable by this account only, unless they exist and stay valid."""
    key, certificate = folder / _KEY, folder / _CERTIFICATE
    if not (key.exists() and certificate.exists() and _stays_valid(certificate)):
        made = Security.temporary()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for path, text in ((certificate, made.tls_ca_file), (key, made.tls_client_key)):
            hidden = folder / f".{path.name}.{os.getpid()}.tmp"
            with open(os.open(hidden, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:  # noqa: PTH123
                file.write(text)
            hidden.replace(path)
    places = {f"tls_{role}_{kind}": str(path) for role in ("client", "scheduler", "worker")
              for kind, path in (("key", key), ("cert", certificate))}  # fmt: skip
    return Security(tls_ca_file=str(certificate), require_encryption=True, **places)


def _stays_valid(certificate: Path) -> bool:
    end = x509.load_pem_x509_certificate(certificate.read_bytes()).not_valid_after_utc
    return end - datetime.now(UTC) > _LEAST_LEFT


if __name__ == "__main__":
    write_key(Path(sys.argv[1]))
