"""One shake seen closely: table, plots, a page that plays and a moving picture of the rock's way."""

from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq

from toppling.models.folder import new_file
from toppling.results.drawing import figures
from toppling.results.drawing.animation import moving_picture, page
from toppling.results.replay import Way, way_table


def write_way(way: Way, folder: Path, title: str) -> Iterator[Path]:
    """Write table (Parquet, CSV), plots (PNG, SVG), page and moving picture; yields each path once it is whole."""
    folder.mkdir(parents=True, exist_ok=True)
    table = way_table(way)
    frame = table.to_pandas()
    with new_file(folder / "trajectory.parquet") as hidden:
        pq.write_table(table, hidden, compression="zstd")
    yield folder / "trajectory.parquet"
    with new_file(folder / "trajectory.csv") as hidden:
        frame.to_csv(hidden, index=False, float_format="%.7g")
    yield folder / "trajectory.csv"
    yield from figures.save(
        figures.way_figure(frame, way.motion, title, way.topple_time_s), folder / "trajectory"
    )
    with new_file(folder / "replay.html") as hidden:
        hidden.write_text(page(way, title), encoding="utf-8")
    yield folder / "replay.html"
    with new_file(folder / "replay.gif") as hidden:
        moving_picture(way, hidden)
    yield folder / "replay.gif"
