"""Score denoisers on real recordings, which have no clean truth: ``glsim eval-real``.

``split`` finds static scenes and halves, ``frame_truth`` prepares the measures of one frame,
``run`` scores all methods in worker processes, ``tune`` chooses the settings of filters,
``results`` adds up.
"""

from glsim.eval.real_frames.frame_truth import BINS_M
from glsim.eval.real_frames.results import RealMeasures, RealScores
from glsim.eval.real_frames.run import score_recording
from glsim.eval.real_frames.split import SplitRecording, split_recording
from glsim.eval.real_frames.tune import tune_on_pairs

__all__ = [
    "BINS_M",
    "RealMeasures",
    "RealScores",
    "SplitRecording",
    "score_recording",
    "split_recording",
    "tune_on_pairs",
]
