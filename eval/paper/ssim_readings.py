"""The SSIM column of the paper's table 1 under every reading of its text.

The text does not define the data type of the maps, the range L ("the dynamic range found in the
pixels"), whether K1 and K2 are intentionally a tenth of the usual values, and the program. Each
reading is computed on our frames, which are not the paper's: this can refute readings, and show
which come near.

scikit-image takes L from the type of the first image if it is not given: 255 for uint8, 65535 for
uint16, and, before version 0.20, 2 for floats (-1 to 1); since then it refuses floats without L.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.denoise import Method, compose, load
from glsim.denoise.frames import Frames
from glsim.denoise.interface import Depth
from glsim.errors import ConfigError
from glsim.eval.metrics.ssim import Moments, window_statistics

_Image = NDArray[Any]

#: L of each data type in scikit-image.
TYPE_RANGE: Final = {"uint8": 255.0, "uint16": 65535.0, "float": 2.0}
#: K1 and K2: of Wang et al. 2004, and as the paper prints them.
USUAL: Final = (0.01, 0.03)
AS_PRINTED: Final = (0.001, 0.003)
#: The paper's depth range, mm.
DEPTH_RANGE_MM: Final = 8000.0
#: The filters of the column; the paper's Adaptive row equals Baseline.
COLUMNS: Final = ("noisy", "median", "nlm", "bilateral")
#: OpenCV's NLM takes 8-bit images by default, and 16-bit ones only with NORM_L1; maps at 1 mm fit
#: into 8 bits. A variant of the NLM row.
NLM_8_BIT: Final = "nlm, 8 bit"
#: Parameters of the paper's NLM: strength, window, search window.
_NLM: Final = (30.0, 7, 21)


@dataclass(frozen=True)
class Reading:
    """One reading of the paper's SSIM.

    Attributes:
        data: data type of the maps.
        data_range: definition of L.
        k: K1 and K2.
        program: the program that computes it.
        of: SSIM of two depth maps, (H, W) float32 mm, the prediction first.
    """

    data: str
    data_range: str
    k: tuple[float, float]
    program: str
    of: Callable[[Depth, Depth], float]

    @property
    def name(self) -> str:
        """A line that names it."""
        k = "K as printed" if self.k == AS_PRINTED else "usual K"
        return f"{self.data}, L {self.data_range}, {k}, {self.program}"


def whole_mm(depth: Depth) -> _Image:
    """Round to whole millimetres, uint16."""
    return np.clip(np.rint(depth), 0, 65535).astype(np.uint16)


def saturated(depth: Depth) -> _Image:
    """Round to whole millimetres, at most 255."""
    return np.clip(np.rint(depth), 0, 255).astype(np.uint8)


def wrapped(depth: Depth) -> _Image:
    """Keep the lower eight bits of whole millimetres, as a plain cast does."""
    return (whole_mm(depth) & 255).astype(np.uint8)


def of_8000_mm(depth: Depth) -> _Image:
    """Scale 8000 mm to 255."""
    scaled: _Image = np.clip(np.rint(depth * (255 / DEPTH_RANGE_MM)), 0, 255).astype(np.uint8)
    return scaled


def of_own_maximum(depth: Depth) -> _Image:
    """Scale the largest depth of the map to 255."""
    largest = float(depth.max(initial=0.0))
    scaled: _Image = np.rint(depth * (255 / largest) if largest else depth).astype(np.uint8)
    return scaled


def millimetres(depth: Depth) -> _Image:
    """Keep float millimetres."""
    return depth.astype(np.float64)


def scikit_image(
    first: _Image, second: _Image, data_range: float, k: tuple[float, float], gauss: bool = False
) -> float:
    """Compute scikit-image's SSIM, with ``gauss`` as Wang et al. define window and covariance.

    Raises:
        ConfigError: without scikit-image.
    """
    try:
        from skimage.metrics import structural_similarity
    except ImportError:
        raise ConfigError("the study of SSIM needs scikit-image: pip install 'glsim[eval]'") from (
            None
        )
    window: dict[str, Any] = {"gaussian_weights": True, "sigma": 1.5} if gauss else {}
    if gauss:
        window["use_sample_covariance"] = False
    value = structural_similarity(  # type: ignore[no-untyped-call]  # it has no annotations
        first, second, data_range=data_range, K1=k[0], K2=k[1], **window
    )
    return float(value)


def printed_formula(
    first: _Image, second: _Image, data_range: float, k: tuple[float, float]
) -> float:
    """Compute SSIM as the paper prints it: C1 in both factors below the line; windows of 7 x 7."""
    c1, c2 = ((part * data_range) ** 2 for part in k)
    return window_statistics(Moments.of(first), Moments.of(second)).similarity(c1, c2, c1)


def one_window(first: _Image, second: _Image, data_range: float, k: tuple[float, float]) -> float:
    """Compute SSIM with one window, the whole image."""
    x, y = first.astype(np.float64), second.astype(np.float64)
    c1, c2 = ((part * data_range) ** 2 for part in k)
    product, squares = x.mean() * y.mean(), x.mean() ** 2 + y.mean() ** 2
    covariance = ((x - x.mean()) * (y - y.mean())).mean()
    upper = (2 * product + c1) * (2 * covariance + c2)
    return float(upper / ((squares + c1) * (x.var() + y.var() + c2)))


def found_range(first: _Image, second: _Image) -> float:
    """Return the range of the values in two images; 1 if they have none."""
    low, high = min(first.min(), second.min()), max(first.max(), second.max())
    return float(high) - float(low) or 1.0


def _readings() -> list[Reading]:
    readings: list[Reading] = []

    def add(
        data: str,
        convert: Callable[[Depth], _Image],
        data_range: str,
        length: float | None,
        k: tuple[float, float] = USUAL,
        program: str = "scikit-image",
        compute: Callable[..., float] = scikit_image,
        **options: Any,
    ) -> None:
        """length: L; None: the range found in the two images."""

        def of(prediction: Depth, truth: Depth) -> float:
            first, second = convert(prediction), convert(truth)
            found = found_range(first, second) if length is None else length
            return compute(first, second, found, k, **options)

        readings.append(Reading(data, data_range, k, program, of))

    casts: list[tuple[str, Callable[[Depth], _Image], str]] = [
        ("uint16 mm", whole_mm, "uint16"),
        ("uint8, saturated", saturated, "uint8"),
        ("uint8, wrapped", wrapped, "uint8"),
        ("uint8, 8000 mm = 255", of_8000_mm, "uint8"),
        ("uint8, own maximum = 255", of_own_maximum, "uint8"),
        ("float mm", millimetres, "float"),
    ]
    for k in (USUAL, AS_PRINTED):
        for data, convert, kind in casts:
            add(data, convert, f"{TYPE_RANGE[kind]:g} (the type's)", TYPE_RANGE[kind], k)
        add("float mm", millimetres, "8000", DEPTH_RANGE_MM, k)
        add("float mm", millimetres, "found in the pixels", None, k)
    for data_range, length in (("65535", 65535.0), ("2", 2.0), ("found in the pixels", None)):
        add("float mm", millimetres, data_range, length,
            program="scikit-image, Gaussian window", gauss=True)  # fmt: skip
    for data_range, length in (("8000", DEPTH_RANGE_MM), ("found in the pixels", None)):
        for program, compute in (
            ("printed formula", printed_formula),
            ("one window", one_window),
        ):
            add("float mm", millimetres, data_range, length, AS_PRINTED, program, compute)
    return readings


READINGS: Final = tuple(_readings())
#: The hypothesis: each row is computed in the data type in which OpenCV's filter returns it, with
#: that type's L. Column -> the data type of its reading.
ROW_TYPES: Final = {
    "noisy": "uint16 mm",
    "median": "uint16 mm",
    "nlm": "uint8, saturated",
    "bilateral": "float mm",
}


def reading_of_type(data: str) -> Reading:
    """Return the reading of a data type with its own L, the usual K and scikit-image."""
    return next(reading for reading in READINGS if reading.data == data)


@dataclass(frozen=True)
class ReadingScores:
    """Means over frames.

    Attributes:
        ssim: reading -> column -> SSIM.
        mse_mm2: column -> MSE of all pixels.
        ours_off: largest difference between our SSIM and scikit-image's.
    """

    frames: int
    ssim: dict[str, dict[str, float]]
    mse_mm2: dict[str, float]
    ours_off: float

    def mixed(self) -> dict[str, float]:
        """Return the column under the hypothesis of ROW_TYPES, with NLM in 8 bits if it fits."""
        column_of = {column: column for column in ROW_TYPES}
        if NLM_8_BIT in self.mse_mm2:
            column_of["nlm"] = NLM_8_BIT
        return {
            column: self.ssim[reading_of_type(data).name][column_of[column]]
            for column, data in ROW_TYPES.items()
        }


def measure_readings(
    frames: Frames, limit: int = 20, networks: Mapping[str, Method] | None = None
) -> ReadingScores:
    """Compute every reading on at most ``limit`` frames, evenly spread.

    Args:
        frames: the pairs.
        limit: largest number of frames.
        networks: row of tables 2 and 3 -> its network, whose validity is a mask; columns of their
            own beside the filters.

    Raises:
        DatasetError: for an unreadable frame.
        DenoiserError: for a network that returns no depth map.
    """
    numbers = np.unique(np.linspace(0, len(frames) - 1, min(limit, len(frames))).round())
    methods = {column: load(column) for column in COLUMNS} | dict(networks or {})
    ssim: dict[str, dict[str, list[float]]] = {reading.name: {} for reading in READINGS}
    mse: dict[str, list[float]] = {}
    off = 0.0
    for number in numbers.astype(int):
        sample = frames.load(int(number))
        maps = {
            name: compose(method(sample.noisy_mm[None]), sample.noisy_mm)[""]
            for name, method in methods.items()
        }
        if frames.protocol == "paper":
            maps[NLM_8_BIT] = cv2.fastNlMeansDenoising(
                saturated(sample.noisy_mm), None, *_NLM
            ).astype(np.float32)
        for column, depth in maps.items():
            error = depth.astype(np.float64) - sample.clean_mm
            mse.setdefault(column, []).append(float((error * error).mean()))
            for reading in READINGS:
                value = reading.of(depth, sample.clean_mm)
                ssim[reading.name].setdefault(column, []).append(value)
            off = max(off, _ours_off(depth, sample.clean_mm))
    means = {
        name: {column: float(np.mean(values)) for column, values in columns.items()}
        for name, columns in ssim.items()
    }
    return ReadingScores(
        len(numbers), means, {name: float(np.mean(values)) for name, values in mse.items()}, off
    )


def _ours_off(depth: Depth, truth: Depth) -> float:
    """Return the difference between our SSIM and scikit-image's, usual K, L = 8000."""
    first, second = millimetres(depth), millimetres(truth)
    c1, c2 = ((part * DEPTH_RANGE_MM) ** 2 for part in USUAL)
    ours = window_statistics(Moments.of(first), Moments.of(second)).similarity(c1, c2, c2)
    return abs(ours - scikit_image(first, second, DEPTH_RANGE_MM, USUAL))
