"""A trained network as a function of whole frames, run by PyTorch or by an ONNX runtime."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Protocol

import numpy as np

from glsim.core.array_types import Depth, Floats, Mask, Probability
from glsim.core.depth_map import FLYING_MM
from glsim.core.errors import DenoiserError
from glsim.networks.composites import UNLIKELY
from glsim.networks.flat_surfaces import held_to_planes
from glsim.networks.inputs import NetworkInputs, past_mean, stack_inputs
from glsim.networks.interface import MIN_DEPTH_MM, DepthFunction
from glsim.networks.record import NetworkRecord
from glsim.networks.safeguards import clean_noise_mm, estimate_noise_mm, trusted_mask
from glsim.networks.tiles import box_around, run_tiled

#: Frames are padded with holes to multiples of this, px: networks halve sizes up to four times.
SIZE_MULTIPLE_PX: Final = 16
#: A pixel moves if its depth changes by at least this multiple of the frame's noise, and by
#: _LEAST_MOTION_MM. Chosen: noise alone changes depth by 1.4 standard deviations.
_MOTION_NOISES: Final = 5.0
_LEAST_MOTION_MM: Final = 3.0


class Runner(Protocol):
    """An object that runs a network, whose outputs are named as in ``glsim.train.models.base``."""

    inputs: NetworkInputs
    outputs: tuple[str, ...]
    record: NetworkRecord

    def __call__(self, stack: Depth) -> Mapping[str, Depth]:
        """Run the network on a stack (C, H, W) float32; return output name -> (H, W) float32."""
        ...


class NetworkFunction(DepthFunction):
    """The denoising of frames of any size by a network.

    Attributes:
        earlier: number of earlier frames that the network sees; frames may be missing.
        average: where nothing moves, the network sees the mean of this number of past frames.
        mirror: whether outputs are averaged with those of the frame's mirror image.
        protocol, keep_clean, margin_px: see ``NetworkRecord``.
    """

    def __init__(self, network: Runner, name: str, min_probability: float = 0.0) -> None:
        """Make a denoising function of a network, named in messages, such as by its file.

        A pixel is kept if P(depth on the chosen surface) exceeds ``min_probability``; with 0 the
        probability of depth is returned instead of a mask.
        """
        self._network, self._name, self._min_probability = network, name, min_probability
        self.earlier, self.after = network.inputs
        self.before, self.average, self.mirror = self.earlier, 1, False
        self.uncertain = "sigma_mm" in network.outputs
        self.protocol, self.keep_clean, self.margin_px = network.record

    def configure(self, earlier: int, average: int, mirror: bool, keep_clean: bool | None) -> None:
        """Set ``earlier``, ``average``, ``mirror`` and, unless it is None, ``keep_clean``."""
        self.earlier, self.average, self.mirror = min(self.earlier, earlier), average, mirror
        self.before = max(self.earlier, average - 1)
        if keep_clean is not None:
            self.keep_clean = keep_clean

    def __call__(
        self, noisy_mm: Depth, valid: Mask, now: int, infrared: Depth | None = None
    ) -> tuple[Depth, Mask | Probability] | tuple[Depth, Mask | Probability, Depth]:
        """Denoise frame ``now`` of a sequence.

        With a probability of depth, safeguards apply: frames without noise come back unchanged if
        ``keep_clean``, pixels outside ``trusted_mask`` have probability 0, measured ones if theirs
        is above UNLIKELY, and walls are ``held_to_planes``. A mask stands for the probability if
        ``min_probability`` is set or the network codes "no depth" as 0. Raises DenoiserError if the
        network returns NaN or infinity. Arguments as of ``DepthFunction``.
        """
        frames = np.where(valid, noisy_mm, 0)
        if self.average > 1:
            motion_mm = _MOTION_NOISES * (estimate_noise_mm(frames[now]) or 0.0)
            past = frames[max(0, now + 1 - self.average) : now + 1]
            frames[now] = past_mean(past, max(_LEAST_MOTION_MM, motion_mm))
        frame, later = frames[now], frames[now + 1 :]
        earlier = frames[max(0, now - self.earlier) : now][::-1]
        stack = stack_inputs(self._network.inputs, frame, [*earlier], [*later])
        outputs = self._run(stack)
        depth_mm, sigma_mm = outputs["depth_mm"], outputs.get("sigma_mm")
        if "probability" not in outputs:
            return self._result(depth_mm, depth_mm >= MIN_DEPTH_MM, sigma_mm)
        noise_mm = clean_noise_mm(frame) if self.keep_clean else None
        if noise_mm is not None:  # return the frame; sigma is its noise
            measured = self._validity((frame > 0).astype(np.float32))
            sigma_mm = np.full_like(frame, noise_mm) if self.uncertain else None
            return self._result(frame, measured, sigma_mm)
        # Runtimes compute the sigmoid with errors of some 1e-7, on either side of 1.
        probability = np.clip(outputs["probability"], 0.0, 1.0)
        # An unlikely measured pixel keeps its probability; it is not doubtful between two surfaces.
        unlikely = (frame > 0) & (probability <= UNLIKELY)
        probability *= unlikely | trusted_mask(frame, outputs.get("risk_mm"))
        if self._min_probability and "choice" in outputs:
            probability *= outputs["choice"]
        depth_mm, probability = held_to_planes(np.maximum(depth_mm, 0), probability, frame)
        return self._result(depth_mm, self._validity(probability), sigma_mm)

    def _result(
        self, depth_mm: Depth, valid: Mask | Probability, sigma_mm: Depth | None
    ) -> tuple[Depth, Mask | Probability] | tuple[Depth, Mask | Probability, Depth]:
        return (depth_mm, valid) if sigma_mm is None else (depth_mm, valid, sigma_mm)

    def _run(self, stack: Depth) -> dict[str, Depth]:
        """Run the network on the box around all depth; return outputs of the frame's size."""
        # They are 0 farther from any depth than ``trusted_mask`` reaches. Networks without a
        # probability code "no depth" as 0, and may see depth far from any pixel that has it.
        box = None
        if "probability" in self._network.outputs:
            box = box_around(np.any(stack > 0, axis=0), self.margin_px)
        if box is None:
            return self._run_both(stack)
        outputs = {}
        for name, image in self._run_both(stack[:, *box]).items():
            outputs[name] = np.zeros(stack.shape[1:], np.float32)
            outputs[name][box] = image
        return outputs

    def _run_both(self, stack: Depth) -> dict[str, Depth]:
        """Run the network; if ``mirror``, average with the outputs of the mirror image."""
        outputs = self._run_padded(stack)
        if not self.mirror:
            return outputs
        mirrored = self._run_padded(stack[:, :, ::-1])
        half = np.float32(0.5)
        both = {n: half * (image + mirrored[n][:, ::-1]) for n, image in outputs.items()}
        depth_mm = outputs["depth_mm"]  # two surfaces have no mean: the first stays
        agree = np.abs(both["depth_mm"] - depth_mm) < FLYING_MM / 2
        return both | {"depth_mm": np.where(agree, both["depth_mm"], depth_mm)}

    def _run_padded(self, stack: Depth) -> dict[str, Depth]:
        """Pad a stack, run the network (in tiles if large), and cut the outputs to its size."""
        height, width = stack.shape[1:]
        below, right = (-size % SIZE_MULTIPLE_PX for size in (height, width))
        padded = np.pad(stack, [(0, 0), (0, below), (0, right)])
        outputs = {
            name: np.ascontiguousarray(image[:height, :width])
            for name, image in run_tiled(self._network, padded).items()
        }
        if not all(np.isfinite(image).all() for image in outputs.values()):
            raise DenoiserError(f"{self._name}: the network returns NaN: its weights are damaged")
        return outputs

    def _validity(self, probability: Floats) -> Mask | Probability:
        return probability > self._min_probability if self._min_probability else probability
