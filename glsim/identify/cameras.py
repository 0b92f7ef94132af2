"""The depth cameras that are told apart, as their recordings show them.

Baselines, focal lengths and constants are those of real recordings and data sheets, as in the
sensors' files (``glsim/sensors``); ranges of noise are those of real frames, wider by a fifth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

#: (width, height), px.
Size = tuple[int, int]


@dataclass(frozen=True)
class Camera:
    """A camera that made recordings.

    Attributes:
        title: its name.
        sensors: size of a mode -> sensor of glsim; the first stands for other sizes.
        focal_px: size of a mode -> focal length; empty for cameras without a lattice of depths.
        baseline_mm: distance of the two views; 0 without a lattice.
        steps: of disparity per pixel.
        units_mm: of depth files of this camera.
        shifted: whether disparities count from a reference plane: the lattice has an offset.
        noise: least and largest residual of planes, in px of disparity, or 1/m without a lattice.
        correlation: least and largest correlation of that residual 4 px apart along rows.
        shadow: "left", or "upright" for gaps above and below, "" where it tells nothing.
        masked: whether the corners of the image never have depth.
        infrared_bits: 8 or 16; 0 for no infrared image.
    """

    title: str
    sensors: Mapping[Size, str]
    focal_px: Mapping[Size, float] = field(default_factory=dict)
    baseline_mm: float = 0.0
    steps: int = 32
    units_mm: tuple[float, ...] = (1.0,)
    shifted: bool = False
    noise: tuple[float, float] = (0.0, 0.0)
    correlation: tuple[float, float] = (-1.0, 1.0)
    shadow: str = ""
    masked: bool = False
    infrared_bits: int = 16

    def constants(self, unit_mm: float) -> dict[Size, float]:
        """Return size of a mode -> K, where depths are round(K / n) units."""
        factor = self.baseline_mm * self.steps / unit_mm
        return {size: focal * factor for size, focal in self.focal_px.items()}


def _d4xx_modes(focal_1280_px: float, vga_share: float) -> dict[Size, float]:
    """Return the focal length of the modes of a D4xx, px.

    Args:
        focal_1280_px: at 1280x720.
        vga_share: of that at 640x480, which is cut from other rows of the imager.
    """
    widths = {(1280, 720): 1280, (848, 480): 848, (640, 360): 640, (480, 270): 480,
              (424, 240): 424}  # fmt: skip
    modes = {size: focal_1280_px * width / 1280 for size, width in widths.items()}
    return modes | {(640, 480): focal_1280_px * vga_share}


#: Of planes that real D4xx cameras see, px, and their correlation at 4 px along rows.
_D4XX_NOISE, _D4XX_CORRELATION = (0.03, 0.26), (0.45, 0.9)


def _d4xx(
    title: str,
    sensors: Mapping[Size, str],
    focal_px: Mapping[Size, float],
    baseline_mm: float,
    units_mm: tuple[float, ...] = (1.0, 0.1),
) -> Camera:
    """Return a RealSense D4xx: they differ in these alone."""
    return Camera(
        title, sensors, focal_px, baseline_mm, units_mm=units_mm, noise=_D4XX_NOISE,
        correlation=_D4XX_CORRELATION, shadow="left", infrared_bits=8,
    )  # fmt: skip


CAMERAS = (
    _d4xx(
        "RealSense D435", {(848, 480): "realsense-d435", (640, 480): "realsense-d435-vga"},
        _d4xx_modes(639.7, 0.6), 50.17,
    ),
    _d4xx("RealSense D455", {(848, 480): "realsense-d455"}, _d4xx_modes(653.8, 0.6), 95.0),
    _d4xx("RealSense D415", {(1280, 720): "realsense-d415"}, _d4xx_modes(943.57, 2 / 3), 56.2),
    _d4xx(
        "RealSense D405", {(1280, 720): "realsense-d405"},
        _d4xx_modes(648.0, 0.6), 18.0, (0.1, 1.0),
    ),
    Camera(
        "OAK-D Pro", {(1280, 800): "oak-d-pro"}, {(1280, 800): 763.0, (640, 400): 381.5}, 75.0, 8,
        noise=(0.03, 0.4), shadow="left", infrared_bits=8,
    ),
    Camera(
        "Kinect V1", {(640, 480): "kinect-v1-pattern"}, {(640, 480): 572.0}, 75.0, 8,
        shifted=True, noise=(0.05, 0.13), correlation=(0.2, 0.6), infrared_bits=16,
    ),
    Camera(
        "TrueDepth (iPhone, iPad)", {(640, 480): "truedepth", (320, 240): "truedepth"},
        units_mm=(0.1,), noise=(0.0035, 0.013), correlation=(0.25, 0.72), shadow="upright",
        infrared_bits=0,
    ),
    Camera("Kinect V2", {(512, 424): "kinect-v2"}),
    Camera(
        "Azure Kinect, Femto Bolt (NFOV)",
        {(640, 576): "azure-kinect", (320, 288): "azure-kinect-nfov-binned"}, masked=True,
    ),
    Camera(
        "Azure Kinect, Femto Bolt (WFOV)",
        {(512, 512): "azure-kinect-wfov", (1024, 1024): "azure-kinect-wfov-unbinned"}, masked=True,
    ),
)  # fmt: skip
