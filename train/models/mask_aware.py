"""Denoising network with the mask of measured pixels as an input and as an output.

The paper's networks read "no return" as a depth of 0 mm, which rewards flying pixels. Here
validity is a separate input and output, and the network corrects relative depth, whose holes are
filled by normalised convolution (Knutsson and Westin 1993). The uncertainty is heteroscedastic and
aleatoric, as in Kendall and Gal, "What Uncertainties Do We Need in Bayesian Deep Learning for
Computer Vision?", NeurIPS 2017.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Final

import torch
from pydantic import AfterValidator, Field
from torch import Tensor, nn

from glsim.core.errors import ConfigError
from glsim.networks.inputs import AFTER, BEFORE, DEPTH, MAX_NEIGHBOURS, NetworkInputs
from glsim.train.models.backbone import Backbone, init_zero
from glsim.train.models.base import DepthModel, Prediction
from glsim.train.models.extra_features import extra_channels, mean_over_time, neighbour_features
from glsim.train.models.features import (
    FILTERS,
    OTHER_CHANNELS,
    FilterName,
    depth_features,
    front_and_back,
    local_mean,
)

Neighbours = Annotated[int, Field(ge=0, le=MAX_NEIGHBOURS)]


def _in_order(filters: tuple[FilterName, ...]) -> tuple[FilterName, ...]:
    if list(filters) != [name for name in FILTERS if name in filters]:
        raise ValueError(f"give each once, in the order {', '.join(FILTERS)}")
    return filters


#: Filters of `depth_features`, each once and in their order.
Filters = Annotated[tuple[FilterName, ...], Field(min_length=1), AfterValidator(_in_order)]
#: Depth correction by an output of 1, mm. Chosen: about the correction by a band's gain of 1.
_CORRECTION_MM: Final = 3.0
#: Log odds of depth before training: +3 for measured pixels, -3 for holes, i.e. 95 %.
_PRIOR_LOGIT: Final = 6.0
#: Log odds of a pixel's own surface over another before training: 95 %.
_PRIOR_CHOICE: Final = 3.0
#: The distance d of another surface becomes asinh(d / this), mm.
_OFFSET_MM: Final = 20.0
#: Standard deviation before training, mm: Kinect v2's noise at 0.9 m.
_PRIOR_SIGMA_MM: Final = 1.65
#: Limits of log sigma: wider than any depth camera's, and safe for exp().
_LEAST_SIGMA_MM, _LARGEST_SIGMA_MM = 0.02, 500.0


class MaskAware(DepthModel):
    """A denoiser that computes corrected depth, validity and uncertainty from depth features.

    Input: (B, C, H, W) float32. The first channel is depth; ``before`` and ``after`` add channels
    (see ``glsim.networks.inputs``). Values that are not above 0 are holes.

    The correction is the sum of the filters' bands (`features.Features.bands_mm`), each times a
    predicted gain, and of a predicted residual, minus the mean of this sum over the surrounding
    surface (24 px), so that a network cannot learn the bias of its training cameras. With
    neighbours in time, the measured depth is first averaged with them (`mean_over_time`).

    With ``surfaces`` a pixel at an edge chooses the surface in front or behind. A single predicted
    depth would be their mean, a flying pixel. Choosing a mode is the idea of Tosi et al.,
    "SMD-Nets: Stereo Mixture Density Networks", CVPR 2021.

    The last layer starts at zero: an untrained network returns the measured depth and mask, and a
    sigma of 1.65 mm. Features and sums in millimetres stay float32 under autocast.

    ``filters`` are some of FILTERS, in their order; fewer filters take less time. The backbone maps
    a channel per filter and 5 others (2 more with ``surfaces``) to a gain per filter and 2 others
    (1 more with ``uncertainty``, 4 more with ``surfaces``). The buffer ``sigma_scale`` multiplies
    sigma, see `calibrate`. ``keep_clean=False`` is for cameras whose noise looks like the form of
    surfaces, and so like frames without noise.
    """

    sigma_scale: Tensor

    def __init__(
        self, backbone: Backbone, uncertainty: bool = False, surfaces: bool = False,
        before: Neighbours = 0, after: Neighbours = 0, filters: Filters = FILTERS,
        keep_clean: bool = True,
    ) -> None:  # fmt: skip
        super().__init__()
        self.keep_clean, self.margin_px = keep_clean, backbone.margin_px
        self.filters = filters
        self.inputs = NetworkInputs(before, after)
        self.backbone = backbone
        init_zero([layer for layer in backbone.modules() if isinstance(layer, nn.Conv2d)][-1])
        self.uncertainty = uncertainty
        self.surfaces = surfaces
        self.register_buffer("sigma_scale", torch.ones(()))

    @staticmethod
    def backbone_settings(
        uncertainty: bool = False, surfaces: bool = False, before: int = 0, after: int = 0,
        filters: Sequence[FilterName] = FILTERS, **_others: Any,
    ) -> dict[str, Any]:  # fmt: skip
        """Return the backbone's arguments that follow from the arguments of the model."""
        extra = extra_channels(NetworkInputs(before, after))
        return {
            "in_channels": len(filters) + OTHER_CHANNELS + 2 * surfaces + extra,
            "out_channels": 2 + len(filters) + uncertainty + 4 * surfaces,
            "residual": False,
        }

    def forward(self, noisy_mm: Tensor) -> Prediction:
        """Denoise a batch, (B, C, H, W) float32."""
        with torch.autocast(noisy_mm.device.type, enabled=False):
            stack = noisy_mm.float()
            named = self.inputs.named(stack)
            noisy_mm = named[DEPTH]
            neighbours = [named[name] for name in (BEFORE, AFTER) if name in named]
            if neighbours:
                neighbours_mm = torch.cat(neighbours, dim=1)
                in_time = mean_over_time(neighbours_mm, noisy_mm)
                noisy_mm = noisy_mm + in_time.offset_mm
            fill_mm, bands_mm, channels, even = depth_features(noisy_mm, self.filters)
            if self.surfaces:
                around_mm = front_and_back(noisy_mm, fill_mm)
                offset = torch.asinh((around_mm - fill_mm) / _OFFSET_MM)
                channels = torch.cat([offset, channels], dim=1)
            valid = channels[:, -1:]
            # Extra channels are last, so that weights of single-frame networks fit (`copy_weights`)
            if neighbours:
                features = neighbour_features(neighbours_mm, fill_mm, in_time)
                channels = torch.cat([channels, features], dim=1)
        out = self.backbone(channels).float()
        count = len(self.filters)
        gains, out = out[:, :count], out[:, count:]
        correction_mm = (gains * bands_mm).sum(1, keepdim=True) + _CORRECTION_MM * out[:, :1]
        prediction = Prediction(
            depth_mm=fill_mm + correction_mm - local_mean(correction_mm, even),
            valid_logit=out[:, 1:2] + _PRIOR_LOGIT * (valid - 0.5),
            log_sigma=self._log_sigma(out[:, 2:3]) if self.uncertainty else None,
        )
        if not self.surfaces:
            return prediction
        return self._with_likeliest_surface(prediction, around_mm, out[:, -4:])

    def _with_likeliest_surface(
        self, single: Prediction, around_mm: Tensor, out: Tensor
    ) -> Prediction:
        """Replace each depth by the most probable of three surfaces: the pixel's, front, back."""
        depth_mm = single.depth_mm
        candidates_mm = torch.cat([depth_mm, around_mm + _CORRECTION_MM * out[:, :2]], dim=1)
        logits = torch.cat([torch.zeros_like(depth_mm), out[:, 2:] - _PRIOR_CHOICE], dim=1)
        # argmax over three channels would add a tenth to the time of the whole network.
        front, behind = logits[:, 1:2], logits[:, 2:]
        other = torch.where(behind > front, 2, 1)
        likeliest = torch.where(torch.maximum(front, behind) > 0, other, 0)
        depth_mm = candidates_mm.gather(1, likeliest)
        return single._replace(depth_mm=depth_mm, candidates_mm=candidates_mm, choice_logits=logits)

    def _log_sigma(self, out: Tensor) -> Tensor:
        least, largest = math.log(_LEAST_SIGMA_MM), math.log(_LARGEST_SIGMA_MM)
        log_sigma = (out + math.log(_PRIOR_SIGMA_MM)).clamp(least, largest)
        return log_sigma + self.sigma_scale.log()


#: Median of |x| for a standard normal x.
_MEDIAN_NORMAL: Final = 0.6744898


@torch.no_grad()
def calibrate(model: MaskAware, pairs: Iterable[tuple[Tensor, Tensor]]) -> float:
    """Fit ``model.sigma_scale`` to validation pairs (noisy_mm, clean_mm), (B, 1, H, W) each.

    Temperature scaling (Guo et al., "On Calibration of Modern Neural Networks", ICML 2017) for
    regression (Levi et al., "Evaluating and Calibrating Uncertainty Prediction in Regression
    Tasks", Sensors 22, 2022). One factor keeps the order of pixels, and cannot overfit.

    Half of the errors are then smaller than 0.67 sigma, which describes surfaces and ignores tails.
    Only pixels with depth in both prediction and truth count. Returns the factor; the mode of the
    model (train or eval) stays. Raises ConfigError for a model without uncertainty, and if there is
    nothing to fit: no pixel, only errors of 0, or a value that is not finite.
    """
    if not model.uncertainty:
        raise ConfigError("calibration: the model predicts no sigma; set uncertainty = true")
    training = model.training
    model.eval()
    parts = [torch.zeros(0)]
    for noisy_mm, clean_mm in pairs:
        prediction = model(noisy_mm)
        unscaled = (prediction.log_sigma - model.sigma_scale.log()).exp()
        both = (clean_mm > 0) & (prediction.valid_logit > 0)
        parts.append(((prediction.depth_mm - clean_mm) / unscaled)[both].cpu())
    model.train(training)
    size = torch.cat(parts).abs().double()
    if not size.numel() or not bool(size.isfinite().all()) or not size.any():
        raise ConfigError("calibration: no finite errors; give noisy frames with depth to compare")
    scale = float(size.median()) / _MEDIAN_NORMAL
    model.sigma_scale.fill_(scale)
    return scale
