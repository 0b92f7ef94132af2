"""Make training pairs of rendered frames, in whichever process they were rendered."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import MeshError
from glsim.core.seeds import pcg_rng
from glsim.denoise.inputs import NetworkInputs, stack_inputs
from glsim.simulation.frame import Frame, Skipped, to_mm
from glsim.train.data.checks import Target, moved_pair, pair_layers
from glsim.train.data.extra_inputs import Moment, Neighbours, vary_inputs
from glsim.train.data.stream import BatchStream

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class BlockMaker:
    """What the pairs of blocks are made of, wherever they are rendered."""

    stream: BatchStream
    target: Target
    inputs: NetworkInputs
    vary: bool
    backend: str | None
    protocol: DepthProtocol

    @property
    def layers(self) -> tuple[str, ...]:
        """The layers of a frame that are needed."""
        return pair_layers(self.target, self.inputs)

    def images(
        self, results: Sequence[Frame | Skipped], lane: int, block: int
    ) -> list[NDArray[np.float32]]:
        """Return the images of each frame of a block, (C + 1, H, W): its inputs, and the target.

        Raises MeshError if no frame could be rendered.
        """
        frames = replace_skipped(results)
        pairs = [_pair_mm(frame, pair_layers(self.target)) for frame in frames]
        moments = [Moment((f.source, f.key.subject, f.key.sequence), f.key.frame) for f in frames]
        neighbours = Neighbours(moments, self.inputs)
        rng = pcg_rng("inputs", self.stream.seed, lane, block)
        images = []
        for number, (frame, (noisy_mm, target_mm)) in enumerate(zip(frames, pairs, strict=True)):
            before, after = ([pairs[n][0] for n in side] for side in neighbours.of(number))
            infrared = frame.infrared if self.inputs.infrared else None
            stack = stack_inputs(self.inputs, noisy_mm, before, after, infrared)
            if self.vary:
                stack = vary_inputs(stack, self.inputs, rng)
            pair = np.concatenate([stack, target_mm[None]])
            images.append(moved_pair(pair, self.inputs) if self.protocol == "paper" else pair)
        return images


def replace_skipped(results: Sequence[Frame | Skipped]) -> list[Frame]:
    """Replace each skipped frame by the next good one. Raises MeshError if none is good."""
    good = [number for number, result in enumerate(results) if isinstance(result, Frame)]
    bad = [result for result in results if isinstance(result, Skipped)]
    if not good:
        raise MeshError(
            f"none of {len(results)} faces can be rendered, e.g. {bad[0].key}: {bad[0].why}"
        )
    for result in bad:
        log.warning("%s: skipped and replaced by another: %s", result.key.subject, result.why)
    frames = []
    for number in range(len(results)):
        frame = results[min((other for other in good if other >= number), default=good[0])]
        assert isinstance(frame, Frame)
        frames.append(frame)
    return frames


def _pair_mm(frame: Frame, layers: Sequence[str]) -> NDArray[np.float32]:
    """Noisy depth and target, (2, H, W) millimetres, rounded as in files."""
    both = np.stack([frame.image(layer) for layer in layers])
    return to_mm(both, frame.depth_unit_mm, frame.depth_offset_mm)
