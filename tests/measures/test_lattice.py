"""The lattice of depth values: planted constants are found, real cameras have the known ones."""

import numpy as np
import pytest

from glsim.measures.lattice import distinct_values, estimate_lattice, on_lattice
from tests.support.real_cameras import needs_real_cameras, real_depths


def _values(constant: float, low: int, high: int, keep: float = 1.0) -> np.ndarray:
    """Depths that a camera of this constant delivers between two limits, some left out."""
    steps = np.arange(1, int(constant / low) + 1)
    depth = np.unique(np.round(constant / steps))
    depth = depth[(depth >= low) & (depth <= high)]
    return depth[np.random.default_rng(5).random(depth.size) < keep]


@pytest.mark.parametrize(
    ("constant", "low", "high"),
    [(626_823.0, 300, 3200), (1_698_044.0, 600, 9000), (345_000.0, 500, 4000)],
)
def test_a_planted_constant_is_found(constant: float, low: int, high: int) -> None:
    lattice = estimate_lattice(_values(constant, low, high, 0.5))
    assert lattice.accepted
    assert lattice.share == 1.0
    assert lattice.constant == pytest.approx(constant, abs=constant / high * 0.2)


@pytest.mark.parametrize("phase", [0.3, 0.5, 0.8])
def test_a_planted_phase_is_found(phase: float) -> None:
    """A Kinect V1 delivers depths K / (n + phase), n whole: a head and a wall."""
    level = np.r_[180:230, 380:460]
    values = np.unique(np.round(345_160.0 / (level + phase)))
    lattice = estimate_lattice(values)
    assert lattice.accepted
    assert lattice.constant == pytest.approx(345_160.0, rel=5e-4)
    assert lattice.phase == pytest.approx(phase, abs=0.1)


def test_a_tenth_of_strange_depths_is_no_lattice() -> None:
    values = _values(626_823.0, 800, 3200)
    strange = np.setdiff1d(np.arange(1500, 3200), values)[:: 5_000 // values.size]
    mixed = np.concatenate([values, strange[: values.size // 8]])
    assert estimate_lattice(values).accepted
    assert not estimate_lattice(mixed).accepted


@pytest.mark.long
def test_other_depths_have_no_lattice() -> None:
    rng = np.random.default_rng(6)
    some = np.unique(rng.integers(400, 4000, 700)).astype(float)
    assert not estimate_lattice(some).accepted
    assert not estimate_lattice(np.arange(500.0, 3000.0)).accepted
    assert estimate_lattice(np.arange(500.0, 505.0)) is None
    for seed in range(12):  # few depths that lie on many lattices by chance, clusters and strays
        rng = np.random.default_rng(seed)
        few = rng.choice(np.arange(390, 873 + 100 * seed), 30, replace=False)
        walls = np.rint(np.r_[rng.normal(900, 9, 300), rng.normal(2000, 9, 300)])
        for values in (few, np.r_[walls, rng.integers(400, 4500, 30)]):
            lattice = estimate_lattice(np.unique(values).astype(float))
            assert lattice is None or not lattice.accepted, seed


def test_known_depths_on_a_lattice() -> None:
    values = np.array([901.0, 2000.0, 2003.0])
    assert on_lattice(values, 626_823.0).tolist() == [True, False, True]
    shifted = np.round(345_160.0 / (np.arange(250, 400) + 0.3))
    assert on_lattice(shifted, 345_160.0, 0.3).all()
    assert on_lattice(shifted, 345_160.0).mean() < 0.6


def test_distinct_values_leave_out_holes_and_clipped_depths() -> None:
    frames = [np.array([[0.0, 100.1], [6553.5, np.nan]]), np.array([[100.1, 100.0]])]
    assert distinct_values(frames, 0.1).tolist() == [1000.0, 1001.0]


@needs_real_cameras
@pytest.mark.parametrize(
    ("folder", "constant"),
    [
        ("d435_wall_2frames", 626_823),  # of the calibration in the file: 390.4315 x 50.1707
        ("d435_robot_room", 612_342),
        ("d405_bed", 3_734_873),  # files in 0.1 mm
        ("kinect_v1_tables", 345_160),  # 575.3 px x 75 mm x 8, phase 0.27
        ("azure_kinect_mug", 0),
        ("truedepth_zeiss/board_iPadPro12_4gen_iOS15", 0),
    ],
)
def test_real_cameras_have_the_known_constants_or_none(folder: str, constant: float) -> None:
    lattice = estimate_lattice(distinct_values(real_depths(folder)))
    assert lattice.accepted == (constant > 0)
    assert constant == 0 or lattice.constant == pytest.approx(constant, rel=5e-5)
