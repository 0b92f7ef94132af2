"""The clean depth, normals and shadows against other renderers: Open3D's rays, pyrender."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray

from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.faces import open_source
from glsim.settings.source_settings import parse_source
from tests.support.imports import ROOT
from tests.support.scenes import V2, interior, layers_of, rig

POSES = [
    {"distance_mm": 900.0},
    {"distance_mm": 700.0, "yaw_deg": 40.0, "pitch_deg": 15.0, "roll_deg": 8.0, "x_mm": 60.0},
    {"distance_mm": 2000.0, "yaw_deg": -25.0, "y_mm": -300.0, "x_mm": -500.0},
]


def camera_points(mesh: Mesh, pose: dict[str, float]) -> NDArray[np.float64]:
    view = pose_matrix(pose).astype(np.float64)
    return mesh.vertices_mm @ view[:3, :3].T + view[:3, 3]


def check(ours: NDArray[np.float32], theirs: NDArray[np.float32]) -> None:
    """Compare depths in metres, 0 = none. Both round depth and vertices to float32: 1e-7."""
    outline = ((ours > 0) ^ (theirs > 0)).sum()
    assert outline <= 0.005 * (theirs > 0).sum()
    inside = interior(ours * (theirs > 0), 1)
    assert inside.sum() > 400
    error_mm = 1000 * np.abs(ours - theirs)[inside]
    assert np.median(error_mm) <= 0.005
    assert np.percentile(error_mm, 99.9) <= 0.05


@pytest.mark.parametrize("pose", POSES, ids=["front", "turned", "far"])
def test_depth_and_normals_are_those_of_open3d(
    context: Context, face: Mesh, pose: dict[str, float]
) -> None:
    import open3d

    tensor: Any = open3d.core.Tensor
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    points = camera_points(face, pose).astype(np.float32)
    scene.add_triangles(tensor(points), tensor(face.faces.astype(np.uint32)))
    rays = np.zeros((V2.height, V2.width, 6), np.float32)
    rays[..., 3:5], rays[..., 5] = V2.rays(), 1
    hits = scene.cast_rays(tensor(rays))
    depth = hits["t_hit"].numpy()  # directions have z = 1
    normal = hits["primitive_normals"].numpy()
    layers = layers_of(context, rig(), [(face, pose)])
    # A ray also meets the inside of the mask, which is not drawn.
    outside = np.isfinite(depth) & ((normal * rays[..., 3:]).sum(-1) < 0)
    check(layers["clean"], np.where(outside, depth, np.float32(0)))
    inside = interior(layers["clean"] * outside, 1)
    cosine = (normal * layers["normal"][..., :3]).sum(-1)[inside]
    # Where two facets meet in a pixel's centre either may win.
    assert np.percentile(cosine, 1) > np.cos(np.radians(0.5))


_PEER = """
import importlib, sys
import numpy as np
from tests.support.scenes import rig
peer = importlib.import_module(f"benchmarks.{sys.argv[1]}_peer").Renderer(rig((0.075, 0, 0)))
meshes = [np.load(file) for file in sys.argv[3:]]
np.save(sys.argv[2], [peer(mesh["points"], mesh["faces"])[0] for mesh in meshes])
"""


@pytest.mark.long
@pytest.mark.parametrize("peer", ["open3d", "pyrender"])
def test_heads_and_people_are_those_of_the_benchmarks_peers(
    context: Context, tmp_path: Path, peer: str
) -> None:
    """The peers run in a process of their own, since pyrender ends all contexts of EGL."""
    files, ours = [], []
    for kind in ("procedural", "people"):
        source = open_source(parse_source({"kind": kind}), seed=5)
        (mesh,) = (face.mesh for face in source.load(source.frames(source.subjects(1)[0], 1)))
        files.append(tmp_path / f"{kind}.npz")
        np.savez(files[-1], points=camera_points(mesh, POSES[2]).astype("f4"), faces=mesh.faces)
        ours.append(layers_of(context, rig(), [(mesh, POSES[2])])["clean"])
    command = [sys.executable, "-c", _PEER, peer, str(tmp_path / "depth.npy"), *map(str, files)]
    environment = os.environ | {"PYOPENGL_PLATFORM": "egl"}
    subprocess.run(command, check=True, cwd=ROOT, env=environment)
    for depth, theirs in zip(ours, np.load(tmp_path / "depth.npy"), strict=True):
        check(depth, theirs)


@pytest.mark.parametrize("aside_m", [0.075, 0.8, 2.0])
def test_shadows_are_those_of_open3d(context: Context, face: Mesh, aside_m: float) -> None:
    """Cast a ray from each pixel's point to the emitter. Far aside, it makes a long nose shadow."""
    import open3d

    pose, emitter = {"distance_mm": 900.0, "yaw_deg": -15.0}, (aside_m, -0.1, 0.0)
    layers = layers_of(context, rig(emitter), [(face, pose)])
    seen = interior(layers["clean"], 1)
    points = np.concatenate([V2.rays(), np.ones((*seen.shape, 1))], -1) * layers["clean"][..., None]
    normal = layers["normal"][..., :3]
    rays = np.zeros((int(seen.sum()), 6), np.float32)
    rays[:, :3] = (points + 0.0003 * normal)[seen]
    rays[:, 3:] = emitter - points[seen]
    tensor: Any = open3d.core.Tensor
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        tensor(camera_points(face, pose).astype(np.float32)), tensor(face.faces.astype(np.uint32))
    )
    hidden = scene.test_occlusions(tensor(rays), tfar=1.0).numpy()
    hidden |= (rays[:, 3:] * normal[seen]).sum(-1) <= 0
    lit = layers["lit"][seen]
    assert ((lit < 0.5) == hidden).mean() > 0.99
    if aside_m > 1:
        assert 0.05 < hidden.mean() < 0.6
