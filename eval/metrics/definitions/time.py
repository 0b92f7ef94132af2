"""The time of a denoiser, which the evaluation measures around its call."""

from __future__ import annotations

from glsim.eval.metrics.metric import Metric

TIME = Metric(
    "time_ms",
    "ms",
    "lower",
    "time",
    "the denoiser's time for the frame, one core",
    in_table=True,
)
