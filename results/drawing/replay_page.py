"""One shake seen closely: table, plots, a page that plays and a moving picture of the rock."""

from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq

from toppling.models.files.folder import new_file
from toppling.results.drawing.animation import moving_picture
from toppling.results.drawing.page import replay_page
from toppling.results.drawing.style import save
from toppling.results.drawing.trajectory_figures import trajectory_figure
from toppling.results.replayed_job import Replay, trajectory_table


def write_replay(replay: Replay, folder: Path, title: str) -> Iterator[Path]:
    """Write table (Parquet, CSV), plots (PNG, SVG), page and moving picture; yields each path once it is whole."""
    folder.mkdir(parents=True, exist_ok=True)
    table = trajectory_table(replay)
    frame = table.to_pandas()
    with new_file(folder / "trajectory.parquet") as hidden:
        pq.write_table(table, hidden, compression="zstd")
    yield folder / "trajectory.parquet"
    with new_file(folder / "trajectory.csv") as hidden:
        frame.to_csv(hidden, index=False, float_format="%.7g")
    yield folder / "trajectory.csv"
    figure = trajectory_figure(frame, replay.motion, title, replay.topple_time_s)
    yield from save(figure, folder / "trajectory")
    with new_file(folder / "replay.html") as hidden:
        hidden.write_text(replay_page(replay, title), encoding="utf-8")
    yield folder / "replay.html"
    with new_file(folder / "replay.gif") as hidden:
        moving_picture(replay, hidden, title)
    yield folder / "replay.gif"
