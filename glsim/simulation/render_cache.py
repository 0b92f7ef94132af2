"""A cache of shader programs and rendered layers, shared by simulators on one GL context."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cached_property

import moderngl

from glsim.core.camera import SensorRig
from glsim.core.rect import Rect
from glsim.faces.face_source import FaceSource
from glsim.noise.chain import StageLayers
from glsim.noise.stage_pass import LinkedStages
from glsim.render.renderer import Rendered, Renderer
from glsim.render.sub_frames import SubFrames
from glsim.settings.schema import Settings
from glsim.simulation.face_loader import FaceLoader
from glsim.simulation.scenes import FrameScene, FrameScenes

#: Number of kept scene builders: for the plan, the displayed pose, and the pose before it.
_KEPT_SCENES = 3


class RenderCache:
    """A cache of all linked programs, and of the rendered and the stage layers of the last scene.

    For other noise over the same scene, only the stages from the first changed one on are run
    again. Another rig, face or pose replaces the kept layers.
    """

    def __init__(self, context: moderngl.Context) -> None:
        self.linked = LinkedStages(context)
        self._context = context
        self._renderers: dict[SensorRig, Renderer] = {}
        self._scenes: deque[FrameScenes] = deque(maxlen=_KEPT_SCENES)
        self._last: tuple[tuple[FrameScene, int], Rendered] | None = None
        self._rendering = ExitStack()
        self._stages = StageLayers(kept=True)

    @cached_property
    def sub_frames(self) -> SubFrames:
        """The composer of frames from sub-frames, for moving scenes."""
        return SubFrames(self._context)

    def renderer(self, rig: SensorRig) -> Renderer:
        """Return the renderer of a rig; the last depth camera's and colour camera's are kept."""
        renderer = self._renderers.pop(rig, None) or Renderer(self._context, rig)
        self._renderers = dict([*self._renderers.items(), (rig, renderer)][-2:])
        return renderer

    def scenes(
        self, settings: Settings, sources: Sequence[FaceSource], rig: SensorRig, *, regions: bool
    ) -> FrameScenes:
        """Return the scene builder of these settings. Raises the errors of FrameScenes."""
        for scenes in self._scenes:
            same = rig == scenes.loader.rig and regions == scenes.regions
            if same and scenes.loader.changed_settings(settings) <= {"stage"}:
                return scenes
        if self._scenes:
            loader = self._scenes[-1].loader.like(settings, rig)
        else:
            loader = FaceLoader(settings, sources, rig)
        self._scenes.append(FrameScenes(loader, regions=regions))
        return self._scenes[-1]

    def rendered(
        self, renderer: Renderer, scene: FrameScene, crop: Rect, reach_px: int
    ) -> tuple[Rendered, StageLayers | None]:
        """Return a scene's clean layers, and the cache of its stage layers.

        Both are valid until another scene is rendered. The cache of a new scene is None, because
        few scenes are requested again. Raises MeshError.
        """
        asked = scene, reach_px
        if self._last is not None and self._last[0] == asked:
            return self._last[1], self._stages
        self._stages.clear()
        self._last = None
        self._rendering.close()  # its textures are used again
        drawing = renderer.render(scene.meshes, crop, scene.labels, reach_px)
        rendered = self._rendering.enter_context(drawing)
        self._last = asked, rendered
        return rendered, None
