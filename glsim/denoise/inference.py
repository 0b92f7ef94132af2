"""Run the network of a checkpoint as a denoiser of whole frames."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from glsim.denoise import checkpoint
from glsim.denoise.protocol import MIN_DEPTH_MM
from glsim.denoise.safeguards import CLEAN_MM, estimate_noise_mm, trusted_mask
from glsim.errors import DenoiserError, GlsimError
from glsim.train.models.base import DepthModel, Prediction
from glsim.train.models.registry import build_model, weight_shapes

Depth = NDArray[np.float32]
Validity = NDArray[np.bool_] | NDArray[np.float32]

#: Keeps GPU convolutions in float32: the default, TF32, has ten bits, steps of 0.5 mm at 900 mm.
_FLOAT32 = partial(torch.backends.cudnn.flags, enabled=True, allow_tf32=False)


class NetworkDenoiser:
    """Denoises single frames of any size in float32, on the GPU if there is one.

    uncertain: whether the network predicts its uncertainty (``with_uncertainty``).
    min_probability: keep a pixel if P(depth on the chosen surface) exceeds this; 0: return the
    probability of depth instead of a mask.
    """

    def __init__(
        self, model: DepthModel, name: str, uncertain: bool, min_probability: float = 0.0
    ) -> None:
        self._device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self._model = model.eval().to(self._device, memory_format=torch.channels_last)
        self._name = name
        self._min_probability = min_probability
        self.uncertain = uncertain

    def __call__(self, noisy_mm: Depth, valid: NDArray[np.bool_]) -> tuple[Depth, Validity]:
        """Denoise (H, W) float32 millimetres, 0 = no return, with their (H, W) bool mask.

        Returns (H, W) float32 depth in millimetres and the probability of depth, float32; a bool
        mask if ``min_probability`` is set or if the network codes "no depth" as 0. With a
        probability, the safeguards apply: frames without noise are returned unchanged, and pixels
        outside ``trusted_mask`` have probability 0. See ``glsim.denoise.safeguards``.
        """
        depth_mm, validity, _ = self._run(noisy_mm, valid)
        return depth_mm, validity

    def with_uncertainty(
        self, noisy_mm: Depth, valid: NDArray[np.bool_]
    ) -> tuple[Depth, Validity, Depth]:
        """Denoise as a call does; also return the standard deviation, (H, W) float32 millimetres.

        Raises DenoiserError for a network that was not trained to predict it.
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
            return depth_mm, depth_mm >= MIN_DEPTH_MM, sigma_mm
        noise_mm = estimate_noise_mm(frame)
        if noise_mm is not None and noise_mm < CLEAN_MM:  # unchanged; sigma is the input's noise
            input_sigma_mm = None if sigma_mm is None else np.full_like(frame, noise_mm)
            return frame, self._validity((frame > 0).astype(np.float32)), input_sigma_mm
        choice, risk_mm = _choice(prediction)
        probability = _image(prediction.valid_logit.sigmoid()) * trusted_mask(frame, risk_mm)
        if self._min_probability:
            probability *= choice
        return np.maximum(depth_mm, 0), self._validity(probability), sigma_mm

    def _validity(self, probability: Depth) -> Validity:
        return probability > self._min_probability if self._min_probability else probability


def _choice(prediction: Prediction) -> tuple[Depth | float, Depth | None]:
    """Return the (H, W) probability of the chosen surface and its risk (expected error), mm.

    Returns 1 and None for a network that does not choose between surfaces.
    """
    if prediction.choice_logits is None or prediction.candidates_mm is None:
        return 1.0, None
    probability = prediction.choice_logits.softmax(dim=1)
    off_mm = (prediction.candidates_mm - prediction.depth_mm).abs()
    risk_mm = (probability * off_mm).sum(dim=1, keepdim=True)
    return _image(probability.amax(dim=1, keepdim=True)), _image(risk_mm)


def _image(batch: torch.Tensor) -> Depth:
    """Return the (H, W) image of a (1, 1, H, W) batch."""
    image: Depth = batch[0, 0].float().cpu().numpy()
    return image


def load_network(path: Path, min_probability: float = 0.0) -> NetworkDenoiser:
    """Load the network of a checkpoint of ``glsim train``, best.pt or last.pt; runs no code in it.

    min_probability: see ``NetworkDenoiser``; networks that code "no depth" as 0 ignore it.

    Raises DenoiserError for a file that is truncated, foreign, or does not fit this glsim's models.
    """
    try:
        content: dict[str, Any] = checkpoint.load(path)
        table = content["recipe"]["model"]
        _check_shapes(weight_shapes(table), content["model"])
        model = build_model(table)
        model.load_state_dict(content["model"])
    except GlsimError as error:
        raise DenoiserError(str(error)) from None
    except (RuntimeError, KeyError, TypeError, AttributeError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DenoiserError(
            f"{path}: its weights do not fit its recipe ({reason}): train again"
        ) from None
    uncertain = bool(table.get("uncertainty", False))
    return NetworkDenoiser(model, str(path), uncertain, min_probability)


def _check_shapes(expected: Mapping[str, tuple[int, ...]], weights: Mapping[str, Any]) -> None:
    """Raise ValueError if weights do not fit their model, before the model takes any memory."""
    found = {name: tuple(value.shape) for name, value in weights.items()}
    for name in sorted(expected.keys() | found.keys()):
        if expected.get(name) != found.get(name):
            raise ValueError(f"{name}: {found.get(name)}, not {expected.get(name)}")


def load_denoiser(path: Path, sure: float = 0.0) -> NetworkDenoiser:
    """Load a network by the deprecated name and parameter: use ``load_network``."""
    warnings.warn(
        "glsim.denoise.inference.load_denoiser(path, sure) is deprecated: call "
        "load_network(path, min_probability), or glsim.denoise.load_denoiser(spec)",
        DeprecationWarning,
        stacklevel=2,
    )
    return load_network(path, sure)
