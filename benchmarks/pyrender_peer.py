"""pyrender as a peer: depth seen from the camera and from the emitter, and shadow from both."""

import numpy as np
import pyrender
from numpy.typing import NDArray

from glsim.core.camera import SensorRig

#: As in `benchmarks/open3d_peer.py`.
_SHADOW_BIAS_M = 0.003
#: pyrender reads the first of four samples of a pixel, which lies beside its centre, px right and
#: down (the standard pattern; Mesa's too).
_SAMPLE_PX = (-0.125, -0.375)


class Renderer:
    """Draws each mesh twice, depth only, with one off-screen renderer."""

    def __init__(self, rig: SensorRig) -> None:
        image = self._image = rig.intrinsics
        self._renderer = pyrender.OffscreenRenderer(image.width, image.height)
        self._camera = pyrender.IntrinsicsCamera(
            image.fx,
            image.fy,
            image.cx + _SAMPLE_PX[0],
            image.cy - _SAMPLE_PX[1],
            znear=0.1,
            zfar=12.0,
        )
        self._emitter = np.asarray(rig.emitters[0].position_m)
        rays = rig.rays()
        self._rays = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)

    def __call__(
        self, points_m: NDArray[np.float32], faces: NDArray[np.int32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return clean depth, m, and the lit share; arguments as in `benchmarks/open3d_peer.py`."""
        primitive = pyrender.Primitive(
            positions=(points_m * (1, -1, -1)).astype(np.float32), indices=faces
        )
        drawn = pyrender.Mesh([primitive])
        depth = self._depth(drawn, np.zeros(3))
        return depth, self._lit(depth, self._depth(drawn, self._emitter))

    def _depth(self, drawn: pyrender.Mesh, origin_m: NDArray[np.float64]) -> NDArray[np.float32]:
        scene = pyrender.Scene()
        scene.add(drawn)
        pose = np.eye(4)
        pose[:3, 3] = origin_m * (1, -1, -1)  # OpenGL's camera looks along -z with y up
        scene.add(self._camera, pose=pose)
        depth: NDArray[np.float32] = self._renderer.render(
            scene, flags=pyrender.RenderFlags.DEPTH_ONLY
        )
        return depth

    def _lit(
        self, depth: NDArray[np.float32], seen_by_emitter: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        image = self._image
        towards = self._rays * depth[..., None] - self._emitter.astype(np.float32)
        z = np.where(depth > 0, towards[..., 2], 1.0)
        column = np.floor(image.fx * towards[..., 0] / z + image.cx).astype(int)
        row = np.floor(image.fy * towards[..., 1] / z + image.cy).astype(int)
        stored = seen_by_emitter[row.clip(0, image.height - 1), column.clip(0, image.width - 1)]
        lit = (stored == 0) | (z < stored + _SHADOW_BIAS_M)
        return np.where(depth > 0, lit, False).astype(np.float32)
