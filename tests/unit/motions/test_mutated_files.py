"""A damaged file gives a sound record or an error that says what and where; nothing else, ever."""

from pathlib import Path

import numpy as np
import pytest
from motion_samples import WRITERS, shaking

from toppling.models.motions.importing import ImportOptions, import_records
from toppling.models.motions.metadata import read_table

FEW, MANY = 8, 60
"""Mutations of each format: a sample every time, more than a thousand with the slow tests."""


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    data = bytearray(content)
    kind = rng.integers(7)
    at = int(rng.integers(len(data))) if rng.random() < 0.5 else int(rng.integers(min(len(data), 3000)))
    length = int(rng.integers(1, 60))
    if kind == 0:
        return bytes(data[:at])
    if kind == 1:
        del data[at : at + length]
    elif kind == 2:
        data[at : at + length] = rng.integers(0, 256, length, dtype=np.uint8).tobytes()
    elif kind == 3:
        data[at:at] = data[at : at + length]
    elif kind == 4:
        data[at : at + 1] = rng.choice([b"NaN", b"-", b"1e400", b"\n", b" ", b"9", b".", b"*******", b"0"])
    elif kind == 5:  # a line twice, or one less
        lines = bytes(data).split(b"\n")
        line = int(rng.integers(len(lines)))
        lines[line : line + 1] = [lines[line]] * int(rng.integers(0, 3))
        return b"\n".join(lines)
    else:  # one digit for another
        digits = [i for i, byte in enumerate(data[:4000]) if 48 <= byte <= 57]
        if digits:
            data[digits[int(rng.integers(len(digits)))]] = 48 + int(rng.integers(10))
    return bytes(data)


def is_sound(record) -> bool:
    motion = record.motion
    return (
        np.isfinite(motion.acceleration_m_s2).all()
        and motion.time_step_s > 0
        and all(np.isfinite(value) for value in record.intensity.values())
        and record.intensity["pga_m_s2"] <= 5 * 9.80665 * np.sqrt(2)
    )


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", WRITERS)
def test_a_mutated_file_gives_a_sound_record_or_a_clear_error(name, count, tmp_path):
    rng = np.random.default_rng(sum(name.encode()) + count)
    files: list[Path] = [f for f in WRITERS[name](tmp_path, shaking(150)) if f.name != "table.csv"]
    table = read_table(tmp_path / "table.csv") if (tmp_path / "table.csv").exists() else []
    original = {path: path.read_bytes() for path in files}
    for _ in range(count):
        victim = files[int(rng.integers(len(files)))]
        victim.write_bytes(mutated(original[victim], rng))
        outcome = import_records(files, table, ImportOptions(process=False))
        assert all(is_sound(record) for record in outcome.records)
        assert outcome.records or outcome.refusals
        for refusal in outcome.refusals:
            assert refusal.reason.where
            assert refusal.reason.remedy
        victim.write_bytes(original[victim])
