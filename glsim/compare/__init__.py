"""Compare two sets of depth frames, real or simulated, measure by measure.

``frames`` reads a set; ``temporal``, ``spatial``, ``pattern``, ``light``, ``silhouettes``,
``validity`` and ``classifier`` measure one kind of fact each; ``run`` collects them for two sets,
``report`` writes the table and ``figure`` draws it.
"""

from glsim.compare.figure import draw_comparison
from glsim.compare.frames import DepthFrame, FrameSet, read_frame_set
from glsim.compare.report import Comparison
from glsim.compare.run import compare

__all__ = [
    "Comparison",
    "DepthFrame",
    "FrameSet",
    "compare",
    "draw_comparison",
    "read_frame_set",
]
