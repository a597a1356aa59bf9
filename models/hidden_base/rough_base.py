"""Draws of the base of a known mesh on a plane: three points carry there, and no mesh is right to a millimetre.

The lowest part of the mesh is displaced along the plane's normal by smooth noise, as large and as long as what is known
of the mesh's errors (accuracy of photogrammetry, differences of two meshes of one rock, roughness of seen faces). The
rock is then let down on the plane, exactly and without speed, and the base is kept if the rock stands on it as it was
seen to stand. No outcome of a shaking is used.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.arrays import Array
from toppling.models.errors import InputError, check_positive
from toppling.models.frames import plane_axes
from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase, feet_above_m, least_feet
from toppling.models.scene import Scene
from toppling.models.statics import CONTACT_SHARE_OF_HEIGHT, at_rest, quasi_static_toppling_m_s2

_WAVES = 96
"""Number of waves of which the noise is made."""
_SPREAD_OF_WAVENUMBERS = 0.3
"""Standard deviation of a wave's number over that of the wavelength asked for."""
_FADES_OVER = 0.25
"""Share of the band, at its top, in which the noise fades to nothing."""
_LEAST_SHARE_THAT_STANDS = 0.005
"""Share of the bases tried; below it the rock hardly ever stands."""
TOLERANCE_SHARE = 0.05
"""Tolerance of contact points on a draw, over the noise's standard deviation."""


@dataclass(frozen=True)
class Standing:
    """Known attitude and contacts of the rock before it was shaken."""

    # How well the mesh's pose gives the pose in which the rock stood: of a base that tilts the rock by more
    # than this fewer are kept (normal distribution). Infinite if the mesh's attitude says nothing.
    attitude_std_deg: float = 1.0
    # Horizontal acceleration, of any azimuth, slowly applied, that the rock is known to have borne: by itself
    # it stood under 0, and through a weak shaking under about half of its peak.
    least_toppling_m_s2: float = 0.0


_AS_SCANNED = Standing()


def with_rough_base(
    scene: Scene,
    *,
    std_m: tuple[float, float],
    wavelength_m: float,
    band_m: float,
    draws: int = 32,
    standing: Standing = _AS_SCANNED,
    com_std_m: float = 0.0,
    tolerance_share: float = TOLERANCE_SHARE,
    seed: int = 0,
    progress: Callable[[int], None] = lambda _: None,
) -> Scene:
    """A scene of a mesh on an endless plane, with draws of its base.

    Parameters
    ----------
    scene : Scene
    std_m : (float, float)
        Standard deviation of the error of the mesh near its base: between these, its logarithm as likely anywhere.
    wavelength_m : float
        Dominant wavelength of that error.
    band_m : float
        Height over the plane up to which the mesh is displaced.
    draws : int
    standing : Standing
    com_std_m : float
        Of each coordinate of the centre of mass.
    tolerance_share : float
        Feet are left out while the hull of the others stays within this share of the noise's standard deviation.
    seed : int
        The same seed gives the same draws.
    progress : callable
        Told the number of draws so far.

    Returns
    -------
    Scene
        With `unseen`: the bases of a campaign's realisations.

    Raises
    ------
    InputError
        If the pedestal is no plane, a length is none, or the rock hardly ever stands on such bases.
    """
    _check(scene, std_m, wavelength_m, band_m, draws)
    random = np.random.default_rng([2029, seed])
    found: list[BaseDraw] = []
    tried = 0
    while len(found) < draws:
        if tried * _LEAST_SHARE_THAT_STANDS > max(draws, len(found), 1):
            raise InputError(
                "base.hardly_stands",
                f"of {tried} bases with noise of {std_m[0]:g} to {std_m[1]:g} m the rock stands on {len(found)}",
                where=f"scene {scene.id}",
                expected=f"a rock that stands on at least {_LEAST_SHARE_THAT_STANDS:.1%} of its possible bases",
                remedy="give a smaller standard deviation, a larger attitude_std_deg or a smaller "
                "least_toppling_m_s2, or turn the mesh to the pose in which the rock stood",
            )
        tried += 1
        noise, shift_m = _Noise.drawn(std_m, wavelength_m, random), com_std_m * random.normal(size=3)
        chance = float(random.random())
        draw = _let_down(scene, noise, band_m, shift_m, tolerance_share * noise.std_m)
        if draw is not None and _stood(scene, UnseenBase(band_m, (draw,)), standing, chance):
            found.append(draw)
            progress(len(found))
    return dataclasses.replace(scene, unseen=UnseenBase(band_m, tuple(found)))


_POSITIVE = "a positive number"
_REMEDY = "for a mesh from photographs: some 0.0005 to 0.003 m of error over 0.15 m in the lowest 0.08 m"


@dataclass(frozen=True, eq=False)
class _Noise:
    """A sum of plane waves in space: a smooth random field of heights."""

    wave_rad_m: Array
    phase_rad: Array
    std_m: float

    @classmethod
    def drawn(cls, std_m: tuple[float, float], wavelength_m: float, random: np.random.Generator) -> _Noise:
        """Draw one; the logarithm of its standard deviation is as likely anywhere between two."""
        deviation_m = float(np.exp(random.uniform(*np.log(std_m))))
        direction = random.normal(size=(_WAVES, 3))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        length = 1.0 + _SPREAD_OF_WAVENUMBERS * random.normal(size=(_WAVES, 1))
        phase = random.uniform(0.0, 2.0 * np.pi, _WAVES)
        return cls(2.0 * np.pi / wavelength_m * length * direction, phase, deviation_m)

    def __call__(self, points_m: Array) -> Array:
        return (
            self.std_m
            * float(np.sqrt(2.0 / _WAVES))
            * np.cos(points_m @ self.wave_rad_m.T + self.phase_rad).sum(axis=1)
        )


def _let_down(
    scene: Scene, noise: _Noise, band_m: float, com_offset_m: Array, tolerance_m: float
) -> BaseDraw | None:
    """The base under one noise, the rock at rest on it; None if it falls."""
    rock, pedestal = scene.rock, scene.pedestal
    frame = np.vstack([*plane_axes(pedestal.normal), pedestal.normal])
    flat = (rock.vertices_m - pedestal.point_m) @ frame.T
    low = flat[flat[:, 2] < band_m]
    fade = np.clip((band_m - low[:, 2]) / (_FADES_OVER * band_m), 0.0, 1.0)
    low = low + np.column_stack([np.zeros((len(low), 2)), fade * noise(low)])
    high_m = feet_above_m(rock, pedestal, band_m)
    high = (high_m - pedestal.point_m) @ frame.T
    com_m = rock.com_m + com_offset_m
    feet = least_feet(low, high, (com_m - pedestal.point_m) @ frame.T, tolerance_m)
    feet_m = np.vstack([feet @ frame + pedestal.point_m, high_m])
    rough = dataclasses.replace(rock, com_m=com_m, feet_m=feet_m)
    rest = at_rest(rough, pedestal, scene.gravity_m_s2)
    if rest is None:
        return None
    turn, shift = rest
    settled = ((feet @ frame + pedestal.point_m) @ turn.T + shift - pedestal.point_m) @ frame.T
    touching = settled[:, 2] < 2.0 * CONTACT_SHARE_OF_HEIGHT * rock.height_m
    settled[touching, 2] = 0.0
    return BaseDraw(settled, com_offset_m, Rotation.from_matrix(turn).as_rotvec(), shift)


def _stood(scene: Scene, base: UnseenBase, standing: Standing, chance: float) -> bool:
    """Whether the rock stands on a base as it was seen to."""
    draw = base.draws[0]
    if chance > np.exp(-0.5 * (draw.tilt_deg / standing.attitude_std_deg) ** 2):
        return False
    rock, least_m_s2 = base.realised(scene.rock, scene.pedestal, 0), standing.least_toppling_m_s2
    azimuths = np.arange(0.0, 360.0, 15.0) if least_m_s2 > 0.0 else (0.0,)
    # One after the other: most bases that fail do so toward the first few azimuths.
    return all(
        quasi_static_toppling_m_s2(rock, scene.pedestal, scene.gravity_m_s2, (azimuth,))[0][1] > least_m_s2
        for azimuth in azimuths
    )


def _check(scene: Scene, std_m: tuple[float, float], wavelength_m: float, band_m: float, draws: int) -> None:
    if not scene.pedestal.is_plane:
        raise InputError(
            "base.pedestal_is_scanned",
            "the pedestal is a scanned surface",
            where=f"scene {scene.id}",
            expected="a mesh on an endless plane",
            remedy="'toppling scan' draws the bases of scanned rocks; make this scene with Scene.from_mesh",
        )
    for deviation_m in std_m:
        check_positive("with_rough_base", _POSITIVE, _REMEDY, std_m=deviation_m)
    check_positive(
        "with_rough_base", _POSITIVE, _REMEDY, wavelength_m=wavelength_m, band_m=band_m, draws=draws
    )
