"""One shake seen closely: table, plots, a page that plays and a moving picture of the rock's way."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pyarrow.parquet as pq

from results import figures
from results.animation import moving_picture, page
from results.way import Way, way_table


def write_way(way: Way, folder: Path, title: str) -> Iterator[Path]:
    """Write table (Parquet, CSV), plots (PNG, SVG), page and moving picture; yields each path once it is whole."""
    folder.mkdir(parents=True, exist_ok=True)
    table = way_table(way)
    frame = table.to_pandas()
    yield _whole(folder / "trajectory.parquet", lambda path: pq.write_table(table, path, compression="zstd"))
    yield _whole(folder / "trajectory.csv", lambda path: frame.to_csv(path, index=False, float_format="%.7g"))
    yield from figures.save(
        figures.way_figure(frame, way.motion, title, way.topple_time_s), folder / "trajectory"
    )
    yield _whole(folder / "replay.html", lambda path: path.write_text(page(way, title), encoding="utf-8"))
    yield _whole(folder / "replay.gif", lambda path: moving_picture(way, path))


def _whole(target: Path, write: Callable[[Path], object]) -> Path:
    """Write a file that appears complete or not at all."""
    hidden = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        write(hidden)
        hidden.replace(target)
    finally:
        hidden.unlink(missing_ok=True)
    return target
