"""A trained network as a denoiser of whole frames, whatever runs it: PyTorch or an ONNX runtime."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.denoise.composites import calibrated
from glsim.denoise.inputs import DEPTH_ALONE, NetworkInputs, stack_inputs
from glsim.denoise.interface import MIN_DEPTH_MM
from glsim.denoise.record import DEFAULT_RECORD, UNLIKELY, NetworkRecord
from glsim.denoise.safeguards import clean_noise_mm, trusted_mask
from glsim.denoise.tiles import box_around, run_tiled
from glsim.errors import DenoiserError

Depth = NDArray[np.float32]
Validity = NDArray[np.bool_] | NDArray[np.float32]

#: Runs a network: (H, W) float32 millimetres, 0 = no return, to its outputs by name, (H, W) float32
#: each; the names are those of glsim.train.models.named_outputs. A network with further inputs
#: takes their stack, (C, H, W): see glsim.denoise.inputs.
Network = Callable[[Depth], Mapping[str, Depth]]

#: Frames are padded with holes, to the right and below, to multiples of this, pixels: the shipped
#: architectures halve the size three or four times, and an ONNX graph cannot pad by itself.
SIZE_MULTIPLE_PX: Final = 16


class NetworkDenoiser:
    """Denoises single frames of any size.

    Attributes:
        uncertain: whether the network predicts its uncertainty (``with_uncertainty``).
        infrared: whether it uses the infrared image; without one it denoises by depth alone.
        protocol, keep_clean, margin_px, unlikely: of its ``NetworkRecord``.
    """

    def __init__(
        self,
        network: Network,
        name: str,
        uncertain: bool,
        min_probability: float = 0.0,
        inputs: NetworkInputs = DEPTH_ALONE,
        record: NetworkRecord = DEFAULT_RECORD,
    ) -> None:
        """Wrap a network as a denoiser.

        Args:
            network: runs the network on a padded frame.
            name: for messages, such as the path of the file.
            uncertain: whether the network predicts its uncertainty.
            min_probability: keep a pixel if P(depth on the chosen surface) exceeds this; 0: return
                the probability of depth instead of a mask.
            inputs: what the network sees besides depth.
            record: what its file records about its training.
        """
        self._network = network
        self._name = name
        self._min_probability = min_probability
        self.uncertain = uncertain
        self.infrared = inputs.infrared
        self._inputs = inputs
        self.protocol, self.keep_clean, self.margin_px, self.unlikely = record
        # Others code "no depth" as 0, and may see depth far from any pixel that has it.
        self._only_near_depth = "probability" in getattr(network, "outputs", ())

    def __call__(
        self, noisy_mm: Depth, valid: NDArray[np.bool_], infrared: Depth | None = None
    ) -> tuple[Depth, Validity]:
        """Denoise a frame.

        With a probability of depth, ``glsim.denoise.safeguards`` apply: frames without noise are
        returned unchanged if ``keep_clean``, and pixels outside ``trusted_mask`` have probability
        0, measured ones if their probability is above UNLIKELY.

        Args:
            noisy_mm: (H, W) float32 millimetres, 0 = no return.
            valid: (H, W) bool mask of returns.
            infrared: (H, W) counts, if the network uses them.

        Returns:
            (H, W) float32 depth in millimetres, and the probability of depth, float32; a bool mask
            if ``min_probability`` is set or the network codes "no depth" as 0.

        Raises:
            DenoiserError: if the network returns NaN or infinity.
        """
        stack = stack_inputs(self._inputs, np.where(valid, noisy_mm, 0), infrared=infrared)
        return self._denoise(stack)[:2]

    def with_uncertainty(
        self, noisy_mm: Depth, valid: NDArray[np.bool_], infrared: Depth | None = None
    ) -> tuple[Depth, Validity, Depth]:
        """Denoise as a call does; also return the standard deviation, (H, W) float32 millimetres.

        Raises DenoiserError for a network that was not trained to predict it.
        """
        stack = stack_inputs(self._inputs, np.where(valid, noisy_mm, 0), infrared=infrared)
        return self._uncertain(stack)

    def _uncertain(self, stack: Depth) -> tuple[Depth, Validity, Depth]:
        depth_mm, validity, sigma_mm = self._denoise(stack)
        if sigma_mm is None:
            raise DenoiserError(
                f"{self._name}: the network does not predict its uncertainty: train one with "
                "model.uncertainty = true"
            )
        return depth_mm, validity, sigma_mm

    def _denoise(self, stack: Depth) -> tuple[Depth, Validity, Depth | None]:
        frame = stack[0]
        outputs = self._run(stack)
        depth_mm, sigma_mm = outputs["depth_mm"], outputs.get("sigma_mm")
        if "probability" not in outputs:
            return depth_mm, depth_mm >= MIN_DEPTH_MM, sigma_mm
        noise_mm = clean_noise_mm(frame) if self.keep_clean else None
        if noise_mm is not None:  # unchanged; sigma is the input's noise
            input_sigma_mm = None if sigma_mm is None else np.full_like(frame, noise_mm)
            return frame, self._validity((frame > 0).astype(np.float32)), input_sigma_mm
        # Runtimes compute the sigmoid with errors of some 1e-7, on either side of 1.
        probability = calibrated(np.clip(outputs["probability"], 0.0, 1.0), self.unlikely)
        # A measured pixel that is unlikely keeps its probability: the doubt is not which surface.
        unlikely = (frame > 0) & (probability <= UNLIKELY)
        probability *= unlikely | trusted_mask(frame, outputs.get("risk_mm"))
        if self._min_probability and "choice" in outputs:
            probability *= outputs["choice"]
        return np.maximum(depth_mm, 0), self._validity(probability), sigma_mm

    def _run(self, stack: Depth) -> dict[str, Depth]:
        """Run the network where there is something to see; return outputs of the stack's size.

        They are 0 farther from any depth than ``trusted_mask`` reaches.
        """
        seen = np.any(stack > 0, axis=0)
        box = box_around(seen, self.margin_px) if self._only_near_depth else None
        if box is None:
            return self._run_padded(stack)
        outputs = {}
        for name, image in self._run_padded(stack[:, *box]).items():
            outputs[name] = np.zeros(stack.shape[1:], np.float32)
            outputs[name][box] = image
        return outputs

    def _run_padded(self, stack: Depth) -> dict[str, Depth]:
        """Run the network on a padded stack, a large one in tiles; return outputs of its size."""
        height, width = stack.shape[1:]
        below, right = (-size % SIZE_MULTIPLE_PX for size in (height, width))
        padded = np.pad(stack, [(0, 0), (0, below), (0, right)])
        outputs = {
            name: np.ascontiguousarray(image[:height, :width])
            for name, image in run_tiled(
                self._network, padded if len(stack) > 1 else padded[0]
            ).items()
        }
        if not all(np.isfinite(image).all() for image in outputs.values()):
            raise DenoiserError(
                f"{self._name}: the network returns NaN or infinity: its weights are damaged"
            )
        return outputs

    def _validity(self, probability: Depth) -> Validity:
        return probability > self._min_probability if self._min_probability else probability


class VideoDenoiser(NetworkDenoiser):
    """Denoises a frame of a sequence with a network that sees its neighbours in time.

    It is a ``glsim.denoise.SequenceDenoiser``; missing neighbours are allowed, all of them too.
    """

    def __init__(
        self,
        network: Network,
        name: str,
        uncertain: bool,
        min_probability: float,
        inputs: NetworkInputs,
        record: NetworkRecord = DEFAULT_RECORD,
    ) -> None:
        """Arguments as of ``NetworkDenoiser``."""
        super().__init__(network, name, uncertain, min_probability, inputs, record)
        self.before, self.after = inputs.before, inputs.after

    def __call__(  # type: ignore[override]
        self,
        noisy_mm: Depth,
        valid: NDArray[np.bool_],
        now: int,
        infrared: Depth | None = None,
    ) -> tuple[Depth, Validity]:
        """Denoise frame ``now`` of (T, H, W) float32 millimetres; results as of the base class."""
        return self._denoise(self._stack(noisy_mm, valid, now, infrared))[:2]

    def with_uncertainty(  # type: ignore[override]
        self,
        noisy_mm: Depth,
        valid: NDArray[np.bool_],
        now: int,
        infrared: Depth | None = None,
    ) -> tuple[Depth, Validity, Depth]:
        """Denoise as a call does; also return the standard deviation, as the base class."""
        return self._uncertain(self._stack(noisy_mm, valid, now, infrared))

    def _stack(
        self, noisy_mm: Depth, valid: NDArray[np.bool_], now: int, infrared: Depth | None
    ) -> Depth:
        frames = np.where(valid, noisy_mm, 0)
        earlier, later = frames[:now][::-1], frames[now + 1 :]
        return stack_inputs(self._inputs, frames[now], [*earlier], [*later], infrared)


def network_denoiser(
    network: Network,
    name: str,
    uncertain: bool,
    min_probability: float,
    inputs: NetworkInputs,
    record: NetworkRecord,
) -> NetworkDenoiser:
    """Make the denoiser of a network: a ``VideoDenoiser`` if it sees neighbours in time."""
    kind = VideoDenoiser if inputs.temporal else NetworkDenoiser
    return kind(network, name, uncertain, min_probability, inputs, record)
