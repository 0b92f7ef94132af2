"""Score denoisers on real recordings, which have no clean truth: ``glsim eval --real``.

``measures`` prepares what one frame tells, ``recording`` reads the frames, ``run`` scores all
methods in worker processes, ``tune`` chooses the settings of filters, ``results`` adds up.
"""

from glsim.eval.real_frames.measures import BINS_M
from glsim.eval.real_frames.results import MethodScores, RealScores
from glsim.eval.real_frames.run import score_recording
from glsim.eval.real_frames.split import SplitRecording, split_recording
from glsim.eval.real_frames.tune import tune_on_pairs

__all__ = [
    "BINS_M",
    "MethodScores",
    "RealScores",
    "SplitRecording",
    "score_recording",
    "split_recording",
    "tune_on_pairs",
]
