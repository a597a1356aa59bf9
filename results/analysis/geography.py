"""GeoJSON (RFC 7946) of rocks whose place on Earth is known, and of the directions in which they topple."""

from collections.abc import Sequence
from typing import Any

from toppling.models.frames import compass_deg, horizontal_unit_vector
from toppling.results.analysis.directions import topple_rose
from toppling.results.analysis.side_by_side import Beside, on_earth

_ARROW_M = 100.0
"""Length of the line toward which all of a rock's topplings went."""


def geojson(rocks: Sequence[Beside]) -> dict[str, Any]:
    """The rocks whose place is known as points, with the columns of their table."""
    features = []
    for rock in rocks:
        if rock.place is not None:
            properties = {
                name: value for name, value in rock.row.items() if name not in ("longitude", "latitude")
            }
            features.append(_feature("Point", [rock.place], properties))
    return _collection(features)


def directions_geojson(rocks: Sequence[Beside]) -> dict[str, Any]:
    """Lines from each rock whose place is known toward where it toppled, as long as the share of its topplings.

    `length_m` of a line is `_ARROW_M` times the share of the topplings that went within half a petal of its azimuth.
    """
    found = []
    for rock in rocks:
        rose = topple_rose(rock.jobs) if rock.place is not None and len(rock.jobs) else None
        if rose is None:
            continue
        rose = rose[rose["toppled"] > 0]
        ends = on_earth(
            rock.run,
            _ARROW_M
            * rose["share_of_toppled"].to_numpy()[:, None]
            * horizontal_unit_vector(rose["azimuth_deg"])[:, :2],
        )
        for row, end in zip(rose.to_dict("records"), ends if ends is not None else (), strict=False):
            properties = {
                "rock": rock.name,
                **row,
                "toppled": int(row["toppled"]),
                "compass_deg": float(compass_deg(row["azimuth_deg"])),
                "length_m": _ARROW_M * row["share_of_toppled"],
            }
            found.append(_feature("LineString", [rock.place, end], properties))
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
