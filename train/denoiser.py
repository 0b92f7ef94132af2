"""A checkpoint as a denoiser of whole frames, for ``glsim denoise``, ``glsim eval`` and others."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from glsim.errors import DenoiserError, GlsimError
from glsim.train import checkpoint
from glsim.train.caution import CLEAN_MM, believed, noise_mm
from glsim.train.models.base import DepthModel, Prediction
from glsim.train.models.registry import build_model
from glsim.train.validation import HALF_MM

Depth = NDArray[np.float32]
Validity = NDArray[np.bool_] | NDArray[np.float32]

#: Convolutions of a GPU in float32: its default, TF32, has ten bits, steps of 0.5 mm at 900 mm.
_FLOAT32 = partial(torch.backends.cudnn.flags, enabled=True, allow_tf32=False)


class NetworkDenoiser:
    """Frames of any size, one at a time, in float32; on the GPU if there is one.

    uncertain: whether ``with_uncertainty`` has something to say. sure: depth is kept where that
    there is some, on the surface that was chosen, is more probable than this; 0: the probability of
    depth is returned.
    """

    def __init__(self, model: DepthModel, name: str, uncertain: bool, sure: float = 0.0) -> None:
        self._device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self._model = model.eval().to(self._device, memory_format=torch.channels_last)
        self._name = name
        self._sure = sure
        self.uncertain = uncertain

    def __call__(self, noisy_mm: Depth, valid: NDArray[np.bool_]) -> tuple[Depth, Validity]:
        """(H, W) float32 millimetres with 0 = no return, and (H, W) bool.

        Returns depth in millimetres (H, W) float32, and the probability of depth, float32, or
        bool with ``sure`` or where the network codes "no depth" as 0. With a probability, frames
        without noise come back as they are and what is not ``believed`` has a probability of 0,
        see ``glsim.train.caution``.
        """
        depth_mm, validity, _ = self._run(noisy_mm, valid)
        return depth_mm, validity

    def with_uncertainty(
        self, noisy_mm: Depth, valid: NDArray[np.bool_]
    ) -> tuple[Depth, Validity, Depth]:
        """As a call, and the standard deviation of the depth in millimetres, (H, W) float32.

        Raises DenoiserError for a network that was not trained to know it.
        """
        depth_mm, validity, sigma_mm = self._run(noisy_mm, valid)
        if sigma_mm is None:
            raise DenoiserError(
                f"{self._name}: the network does not predict its uncertainty: train one with "
                "model.uncertainty = true"
            )
        return depth_mm, validity, sigma_mm

    def _run(
        self, noisy_mm: Depth, valid: NDArray[np.bool_]
    ) -> tuple[Depth, Validity, Depth | None]:
        frame = np.where(valid, noisy_mm, 0).astype(np.float32)
        noisy = torch.from_numpy(frame)[None, None].to(self._device)
        with torch.inference_mode(), _FLOAT32():
            prediction: Prediction = self._model(noisy)
        depth_mm = _image(prediction.depth_mm)
        sigma_mm = None if prediction.log_sigma is None else _image(prediction.log_sigma.exp())
        if prediction.valid_logit is None:
            return depth_mm, depth_mm >= HALF_MM, sigma_mm
        noise = noise_mm(frame)
        if noise is not None and noise < CLEAN_MM:  # as it came; sigma is that of what is left
            left = None if sigma_mm is None else np.full_like(frame, noise)
            return frame, self._validity((frame > 0).astype(np.float32)), left
        chosen, risk_mm = _choice(prediction)
        probability = _image(prediction.valid_logit.sigmoid()) * believed(frame, risk_mm)
        if self._sure:
            probability *= chosen
        return np.maximum(depth_mm, 0), self._validity(probability), sigma_mm

    def _validity(self, probability: Depth) -> Validity:
        return probability > self._sure if self._sure else probability


def _choice(prediction: Prediction) -> tuple[Depth | float, Depth | None]:
    """The probability of the surface that was chosen, and how far off it is on average, mm.

    1 and None for a network that does not choose.
    """
    if prediction.choice_logits is None or prediction.candidates_mm is None:
        return 1.0, None
    probability = prediction.choice_logits.softmax(dim=1)
    off_mm = (prediction.candidates_mm - prediction.depth_mm).abs()
    risk_mm = (probability * off_mm).sum(dim=1, keepdim=True)
    return _image(probability.amax(dim=1, keepdim=True)), _image(risk_mm)


def _image(batch: torch.Tensor) -> Depth:
    image: Depth = batch[0, 0].float().cpu().numpy()
    return image


def load_denoiser(path: Path, sure: float = 0.0) -> NetworkDenoiser:
    """The network of a checkpoint of ``glsim train``, best.pt or last.pt; no code in it is run.

    sure: see ``NetworkDenoiser``; networks that code "no depth" as 0 take no notice of it.

    Raises DenoiserError for a file that is truncated, foreign, or does not fit this glsim's models.
    """
    try:
        content: dict[str, Any] = checkpoint.load(path)
        table = content["recipe"]["model"]
        model = build_model(table)
        model.load_state_dict(content["model"])
    except GlsimError as error:
        raise DenoiserError(str(error)) from None
    except (RuntimeError, KeyError, TypeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DenoiserError(
            f"{path}: its weights do not fit its recipe ({reason}): train again"
        ) from None
    return NetworkDenoiser(model, str(path), bool(table.get("uncertainty", False)), sure)
