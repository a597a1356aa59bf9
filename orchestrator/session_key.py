"""Key and certificate of a cluster of containers, made once in a folder that they share: without them nobody is let in.

`python -m toppling.orchestrator.session_key FOLDER` is what the compose file starts first.
"""

import os
import sys
from pathlib import Path

from distributed.security import Security

_KEY, _CERTIFICATE = "key.pem", "certificate.pem"


def _write_key(folder: Path) -> None:
    """Write a key and a certificate that it signed, unless they are there, for this account's eyes alone."""
    if (folder / _KEY).exists() and (folder / _CERTIFICATE).exists():
        return
    made = Security.temporary()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    for name, text in ((_CERTIFICATE, made.tls_ca_file), (_KEY, made.tls_client_key)):
        hidden = folder / f".{name}.{os.getpid()}.tmp"
        with open(os.open(hidden, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:  # noqa: PTH123
            file.write(text)
        hidden.replace(folder / name)


if __name__ == "__main__":
    _write_key(Path(sys.argv[1]))
