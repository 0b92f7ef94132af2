"""Which measured pixels in mid-air can be told from surface pixels at all, and by what.

``python -m benchmarks.midair [SENSOR]`` simulates heads alone and before walls, trains boosted
trees to tell wrong pixels (the truth has no depth there, or is more than 30 mm away) from right
ones by all that surrounds them, and prints how many wrong ones are left when 5 % of the outermost
right ones are lost: with depth alone, infrared, and earlier frames, beside the shipped network.
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
        """Measured pixels within ``_REACH_PX`` of a hole or of a step that a wrong pixel makes."""
        reach = np.ones((2 * _REACH_PX + 1,) * 2, np.uint8)
        span = cv2.dilate(self.depth_mm, reach) - cv2.erode(self.depth_mm, reach)
        return np.asarray((self.depth_mm > 0) & (span > _WRONG_MM))

    @property
    def wrong(self) -> Mask:
        """Measured pixels that are not on the surface of the truth."""
        apart = np.abs(self.depth_mm - self.clean_mm) > _WRONG_MM
        return np.asarray((self.depth_mm > 0) & ((self.clean_mm == 0) | apart))

    @property
    def ring(self) -> Mask:
        """Right pixels beside a wrong pixel, a hole, or a step."""
        right = (self.depth_mm > 0) & ~self.wrong
        shown = np.where(right, self.depth_mm, 0)
        square = np.ones((3, 3), np.uint8)
        return np.asarray(
            right & (cv2.dilate(shown, square) - cv2.erode(shown, square) > _WRONG_MM)
        )


def views(sensor: str, subjects: int, seed: int, *, wall: bool) -> list[View]:
    """Simulate heads that stand still for five frames, each by a device of its own."""
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
                "distance_mm": drawn | {"uniform": [700, 1050]},
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
    """Return what surrounds each asked pixel, (N, F); NaN where nothing was measured."""
    own = view.depth_mm[asked]
    columns = [own]
    shown = np.where(view.depth_mm > 0, view.depth_mm, np.nan).astype(np.float32)
    around = _windows(shown, asked, _REACH_PX) - own[:, None]
    columns += list(np.clip(around, -_MOST_MM, _MOST_MM).T)
    middle = around.shape[1] // 2
    side = 2 * _REACH_PX + 1
    for step in (1, side, side + 1, side - 1):  # bends along rows, columns and diagonals
        for reach in (step, 2 * step):
            columns.append(around[:, middle - reach] + around[:, middle + reach])
    columns += [np.isfinite(_windows(shown, asked, r)).sum(1) for r in (1, 2, 4)]
    columns += [(np.abs(around) < _WRONG_MM).sum(1)]
    if infrared:
        light = view.infrared * (view.depth_mm / np.float32(1000)) ** 2  # as bright as at 1 m
        near = np.log(_windows(light, asked, 2) + 1)
        columns += list((near - near[:, near.shape[1] // 2, None]).T)
        columns += [near[:, near.shape[1] // 2], np.log(view.infrared[asked] + 1)]
        raw = np.log(_windows(view.infrared, asked, 2) + 1)  # holes have infrared too
        columns += list((raw - raw[:, raw.shape[1] // 2, None]).T)
    if earlier:
        past = np.where(view.before_mm > 0, view.before_mm, np.nan)
        apart = np.stack([_windows(frame, asked, 1) - own[:, None] for frame in past])  # (4, N, 9)
        known = np.isfinite(apart)
        count = np.maximum(known.sum(0), 1)
        mean = np.nansum(apart, 0) / count
        spread = np.sqrt(np.nansum((apart - mean) ** 2, 0) / count)
        for part in (known.mean(0), mean, spread):
            columns += list(np.clip(part, -_MOST_MM, _MOST_MM).T)
        columns += list(np.clip(apart[:, :, 4], -_MOST_MM, _MOST_MM))
    return np.stack([np.asarray(column, np.float32) for column in columns], 1)


def _windows(image: Depth, asked: Mask, reach_px: int) -> Depth:
    """Return the (N, side * side) windows around the asked pixels; NaN outside the image."""
    side = 2 * reach_px + 1
    padded = np.pad(image, reach_px, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (side, side))
    return np.asarray(windows[asked].reshape(-1, side * side))


def bound_of(doubt: list[Depth], seen: list[View]) -> float:
    """Return the doubt above which pixels are dropped, so that ``_RING_LOST`` of rings are lost."""
    of_rings = np.concatenate([d[v.ring] for d, v in zip(doubt, seen, strict=True)])
    return float(np.quantile(of_rings, 1 - _RING_LOST))


def row(name: str, kept: list[Mask], seen: list[View]) -> str:
    """Return a row of the table: wrong pixels that stay and right ones that are lost, of a frame.

    Args:
        name: of the row.
        kept: (H, W) pixels of each view that stay.
        seen: the views.
    """
    pairs = list(zip(kept, seen, strict=True))
    wrong = sum(np.count_nonzero(v.wrong & k) for k, v in pairs) / len(pairs)
    lost = sum(np.count_nonzero((v.depth_mm > 0) & ~v.wrong & ~k) for k, v in pairs) / len(pairs)
    of_rings = sum(np.count_nonzero(v.ring & ~k) for k, v in pairs)
    share = of_rings / sum(np.count_nonzero(v.ring) for v in seen)
    return f"| {name} | {wrong:.0f} | {lost:.0f} | {100 * share:.1f} % |"


def by_trees(
    training: list[View], seen: list[View], *, infrared: bool, earlier: bool
) -> list[Depth]:
    """Return the (H, W) probability that a pixel is wrong, by trees that saw other heads."""
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
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.midair", description=__doc__)
    parser.add_argument("sensor", nargs="?", default="kinect-v2")
    parser.add_argument("-d", "--denoiser", default="face", help="a network without infrared")
    parser.add_argument("--subjects", type=int, default=60, help="for training; half as many judge")
    given = parser.parse_args()
    method = load(given.denoiser)
    print("| scene | by | wrong pixels a frame | right pixels lost | of the ring lost |")
    print("|---|---|---|---|---|")
    for scene in ("alone", "before a wall"):
        wall = scene != "alone"
        training = views(given.sensor, given.subjects, 101, wall=wall)
        judged = views(given.sensor, given.subjects // 2, 102, wall=wall)
        measured = [v.depth_mm > 0 for v in judged]
        print(f"| {scene} {row('input', measured, judged)}", flush=True)
        results = [
            method(np.concatenate([v.before_mm, v.depth_mm[None]]), _FRAMES - 1) for v in judged
        ]
        for composite in ("measured", "hard"):
            kept = [
                composed(result, view.depth_mm, composite) > 0
                for result, view in zip(results, judged, strict=True)
            ]
            name = f"`{given.denoiser}`, composite {composite}"
            print(f"| {scene} {row(name, kept, judged)}", flush=True)
        for name, (infrared, earlier) in _SEEN.items():
            doubt = by_trees(training, judged, infrared=infrared, earlier=earlier)
            bound = bound_of(doubt, judged)
            kept = [m & (d <= bound) for m, d in zip(measured, doubt, strict=True)]
            print(f"| {scene} {row(f'trees: {name}', kept, judged)}", flush=True)


if __name__ == "__main__":
    main()
