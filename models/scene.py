"""A scene: rock, pedestal, contact and gravity, with an identity that is the hash of its content."""

import contextlib
import dataclasses
import hashlib
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from toppling.models.arrays import Array
from toppling.models.caching import Described
from toppling.models.errors import InputError, check_positive, refusals
from toppling.models.files import digest
from toppling.models.files.documents import finite, shown
from toppling.models.files.folder import instead, local, new_folder
from toppling.models.files.mesh_files import MeshLike, read_triangles, remarks_of, triangles_of, write_ply
from toppling.models.files.schemas import BASES, SCHEMA_VERSION, digests_of_scene, read_own
from toppling.models.frames import STANDARD_GRAVITY_M_S2, azimuth_of, quadrant_of, rotation_between
from toppling.models.hidden_base.unseen_base import UnseenBase
from toppling.models.lengths import check_remarks, metres_in, too_large
from toppling.models.pedestal import ContactProperties, Pedestal
from toppling.models.rock import Rock, check_size, joined_mesh, mesh_error, nearby_origin_m
from toppling.models.rounded_base import RoundedBase, refined, rounded_base_of
from toppling.models.shapes import box
from toppling.models.statics import Limits, quasi_static_toppling_m_s2, slides_m_s2

if TYPE_CHECKING:
    from toppling.models.ground.body import GroundedBody
    from toppling.models.ground.plane import GroundKind

COM_SPREAD_SHARE = 0.005
"""Default standard deviation of the centre of mass in a realisation, as a fraction of the rock's height."""

_scene_error = refusals(
    expected=f"a scene folder of schema version {SCHEMA_VERSION}, as written",
    remedy="make the scene anew with 'toppling scan' or Scene.save",
)


@dataclass(frozen=True, eq=False, repr=False)
class Scene(Described):
    """A rock on its pedestal.

    Local frame: x east, y north, z up, metres. The rock's mesh is in its pose at the start.

    Parameters
    ----------
    rock : Rock
    pedestal : Pedestal
    contact : ContactProperties
        Defaults that a campaign's values replace.
    gravity_m_s2 : float
    origin_m : (3,) array
        Survey coordinates of the local origin.
    report : mapping
        Report of the scan (interface, uncertainty, fractions of the surface seen and invented ...), without influence
        on the motion or the id, except for the uncertainty of the centre of mass.
    unseen : UnseenBase or None
        Draws of the hidden base for realisations. If one of them is nominal, the rock has its feet.
    """

    rock: Rock
    pedestal: Pedestal
    contact: ContactProperties = field(default_factory=ContactProperties)
    gravity_m_s2: float = STANDARD_GRAVITY_M_S2
    origin_m: Array = field(default_factory=lambda: np.zeros(3))
    report: Mapping[str, Any] = field(default_factory=dict)
    unseen: UnseenBase | None = None

    def __post_init__(self) -> None:
        unseen = self.unseen
        if unseen is not None and unseen.nominal is not None and self.rock.feet_m is None:
            object.__setattr__(self, "rock", unseen.on_feet_of(self.rock, self.pedestal, unseen.nominal))

    def _facts(self) -> dict[str, object]:
        contact, plane = self.contact, self.pedestal
        return {
            "height": f"{self.rock.height_m:.3g} m",
            "volume": f"{self.rock.volume_m3:.3g} m³",
            "interface dips": f"{plane.slope_deg:.3g}° toward {quadrant_of(plane.downhill_azimuth_deg)}",
            "friction": f"{contact.friction_static:g} static, {contact.friction_kinetic:g} kinetic",
            "drawn bases": 0 if self.unseen is None else len(self.unseen),
        }

    @classmethod
    def block(
        cls,
        half_width: float,
        half_depth: float,
        half_height: float,
        friction: float | Sequence[float] = 0.8,
        restitution: float = 0.0,
        gravity: float = STANDARD_GRAVITY_M_S2,
    ) -> "Scene":
        """Rectangular block on a level plane.

        Parameters
        ----------
        half_width, half_depth, half_height : float
            Half of the block's size along x, y and z, metres.
        friction : float or pair of float
            Coulomb coefficient, or (static, kinetic).
        restitution : float
            Poisson's coefficient, 0 to 1: impulse of restitution over that of compression.
        gravity : float
            m/s2.
        """
        check_positive(
            "Scene.block", "a positive length in metres", "give half of the block's size",
            half_width=half_width, half_depth=half_depth, half_height=half_height,
        )  # fmt: skip
        rock = box(half_width, half_depth, half_height).moved(np.eye(3), (0.0, 0.0, half_height))
        return cls(
            rock, Pedestal.sloping(0.0, 0.0), ContactProperties.of(friction, restitution), _gravity(gravity)
        )

    @classmethod
    def from_mesh(
        cls,
        mesh: MeshLike,
        friction: float | Sequence[float] = 0.8,
        restitution: float = 0.0,
        slope_deg: float = 0.0,
        slope_azimuth_deg: float | str = 0.0,
        gravity: float = STANDARD_GRAVITY_M_S2,
        pedestal: MeshLike | None = None,
        refine: bool = False,
        units: str | None = None,
    ) -> "Scene":
        """Closed mesh on a plane, or on a given surface.

        The mesh keeps its attitude relative to the plane: one with z up stands perpendicular to the slope. It is
        shifted along the plane's normal until its lowest point touches. One in survey coordinates is moved to a local
        origin, the scene's `origin_m`.

        Parameters
        ----------
        mesh : path, pair of (n, 3) vertices and (m, 3) triangles, or trimesh.Trimesh
        friction, restitution, gravity
            As for :meth:`block`.
        slope_deg : float
            Slope of the plane, 0 to below 90 degrees.
        slope_azimuth_deg : float or str
            Azimuth or bearing toward which the plane falls.
        pedestal : as mesh, optional
            The surface below and around the rock, in the rock's frame; the rock is shifted vertically until it touches.
        refine : bool
            Whether the triangles of a rounded base are refined. By default it touches with the smooth surface that its
            vertices stand for, whatever their number, unless it is curved in one direction only.
        units : str, optional
            Unit of the coordinates: m, mm, cm, ft, ... If not given, that stated in the file, else metres; then a rock
            larger than any known precarious one gets a UserWarning.

        Raises
        ------
        InputError
            If the file cannot be read as a mesh, the mesh is not one closed body or not of a rock's height, the plane
            is invalid, or the rock does not stand on the surface.
        """
        plane = Pedestal.sloping(slope_deg, azimuth_of(slope_azimuth_deg))
        rock, origin = _rock_of(mesh, units)
        rock = refined(rock) if refine else rock
        contact = ContactProperties.of(friction, restitution)
        if pedestal is None:
            return cls(_seated(rock, plane), plane, contact, _gravity(gravity), origin)
        placed = _on_surface(rock, pedestal, units, origin, _gravity(gravity), contact.friction_static)
        return cls(*placed, contact, gravity, origin)

    def with_contact(self, contact: ContactProperties) -> "Scene":
        """Scene with other contact properties."""
        return dataclasses.replace(self, contact=contact)

    def with_friction(self, friction: float) -> "Scene":
        """Scene with another friction, static and kinetic, and the same restitution."""
        return self.with_contact(ContactProperties.of(friction, self.contact.restitution))

    def on_base(self, number: int) -> "Scene":
        """Scene on one of the drawn bases, with its centre of mass, at rest in its pose."""
        count = len(self.unseen.draws) if self.unseen else 0
        if self.unseen is None or not 0 <= number < count:
            raise InputError(
                "scene.base_absent",
                f"base {number} of {count}",
                where="on_base",
                expected="the number, from 0, of a base that the scan drew",
                remedy="see len(scene.unseen.draws); a scene that is no scan's has no drawn bases",
            )
        rock = self.unseen.realised(self.rock, self.pedestal, number)
        return dataclasses.replace(self, rock=rock, unseen=dataclasses.replace(self.unseen, nominal=None))

    @property
    def com_std_m(self) -> Array | None:
        """Standard deviation (3,) of the centre of mass for realisations, if the scan states it."""
        spread = self.report.get("uncertainty", {}).get("com_std_m")
        return None if spread is None else np.array(spread, float)

    @cached_property
    def rounded_base(self) -> RoundedBase | None:
        """Rounded base of the rock, unless the base was drawn; else None."""
        drawn = self.unseen is not None or self.rock.feet_m is not None
        return None if drawn else rounded_base_of(self.rock)

    @property
    def rolls(self) -> bool:
        """Whether the rock touches with the smooth surface of a rounded base."""
        return self.rounded_base is not None and self.rounded_base.rolls

    @cached_property
    def ground(self) -> "GroundKind":
        """Whether the pedestal is the interface plane where the rock stands, or another surface, with the reason."""
        from toppling.models.ground.plane import GroundKind, kind_where_it_stands

        if self.pedestal.is_plane:
            return GroundKind(True, "the pedestal is an endless plane")
        if self.is_drawn_over_plane:
            return GroundKind(True, "its base is drawn over the interface plane")
        return kind_where_it_stands(self.rock, self.pedestal)

    @property
    def is_drawn_over_plane(self) -> bool:
        """Whether the base was drawn over the interface plane, rather than over the pedestal's surface."""
        return self.rock.feet_m is not None or (self.unseen is not None and self.unseen.vertices is None)

    @cached_property
    def grounded(self) -> "GroundedBody":
        """The rock on its pedestal's surface, each contact along its own normal."""
        from toppling.models.ground.body import grounded_body

        friction = (self.contact.friction_static, self.contact.friction_kinetic)
        band_m = -np.inf if self.unseen is None else self.unseen.band_m
        return grounded_body(self.rock, self.pedestal, self.gravity_m_s2, friction, self.rolls, band_m)

    def statics(self, ground_accelerates_toward_deg: Iterable[float | str]) -> list[Limits]:
        """Accelerations at which the rock tips and slides, by azimuths or bearings such as "N40E".

        By :mod:`toppling.models.statics` for a rock that stands on points over a plane, else by
        :mod:`toppling.models.tipping`, where one that does not stand by itself has zeros.
        """
        given = ground_accelerates_toward_deg
        azimuths = [azimuth_of(azimuth) for azimuth in ([given] if isinstance(given, str | Real) else given)]
        if self.rolls or not self.ground.is_plane:
            from toppling.models.tipping import limits_on_surface

            return limits_on_surface(self.grounded, tuple(azimuths))
        normal, g = self.pedestal.normal, self.gravity_m_s2
        tips = np.array([a for _, a in quasi_static_toppling_m_s2(self.rock, self.pedestal, g, azimuths)])
        slides = slides_m_s2(normal, g, self.contact.friction_static, np.array(azimuths))
        return list(map(Limits, azimuths, tips.tolist(), np.where(slides < tips, slides, np.inf).tolist()))

    def tips_m_s2(self, ground_accelerates_toward_deg: Iterable[float | str]) -> list[tuple[float, float]]:
        """Least constant horizontal ground acceleration that topples the rock without slip.

        Returns list of (ground_accelerates_toward_deg, acceleration_m_s2): 0 where the rock does not stand by itself,
        infinite where no acceleration topples it.
        """
        return [row[:2] for row in self.statics(ground_accelerates_toward_deg)]

    def slides_m_s2(self, ground_accelerates_toward_deg: Iterable[float | str]) -> list[tuple[float, float]]:
        """Least one at which static friction does not hold the rock before it tips; infinite where it does."""
        return [(row[0], row[2]) for row in self.statics(ground_accelerates_toward_deg)]

    quasi_static_toppling_m_s2 = tips_m_s2

    @cached_property
    def stated(self) -> list[Limits]:
        """Values for `scene.json`; on a surface an azimuth takes some hundredths of a second."""
        return self.statics(np.arange(0.0, 360.0, 5.0 if self.ground.is_plane and not self.rolls else 15.0))

    @cached_property
    def id(self) -> str:
        """Hash of all that affects the motion except the contact properties, which belong to the job."""
        hashed = hashlib.sha256()
        geometry = [self.rock.vertices_m, self.rock.faces, self.pedestal.point_m, self.pedestal.normal]
        if self.pedestal.vertices_m is not None and self.pedestal.faces is not None:
            geometry += [self.pedestal.vertices_m, self.pedestal.faces]
        if self.com_std_m is not None:
            geometry.append(self.com_std_m)
        if self.rock.feet_m is not None and (self.unseen is None or self.unseen.nominal is None):
            geometry.append(self.rock.feet_m)
        for array in geometry:
            canonical = np.ascontiguousarray(array, dtype="<f8" if array.dtype.kind == "f" else "<i8")
            hashed.update(repr(canonical.shape).encode())
            hashed.update(canonical.tobytes())
        hashed.update(repr(float(self.gravity_m_s2)).encode())
        if self.unseen is not None:
            hashed.update(self.unseen.digest)
        return hashed.hexdigest()[:20]

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write `scene.json`, `rock.ply`, `pedestal.ply` and the drawn bases, atomically.

        Raises
        ------
        FileExistsError
            If the folder exists already.
        """
        target = Path(folder)
        with new_folder(target) as staging:
            self.write_into(staging)
        return target

    def write_into(self, folder: Path) -> None:
        """Write the files of :meth:`save` to an existing folder."""
        write_ply(folder / "rock.ply", self.rock.vertices_m, self.rock.faces)
        write_ply(folder / "pedestal.ply", *self.pedestal_triangles())
        if self.unseen is not None:
            self.unseen.write(folder / BASES)
        digest.write_json(folder / "scene.json", self.to_json() | {"files": digests_of_scene(folder)})

    def to_json(self) -> dict[str, Any]:
        """Content of `scene.json`; infinite values (where no acceleration topples) are null."""
        slope, downhill = self.pedestal.slope_deg, self.pedestal.downhill_azimuth_deg
        interface = {
            "slope_deg": slope,
            "downhill_azimuth_deg": downhill,
            "point_m": self.pedestal.point_m.tolist(),
            "normal": self.pedestal.normal.tolist(),
        }
        report = {key: value for key, value in self.report.items() if key != "interface"}
        content = {
            "schema_version": SCHEMA_VERSION,
            "id": self.id,
            "origin_m": self.origin_m.tolist(),
            "gravity_m_s2": self.gravity_m_s2,
            "rock": {
                "mesh": "rock.ply",
                "volume_m3": self.rock.volume_m3,
                "com_m": self.rock.com_m.tolist(),
                "inertia_per_mass_m2": self.rock.inertia_per_mass_m2.tolist(),
                "height_m": self.rock.height_m,
            },
            "pedestal": {"mesh": "pedestal.ply", "kind": "plane" if self.pedestal.is_plane else "surface"},
            "interface": {**self.report.get("interface", {}), **interface},
            "contact": dataclasses.asdict(self.contact),
            "ground": dataclasses.asdict(self.ground),
            **({} if self.unseen is None else {"bases": {"file": BASES, "draws": len(self.unseen)}}),
            "quasi_static_toppling_m_s2": [
                {"azimuth_deg": azimuth, "value": tips, "slides_m_s2": slides}
                for azimuth, tips, slides in self.stated
            ],
            "report": report,
        }
        return finite(content)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> "Scene":
        """Read a scene's folder.

        Raises
        ------
        InputError
            If a file is missing, damaged or of another schema, or the content does not match its id.
        """
        source = local(folder)
        try:
            described = read_own(source)
        except (FileNotFoundError, NotADirectoryError):
            raise _scene_error("scene.absent", f"no scene.json{instead(source)}", source) from None
        rock = Rock.from_triangles(*read_triangles(source / "rock.ply"), where=str(source / "rock.ply"))
        surface: tuple[Any, Any] = (None, None)
        if described["pedestal"]["kind"] == "surface":
            surface = read_triangles(source / "pedestal.ply")
        plane, stated_id = described["interface"], described["id"]
        try:
            contact = ContactProperties(**described["contact"])
        except TypeError as error:
            what = f"contact is {shown(described['contact'])} ({error})"
            raise _scene_error("scene.contact_unusable", what, source) from None
        scene = cls(
            rock=rock,
            pedestal=Pedestal(np.array(plane["point_m"], float), np.array(plane["normal"], float), *surface),
            contact=contact,
            gravity_m_s2=float(described["gravity_m_s2"]),
            origin_m=np.array(described["origin_m"], float),
            report={**described["report"], "interface": plane},
            unseen=UnseenBase.read(source / BASES) if "bases" in described else None,
        )
        if scene.id != stated_id:
            raise _scene_error(
                "scene.changed",
                f"the content hashes to {scene.id}, scene.json says {stated_id}: a file was changed, or a "
                "program of another version wrote the scene",
                source,
            )
        return scene

    def pedestal_triangles(self) -> tuple[Array, NDArray[np.int64]]:
        """Vertices (n, 3) and triangles (m, 3) of the pedestal for display; a square for an infinite plane."""
        reach = 2.0 * float(np.linalg.norm(np.ptp(self.rock.vertices_m, axis=0)))
        return self.pedestal.triangles(self.pedestal.point_m, reach)


def _gravity(gravity: float) -> float:
    check_positive("scene", "a positive number in m/s2", "9.81 on Earth", gravity=gravity)
    return float(gravity)


def _rock_of(mesh: MeshLike, units: str | None) -> tuple[Rock, Array]:
    """Rock from a mesh, moved to a nearby origin (3,) if it is far from its own.

    units: unit of the coordinates; None for that of a trimesh object, or else metres, with a warning if the rock would
    be larger than any precarious rock.
    Raises InputError if the mesh is not a single closed body, or not of a rock's height.
    """
    vertices, faces, where, stated = _in_metres(mesh, units, "rock mesh")
    rock = Rock.from_triangles(vertices, faces, where=where)
    check_size(rock.height_m, where, "units")
    warning = "" if stated else too_large(rock.height_m, rock.volume_m3, "units")
    if warning:
        warnings.warn(f"{where}: {warning}. If they are in metres, give units='m'.", stacklevel=3)
    origin = nearby_origin_m(rock.vertices_m)
    return (rock.moved(np.eye(3), -origin) if origin.any() else rock), origin


def _seated(rock: Rock, plane: Pedestal) -> Rock:
    """Rock rotated from the level to a plane's slope, and shifted until its lowest point touches."""
    turned = rock.moved(rotation_between((0.0, 0.0, 1.0), plane.normal))
    lowest = float((turned.vertices_m @ plane.normal).min())
    return turned.moved(np.eye(3), -lowest * plane.normal)


def _on_surface(
    rock: Rock, pedestal: MeshLike, units: str | None, origin_m: Array, gravity_m_s2: float, friction: float
) -> tuple[Rock, Pedestal]:
    """Seat a rock, already moved to a local origin, on a surface given in the original frame."""
    from toppling.models.ground.interface import surface_below

    vertices, faces, where, _ = _in_metres(pedestal, units, "pedestal mesh")
    mesh = joined_mesh(vertices, faces, where)
    if len(mesh.faces) and not mesh.is_winding_consistent:
        raise mesh_error("mesh.not_oriented", "triangles are not consistently oriented", where)
    at_origin, triangles = np.array(mesh.vertices, float) - origin_m, np.array(mesh.faces, np.int64)
    return surface_below(rock, at_origin, triangles, gravity_m_s2, friction, where)


def _in_metres(mesh: MeshLike, units: str | None, what: str) -> tuple[ArrayLike, ArrayLike, str, str | None]:
    """Vertices in metres, triangles, name for error messages, and stated unit of a mesh."""
    vertices, faces, where = triangles_of(mesh, what)
    own = getattr(mesh, "units", None)  # such as trimesh's for some formats; files are taken in metres
    stated = units or (own if isinstance(own, str) else None)
    if not units and isinstance(mesh, str | os.PathLike):
        check_remarks(remarks_of(Path(mesh)), str(mesh))
    if stated:
        factor = metres_in(stated)
        with contextlib.suppress(TypeError, ValueError):  # invalid arrays are refused later
            vertices = factor * np.asarray(vertices, float)
    return vertices, faces, where, stated
