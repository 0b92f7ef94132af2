"""Run the network of an ONNX file: by onnxruntime if it is installed, else by OpenCV.

Each input of ``glsim.denoise.inputs`` is a named input of the graph, (1, images, H, W) float32; H
and W are multiples of SIZE_MULTIPLE_PX.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import cv2
import numpy as np

from glsim.denoise.inputs import NetworkInputs
from glsim.denoise.network import Depth, NetworkDenoiser, network_denoiser
from glsim.denoise.onnx_check import check_onnx
from glsim.denoise.onnx_inputs import read_inputs, read_record
from glsim.errors import DenoiserError
from glsim.files.regular import read_regular

Runtime = Literal["onnxruntime", "opencv"]

#: Largest file that is read, bytes: four times the float32 weights of the largest shipped recipe
#: (Restormer, 26 million).
_MAX_BYTES: Final = 2**29


class OpenCvNetwork:
    """Runs an ONNX graph by OpenCV, whose new engine (OpenCV 5) accepts frames of any size."""

    def __init__(self, data: bytes) -> None:
        self.inputs = read_inputs(data)
        self._net = cv2.dnn.readNetFromONNX(
            np.frombuffer(data, np.uint8), engine=cv2.dnn.ENGINE_NEW
        )
        self.outputs: Sequence[str] = self._net.getUnconnectedOutLayersNames()

    def __call__(self, noisy_mm: Depth) -> Mapping[str, Depth]:
        """Run the graph on (H, W) millimetres, or on the (C, H, W) stack of its inputs."""
        for name, blob in _blobs(self.inputs, noisy_mm).items():
            self._net.setInput(blob, name)
        images = self._net.forward(self.outputs)
        return {name: image[0, 0] for name, image in zip(self.outputs, images, strict=True)}


class OnnxRuntimeNetwork:
    """Runs an ONNX graph by onnxruntime, on as many threads as OpenCV uses."""

    def __init__(self, data: bytes) -> None:
        import onnxruntime

        self.inputs = read_inputs(data)

        onnxruntime.disable_telemetry_events()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = cv2.getNumThreads()
        # Threads that spin for work starve each other where other programs run. Measured, a head in
        # a stream on two cores: 49 instead of 45 ms alone, 59 instead of 111 ms with one core busy.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = 3  # errors; warnings would go to stderr
        self._session = onnxruntime.InferenceSession(
            data, options, providers=["CPUExecutionProvider"]
        )
        self.outputs: Sequence[str] = [output.name for output in self._session.get_outputs()]

    def __call__(self, noisy_mm: Depth) -> Mapping[str, Depth]:
        """Run the graph on (H, W) millimetres, or on the (C, H, W) stack of its inputs."""
        images = self._session.run(self.outputs, _blobs(self.inputs, noisy_mm))
        return {name: image[0, 0] for name, image in zip(self.outputs, images, strict=True)}


def _blobs(inputs: NetworkInputs, noisy_mm: Depth) -> dict[str, Depth]:
    """Return name -> (1, images, H, W) of each input of a graph."""
    stack = noisy_mm[None] if noisy_mm.ndim == 2 else noisy_mm
    return {name: np.ascontiguousarray(part[None]) for name, part in inputs.named(stack).items()}


def read_onnx(path: Path) -> bytes:
    """Read a file that ``glsim export`` wrote.

    Raises DenoiserError for a file that is missing, too large, damaged or not of glsim.
    """
    try:
        data = read_regular(path, _MAX_BYTES)
    except OSError as error:
        reason = error.strerror or error
        raise DenoiserError(f"{path}: cannot be read: {reason}") from None
    try:
        check_onnx(data)
    except ValueError as error:
        raise DenoiserError(
            f"{path}: is damaged, or is no network of glsim export (it {error})"
        ) from None
    return data


def load_onnx(
    path: Path, min_probability: float = 0.0, runtime: Runtime | None = None
) -> NetworkDenoiser:
    """Load a network that ``glsim export`` wrote.

    min_probability: see ``NetworkDenoiser``. runtime: default onnxruntime if it is installed, else
    opencv. Raises DenoiserError for a file that is missing, too large, damaged or not of glsim.
    """
    data = read_onnx(path)
    try:
        network = _open(data, runtime)
        record = read_record(data)
    except Exception as error:  # both runtimes have their own classes of errors
        reason = " ".join(str(error).split())[:200]
        raise DenoiserError(f"{path}: is damaged, or is no ONNX network ({reason})") from None
    if "depth_mm" not in network.outputs:
        raise DenoiserError(
            f"{path}: has no output 'depth_mm' (but {', '.join(network.outputs)}): make it with "
            "glsim export"
        )
    uncertain = "sigma_mm" in network.outputs
    return network_denoiser(network, str(path), uncertain, min_probability, network.inputs, record)


def _open(data: bytes, runtime: Runtime | None) -> Any:
    if runtime == "opencv":
        return OpenCvNetwork(data)
    try:
        return OnnxRuntimeNetwork(data)
    except ImportError:
        if runtime is not None:
            raise
        return OpenCvNetwork(data)
