"""Depth edges: the two numbers that define "edge" and "interior" in evaluation and training.

An edge of a clean depth map is an invalid pixel or a jump between two neighbouring valid pixels.
The edge band holds the valid pixels near an edge; the interior holds the other valid pixels.
``eval/metrics/prediction.py`` computes them in NumPy and ``train/losses.py`` in PyTorch.

Other thresholds are defined differently and have their own constants: the span of a 3x3 window
(``glsim.denoise.safeguards``), the distance to a median (``glsim.denoise.filters``), 100 mm for
recordings (``glsim.bench.fit.recording_statistics``) and for the checks of heads
(``glsim.bench.validate.checks.faces``).
"""

from __future__ import annotations

from typing import Final

#: Width of the edge band on either side of an edge, in rows and columns, px (docs/evaluation.md).
BAND_PX: Final = 3

#: Two neighbouring pixels whose clean depths differ by more than this lie on two surfaces, mm. One
#: surface would have to be seen at 85 degrees, at 0.9 m and the Kinect V2's 2.5 mm per pixel.
JUMP_MM: Final = 30.0
