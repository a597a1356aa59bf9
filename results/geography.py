"""Where rocks stand on Earth (WGS 84), and GeoJSON (RFC 7946) of them and of the directions in which they topple."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from toppling.models.frames import compass_deg, horizontal_unit_vector
from toppling.results.directions import topple_rose
from toppling.results.run import Run

if TYPE_CHECKING:
    from toppling.results.side_by_side import Beside

ARROW_M = 100.0
"""Length of the line toward which all of a rock's topplings went."""


def on_earth(run: Run, offsets_m: ArrayLike = ((0.0, 0.0),)) -> NDArray[np.float64] | None:
    """Longitude and latitude (n, 2) of places beside a rock; None where its place is not known.

    Parameters
    ----------
    run : Run
        Of the rock: its atlas, or the coordinate system of its scan, says where it stands.
    offsets_m : (n, 2) array
        East and north of the rock's centre of mass, scene frame.
    """
    offsets = np.asarray(offsets_m, float)
    told = run.told
    if told.get("longitude") is not None:
        from pyproj import Geod

        away = np.hypot(*offsets.T)
        bearing = np.rad2deg(np.arctan2(*offsets.T))
        longitude, latitude = (np.full(len(offsets), float(told[name])) for name in ("longitude", "latitude"))
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


def geojson(rocks: Sequence["Beside"]) -> dict[str, Any]:
    """The rocks whose place is known as points, with the columns of their table."""
    features = []
    for rock in rocks:
        if rock.place is not None:
            told = {name: value for name, value in rock.row.items() if name not in ("longitude", "latitude")}
            features.append(_feature("Point", [rock.place], told))
    return _collection(features)


def directions_geojson(rocks: Sequence["Beside"]) -> dict[str, Any]:
    """Lines from each rock whose place is known toward where it toppled, as long as the share of its topplings.

    `length_m` of a line is `ARROW_M` times the share of the topplings that went within half a petal of its azimuth.
    """
    found = []
    for rock in rocks:
        rose = topple_rose(rock.jobs) if rock.place is not None and len(rock.jobs) else None
        if rose is None:
            continue
        rose = rose[rose["toppled"] > 0]
        ends = on_earth(
            rock.run,
            ARROW_M
            * rose["share_of_toppled"].to_numpy()[:, None]
            * horizontal_unit_vector(rose["azimuth_deg"])[:, :2],
        )
        for row, end in zip(rose.to_dict("records"), ends if ends is not None else (), strict=False):
            told = {
                "rock": rock.name,
                **row,
                "toppled": int(row["toppled"]),
                "compass_deg": float(compass_deg(row["azimuth_deg"])),
                "length_m": ARROW_M * row["share_of_toppled"],
            }
            found.append(_feature("LineString", [rock.place, end], told))
    return _collection(found)


def _feature(kind: str, places: Sequence[Any], properties: dict[str, Any]) -> dict[str, Any]:
    points = [[round(float(one), 7) for one in place] for place in places]
    coordinates = points[0] if kind == "Point" else points
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": properties,
    }


def _collection(features: list[dict[str, Any]]) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": features}
