"""Write the page that denoises the visitor's own depth maps: ``glsim tune --static DIR --denoise``.

    DIR/denoise.html, denoise.js   the page; its style is that of the tuner's, tune.css
    DIR/example.png                a simulated map to try
    DIR/networks/NAME.onnx         the shipped networks
    DIR/onnxruntime/               the files of onnxruntime-web

All that the page asks for lies in its folder, and its policy lets the browser ask nobody else. It
needs a server, since browsers read no networks beside a page that is opened from a disk.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from glsim.denoise import around, composites, safeguards, tiles
from glsim.denoise.loading import is_shipped, shipped_file
from glsim.denoise.map_steps import FINE_MM
from glsim.denoise.network import SIZE_MULTIPLE_PX
from glsim.denoise.onnx_inputs import read_inputs, read_record
from glsim.denoise.record import UNLIKELY
from glsim.denoise.registry import NETWORKS
from glsim.errors import ConfigError, MeshError
from glsim.files.atomic import write_atomic
from glsim.files.png import UNIT_KEYWORD, encode_png
from glsim.frame import Frame
from glsim.pipeline import frames
from glsim.settings.schema import load_settings
from glsim.tune.onnxruntime_web import FILES, is_fetched, runtime_folder
from glsim.tune.page_script import ASSETS, join_script

#: The modules of the script, each after those that it imports.
MODULES: Final = (
    "maps.js", "charts.js", "packet.js", "images.js", "surface_mesh.js", "surface_points.js",
    "surface.js", "figures.js", "rate.js", "tune.js", "static/theme.js",
    "denoise/png.js", "denoise/depth_files.js", "denoise/safeguards.js", "denoise/composites.js",
    "denoise/network.js", "denoise/page.js",
)  # fmt: skip
#: A head before a wall, measured by the default sensor.
_EXAMPLE: Final[dict[str, Any]] = {
    "seed": 3,
    "source": {"kind": "procedural", "subjects": 1, "frames_per_subject": 1},
    "appearance": {"wear": "always", "glasses": 0.0, "cloth": 0.0},
    "pose": {"distance_mm": 800, "yaw_deg": -20, "motion": 0},
    "scene": {"wall_mm": 1500},
}


def write_denoise_page(folder: Path, backend: str | None = None) -> list[Path]:
    """Write the page beside a tuner's page; return the files.

    Args:
        folder: of ``glsim.tune.static_page.write_static_page``, whose style it has.
        backend: "egl" or "osmesa".

    Raises:
        ConfigError: onnxruntime-web is not there, or no network is.
    """
    runtime = check_runtime()
    names = [name for name in NETWORKS if is_shipped(name)]
    if not names:
        raise ConfigError("--denoise: this installation has no networks: install glsim again")
    written = {folder / "onnxruntime" / name: (runtime / name).read_bytes() for name in FILES}
    described = {}
    for name in names:
        with shipped_file(name) as path:
            data = path.read_bytes()
        file = f"networks/{name}.onnx"
        written[folder / file] = data
        record = read_record(data)
        described[name] = {
            "file": file,
            "images": read_inputs(data).names,
            "keep_clean": record.keep_clean,
            "margin_px": record.margin_px,
            "unlikely": record.unlikely,
        }
    facts = {"networks": described, "numbers": _numbers()}
    written[folder / "denoise.html"] = (ASSETS / "denoise/page.html").read_bytes()
    written[folder / "denoise.js"] = join_script(facts, MODULES).encode()
    written[folder / "example.png"] = _example(backend)
    for path, content in written.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(content, path)
    return list(written)


def check_runtime() -> Path:
    """Return the folder of onnxruntime-web. Raises ConfigError if it was not fetched."""
    runtime = runtime_folder()
    if not is_fetched(runtime):
        raise ConfigError("--denoise needs onnxruntime-web: run glsim fetch onnxruntime-web")
    return runtime


def _numbers() -> dict[str, Any]:
    """Return the constants of glsim.denoise that the script uses: written in Python alone."""
    return {
        "size_multiple_px": SIZE_MULTIPLE_PX,
        "grid_px": tiles.GRID_PX,
        "most_px": tiles.TILE_PX**2,  # a larger map would be divided into tiles
        "focal_share": around.FOCAL_SHARE,
        "fine_mm": FINE_MM,
        "unit_keyword": UNIT_KEYWORD.decode(),
        "safeguards": {
            "clean_mm": safeguards.CLEAN_MM,
            "form_growth": safeguards.FORM_GROWTH,
            "same_mm": safeguards.SAME_MM,
            "dither_side": safeguards.DITHER_SIDE,
            "dither_density": safeguards.DITHER_DENSITY,
            "dither_least_mm": safeguards.DITHER_LEAST_MM,
            "dither_steps": safeguards.DITHER_STEPS,
            "measured_risk_mm": safeguards.MEASURED_RISK_MM,
            "hole_risk_mm": safeguards.HOLE_RISK_MM,
            "reach_px": safeguards.REACH_PX,
            "gain": safeguards.GAIN,
            "mean_root": safeguards.MEAN_ROOT,
            "edge_mm": safeguards.EDGE_MM,
            "least_windows": safeguards.LEAST_WINDOWS,
        },
        "composites": {
            "doubt": composites.DOUBT,
            "same_surface_mm": composites.SAME_SURFACE_MM,
            "same_surface_mm_per_m": composites.SAME_SURFACE_MM_PER_M,
            "reach_px": composites.REACH_PX,
            "least_sure": composites.LEAST_SURE,
            "least_patch": composites.LEAST_PATCH,
            "least_touching": composites.LEAST_TOUCHING,
            "beside_px": composites.BESIDE_PX,
            "unlikely": UNLIKELY,
        },
    }


def _example(backend: str | None) -> bytes:
    for frame in frames(load_settings(overrides=_EXAMPLE), backend=backend):
        if isinstance(frame, Frame):
            return encode_png(frame.noisy, 1.0)
    raise MeshError("the example of the page cannot be drawn")
