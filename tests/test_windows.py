"""What needs neither OpenGL nor Linux runs without both: owners of cameras sit at Windows."""

import subprocess
import sys
from pathlib import Path

import pytest

from glsim import generate, load_settings
from tests.cli.test_train import TINY
from tests.support.face_sets import FACE, TRIANGLES, obj_bytes, put
from tests.support.recordings import scene, write_static_pair

ROOT = Path(__file__).parents[1]

#: Other packages keep what this system has: they are Windows' own there. After them, imports find
#: neither the modules that Windows lacks nor OpenGL's, and ``os`` and ``signal`` lack their names.
SCRIPT = """
import os, pathlib, signal, subprocess, sys, tempfile, types, warnings
import cv2, isal, lightning_fabric, pydantic, rich, safetensors, tensorboard, torch, trimesh, typer
import fast_simplification, filelock, torch.utils.tensorboard
import scipy.optimize, sklearn.ensemble, torch._dynamo

for name in ("fcntl", "resource", "pwd", "grp", "termios", "glcontext"):
    sys.modules[name] = None

def without(module, names):
    left = types.ModuleType(module.__name__)
    left.__dict__.update({k: v for k, v in vars(module).items() if k not in names})
    sys.modules[module.__name__] = left
    return left

system = without(os, {"fork", "geteuid", "getuid", "sync", "sched_getaffinity", "getppid", "killpg",
                      "O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "uname", "pread"})
without(signal, {"SIGKILL", "SIGHUP", "SIGSTOP", "pause"})
system.supports_effective_ids = set()

def open_no_folder(path, *arguments):
    if os.path.isdir(path):
        raise PermissionError(13, "Permission denied", str(path))
    return os.open(path, *arguments)

system.open = open_no_folder

warnings.filterwarnings("error", category=EncodingWarning, module=r"glsim\\.")
import numpy as np
import glsim
from glsim.cli import main

def run(*words):
    assert main(list(words)) == 0, words

clean = sorted(pathlib.Path("data").rglob("*_clean.png"))[0]
noisy = str(clean).replace("_clean", "_noisy")
run("denoise", noisy, "-o", "denoised.png")
run("denoise", "recording", "-d", "median", "-o", "denoised")
run("inspect", "scans")
run("eval-real", "recording", "-d", "median", "-o", "real", "--no-figures")
run("compare", "recording", "data")
run("corrupt", str(clean), "-o", "corrupted.png", "--backend", "numpy")
run("eval", "data", "--split", "val", "-d", "median", "-o", "scores", "--no-figures")
run("train", "tiny.toml", "--data", "data", "-o", "run", "--steps", "2")
depth_m = np.full((40, 48), 0.9, np.float32)
assert (glsim.DepthNoise("kinect-v2-fast", backend="numpy")(depth_m) != depth_m).any()
tensor = torch.from_numpy(depth_m)[None]
assert (glsim.DepthNoise("kinect-v2-fast", backend="torch")(tensor) != tensor).any()
from glsim.train import StoredPairs
pairs = StoredPairs(pathlib.Path("data"), "train", crop=32)
loader = torch.utils.data.DataLoader(pairs, 3, num_workers=1, multiprocessing_context="spawn")
assert next(iter(loader))[0].shape == (3, 1, 32, 32)
"""


@pytest.mark.long
def test_recordings_noise_and_training_need_neither_opengl_nor_linux(tmp_path: Path) -> None:
    settings = load_settings(
        overrides={"split": [0.75, 0.25, 0.0], "output": {"crop": 32}},
        source={"subjects": 4, "frames_per_subject": 6},
    )
    generate(settings, tmp_path / "data", workers=1)
    write_static_pair(tmp_path / "recording", scene(), 2.0)
    put(tmp_path / "scans" / "a.obj", obj_bytes(FACE, TRIANGLES))
    (tmp_path / "tiny.toml").write_text(TINY)
    # Windows has another encoding by default: a text file without a stated one is an error.
    words = ["-X", "warn_default_encoding", "-c", SCRIPT]
    done = subprocess.run(
        [sys.executable, *words], cwd=tmp_path, capture_output=True, text=True,
        env={"PYTHONPATH": str(ROOT), "GLSIM_CACHE": str(tmp_path / "cache"), "PATH": ""},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
