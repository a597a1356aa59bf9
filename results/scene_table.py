"""The one row about a run's scene."""

from typing import Any

import pyarrow as pa

_SITE_COLUMNS = (
    ("rock", "", "name of the rock"),
    ("site", "", "name of its site"),
    ("longitude", "deg", "degrees east (WGS 84)"),
    ("latitude", "deg", "degrees north (WGS 84)"),
    ("age", "a", "years that the rock has stood, as its campaign states them"),
)


def scene_table(document: dict[str, Any], site: dict[str, Any]) -> pa.Table:
    """One row, of a scene document and of what a table of rocks says of it."""
    rock, plane, contact = document["rock"], document["interface"], document["contact"]
    statics = document["quasi_static_toppling_m_s2"]
    least = min((row["value"] for row in statics if row["value"] is not None), default=None)
    static, kinetic, bounce = (
        contact[name] for name in ("friction_static", "friction_kinetic", "restitution")
    )
    # fmt: off
    columns: list[tuple[str, Any, str, str]] = [
        ("scene_id", document["id"], "", "hash of the scene's content"),
        *((name, site[name], unit, text) for name, unit, text in _SITE_COLUMNS if site),
        ("height_m", rock["height_m"], "m", "vertical extent of the rock"),
        ("volume_m3", rock["volume_m3"], "m3", "volume of the rock"),
        ("com_x_m", rock["com_m"][0], "m", "centre of mass, east"),
        ("com_y_m", rock["com_m"][1], "m", "centre of mass, north"),
        ("com_z_m", rock["com_m"][2], "m", "centre of mass, up"),
        ("slope_deg", plane["slope_deg"], "deg", "slope of the interface plane"),
        ("downhill_azimuth_deg", plane["downhill_azimuth_deg"], "deg", "azimuth toward which the plane falls"),
        ("gravity_m_s2", document["gravity_m_s2"], "m/s2", "gravity"),
        ("default_friction_static", static, "1", "static friction of the scene; a campaign states its own"),
        ("default_friction_kinetic", kinetic, "1", "kinetic friction of the scene; a campaign states its own"),
        ("default_restitution", bounce, "1", "restitution of the scene; a campaign takes what it states, or 0"),
        ("least_quasi_static_m_s2", least, "m/s2", "least constant ground acceleration that topples"),
        ("quasi_static_toppling", statics, "deg, m/s2", "least toppling acceleration by azimuth of the ground's"),
    ]
    # fmt: on
    kinds = {"longitude": pa.float64(), "latitude": pa.float64(), "age": pa.string()}
    arrays = [pa.array([value], kinds.get(name)) for name, value, _, _ in columns]
    fields = [
        pa.field(name, array.type, metadata={"group": "scene", "unit": unit, "description": text})
        for (name, _, unit, text), array in zip(columns, arrays, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))
