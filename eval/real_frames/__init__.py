"""Scoring of denoisers on real recordings, which have no clean truth: ``glsim eval-real``.

``split`` finds static scenes and halves, ``frame_truth`` measures one frame, ``results`` adds up,
``run`` scores all methods and tunes filters in worker processes.
"""

from glsim.eval.real_frames.frame_truth import BINS_M
from glsim.eval.real_frames.halves import SplitRecording, split_recording
from glsim.eval.real_frames.score_recording import score_recording, tune_on_pairs
from glsim.eval.real_frames.totals import RealMeasures, RealScores

__all__ = [
    "BINS_M",
    "RealMeasures",
    "RealScores",
    "SplitRecording",
    "score_recording",
    "split_recording",
    "tune_on_pairs",
]
