"""Draw the noise of a sensor as one figure of up to nine panels."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from glsim.errors import require_package
from glsim.measures import stacks as measure
from glsim.validate import published_curves, scenes
from glsim.validate.captures import Captures
from glsim.validate.checks import depth, edges, phases
from glsim.validate.run import sheet_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.typing import RcKeyType

#: Colours for grey printing and for colour-blind readers (Okabe and Ito).
_BLUE, _ORANGE, _GREEN, _GREY = "#0072B2", "#D55E00", "#009E73", "#777777"

_COLUMNS = 3

#: Noise of slanted surfaces in real frames, measured: angles, deg, and sigma of a white wall at
#: 0.9 m, mm.
_REAL_TILT = (
    (30.0, 45.0, 55.0, 64.0, 66.0, 69.0, 71.0, 74.0),
    tuple(1.25 * r for r in (1.00, 0.98, 1.0, 1.07, 1.15, 1.23, 1.38, 1.42)),
)

_SIGMA_MM = r"$\sigma$ (mm)"

_STYLE: dict[RcKeyType, object] = {
    "font.family": "DejaVu Sans", "font.size": 7.5, "axes.titlesize": 8, "axes.titleweight": "bold",
    "axes.titlelocation": "left", "axes.spines.top": False, "axes.spines.right": False,
    "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6,
    "lines.linewidth": 1.2, "lines.markersize": 3.5, "legend.frameon": False,
    "legend.fontsize": 6.5, "legend.handlelength": 1.6, "figure.facecolor": "white",
}  # fmt: skip


def draw_figure(captures: Captures) -> bytes:
    """Draw the panels that apply as a PNG, 180 mm wide, 300 dpi. Raises ConfigError."""
    require_package("matplotlib", "--figure", "eval")
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    panels = [panel for panel, applies in _PANELS if applies(captures)]
    rows = -(-len(panels) // _COLUMNS)
    with mpl.rc_context(_STYLE):
        drawn = Figure(figsize=(7.1, 2.5 * rows + 0.4), layout="constrained")
        FigureCanvasAgg(drawn)
        axes = drawn.subplots(rows, _COLUMNS, squeeze=False).ravel()
        for axis, letter, panel in zip(axes, "abcdefghi", panels, strict=False):
            panel(axis, captures)
            axis.set_title(f"{letter}  {axis.get_title(loc='left')}", loc="left")
        for axis in axes[len(panels) :]:
            axis.remove()
        drawn.suptitle(captures.camera.sensor.title, fontsize=9, x=0.01, ha="left")
        file = io.BytesIO()
        drawn.savefig(file, dpi=300, metadata={"Software": "glsim"})
    return file.getvalue()


def _is_v2(captures: Captures) -> bool:
    """Whether the sensor is checked as a Kinect V2."""
    return sheet_of(captures.camera.sensor).title == "Kinect V2"


def _always(_captures: Captures) -> bool:
    return True


def _has_phases(captures: Captures) -> bool:
    return bool(captures.ablations.phases) and captures.ablations.no_filters is not None


def _has_infrared(captures: Captures) -> bool:
    return _validity_curve(captures) is not None


def _has_shadow(captures: Captures) -> bool:
    return bool(captures.camera.rig.emitters) and _has_infrared(captures)


def _validity_curve(captures: Captures) -> tuple[np.ndarray, np.ndarray, float] | None:
    return captures.cached("validity", lambda: depth.validity_curve(captures))


def _reference(captures: Captures) -> tuple[str, Callable[[np.ndarray], np.ndarray]] | None:
    """Return name and function, m to mm, of a sensor's published noise curve, if any."""
    if captures.camera.sensor.name == "kinect-v1":
        return "Nguyen 2012", published_curves.nguyen_mm
    return ("Fankhauser 2015", published_curves.fankhauser_mm) if _is_v2(captures) else None


def _distance(axis: Axes, captures: Captures) -> None:
    z = np.array([700, 900, 1200, 1500, 2000, 2500, 3000, 3500, 4000, 4450], float)
    spatial = [captures.spatial_sigma_mm(float(at)) for at in z]
    temporal = [captures.temporal_sigma_mm(float(at)) for at in z]
    reference = _reference(captures)
    if reference is not None:
        name, curve = reference
        fine = np.linspace(0.5, 4.5, 100)
        low, high = 0.75 * curve(fine), 1.25 * curve(fine)
        axis.fill_between(fine, low, high, color=_GREY, alpha=0.2, lw=0)
        axis.plot(fine, curve(fine), color=_GREY, label=f"{name} ± 25 %")
    if _is_v2(captures):
        near = np.linspace(0.65, 4.5, 100)
        law = np.hypot(1.05, 4600 * near**2 / 30_300)
        axis.plot(near, law, color=_GREY, ls="--", label="real frames, temporal")
    axis.plot(z / 1000, spatial, "o", color=_BLUE, label="spatial")
    axis.plot(z / 1000, temporal, "^", color=_ORANGE, label="temporal", mfc="none")
    if captures.ablations.white is not None:
        white = [
            captures.temporal_sigma_mm(float(at), changes=captures.ablations.white) for at in z
        ]
        axis.plot(z / 1000, white, "-", color=_GREEN, label="phase noise alone", lw=0.9)
    axis.set(title="noise over distance", xlabel="z (m)", ylabel=_SIGMA_MM, ylim=(0, None))
    axis.legend()


def _angle(axis: Axes, captures: Captures) -> None:
    angles = np.array([0, 20, 40, 50, 60, 70, 75, 80], float)
    sigma = []
    for angle in angles:
        capture = captures.camera.capture(
            scenes.tilted(900, float(angle)),
            captures.scene_frames,
            at_mm=(0, 0, 900),
            scene=f"tilt {angle:.0f}",
        )
        sigma.append(measure.sigma_spatial(capture.centre(64, 8).residual_mm))
    highest = np.fmax.reduce(sigma)
    if _is_v2(captures):
        fine = np.linspace(0, 81, 100)
        published = published_curves.fankhauser_mm(0.9, np.radians(fine))
        axis.plot(fine, published, color=_GREY, label="Fankhauser 2015")
        axis.plot(*_REAL_TILT, "^", color=_GREY, mfc="none", label="real frames, of 1.25 mm")
        highest = np.fmax(highest, np.max(published))
    axis.plot(angles, sigma, "o", color=_BLUE, label="spatial")
    axis.set(title="noise over tilt, 0.9 m", xlabel="angle to the axis (deg)", ylabel=_SIGMA_MM)
    axis.set(ylim=(0, 1.15 * highest))
    axis.legend()


def _autocorrelation(axis: Axes, captures: Captures) -> None:
    lags = np.arange(8)
    part = measure.temporal_part(captures.wall(900).frames_mm)
    straight = measure.autocorrelation(part, [(0, int(k)) for k in lags])
    diagonal = measure.autocorrelation(part, [(int(k), int(k)) for k in lags])
    box = np.clip(1 - lags / 3, 0, 1)
    if _is_v2(captures):  # whose decoder filters the phases over 3 x 3 pixels
        axis.plot(lags, box, color=_GREY, label="3 x 3 box, along")
        axis.plot(lags, box**2, color=_GREY, ls="--", label="3 x 3 box, diagonal")
    axis.plot(lags, straight, "o", color=_BLUE, label="along rows, columns")
    axis.plot(lags, diagonal, "^", color=_ORANGE, label="diagonal", mfc="none")
    axis.set(title="spatial correlation, 0.9 m", xlabel="lag (px)", ylabel="autocorrelation")
    axis.legend()


def _edge(axis: Axes, captures: Captures) -> None:
    far = 1500.0
    capture = edges.capture_edge(captures, far)
    # The camera's geometry gives the position of the slanted edge in each row.
    focal = captures.camera.rig.intrinsics.fx
    x = capture.rays[..., 0] - scenes.EDGE_SLANT * capture.rays[..., 1]
    place = np.broadcast_to(x * focal, capture.fine_mm.shape)
    shown = slice(0, 4)
    valid = np.isfinite(capture.fine_mm[shown])
    axis.plot(place[shown][valid], capture.fine_mm[shown][valid] / 1000, ".", ms=1.5, color=_BLUE,
              rasterized=True)  # fmt: skip
    axis.set(title="edge, 0.9 before 1.5 m", xlabel="from the edge (px)", ylabel="depth (m)")
    axis.set(xlim=(-5, 5), ylim=(0.8, 1.6))
    other = axis.twinx()
    bins = np.arange(-5, 5.01, 0.5)
    which = np.digitize(place.ravel(), bins)
    lost = np.isnan(capture.fine_mm).ravel().astype(np.float64)
    share = [100 * measure.mean_of(lost[which == b]) for b in range(1, len(bins))]
    other.stairs(share, bins, color=_ORANGE)
    other.set(ylim=(0, 105))
    other.set_ylabel("without depth (%)", color=_ORANGE)


def _shadow(axis: Axes, captures: Captures) -> None:
    baseline, focal = captures.camera.rig.baseline_m, captures.camera.rig.intrinsics.fx
    for far, colour in ((1100, _BLUE), (1500, _ORANGE), (2000, _GREEN)):
        place, profile, _ = edges.horizontal_shadow(captures, far)
        axis.plot(place + edges.HALF_PX, profile, color=colour, label=f"on {far / 1000:g} m")
        width = published_curves.shadow_px(baseline, focal, 0.9, far / 1000)
        axis.axvline(-width, color=colour, ls=":", lw=0.8)
    axis.set(title="shadow of an edge", xlabel="from the edge, at 0.9 m (px)", ylabel="light")
    axis.set(xlim=(-42, 2), ylim=(-0.05, 1.1))
    axis.legend(title="dotted: expected", title_fontsize=6.5, loc="lower left")


def _wiggle(axis: Axes, captures: Captures) -> None:
    z, error = captures.cached("wiggle", lambda: depth.wiggle_curve(captures))
    axis.axhline(0, color=_GREY, lw=0.6)
    axis.plot(z / 1000, error, color=_BLUE)
    axis.set(title="mean error", xlabel="z (m)", ylabel="measured - true (mm)")


def _phase(axis: Axes, captures: Captures) -> None:
    from matplotlib.ticker import FixedLocator

    axis.set(title="phase noise, filtered", xlabel="amplitude (IR units)", ylabel=r"$\sigma$ (rad)")
    amplitudes = np.array([10, 15, 20, 30, 50, 70, 100], float)
    noise = phases.measure_phase_noise(captures, amplitudes)
    fine = np.geomspace(
        published_curves.KDE_LEAST_AMPLITUDE, published_curves.KDE_MOST_AMPLITUDE, 80
    )
    published = published_curves.kde_phase_sigma_rad(fine)
    for k, colour in enumerate((_BLUE, _ORANGE, _GREEN)):
        axis.plot(fine, published[k], color=colour, lw=0.9)
        if noise is not None:
            axis.plot(noise.amplitude, noise.sigma_rad[k], "o", color=colour,
                      label=f"{published_curves.FREQUENCIES_MHZ[k]} MHz")  # fmt: skip
    axis.set(xscale="log", yscale="log", xlim=(8, 125), ylim=(0.01, 0.7))
    for scale, ticks in ((axis.xaxis, (10, 20, 50, 100)), (axis.yaxis, (0.01, 0.03, 0.1, 0.3))):
        scale.set_major_locator(FixedLocator(ticks))
        scale.set_major_formatter("{x:g}")
        scale.set_minor_formatter("")
    axis.legend(title="lines: Järemo Lawin 2016", title_fontsize=6.5)


def _validity(axis: Axes, captures: Captures) -> None:
    curve = _validity_curve(captures)
    if _is_v2(captures):
        axis.axvspan(3, 12, color=_GREY, alpha=0.2, lw=0, label="50 % expected here")
    if curve is not None:
        axis.plot(curve[0], 100 * curve[1], "o-", color=_BLUE)
    axis.set(title="validity", xlabel="amplitude (IR units)", ylabel="valid (%)")
    if _is_v2(captures):
        axis.legend(loc="upper left")


def _radius(axis: Axes, captures: Captures) -> None:
    image = captures.camera.rig.intrinsics
    capture = captures.camera.capture(
        scenes.wall(1500), 12, None, at_mm=(0, 0, 1500), scene="whole wall"
    )
    sigma = measure.sigma_temporal_map(capture.frames_mm)
    rows, columns = np.mgrid[: image.height, : image.width]
    r = np.hypot(columns + 0.5 - image.cx, rows + 0.5 - image.cy)
    bins = np.arange(0, r.max(), 20.0)
    middle = 0.5 * (bins[1:] + bins[:-1])
    curve = np.array([measure.mean_of(sigma[(r >= a) & (r < a + 20)]) for a in bins[:-1]])
    axis.plot(middle, curve / curve[0], "o-", color=_BLUE, label="wall at 1.5 m")
    if _is_v2(captures):
        axis.plot([50, 130, 185, 230, 265], np.array([1.45, 1.35, 1.51, 2.14, 3.9]) / 1.45, "^",
                  color=_GREY, label="real frames, 1.36 m", mfc="none")  # fmt: skip
    axis.set(
        title="noise over radius",
        xlabel="from the centre (px)",
        ylabel=r"$\sigma$ / $\sigma$(centre)",
    )
    axis.margins(y=0.15)
    axis.set(ylim=(0, None))
    axis.legend()


#: Panels and whether a sensor has what they show.
_PANELS: tuple[tuple[Callable[[Axes, Captures], None], Callable[[Captures], bool]], ...] = (
    (_distance, _always), (_angle, _always), (_radius, _always), (_autocorrelation, _always),
    (_edge, _always), (_shadow, _has_shadow), (_wiggle, _always), (_phase, _has_phases),
    (_validity, _has_infrared),
)  # fmt: skip
