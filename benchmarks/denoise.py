"""Time denoisers: python -m benchmarks.denoise [--opencv] [--live].

Without --live: a shipped network on one frame and one thread. The frame is a plane at 0.9 m with
2 mm of noise. Networks of video hold four earlier frames by then.

With --live: frames a second of a stream of 512 x 424 px, a head at 0.9 m before a wall, on all
cores: networks and filters on whole frames, without the wall, and around the head; NLM and the
guided filter by OpenCV beside them in the same run.
"""

import argparse
import os
import statistics
import sys
import time
from collections.abc import Sequence

_NETWORKS = ("face", "face-video")
_SIZES = ((128, 128), (424, 512))
#: Frames before the timed ones, so that video has its neighbours, and timed frames.
_BEFORE, _TIMED = 4, 5


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the median time of each network and size, ms."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.denoise", description=__doc__)
    parser.add_argument("--live", action="store_true", help="frames a second of a stream")
    parser.add_argument("--opencv", action="store_true", help="not onnxruntime, if it is there")
    options = parser.parse_args(arguments)
    if options.opencv:
        sys.modules["onnxruntime"] = None  # type: ignore[assignment]  # cannot be imported now
    if options.live:
        _time_live()
    else:
        _time_single()


def _time_single() -> None:
    os.environ["OMP_NUM_THREADS"] = "1"  # read when the runtimes are imported
    import cv2
    import numpy as np

    from glsim import load_denoiser

    cv2.setNumThreads(1)
    print(f"{'network':12}" + "".join(f"{f'{w} x {h}, ms':>18}" for h, w in _SIZES))
    for name in _NETWORKS:
        cells = []
        for height, width in _SIZES:
            stream = load_denoiser(name)
            noise = np.random.default_rng(0).normal(0, 2, (_BEFORE + _TIMED, height, width))
            times = []
            for frame in (900 + noise).astype(np.float32):
                start = time.perf_counter()
                stream.push(frame)
                times.append(1000 * (time.perf_counter() - start))
            cells.append(statistics.median(times[_BEFORE:]))
        print(f"{name:12}" + "".join(f"{cell:18.0f}" for cell in cells), flush=True)


#: Rows of --live: denoiser, and where it works.
_LIVE = (
    ("face", ""), ("face", "face"),
    ("face-video", "face"), ("nlm", ""), ("nlm", "face"),
    ("guided:radius=2,epsilon_mm=5", ""), ("guided:radius=2,epsilon_mm=5", "face"),
    ("tgv", "face"),
)  # fmt: skip
_DISTANCE_MM, _WALL_MM = 900, 1500


def _time_live() -> None:
    """Print frames a second by the clock, and seconds of processor time a frame."""
    import cv2
    import numpy as np

    import glsim
    from glsim import load_denoiser, load_settings

    streams = {}
    for title, scene in (("before a wall", {"wall_mm": _WALL_MM}), ("alone", {})):
        settings = load_settings(
            overrides={"sensor": "kinect-v2-fast", "seed": 1, "scene": scene,
                       "pose": {"distance_mm": _DISTANCE_MM}},
            source={"subjects": 1, "frames_per_subject": _BEFORE + _TIMED},
        )  # fmt: skip
        streams[title] = [frame.noisy.astype(np.float32) for frame in glsim.frames(settings)]
    print(f"{cv2.getNumThreads()} threads, load {os.getloadavg()[0]:.1f} before the first row")
    print(f"{'denoiser':32}{'around':8}" + "".join(f"{title:>26}" for title in streams))
    for name, around in _LIVE:
        cells = []
        for frames in streams.values():
            stream = load_denoiser(name, around=around or None)
            times, busy = [], []
            for frame in frames:
                start, used = time.perf_counter(), time.process_time()
                stream.push(frame)
                times.append(time.perf_counter() - start)
                busy.append(time.process_time() - used)
            wall_s, cpu_s = (statistics.median(part[_BEFORE:]) for part in (times, busy))
            cells.append(f"{1 / wall_s:8.1f} /s, {cpu_s:.3f} s CPU")
        print(f"{name:32}{around or '-':8}" + "".join(f"{cell:>26}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
