"""Which reader a file needs, by its first bytes."""

from pathlib import Path
from typing import Any, Protocol

from toppling.models.motions.formats import columns, cosmos, geonet, peer, seismic, smc, volumes
from toppling.models.motions.formats.component import Component, refuse
from toppling.models.motions.formats.keyed import cwb, esm, unam


class Reader(Protocol):
    """What a module or class of a text format gives."""

    NAME: str

    def recognises(self, head: str, /) -> bool:
        """Whether a file that begins so is of this format."""

    def read(self, path: Path, text: str, /) -> list[Component]:
        """Read all channels of acceleration."""


TEXT_FORMATS: tuple[Reader, ...] = (peer, geonet, cosmos, smc, volumes, esm, unam, cwb, columns)
"""In the order in which they are tried."""
HEAD_BYTES = 4000


def read_file(path: Path, inventory: Any | None = None) -> list[Component]:
    """Channels of a file.

    Parameters
    ----------
    path : Path
    inventory : obspy.Inventory or None
        Responses for the formats that hold counts.

    Raises
    ------
    InputError
        If no reader knows the format, or the file is damaged: with file and line.
    """
    content = path.read_bytes()
    if not content.strip():
        refuse("the file is empty", path, expected="a record", remedy="fetch the file again")
    text = content.decode("utf-8-sig", errors="replace") if b"\0" not in content[:HEAD_BYTES] else None
    if text is not None:
        for reader in TEXT_FORMATS:
            if reader.recognises(text[:HEAD_BYTES]):
                return _with_samples(reader.read(path, text), path)
    found = seismic.read(path, content, inventory)
    if found is None:
        names = ", ".join(reader.NAME for reader in TEXT_FORMATS)
        refuse(
            "the format is not known",
            path,
            expected=f"{names}, or a format that ObsPy reads",
            remedy="convert the file, or leave it out",
        )
    return _with_samples(found, path)


def _with_samples(components: list[Component], path: Path) -> list[Component]:
    for component in components:
        if len(component.acceleration_m_s2) < 2:
            refuse(
                f"{len(component.acceleration_m_s2)} samples",
                path,
                component.line,
                expected="at least two samples",
                remedy="fetch the file again",
            )
    if not components:
        refuse("no channel", path, expected="at least one channel", remedy="fetch the file again")
    return components
