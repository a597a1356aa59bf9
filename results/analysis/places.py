"""Where a rock stands on Earth (WGS 84), by its atlas or by the coordinate system of its scan."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from toppling.results.reader import Run


def on_earth(run: Run, offsets_m: ArrayLike = ((0.0, 0.0),)) -> NDArray[np.float64] | None:
    """Longitude and latitude (n, 2) of places beside a rock; None where its place is not known.

    run: of the rock: its atlas, or the coordinate system of its scan, says where it stands.
    offsets_m: (n, 2), east and north of the rock's centre of mass, scene frame.
    """
    offsets = np.asarray(offsets_m, float)
    entry = run.entry
    if entry.get("longitude") is not None:
        from pyproj import Geod

        away = np.hypot(*offsets.T)
        bearing = np.rad2deg(np.arctan2(*offsets.T))
        longitude, latitude = (
            np.full(len(offsets), float(entry[name])) for name in ("longitude", "latitude")
        )
        longitude, latitude, _ = Geod(ellps="WGS84").fwd(longitude, latitude, bearing, away)
        return np.column_stack([longitude, latitude])
    codes = {one.get("epsg") for one in run.scene_report().get("files") or () if isinstance(one, dict)}
    rock = run.rock_m()
    if len(codes) != 1 or not isinstance(code := codes.pop(), int) or rock is None:
        return None
    from pyproj import CRS, Transformer
    from pyproj.exceptions import ProjError

    try:
        system = CRS.from_epsg(code)
        own = (np.array(rock[:2]) + offsets) / system.axis_info[0].unit_conversion_factor
        found = np.column_stack(Transformer.from_crs(system, 4326, always_xy=True).transform(*own.T))
    except ProjError:
        return None
    return found if np.isfinite(found).all() else None
