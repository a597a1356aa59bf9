"""Readers, one file format a module. The format is found by content; nothing here knows what a record is."""

from toppling.models.motions.formats.reading import read_file

__all__ = ["component", "read_file", "record_text", "response", "units"]
