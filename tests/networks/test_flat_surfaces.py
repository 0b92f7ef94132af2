"""Walls are held to their planes beside holes; heads and real relief stay as the network has it."""

import numpy as np

from glsim.networks.composites import UNLIKELY, beside_holes
from glsim.networks.flat_surfaces import held_to_planes

_Y, _X = np.mgrid[:96, :97].astype(np.float32)
_WALL_MM = np.where((_X > 40) & (_X < 50), 0, 1e6 / (600 + 0.3 * _X - 0.2 * _Y)).astype(np.float32)
_SURE = np.ones_like(_WALL_MM)
_NOISE_MM = np.random.default_rng(0).normal(0, 2, _WALL_MM.shape).astype(np.float32)


def test_ghosts_beside_a_hole_are_laid_onto_the_wall_and_what_lies_behind_is_unlikely() -> None:
    noisy = np.where(_WALL_MM > 0, _WALL_MM + _NOISE_MM, 0)
    ghost = (noisy > 0) & beside_holes(noisy)
    noisy[20:23, 39] += 60
    network = np.where(ghost, _WALL_MM - 6, _WALL_MM)
    network[20:23, 39] = noisy[20:23, 39]
    depth_mm, probability = held_to_planes(network, _SURE, noisy)
    assert np.abs(depth_mm - _WALL_MM)[ghost & (probability == 1)].max() < 0.5
    assert (probability == np.float32(UNLIKELY)).sum() == (probability[20:23, 39] < 1).sum() == 3


def test_a_head_and_a_plate_on_the_wall_stay() -> None:
    ball = 990 - np.sqrt(np.maximum(90**2 - (2.5 * (_X - 48)) ** 2 - (2.5 * (_Y - 48)) ** 2, 0))
    plate = (np.abs(_X - 34) < 7) & (np.abs(_Y - 50) < 8)
    for truth in (np.where(ball < 970, ball, 0), np.where(plate, _WALL_MM - 5, _WALL_MM)):
        noisy = np.where(truth > 0, truth + _NOISE_MM, 0).astype(np.float32)
        depth_mm, _ = held_to_planes(truth.astype(np.float32), _SURE, noisy)
        assert np.abs(depth_mm - truth)[plate | (_WALL_MM == 0)].max() < 0.1
