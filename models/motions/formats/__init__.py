"""Readers, one file format a module. The format is found by content; nothing here knows what a record is."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from toppling.models.errors import InputError
from toppling.models.files.given import HEAD_BYTES, LARGEST_DATA_BYTES, bytes_given, other_kind, text_of
from toppling.models.motions.formats import columns, cosmos, geonet, peer, seismic, smc, volumes
from toppling.models.motions.formats.component import (
    Component,
    check_samples,
    check_time_step,
    no_record,
    refuse_file,
)
from toppling.models.motions.formats.key_value import cwb, esm, unam
from toppling.models.motions.formats.record_text import RecordText
from toppling.models.motions.place import place_in_name

__all__ = ["component", "read_file", "record_text", "response", "units"]


class Reader(Protocol):
    """Interface of a module or class that reads a text format."""

    NAME: str

    def recognises(self, head: str, /) -> bool:
        """Whether a file that begins so is of this format."""

    def read(self, file: RecordText, /) -> list[Component]:
        """Read all channels of acceleration."""


_TEXT_FORMATS: tuple[Reader, ...] = (peer, geonet, cosmos, smc, volumes, esm, unam, cwb, columns)
"""Text formats in the order in which they are tried."""
_NO_RECORDS = (
    (rb"\s*<!doctype html|\s*<html", "a web page, such as of a login", "fetch the record itself again"),
    (rb"\s*<\?xml|\s*<", "XML other than StationXML", "give the record, or the StationXML of its station"),
    (rb"\s*[{\[]", "JSON", "export the record as text: time and acceleration in columns"),
)
"""Beginnings of files that are no records: what they are, and what to give instead."""
_LONGEST_LINE = 5000
"""Formats have lines of at most a few hundred characters, and searching endless ones for words is slow."""
_LARGEST_SAMPLE = 1e12
"""Largest sample in the file's unit: above the counts of any instrument; its square is far from overflow."""


def read_file(path: Path, inventory: Any | None = None) -> list[Component]:
    """Channels of a file.

    inventory: responses for the formats that hold counts.
    Raises InputError if no reader knows the format, or the file is damaged: with file and line.
    """
    content = bytes_given(path, no_record, LARGEST_DATA_BYTES)
    if not content.strip(b"\0\x1a \t\r\n"):
        refuse_file("file.empty", path, "the file is empty")
    text = text_of(content)
    reader = next((reader for reader in _TEXT_FORMATS if text and reader.recognises(text[:HEAD_BYTES])), None)
    if text is not None and reader is not None:
        return _checked(_read_text(reader, RecordText(path, text.splitlines())), path)
    head = content[:HEAD_BYTES]
    del content, text
    found = seismic.read(path, inventory)
    if found is None:
        if other := other_kind(head, _NO_RECORDS):
            refuse_file("record.format_not_read", path, f"the file is {other[0]}", remedy=other[1])
        names = ", ".join(reader.NAME for reader in _TEXT_FORMATS)
        remedy = "convert the file to columns under names such as 'Time (s),NS (cm/s2),EW (cm/s2),UD (cm/s2)'"
        refuse_file("record.format_unknown", path, "the format is not known",
            f"{names}, miniSEED, SAC, K-NET or Kinemetrics EVT", remedy)  # fmt: skip
    return _checked(found, path)


def _read_text(reader: Reader, file: RecordText) -> list[Component]:
    """Read by a reader that may meet anything: what it did not foresee is a damaged file too."""
    lengths = list(map(len, file.lines))
    if max(lengths) > _LONGEST_LINE:
        expected = f"{reader.NAME}, with lines of at most {_LONGEST_LINE} characters"
        file.refuse("file.line_too_long", lengths.index(max(lengths)),
            f"the line has {max(lengths)} characters", expected)  # fmt: skip
    try:
        return reader.read(file)
    except InputError:
        raise
    except (ArithmeticError, LookupError, TypeError, ValueError, AttributeError, MemoryError) as error:
        what = f"the file is damaged: it begins as {reader.NAME} and cannot be read so ({error})"
        refuse_file("record.damaged", file.path, what, "a whole file of one format")


def _checked(components: list[Component], path: Path) -> list[Component]:
    for number, component in enumerate(components):
        if component.place.free_field:
            components[number] = replace(component, place=place_in_name(component.station))
        a, step = component.acceleration_m_s2, component.time_step_s
        if len(a) < 2:
            component.refuse("record.too_few_samples", f"{len(a)} samples", "at least two samples")
        check_samples(a, component.label, component.where, _LARGEST_SAMPLE)
        if not math.isnan(step):
            check_time_step(step, component.where)
    if not components:
        refuse_file("record.no_channel", path, "no channel", "at least one channel")
    return components
