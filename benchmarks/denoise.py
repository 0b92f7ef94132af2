"""Time a shipped network on one frame and one thread: python -m benchmarks.denoise [--opencv].

The frame is a plane at 0.9 m with 2 mm of noise; what a network computes does not depend on what
it sees. Networks of video hold four earlier frames by then.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time
from collections.abc import Sequence

_NETWORKS = ("face", "face-ir", "face-video")
_SIZES = ((128, 128), (424, 512))
#: Frames before the timed ones, so that video has its neighbours, and timed frames.
_BEFORE, _TIMED = 4, 5


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the median time of each network and size, ms."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.denoise", description=__doc__)
    parser.add_argument("--opencv", action="store_true", help="not onnxruntime, if it is there")
    options = parser.parse_args(arguments)
    os.environ["OMP_NUM_THREADS"] = "1"  # read when the runtimes are imported
    if options.opencv:
        sys.modules["onnxruntime"] = None  # type: ignore[assignment]  # cannot be imported now
    import cv2
    import numpy as np

    from glsim import load_denoiser

    cv2.setNumThreads(1)
    print(f"{'network':12}" + "".join(f"{f'{w} x {h}, ms':>18}" for h, w in _SIZES))
    for name in _NETWORKS:
        cells = []
        for height, width in _SIZES:
            stream = load_denoiser(name).stream()
            noise = np.random.default_rng(0).normal(0, 2, (_BEFORE + _TIMED, height, width))
            times = []
            for frame in (900 + noise).astype(np.float32):
                infrared = np.full_like(frame, 1000) if name == "face-ir" else None
                start = time.perf_counter()
                stream.push(frame, infrared)
                times.append(1000 * (time.perf_counter() - start))
            cells.append(statistics.median(times[_BEFORE:]))
        print(f"{name:12}" + "".join(f"{cell:18.0f}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
