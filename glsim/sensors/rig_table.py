"""The rig of a sensor file, read from its TOML table [rig] and checked.

[rig]
width = 512
height = 424
focal_px = [365.456, 365.456]
centre_px = [254.878, 205.395]
[rig.distortion]          optional: k1, k2, k3, p1, p2; k4, k5, k6 of the rational model; limit_tan
supersample = 3           optional: samples per pixel along each axis (1, 3 or 5)
modulation_mhz = [80, 16, 120]   time of flight only: fast, slow, fastest
shadow_map = true         false: a stage casts the shadows instead of the renderer
fixed_pattern_map = "x_fixed_pattern.npy"   optional: this device's error map, from glsim fit
projector_image = "dots.png"   optional: image that all emitters project instead of dots
projector_view_deg = [90, 63]  its field of view, degrees (glsim.sensors.images)
[rig.exposure]            optional: captures and spacing_ms; or read_out_ms and bands of rows
[[rig.wiggling]]          optional: this device's wiggling, from glsim fit (glsim.sensors.wiggling)
border_px = [0, 0, 0, 0]  optional: pixels that imagers see left, above, right, below the image
[[rig.emitter]]
position_m = [0.045, 0, 0]
spread_m = 0.005          optional: three points of light at this distance, instead of one
shares = [0.2, 0.4, 0.4]  optional: shares of the light: near end, centre, far end
path_from_m = [0.04, 0, 0]   optional: start of the light's path in the decoder, if elsewhere
[[rig.imager]]            stereo: two; structured light: one, matched with the first emitter's dots
position_m = [0, 0, 0]
deliver = "colour"        registers the frame to this camera:
[rig.colour]              width, height, focal_px, centre_px as above
position_m = [-0.015, 0, 0]   in the depth camera's frame
turn_deg = [0, 0, 0]      optional: rotation vector from the depth camera's axes to its axes
covers = "corners"        optional: or "centre", after which a depth pixel covers one colour pixel
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, ConfigDict, Field, model_validator, with_config

from glsim.core.camera import ColourCamera, Distortion, Emitter, Exposure, Intrinsics, SensorRig
from glsim.sensors.images import half_tan
from glsim.sensors.wiggling import Wave
from glsim.settings.toml_tables import TomlTable

#: Coordinates in the camera frame, m, and in the image, px; their limits exceed any camera's.
_Metres = Annotated[float, Field(ge=-2, le=2)]
_Pixels = Annotated[float, Field(ge=-1e6, le=1e6)]
_Border = Annotated[int, Field(ge=0, le=1024)]
_FocalPx = Annotated[float, Field(ge=1, le=1e6)]
_Degrees = Annotated[float, Field(ge=-180, le=180)]
_Share = Annotated[float, Field(ge=0, le=1)]
_ViewDeg = Annotated[float, Field(ge=1, le=170)]


class _EmitterTable(TomlTable, allow_inf_nan=False):
    position_m: tuple[_Metres, _Metres, _Metres]
    spread_m: float = Field(0.0, ge=0, le=0.2)
    path_from_m: tuple[_Metres, _Metres, _Metres] | None = None
    shares: tuple[_Share, _Share, _Share] = (1 / 3, 1 / 3, 1 / 3)

    @model_validator(mode="after")
    def _check(self) -> _EmitterTable:
        if abs(sum(self.shares) - 1.0) > 1e-3:
            raise ValueError(f"shares {list(self.shares)}: must add up to 1")
        return self


class _ImagerTable(TomlTable, allow_inf_nan=False):
    position_m: tuple[_Metres, _Metres, _Metres]


class _ColourTable(TomlTable, allow_inf_nan=False):
    width: int = Field(ge=8, le=8192)
    height: int = Field(ge=8, le=8192)
    focal_px: tuple[_FocalPx, _FocalPx]
    centre_px: tuple[_Pixels, _Pixels]
    position_m: tuple[_Metres, _Metres, _Metres]
    turn_deg: tuple[_Degrees, _Degrees, _Degrees] = (0.0, 0.0, 0.0)
    covers: Literal["corners", "centre"] = "corners"

    def camera(self) -> ColourCamera:
        image = Intrinsics(self.width, self.height, *self.focal_px, *self.centre_px)
        return ColourCamera(image, self.position_m, self.turn_deg, self.covers)


def _check_limit(lens: Distortion) -> Distortion:
    if not 0 <= lens.limit_tan <= 10:
        raise ValueError(f"limit_tan {lens.limit_tan:g}: must lie in [0, 10]")
    return lens


# The table of a lens has exactly the fields of Distortion.
with_config(ConfigDict(extra="forbid", allow_inf_nan=False))(Distortion)
_Lens = Annotated[Distortion, AfterValidator(_check_limit)]


class _ExposureTable(TomlTable, allow_inf_nan=False):
    captures: Literal[0, 9, 10] = 0
    spacing_ms: float = Field(0.0, ge=0, le=1000)
    read_out_ms: float = Field(0.0, ge=0, le=1000)
    bands: int = Field(16, ge=2, le=64)


class RigTable(TomlTable, allow_inf_nan=False):
    """The validated table [rig] of a sensor file."""

    width: int = Field(ge=8, le=8192)
    height: int = Field(ge=8, le=8192)
    focal_px: tuple[_FocalPx, _FocalPx]
    centre_px: tuple[_Pixels, _Pixels]
    emitter: tuple[_EmitterTable, ...] = ()
    imager: tuple[_ImagerTable, ...] = ()
    border_px: tuple[_Border, _Border, _Border, _Border] = (0, 0, 0, 0)
    distortion: _Lens = Distortion()
    deliver: Literal["undistorted", "raw", "colour"] = "undistorted"
    colour: _ColourTable | None = None
    near_m: float = Field(0.1, gt=0, le=100)
    far_m: float = Field(12.0, gt=0, le=1000)
    supersample: int = Field(1, ge=1, le=5)
    modulation_mhz: tuple[float, float, float] | tuple[()] = ()
    shadow_map: bool = True
    fixed_pattern_map: str = ""
    projector_image: str = ""
    projector_view_deg: tuple[_ViewDeg, _ViewDeg] | None = None
    wiggling: tuple[Wave, ...] = ()
    exposure: _ExposureTable = _ExposureTable()

    @model_validator(mode="after")
    def _check(self) -> RigTable:
        if strange := {w.modulation_mhz for w in self.wiggling} - {*self.modulation_mhz}:
            raise ValueError(f"wiggling: {min(strange):g} MHz is none of modulation_mhz")
        if self.deliver == "colour" and self.colour is None:
            raise ValueError('deliver = "colour" needs the camera of a table [rig.colour]')
        if self.near_m >= self.far_m:
            raise ValueError(f"near_m {self.near_m} must be less than far_m {self.far_m}")
        if any(e.position_m == (0.0, 0.0, 0.0) for e in self.emitter):
            raise ValueError("an emitter at the camera itself throws no shadow: leave it out")
        if self.exposure.captures and self.exposure.read_out_ms:
            raise ValueError("exposure: give captures or read_out_ms, not both")
        if self.projector_image and self.projector_view_deg is None:
            view = "projector_view_deg = [columns, rows]"
            raise ValueError(f"projector_image needs the field of view that it fills, {view}")
        if self.supersample % 2 == 0:
            wrong = f"supersample {self.supersample}"
            raise ValueError(f"{wrong} must be odd: the middle sample is the depth")
        return self

    def rig(self) -> SensorRig:
        """Return the rig that the table describes."""
        return SensorRig(
            Intrinsics(self.width, self.height, *self.focal_px, *self.centre_px),
            tuple(Emitter(e.position_m, e.spread_m, e.path_from_m, e.shares) for e in self.emitter),
            self.distortion,
            self.deliver,
            self.near_m,
            self.far_m,
            self.supersample,
            self.modulation_mhz,
            self.shadow_map,
            tuple(i.position_m for i in self.imager),
            self.border_px,
            Exposure(**self.exposure.model_dump()),
            self._projector_tan(),
            None if self.colour is None else self.colour.camera(),
        )

    def _projector_tan(self) -> tuple[float, float]:
        if not self.projector_image or self.projector_view_deg is None:
            return 0.0, 0.0
        across_deg, down_deg = self.projector_view_deg
        return half_tan(across_deg), half_tan(down_deg)
