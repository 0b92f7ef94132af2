"""Training losses: callables that the table [loss] of a recipe configures.

Arguments are a prediction, the noisy and the clean depth, each (B, 1, H, W) float32 millimetres
with 0 = no depth; further inputs of the network are left out. Results are the total and its terms
by name. All arithmetic is float32.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, Literal

import torch
from pydantic import Field
from torch import Tensor
from torch.nn import functional

from glsim.core.depth_map import FLYING_MM, dilated, interior, jumps
from glsim.core.errors import ConfigError, did_you_mean
from glsim.core.units import MM_PER_M
from glsim.networks.safeguards import REACH_PX
from glsim.settings.toml_tables import TomlTable, parse_table
from glsim.train.models.base import Prediction

LossParts = dict[str, Tensor]


class Loss(TomlTable):
    """Base class of all losses."""

    def batch(self, noisy_mm: Tensor, clean_mm: Tensor) -> tuple[Tensor, Tensor]:
        """Make the input and the target of a training step of a batch, (B, C or 1, H, W) each."""
        return noisy_mm, clean_mm

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, LossParts]:
        """Compute the loss of a prediction: the total, a scalar, and its named parts."""
        raise NotImplementedError


def to_float32(prediction: Prediction) -> Prediction:
    """Convert a prediction made in mixed precision to float32."""
    depth_mm, *others = prediction
    return Prediction(depth_mm.float(), *(None if t is None else t.float() for t in others))


def weighted_mean(values: Tensor, weights: Tensor) -> Tensor:
    """Compute the weighted mean over pixels; 0 if all weights are 0."""
    return (values * weights).sum() / weights.sum().clamp_min(1)


#: Another candidate becomes the target only if it is nearer to the truth than the first by this,
#: mm. Chosen: several times the noise, and half of a flying pixel's smallest error.
_SWITCH_MM: Final = 25.0
#: ``relative`` scales errors to a frame with this noise, mm. The other two limit the noise of a
#: frame, mm: the range of depth cameras on a face at 0.9 m (docs/howto/any_camera.md).
_NOISE_MM, _LEAST_NOISE_MM, _LARGEST_NOISE_MM = 4.0, 0.5, 10.0


class AllPixels(Loss):
    """Mean squared error over all pixels, mm2, as in the paper; missing depth counts as depth 0."""

    kind: Literal["all_pixels"] = "all_pixels"

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, LossParts]:
        """Compute the loss, a single part; a predicted validity multiplies the depth."""
        depth_mm = prediction.depth_mm
        if prediction.valid_logit is not None:
            depth_mm = depth_mm * prediction.valid_logit.sigmoid()
        total = functional.mse_loss(depth_mm, clean_mm)
        return total, {"mse": total}


class Masked(Loss):
    """Loss of depth where clean has depth and the input has depth nearby, and of validity.

    The weights are chosen by experiment with `small_unet` on procedural faces under kinect-v2: the
    slope term smooths the surface; rims have less weight, since their errors are unpredictable.
    """

    kind: Literal["masked"] = "masked"
    beta_mm: float = Field(
        2.0, gt=0, description="error below which depth counts squared, above linearly"
    )
    edge_weight: float = Field(
        0.2, ge=0, le=1, description="weight of depth at most 3 px from a rim; the interior has 1"
    )
    valid_weight: float = Field(20.0, ge=0, description="weight of the cross entropy of validity")
    choice_weight: float = Field(
        5.0, ge=0, description="weight of the cross entropy of the surface, if one is chosen"
    )
    slope_weight: float = Field(
        3.0, ge=0, description="weight of the error of pixel-to-pixel steps in the interior"
    )
    slope_beta_mm: float = Field(0.5, gt=0, description="beta_mm of the slope term")
    relative: bool = Field(
        False,
        description="measure errors by each frame's own noise, so that no camera rules the others",
    )
    sigma_weight: float = Field(
        0.1, ge=0, description="weight of log_sigma, if any; no gradient reaches the depth"
    )
    reach_px: int = Field(
        REACH_PX, ge=1, description="largest distance from a valid input pixel that counts"
    )

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, LossParts]:
        """Compute the total and its terms: depth; valid, choice, slope, sigma where they apply.

        Among several candidates only the target surface's depth counts; sigma, always in mm, is of
        the chosen surface. A pixel without a candidate near the truth shall have no depth.
        """
        has_depth = (clean_mm > 0).float()
        error_mm = prediction.depth_mm - clean_mm
        choice = None
        if prediction.candidates_mm is not None and prediction.choice_logits is not None:
            errors_mm = prediction.candidates_mm - clean_mm
            target = target_surface(errors_mm.detach())
            error_mm = errors_mm.gather(1, target)
            choice = -prediction.choice_logits.log_softmax(dim=1).gather(1, target)
            # If all candidates are far, the surface was not measured, and the error would dominate.
            has_depth = has_depth * (error_mm.detach().abs() < FLYING_MM)
        counted = has_depth * dilated(noisy_mm > 0, self.reach_px)
        inside = counted * interior(clean_mm > 0, jumps(clean_mm))
        weight = self.edge_weight * counted + (1 - self.edge_weight) * inside
        if self.relative:
            error_mm = error_mm * (_NOISE_MM / _noise_mm(noisy_mm, clean_mm, inside))
        parts = {"depth": weighted_mean(_smooth_l1(error_mm, self.beta_mm), weight)}
        total = parts["depth"]
        if self.valid_weight and prediction.valid_logit is not None:
            parts["valid"] = functional.binary_cross_entropy_with_logits(
                prediction.valid_logit, has_depth
            )
            total = total + self.valid_weight * parts["valid"]
        if choice is not None:
            parts["choice"] = weighted_mean(choice, counted)
            total = total + self.choice_weight * parts["choice"]
        if self.slope_weight:
            parts["slope"] = self._slope_loss(error_mm, inside)
            total = total + self.slope_weight * parts["slope"]
        if self.sigma_weight and prediction.log_sigma is not None:
            final_error_mm = (prediction.depth_mm - clean_mm).detach()
            log_sigma = prediction.log_sigma  # the standard deviation of a Laplace density
            nll = 2**0.5 * final_error_mm.abs() * torch.exp(-log_sigma) + log_sigma
            parts["sigma"] = weighted_mean(nll + 0.5 * math.log(2), counted)
            total = total + self.sigma_weight * parts["sigma"]
        return total, parts

    def _slope_loss(self, error_mm: Tensor, inside: Tensor) -> Tensor:
        """Sum the mean losses of vertical and horizontal differences of the error, a scalar."""
        terms = []
        for axis in (-2, -1):
            size = inside.shape[axis] - 1
            both_inside = inside.narrow(axis, 0, size) * inside.narrow(axis, 1, size)
            steps = _smooth_l1(error_mm.diff(dim=axis), self.slope_beta_mm)
            terms.append(weighted_mean(steps, both_inside))
        return torch.stack(terms).sum()


def _noise_mm(noisy_mm: Tensor, clean_mm: Tensor, inside: Tensor) -> Tensor:
    """Compute the RMS noise of each frame on measured interior pixels: (B, 1, 1, 1) mm.

    Errors are clipped at 25 mm; larger errors are other surfaces, not noise.
    """
    known = inside * (noisy_mm > 0)
    squares = (noisy_mm - clean_mm).clamp(-_SWITCH_MM, _SWITCH_MM).square() * known
    axes = (1, 2, 3)
    mean = squares.sum(axes, keepdim=True) / known.sum(axes, keepdim=True).clamp_min(1)
    return mean.sqrt().clamp(_LEAST_NOISE_MM, _LARGEST_NOISE_MM)


def target_surface(errors_mm: Tensor) -> Tensor:
    """Choose each pixel's target among K depth candidates: (B, K, H, W) errors to (B, 1, H, W).

    It is the first unless another is nearer by `_SWITCH_MM`: one target for one surface.
    """
    size = errors_mm.abs()
    size = torch.cat([size[:, :1] - _SWITCH_MM, size[:, 1:]], dim=1)
    return size.argmin(dim=1, keepdim=True)


def _smooth_l1(values: Tensor, beta: float) -> Tensor:
    return functional.smooth_l1_loss(values, torch.zeros_like(values), reduction="none", beta=beta)


class NoisyTarget(Loss):
    """Base class of losses that see no clean frame: the target is made of the measured depth.

    Only pixels with a target count. A validation gives the clean depth as the target.
    """

    beta_mm: float = Field(3.0, gt=0, description="as in masked")

    def batch(self, noisy_mm: Tensor, clean_mm: Tensor) -> tuple[Tensor, Tensor]:
        """Return input and target, of networks of depth alone; target 0: no target."""
        return noisy_mm, noisy_mm

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, LossParts]:
        """Compute the loss, a single part: the distance from the target."""
        error = _smooth_l1(prediction.depth_mm - clean_mm, self.beta_mm)
        total = weighted_mean(error, (clean_mm != 0).float())
        return total, {"depth": total}


class Noise2Void(NoisyTarget):
    """The blind spots of Krull, Buchholz, Jug, "Noise2Void", CVPR 2019, for maps with holes.

    Some measured pixels take the depth of a measured neighbour and shall return their own, whose
    noise, if independent from pixel to pixel, the surroundings do not tell.
    """

    kind: Literal["noise2void"] = "noise2void"
    share: float = Field(0.0156, gt=0, lt=1, description="of pixels; the authors' 64 of 64 x 64")
    radius_px: int = Field(2, ge=1, description="half side of the square of neighbours")

    def batch(self, noisy_mm: Tensor, clean_mm: Tensor) -> tuple[Tensor, Tensor]:
        """Replace the spots; they alone have a target."""
        side = 2 * self.radius_px + 1
        near_mm = functional.unfold(noisy_mm, side, padding=self.radius_px)
        near_mm = near_mm.view(len(noisy_mm), side * side, *noisy_mm.shape[2:])
        draw = torch.rand(near_mm.shape).to(noisy_mm) * (near_mm > 0)
        draw[:, side * side // 2] = 0  # not the pixel itself
        highest, chosen = draw.max(dim=1, keepdim=True)
        spots = torch.rand(noisy_mm.shape).to(noisy_mm) < self.share
        spots &= (noisy_mm > 0) & (highest > 0)
        changed_mm = torch.where(spots, near_mm.gather(1, chosen), noisy_mm)
        return changed_mm, torch.where(spots, noisy_mm, 0.0)


class Recorrupted(NoisyTarget):
    """Recorrupted-to-recorrupted, for Gaussian noise of known size on measured pixels.

    Pang, Zheng, Quan, Ji, CVPR 2021, in the form of Monroy, Bacca, Tachella, CVPR 2025: with noise
    w ~ N(0, sigma), y + tau w and y - w / tau, tau = sqrt(alpha / (1 - alpha)), carry independent
    noise. Errors beyond ``beta_mm``, which flying pixels have, count linearly.
    """

    kind: Literal["recorrupted"] = "recorrupted"
    alpha: float = Field(0.15, gt=0, lt=1, description="0.15 as in Monroy et al.")
    sigma_mm: float = Field(2.0, gt=0, description="assumed standard deviation of the noise")

    def batch(self, noisy_mm: Tensor, clean_mm: Tensor) -> tuple[Tensor, Tensor]:
        """Add noise to the input, and its opposite to the target."""
        tau, measured = math.sqrt(self.alpha / (1 - self.alpha)), noisy_mm > 0
        added_mm = self.sigma_mm * torch.randn(noisy_mm.shape).to(noisy_mm) * measured
        return noisy_mm + tau * added_mm, noisy_mm - added_mm / tau


class SelfReDepth(NoisyTarget):
    """Loss of "SelfReDepth" (Duarte et al., 2024): earlier frames predict the next noisy one.

    Noise is new in each frame; where a face moves, large errors count linearly. Their inpainting of
    the target by colours has no counterpart here.
    """

    kind: Literal["selfredepth"] = "selfredepth"

    def batch(self, noisy_mm: Tensor, clean_mm: Tensor) -> tuple[Tensor, Tensor]:
        """Make the latest frame the target of those before it. Raises ConfigError without any."""
        if noisy_mm.shape[1] < 2:
            raise ConfigError("selfredepth needs earlier frames: set model.before to 1")
        earlier_mm = noisy_mm.roll(-1, dims=1)
        earlier_mm[:, -1] = 0
        return earlier_mm, noisy_mm[:, :1] * (earlier_mm[:, :1] > 0)


class Sterzentsenko(NoisyTarget):
    """The priors of Sterzentsenko et al., "Self-Supervised Deep Depth Denoising", ICCV 2019.

    An inverse Huber distance from the measured depth, linear up to a fifth of its largest error,
    and smooth normals. Their main term, colours in registered views of other sensors, has no
    counterpart in frames of one sensor. Weights are the authors'.
    """

    kind: Literal["sterzentsenko"] = "sterzentsenko"
    input_weight: float = Field(0.1, ge=0, description="weight of the distance, m")
    smooth_weight: float = Field(0.05, ge=0, description="weight of 1 - cosine of normals")
    focal_px: float = Field(365.456, gt=0, description="focal length, for normals: a Kinect V2's")

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, LossParts]:
        """Compute the weighted sum of both terms."""
        counted = (clean_mm != 0).float()
        error = (prediction.depth_mm - clean_mm).abs() * counted / MM_PER_M
        limit = (0.2 * error.detach().max()).clamp_min(1e-9)
        error = torch.where(error <= limit, error, (error.square() / limit + limit) / 2)
        step_mm = prediction.depth_mm.detach().clamp_min(1) / self.focal_px
        down, right = torch.gradient(prediction.depth_mm, dim=(-2, -1))
        normal = torch.cat([right / step_mm, down / step_mm, torch.ones_like(step_mm)], dim=1)
        bends = [functional.normalize(normal, dim=1).diff(dim=axis) for axis in (-2, -1)]
        inner = -functional.max_pool2d(-counted, 5, 1, 2)  # differences stay within the surface
        rough = [
            weighted_mean(
                bend.square().sum(1, keepdim=True) / 2, inner.narrow(axis, 0, bend.shape[axis])
            )
            for axis, bend in zip((-2, -1), bends, strict=True)
        ]  # half the squared difference of unit normals is 1 - cosine
        parts = {"input": weighted_mean(error, counted), "smooth": torch.stack(rough).mean()}
        return self.input_weight * parts["input"] + self.smooth_weight * parts["smooth"], parts


#: [loss] kind -> class.
LOSSES: Final[dict[str, type[Loss]]] = {
    kind.model_fields["kind"].default: kind
    for kind in (AllPixels, Masked, Noise2Void, Recorrupted, SelfReDepth, Sterzentsenko)
}


def build_loss(table: Mapping[str, Any]) -> Loss:
    """Build the loss of a [loss] table. Raises ConfigError for an unknown kind or parameter."""
    kind = table.get("kind")
    if kind not in LOSSES:
        raise ConfigError(f"loss: no such kind {kind!r} ({did_you_mean(str(kind), LOSSES)})")
    return parse_table(LOSSES[kind], table, "loss")
