"""Adapt a shipped network to a camera by the camera's own noisy frames, without clean depth.

Recorrupted-to-recorrupted (Pang et al., CVPR 2021): from a frame y with noise n, and z drawn like
n, the network learns y - z / A from y + A z. The noise of both is independent, so that the network
learns the mean. What n is like is measured between two frames of one still view, never guessed
from single frames; another still pair, which the training does not see, decides when it stops.
"""

import copy
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import torch
from torch import Tensor

from glsim.core.array_types import Array, Depth
from glsim.core.depth_frame import DepthFrame
from glsim.core.depth_map import FLYING_MM, interior, jumps
from glsim.core.errors import TrainError
from glsim.core.files.atomic import write_atomic
from glsim.denoise.inference import TorchNetwork, record_of
from glsim.denoise.registry import shipped_file
from glsim.measures.depth_noise import still_difference
from glsim.measures.static import view_change
from glsim.networks.network import NetworkFunction
from glsim.networks.onnx_file import OpenCvNetwork, read_onnx
from glsim.train.models.base import channels_last, named_outputs
from glsim.train.models.mask_aware import MaskAware
from glsim.train.models.registry import build_model
from glsim.train.onnx_export import onnx_bytes
from glsim.train.recipe import load_recipe
from glsim.train.run_setup import read_start
from glsim.train.state import copy_weights

#: A: share of the noise that is added to the input, whose variance is then 1.25 times. Chosen.
_A: Final = 0.5
#: Crops a step, their side, px, learning rate, steps between two looks at the held-back pair, and
#: steps without an improvement that end the training. With a rate of 3e-4 the pair of a simulated
#: office is nearest after 25 steps and farther than at first after 150; with 1e-4 after 50 and 150.
_BATCH, _CROP_PX, _RATE, _LOOK_EVERY, _PATIENCE = 8, 64, 1e-4, 25, 75
#: Least share of measured pixels in a crop, and of known noise in the window it is drawn from.
_LEAST_SHARE: Final = 0.5
#: The held-back pair must come nearer by this share, or nothing is written. Chosen.
_LEAST_GAIN: Final = 0.01
#: Most growth of squared differences from one frame to two of still frames. Measured, heads before
#: four simulated sensors: at rest 0.93 to 1.03; 1 px a frame to the side 1.2 to 2.3, 2 px 1.6 to 3.
#: No bound for refusing: boards held before two real TrueDepths have 1.33 and 1.45.
_MOST_GROWTH: Final = 1.15
#: Ratio of the bounds of a distance bin of the noise's size, and least number of its pixels.
_BIN_RATIO, _LEAST_PIXELS = 1.15, 200


class Adaptation(NamedTuple):
    """Result of ``adapt``: RMS distances of a held-back frame from its still view's mean, mm.

    ``raw_mm``: of the noisy frame; ``before_mm``, ``after_mm``: by the network before and after.
    """

    raw_mm: float
    before_mm: float
    after_mm: float
    steps: int


class MeasuredNoise:
    """Noise between still frames: standard deviation by distance, and maps to draw from."""

    def __init__(self, frames: Sequence[DepthFrame], pairs: Sequence[tuple[int, int]]) -> None:
        """Measure the noise of pairs of frame numbers. Raises TrainError for too few pixels."""
        differences = [still_difference(frames[a], frames[b]) / np.sqrt(2) for a, b in pairs]
        depths = [frames[a].measured_mm for a, _ in pairs]
        noise, depth = (np.concatenate([m.ravel() for m in maps]) for maps in (differences, depths))
        known = np.isfinite(noise) & np.isfinite(depth)
        noise, depth = noise[known], depth[known]
        bins = (np.log(depth) / np.log(_BIN_RATIO)).astype(int)
        counts, squares = np.bincount(bins), np.bincount(bins, noise**2)
        used = np.flatnonzero(counts >= _LEAST_PIXELS)
        if not used.size:
            raise TrainError("the still frames show too few surfaces to measure their noise")
        self._bins_mm = _BIN_RATIO ** (used + 0.5)
        self._sizes_mm = np.sqrt(squares[used] / counts[used])
        self._maps = [n / self.size_mm(z) for n, z in zip(differences, depths, strict=True)]

    def size_mm(self, depth_mm: Array | Depth) -> Array:
        """Return the standard deviation of the noise at each depth, mm."""
        return np.asarray(np.interp(np.nan_to_num(depth_mm), self._bins_mm, self._sizes_mm))

    def draw(self, depth_mm: Depth, rng: np.random.Generator) -> Depth:
        """Draw noise for a square crop: a window of measured noise, scaled, mirrored, either sign.

        Windows with too little of it are drawn again; what a window lacks is white.
        """
        side = len(depth_mm)
        for _ in range(50):
            noise = self._maps[rng.integers(len(self._maps))]
            window = noise[_corner(noise.shape, side, rng)][:: rng.choice((-1, 1))]
            known = np.isfinite(window)
            if window.shape == depth_mm.shape and known.mean() >= _LEAST_SHARE:
                break
        else:
            window, known = np.zeros_like(depth_mm), np.zeros(depth_mm.shape, np.bool_)
        unit = np.where(known, window, rng.standard_normal(depth_mm.shape)) * rng.choice((-1, 1))
        return np.asarray(unit * self.size_mm(depth_mm), np.float32)


def adapt(
    frames: Sequence[DepthFrame], out: Path, network: str, steps: int, seed: int = 0,
    announce: Callable[[str], None] = lambda _: None,
) -> Adaptation:  # fmt: skip
    """Fine-tune a shipped network on noisy frames of one camera, and write it as ONNX.

    Args:
        frames: noisy frames as measured, with at least two disjoint pairs of one still view each.
        network: name of a shipped network that sees one frame.
        announce: called with a line at the start and after each look at the held-back pair.

    Returns what the held-back pair says.

    Raises TrainError: fewer than two still pairs, or the held-back pair does not come nearer.
    """
    pairs = _still_pairs(frames)
    if len(pairs) < 2:
        raise TrainError(
            f"{2 * len(pairs)} of the {len(frames)} frames follow each other in still pairs, and 4 "
            "are needed: record with camera and scene at rest, and then what you like"
        )
    if (growth := _growth(frames, pairs)) > _MOST_GROWTH:
        announce(
            f"squared differences grow {growth:.2f} times from one frame to two: the scene moves "
            "slowly, or the camera drifts or filters in time, and that is learned as noise, too"
        )
    rng, held = np.random.default_rng(seed), pairs[-1]
    noise = MeasuredNoise(frames, pairs[:-1])
    maps = [np.nan_to_num(f.measured_mm) for n, f in enumerate(frames) if n not in held]
    model = _load(network)
    judge = _Judge(frames[held[0]], frames[held[1]])
    before = best = judge.mean_square(model)
    optimiser = torch.optim.Adam(model.parameters(), lr=_RATE)
    weights, at = copy.deepcopy(model.state_dict()), 0
    raw_mm, before_mm = _root(judge.raw), _root(before)
    announce(
        f"adapting {network}: the held-back pair is {before_mm:.3g} mm apart, raw {raw_mm:.3g}"
    )
    for step in range(1, steps + 1):
        model.train()
        loss = _recorrupted_loss(model, noise, [_crop(maps, rng) for _ in range(_BATCH)], rng)
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # it has no annotations
        torch.nn.utils.clip_grad_norm_(model.parameters(), 5.0)
        optimiser.step()
        if step % _LOOK_EVERY == 0:
            score = judge.mean_square(model)
            announce(f"step {step}/{steps}: {_root(score):.3g} mm")
            if score < best:
                best, at, weights = score, step, copy.deepcopy(model.state_dict())
        if step - at >= _PATIENCE:
            break
    result = Adaptation(raw_mm, before_mm, _root(best), at)
    if best > min(before * (1 - _LEAST_GAIN), judge.raw):
        raise TrainError(
            f"the held-back still frames stay {result.after_mm:.3g} mm from each other's mean (raw "
            f"{raw_mm:.3g}) after {step} steps: {network} fits this camera already, or it does not "
            "fit this scene; nothing is written"
        )
    model.load_state_dict(weights)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(onnx_bytes(model.eval(), out, record_of(model)), out)
    return result


def _recorrupted_loss(
    model: MaskAware, noise: MeasuredNoise, crops: Sequence[Depth], rng: np.random.Generator
) -> Tensor:
    """Compute the mean square error, in variances of the noise, on recorrupted square crops."""
    images = [noise.draw(crop, rng) for crop in crops], [noise.size_mm(crop) for crop in crops]
    depth, z, size = (
        torch.from_numpy(np.stack(parts).astype(np.float32))[:, None] for parts in (crops, *images)
    )
    target = depth - z / _A
    error = model(torch.where(depth > 0, depth + _A * z, 0.0)).depth_mm - target
    known = (depth > 0) & (error.detach().abs() < FLYING_MM + z.abs() / _A)
    loss: Tensor = (error[known] / size[known]).square().mean()
    return loss


class _Judge:
    """Measure how far a denoised frame is from another of its still view, inside surfaces."""

    def __init__(self, first: DepthFrame, second: DepthFrame) -> None:
        self._frame = np.nan_to_num(first.measured_mm).astype(np.float32)
        inside = interior(self._frame > 0, jumps(self._frame))  # rims would outweigh skin
        #: Second - first, NaN: unknown.
        self._difference = np.where(inside, still_difference(first, second), np.nan)
        #: Variance of one frame's noise: half of that of the difference.
        self.raw = float(np.nanmean(0.5 * self._difference**2))

    def mean_square(self, model: MaskAware) -> float:
        """Return the mean square of denoised - second, less the variance of the second, mm2."""
        network = NetworkFunction(TorchNetwork(model), "adapt")
        depth_mm = network(self._frame[None], self._frame[None] > 0, 0)[0]
        moved = np.where(depth_mm > 0, depth_mm - self._frame, 0)
        moved = np.where(np.abs(moved) < FLYING_MM, moved, 0)
        return float(np.nanmean((moved - self._difference) ** 2)) - self.raw


def _still_pairs(frames: Sequence[DepthFrame]) -> list[tuple[int, int]]:
    """Find pairs of successive frames that show one still view; no frame is in two pairs."""
    pairs: list[tuple[int, int]] = []
    for n in range(1, len(frames)):
        free = not pairs or pairs[-1][1] < n - 1
        if free and not view_change(frames[n - 1], frames[n], parts=False):
            pairs.append((n - 1, n))
    return pairs


def _growth(frames: Sequence[DepthFrame], pairs: Sequence[tuple[int, int]]) -> float:
    """Divide squared differences of still frames two apart by those one apart; 1 without any."""
    ratios = []
    for a, b in pairs:
        if b + 1 < len(frames) and not view_change(frames[b], frames[b + 1], parts=False):
            changes_mm = (still_difference(frames[a], frames[n]) for n in (b, b + 1))
            one, two = (float(np.nanmean(change_mm**2)) for change_mm in changes_mm)
            ratios.append(two / max(one, 1e-9))
    return float(np.median(ratios)) if ratios else 1.0


def _root(mean_square: float) -> float:
    return float(max(mean_square, 0.0) ** 0.5)


def _load(network: str) -> MaskAware:
    """Load a shipped network as a PyTorch model with its scale of sigma, which ONNX folds away."""
    recipe = load_recipe("face-stereo" if network == "face-stereo" else "face").model
    weights, _ = read_start(network, recipe)
    model = channels_last(build_model(recipe))
    assert isinstance(model, MaskAware)
    copy_weights(weights.values, model, weights.file)
    probe = np.full((1, 32, 32), 900, np.float32)
    shipped = OpenCvNetwork(*read_onnx(shipped_file(network)))(probe)["sigma_mm"]
    with torch.inference_mode():
        unscaled = named_outputs(model.eval()(torch.from_numpy(probe)[None]))["sigma_mm"]
        model.sigma_scale.fill_(float(np.median(shipped / unscaled.numpy()[0, 0])))
    return model


def _crop(maps: Sequence[Depth], rng: np.random.Generator) -> Depth:
    """Cut a random square with enough measured depth; zeros after fifty tries."""
    for _ in range(50):
        image = maps[int(rng.integers(len(maps)))]
        crop: Depth = image[_corner(image.shape, _CROP_PX, rng)]
        if crop.shape == (_CROP_PX, _CROP_PX) and (crop > 0).mean() >= _LEAST_SHARE:
            return crop
    return np.zeros((_CROP_PX, _CROP_PX), np.float32)


def _corner(shape: tuple[int, ...], side: int, rng: np.random.Generator) -> tuple[slice, slice]:
    top, left = (int(rng.integers(max(size - side, 0) + 1)) for size in shape)
    return slice(top, top + side), slice(left, left + side)
