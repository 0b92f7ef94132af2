"""Measure checks 24, 30, 35 and A3 on rendered faces: masks, normals, holes, rims of hair."""

from __future__ import annotations

import numpy as np

from glsim.bench import scenes
from glsim.bench.compare.patches import KINDS, edge_patches
from glsim.bench.validate.captures import Captures
from glsim.bench.validate.report import Measurement, validation_check
from glsim.core.depth_frame import DepthFrame
from glsim.core.mesh import SKIN_ALBEDO
from glsim.measures import stacks as measure
from glsim.measures.depth_noise import measure_spatial
from glsim.measures.silhouettes import measure_silhouettes

_PEOPLE = 6
_FRAMES_EACH = 4
#: Distance of the wall behind dressed heads, mm.
_WALL_MM = 1800.0


@validation_check("kinect-v2")
def isolated_faces(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 24 and 30, and anti-check A3: masks, normals and shadows of faces."""
    invalid = inside = kept = surface = grown = rim = 0
    angles, holes = [], []
    heads = scenes.faces(_PEOPLE, 900, captures.camera.seed, "never")
    for number, (mesh,) in enumerate(heads):
        capture = captures.camera.capture(mesh, _FRAMES_EACH, 160, scene=f"face {number}")
        clean = np.isfinite(capture.truth_mm)
        valid = np.isfinite(capture.whole_mm)
        interior = measure.eroded(clean, 3) & (measure.steps_mm(capture.truth_mm) <= 100)
        invalid += int((~valid & interior).sum())
        inside += int(interior.sum()) * len(valid)
        kept += int((valid & clean).sum())
        surface += int(clean.sum()) * len(valid)
        grown += int((valid & ~clean).sum())
        rim += int((clean & ~measure.eroded(clean, 1)).sum()) * len(valid)
        clean_normals = measure.normals(capture.truth_mm, capture[0].rays)
        # On slanted surfaces and at depth steps, noise is not the only cause of wrong normals.
        clean_normals[~interior | (clean_normals[..., 2] > -0.5)] = np.nan
        angles += [
            measure.angular_error_deg(measure.normals(frame, capture[0].rays), clean_normals)
            for frame in capture.whole_mm
        ]
        holes += [measure.longest_run(~v & measure.eroded(clean, 1)) for v in valid]
    note = f"{_PEOPLE} procedural heads, {inside // (_PEOPLE * _FRAMES_EACH)} px inside each"
    return {
        "24": Measurement(
            {
                "invalid": 100.0 * invalid / max(inside, 1),
                "kept": 100.0 * kept / max(surface, 1),
                "growth": grown / max(rim, 1),
            },
            note,
        ),
        "30": Measurement({"angle": float(np.mean(angles))}, "within 60 deg of the axis"),
        "A3": Measurement({"hole": float(max(holes))}),
    }


@validation_check("kinect-v2")
def dressed_heads(captures: Captures) -> dict[str, Measurement]:
    """Measure check 35 on dressed heads before a wall: flying pixels at rims, rough surfaces."""
    shots: list[DepthFrame] = []
    for number, person in enumerate(scenes.faces(_PEOPLE, 900, captures.camera.seed, "always")):
        head, *worn = person
        mesh = scenes.merge_meshes(head, scenes.wall(_WALL_MM, SKIN_ALBEDO))
        shots += captures.camera.capture(mesh, 1, 240, scene=f"dressed {number}", worn=worn)
    rims = edge_patches(shots, measure_silhouettes(shots).shadow_side)[KINDS[2]]
    flying = rims.features[:, rims.names.index("flying pixels of the gap")]
    heads = [
        shot.changed({"noisy_mm": np.where(shot.noisy_mm < 0.8 * _WALL_MM, shot.noisy_mm, 0)})
        for shot in shots
    ]
    rough_mm = measure_spatial(heads).rough_mm
    values = {"flying": float(np.median(flying)), "p90": rough_mm[2]}
    return {"35": Measurement(values, "procedural heads with hair and clothes")}
