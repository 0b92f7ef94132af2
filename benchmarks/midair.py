"""Estimate how many wrong pixels at silhouettes can be recognised, and from which images.

``python -m benchmarks.midair [SENSOR]`` simulates heads alone and before walls, trains boosted
trees to recognise wrong pixels (the truth has no depth there, or differs by more than 30 mm) by
the pixels around them, and prints how many wrong ones stay when 5 % of the outermost right ones
are lost: with depth alone, infrared, and earlier frames, beside the shipped network.
The trees know the sensor, which the network does not: the Bayes error is at most theirs.
"""

from __future__ import annotations

import argparse
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingClassifier

from glsim.denoise import load
from glsim.denoise.composites import composed
from glsim.pipeline import frames
from glsim.settings.schema import load_settings

Depth = NDArray[np.float32]
Mask = NDArray[np.bool_]

#: Frames of a sequence: four earlier ones and the one that is judged.
_FRAMES: Final = 5
#: A pixel is wrong if the truth is farther away than this, mm. Chosen: ten times the noise.
_WRONG_MM: Final = 30.0
#: Radius of the window that the trees see, px, and largest difference of depth in it, mm.
_REACH_PX, _MOST_MM = 4, 150.0
#: Distances of the heads, mm. Chosen: what every camera measures.
_DISTANCE_MM: Final = (700.0, 1050.0)
#: Share of the outermost right pixels that may be lost.
_RING_LOST: Final = 0.05
#: What the trees see: name -> (infrared, earlier frames).
_SEEN: Final = {
    "depth": (False, False),
    "depth, infrared": (True, False),
    "depth, earlier frames": (False, True),
    "depth, infrared, earlier frames": (True, True),
}


class View(NamedTuple):
    """The judged frame of a sequence and what was measured with and before it.

    depth_mm, clean_mm: (H, W), 0 = none. infrared: (H, W) counts. before_mm: (4, H, W).
    """

    depth_mm: Depth
    clean_mm: Depth
    infrared: Depth
    before_mm: Depth

    @property
    def near_rims(self) -> Mask:
        """Mask of measured pixels within 4 px of a hole or of a depth step above 30 mm."""
        reach = np.ones((2 * _REACH_PX + 1,) * 2, np.uint8)
        span = cv2.dilate(self.depth_mm, reach) - cv2.erode(self.depth_mm, reach)
        return np.asarray((self.depth_mm > 0) & (span > _WRONG_MM))

    @property
    def wrong(self) -> Mask:
        """Mask of measured pixels without true depth, or more than 30 mm off it."""
        return self.wrong_in(self.depth_mm)

    def wrong_in(self, shown_mm: Depth) -> Mask:
        """Mark measured pixels that have depth in another map, but no true one within 30 mm.

        Args:
            shown_mm: (H, W) depth map of the same view, mm, 0 = none.

        Returns:
            (H, W) bool.
        """
        apart = np.abs(shown_mm - self.clean_mm) > _WRONG_MM
        shown = (self.depth_mm > 0) & (shown_mm > 0)
        return np.asarray(shown & ((self.clean_mm == 0) | apart))

    @property
    def ring(self) -> Mask:
        """Mask of right pixels that touch a wrong pixel, a hole, or a step above 30 mm."""
        right = (self.depth_mm > 0) & ~self.wrong
        shown = np.where(right, self.depth_mm, 0)
        square = np.ones((3, 3), np.uint8)
        return np.asarray(
            right & (cv2.dilate(shown, square) - cv2.erode(shown, square) > _WRONG_MM)
        )


def views(
    sensor: str,
    subjects: int,
    seed: int,
    *,
    wall: bool,
    distance_mm: tuple[float, float] = _DISTANCE_MM,
) -> list[View]:
    """Simulate one view of each head: five frames of one device, in which nothing moves.

    Args:
        sensor: name of the sensor.
        subjects: number of heads.
        seed: of the heads, poses, devices and noise.
        wall: whether a wall stands 1.45 to 2.2 m from the camera.
        distance_mm: least and largest distance of the heads.
    """
    drawn: dict[str, Any] = {"per": "sequence"}
    scene = {"wall_mm": drawn | {"uniform": [1450, 2200]}} if wall else {}
    settings = load_settings(
        overrides={
            "seed": seed,
            "sensor": sensor,
            "redraw": "sequence",
            "devices": 4096,
            "source": {
                "kind": "procedural",
                "subjects": subjects,
                "frames_per_subject": _FRAMES,
                "frames_per_sequence": _FRAMES,
            },
            "pose": {
                "distance_mm": drawn | {"uniform": list(distance_mm)},
                "yaw_deg": drawn | {"uniform": [-40, 40]},
                "pitch_deg": drawn | {"uniform": [-15, 15]},
            },
            "scene": scene,
        }
    )
    made = list(frames(settings, layers=("clean", "noisy", "infrared")))
    found = []
    for first in range(0, len(made), _FRAMES):
        *before, last = made[first : first + _FRAMES]
        depth, clean, light = (
            np.asarray(image, np.float32) for image in (last.noisy, last.clean, last.infrared)
        )
        found.append(
            View(depth, clean, light, np.asarray([frame.noisy for frame in before], np.float32))
        )
    return found


def features(view: View, asked: Mask, *, infrared: bool, earlier: bool) -> NDArray[np.float32]:
    """Compute what the trees see of each pixel.

    Args:
        view: the measured images.
        asked: (H, W) mask of N pixels.
        infrared: whether to add infrared.
        earlier: whether to add the earlier frames.

    Returns:
        (N, F) numbers; NaN where nothing was measured.
    """
    columns = _depth_columns(view, asked)
    if infrared:
        columns += _infrared_columns(view, asked)
    if earlier:
        columns += _earlier_columns(view, asked)
    return np.stack([np.asarray(column, np.float32) for column in columns], 1)


def _depth_columns(view: View, asked: Mask) -> list[NDArray[Any]]:
    """Return the depth, differences of depth in 9x9 px, second differences, mm, and counts."""
    own = view.depth_mm[asked]
    shown = np.where(view.depth_mm > 0, view.depth_mm, np.nan).astype(np.float32)
    around = _windows(shown, asked, _REACH_PX) - own[:, None]
    columns = [own, *np.clip(around, -_MOST_MM, _MOST_MM).T]
    middle = around.shape[1] // 2
    side = 2 * _REACH_PX + 1
    for step in (1, side, side + 1, side - 1):  # along rows, columns and diagonals
        for reach in (step, 2 * step):
            columns.append(around[:, middle - reach] + around[:, middle + reach])
    columns += [np.isfinite(_windows(shown, asked, r)).sum(1) for r in (1, 2, 4)]
    columns.append((np.abs(around) < _WRONG_MM).sum(1))
    return columns


def _infrared_columns(view: View, asked: Mask) -> list[NDArray[Any]]:
    """Return logarithms of infrared in 5x5 px, relative and own, with and without fall-off."""
    at_1_m = view.infrared * (view.depth_mm / np.float32(1000)) ** 2
    near = np.log(_windows(at_1_m, asked, 2) + 1)
    raw = np.log(_windows(view.infrared, asked, 2) + 1)  # holes have infrared, but no distance
    own, own_raw = (log[:, log.shape[1] // 2] for log in (near, raw))
    return [*(near - own[:, None]).T, own, own_raw, *(raw - own_raw[:, None]).T]


def _earlier_columns(view: View, asked: Mask) -> list[NDArray[Any]]:
    """Return share, mean and spread of earlier depths in 3x3 px, and each at the pixel itself."""
    past = np.where(view.before_mm > 0, view.before_mm, np.nan)
    own = view.depth_mm[asked, None]
    apart = np.stack([_windows(frame, asked, 1) - own for frame in past])  # (4, N, 9)
    known = np.isfinite(apart)
    count = np.maximum(known.sum(0), 1)
    mean = np.nansum(apart, 0) / count
    spread = np.sqrt(np.nansum((apart - mean) ** 2, 0) / count)
    columns = [column for part in (known.mean(0), mean, spread) for column in part.T]
    return [np.clip(column, -_MOST_MM, _MOST_MM) for column in (*columns, *apart[:, :, 4])]


def _windows(image: Depth, asked: Mask, reach_px: int) -> Depth:
    """Cut the square window around each of N pixels, (N, side * side); NaN outside the image."""
    side = 2 * reach_px + 1
    padded = np.pad(image, reach_px, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (side, side))
    return np.asarray(windows[asked].reshape(-1, side * side))


def bound_of(doubt: list[Depth], seen: list[View]) -> float:
    """Return the threshold of the probability of being wrong that costs 5 % of the ring pixels."""
    of_rings = np.concatenate([d[v.ring] for d, v in zip(doubt, seen, strict=True)])
    return float(np.quantile(of_rings, 1 - _RING_LOST))


def row(name: str, shown: list[Depth], seen: list[View]) -> str:
    """Count wrong and lost pixels of denoised depth maps and format the counts as a table row.

    Args:
        name: text of the first cell.
        shown: (H, W) denoised depth of each view, mm, 0 = none.
        seen: the views, with input and truth.

    Returns:
        Markdown cells: name; measured pixels per view whose denoised depth is wrong; right pixels
        per view that are lost, removed or made wrong; share of the ring that is lost, %.
    """
    wrong = lost = of_rings = 0
    for depth_mm, view in zip(shown, seen, strict=True):
        off = view.wrong_in(depth_mm)
        missed = (depth_mm == 0) | off
        wrong += int(np.count_nonzero(off))
        lost += int(np.count_nonzero((view.depth_mm > 0) & ~view.wrong & missed))
        of_rings += int(np.count_nonzero(view.ring & missed))
    share = of_rings / sum(np.count_nonzero(v.ring) for v in seen)
    return f"| {name} | {wrong / len(seen):.0f} | {lost / len(seen):.0f} | {100 * share:.1f} % |"


def by_trees(
    training: list[View], seen: list[View], *, infrared: bool, earlier: bool
) -> list[Depth]:
    """Train trees on views and predict for other ones.

    Args:
        training: views to learn from.
        seen: views to judge, of other heads.
        infrared: whether the trees see infrared.
        earlier: whether they see the earlier frames.

    Returns:
        (H, W) probability of being wrong for each of ``seen``; 0 away from rims.
    """
    given = {"infrared": infrared, "earlier": earlier}
    data = np.concatenate([features(v, v.near_rims, **given) for v in training])
    wrong = np.concatenate([v.wrong[v.near_rims] for v in training])
    trees = HistGradientBoostingClassifier(max_iter=400, max_leaf_nodes=63, random_state=0)
    trees.fit(data, wrong)
    doubt = []
    for view in seen:
        image = np.zeros_like(view.depth_mm)
        image[view.near_rims] = trees.predict_proba(features(view, view.near_rims, **given))[:, 1]
        doubt.append(image)
    return doubt


def main() -> None:
    """Print the table of both scenes as Markdown."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.midair", description=__doc__)
    parser.add_argument("sensor", nargs="?", default="kinect-v2")
    parser.add_argument("-d", "--denoiser", default="face", help="a network without infrared")
    parser.add_argument("--subjects", type=int, default=60, help="for training; half as many judge")
    parser.add_argument(
        "--distance-mm", type=float, nargs=2, default=_DISTANCE_MM, help="of the heads"
    )
    given = parser.parse_args()
    nearest_mm, farthest_mm = given.distance_mm
    distance_mm = (nearest_mm, farthest_mm)
    method = load(given.denoiser)
    print("| scene | by | wrong pixels a frame | right pixels lost | of the ring lost |")
    print("|---|---|---|---|---|")
    for scene in ("alone", "before a wall"):
        wall = scene != "alone"
        training = views(given.sensor, given.subjects, 101, wall=wall, distance_mm=distance_mm)
        judged = views(given.sensor, given.subjects // 2, 102, wall=wall, distance_mm=distance_mm)
        measured = [v.depth_mm for v in judged]
        print(f"| {scene} {row('input', measured, judged)}", flush=True)
        results = [
            method(np.concatenate([v.before_mm, v.depth_mm[None]]), _FRAMES - 1) for v in judged
        ]
        for composite in ("measured", "hard"):
            shown = [
                composed(result, view.depth_mm, composite)
                for result, view in zip(results, judged, strict=True)
            ]
            name = f"`{given.denoiser}`, composite {composite}"
            print(f"| {scene} {row(name, shown, judged)}", flush=True)
        for name, (infrared, earlier) in _SEEN.items():
            doubt = by_trees(training, judged, infrared=infrared, earlier=earlier)
            bound = bound_of(doubt, judged)
            shown = [np.where(d <= bound, m, 0) for m, d in zip(measured, doubt, strict=True)]
            print(f"| {scene} {row(f'trees: {name}', shown, judged)}", flush=True)


if __name__ == "__main__":
    main()
