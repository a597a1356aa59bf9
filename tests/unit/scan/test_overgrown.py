"""Grass at a rock's foot is named: the interface is fitted to what was seen, and that is no surface there."""

import dataclasses

import numpy as np
import pytest

from toppling.models.scan.foot import overgrown
from toppling.models.scan.interface import Interface
from toppling.models.scan.interface_hint import hint_of
from toppling.models.scan.measure import ObservedRock
from toppling.models.scan.surfels import Surfels, roughness, thin

VOXEL_M = 0.01
LEVEL = Interface(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.eye(3), 0.0)


def drum_on(grass_m=0.0, noise_m=0.0, gravel_m=0.0):
    """A drum of 1 m on level ground, as patches: grass up to a height, noise, or ground of bumps 0.2 m wide."""
    random = np.random.default_rng(4)
    turn, rise = random.uniform(0.0, 2.0 * np.pi, 60_000), random.uniform(0.0, 1.0, 60_000)
    rock = np.column_stack([0.3 * np.cos(turn), 0.3 * np.sin(turn), rise])
    away = np.sqrt(random.uniform(0.3**2, 0.55**2, 60_000))
    ground = np.column_stack([away * np.cos(turn), away * np.sin(turn), np.zeros(60_000)])
    ground[:, 2] += gravel_m * np.sin(ground[:, 0] / 0.03) * np.sin(ground[:, 1] / 0.03)
    ground[::2, 2] += random.uniform(0.0, 1.0, 30_000) * grass_m
    points = np.vstack([rock, ground])
    points += random.normal(0.0, noise_m, points.shape)
    parts = [thin(part, VOXEL_M)[0] for part in np.split(points, 2)]
    patches = np.vstack(parts)
    is_rock = np.arange(len(patches)) < len(parts[0])
    surfels = Surfels(patches, np.zeros_like(patches), roughness(patches), VOXEL_M)
    return ObservedRock(rock, ground, rock[:0], ground[:0], surfels, is_rock, 1.0, None)


@pytest.mark.parametrize("grass_m", [0.05, 0.15])
def test_grass_at_the_foot_is_named_with_its_thickness(grass_m):
    doubt = overgrown(drum_on(grass_m), LEVEL)
    assert doubt is not None
    assert doubt.kind == "overgrown"
    thick = float(doubt.sentence.partition(" m thick")[0].rpartition(" ")[2])
    assert 0.5 * min(grass_m, 0.1) < thick <= grass_m  # farther from the interface nothing is looked at
    assert "--point" in doubt.sentence


@pytest.mark.parametrize("ground", [{}, {"noise_m": 0.004}, {"gravel_m": 0.01}])
def test_bare_ground_noise_and_bumps_are_no_grass(ground):
    assert overgrown(drum_on(**ground), LEVEL) is None


def test_where_the_user_says_where_the_two_meet_grass_does_not_matter():
    known = hint_of(plane=(0.0, 0.0, 0.0, 0.0, 0.0))
    assert overgrown(dataclasses.replace(drum_on(0.1), hint=known), LEVEL) is None
