"""Check the benchmark of wrong pixels: their definition, the trees' inputs and the table."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.midair import View, bound_of, by_trees, features, row


def view(seed: int) -> View:
    """Make a disc at 900 mm that is measured 2 px too wide, with 960 mm in that band."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:64, :64]
    away_px = np.hypot(rows - 32, columns - 32)
    clean = np.where(away_px < 20, 900.0, 0.0)
    frames = []
    for _ in range(5):
        noisy = np.where(away_px < 22, clean + rng.normal(0, 2, clean.shape), 0)
        frames.append(np.where((away_px >= 20) & (away_px < 22), 960.0, noisy))
    infrared = np.where(away_px < 20, 1000.0, 50.0)
    stack = np.asarray(frames, np.float32)
    return View(stack[-1], clean.astype(np.float32), infrared.astype(np.float32), stack[:-1])


def test_wrong_pixels_and_the_ring_are_those_of_the_truth() -> None:
    seen = view(1)
    outside = (seen.depth_mm > 0) & (seen.clean_mm == 0)
    np.testing.assert_array_equal(seen.wrong, outside)
    assert not (seen.ring & seen.wrong).any()
    assert 100 < np.count_nonzero(seen.ring) < 160  # about 2 pi 20
    assert (seen.near_rims | ~seen.ring).all()
    moved = seen._replace(clean_mm=np.where(seen.clean_mm > 0, seen.clean_mm - 60, 0))
    np.testing.assert_array_equal(moved.wrong, seen.depth_mm > 0)


@pytest.mark.parametrize(("infrared", "earlier", "count"), [(0, 0, 94), (1, 0, 146), (1, 1, 177)])
def test_what_trees_see(infrared: int, earlier: int, count: int) -> None:
    seen = view(2)
    table = features(seen, seen.near_rims, infrared=bool(infrared), earlier=bool(earlier))
    assert table.shape == (np.count_nonzero(seen.near_rims), count)
    assert np.isfinite(table[:, 0]).all()


def test_trees_find_what_can_be_told() -> None:
    training, judged = [view(n) for n in range(6)], [view(n) for n in (10, 11)]
    doubt = by_trees(training, judged, infrared=False, earlier=False)
    bound = bound_of(doubt, judged)
    measured = [v.depth_mm for v in judged]
    kept = [np.where(d <= bound, m, 0) for m, d in zip(measured, doubt, strict=True)]
    assert row("input", measured, judged) == f"| input | {judged[0].wrong.sum()} | 0 | 0.0 % |"
    name, wrong, _, ring = row("trees", kept, judged).strip("| ").split(" | ")
    assert (name, wrong) == ("trees", "0")
    assert float(ring.split()[0]) <= 5.0


def test_a_pixel_moved_onto_the_right_surface_is_not_wrong_and_a_moved_right_one_is_lost() -> None:
    seen = view(3)._replace(clean_mm=np.full((64, 64), 900, np.float32))
    assert seen.wrong.any()
    mended = np.where(seen.wrong, np.float32(900), seen.depth_mm)
    assert row("mended", [mended], [seen]) == "| mended | 0 | 0 | 0.0 % |"
    mended[32, 32] = 960
    assert row("spoilt", [mended], [seen]) == "| spoilt | 1 | 1 | 0.0 % |"
