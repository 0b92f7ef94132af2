"""Fixed names of layers in a chain, and special values of pixels in them."""

from __future__ import annotations

import numpy as np

from glsim.core.reason import Reason

#: The layers that exist before the first stage.
INITIAL_LAYERS = ("clean", "depth", "normal", "albedo", "lit", "reason", "rays", "expected")
#: Layer of a supersampling rig -> the layer that is bound to its name for other rigs, whose stages
#: do not read it. fine_seen: depth and albedo of each sample; uneven: how much these differ.
FINE_LAYERS = {"fine_seen": "clean", "uneven": "clean"}
#: Layers of rigs with imagers, as the first (left) and the second (right) imager see them: depth,
#: m; normal with albedo; and the share of each of the two projectors' light.
IMAGER_LAYERS = tuple(
    f"{side}_{n}" for side in ("left", "right") for n in ("clean", "normal", "lit")
)

#: The device's fixed pattern, mm, of the whole frame; NO_PATTERN where it is unknown.
PATTERN_LAYER = "pattern_map"
#: Projector texture in [0, 1], in projector pixels; replaces generated dots.
PROJECTOR_LAYER = "projector_image"
#: Layer of a sensor's image, the same in every frame -> its constant in shaders. A chain has the
#: layer and the constant only if its sensor has the image.
IMAGE_CONSTANTS = {PATTERN_LAYER: "PATTERN_MAP", PROJECTOR_LAYER: "PROJECTOR_IMAGE"}
#: The clean depth with the device's systematic error, without anything random. Before the first
#: stage it equals the clean depth. Stages write it only in chains that request it: their shaders
#: see the constant EXPECTED. tof_light, tof_fast and any_camera_noise write it. Other stages add
#: noise of mean 0 or a removable pattern, blur, move, drop or round depth, or depend on the scene.
EXPECTED_LAYER, EXPECTED_CONSTANT = "expected", "EXPECTED"
#: Depth of N earlier frames of the same still scene, (h, w, N) metres, oldest first. They are other
#: draws of the same device's noise, functions of the frame's seed. They are simulated after the
#: matcher if a later stage reads this layer, such as temporal_filter (glsim.noise.array_chain).
EARLIER_LAYER = "earlier_depth"
#: Stands for NaN, which GLSL compilers may assume never to occur; larger than any error, mm.
NO_PATTERN = np.float32(1e6)
#: The infrared image, and the second one of a stereo camera.
INFRARED, INFRARED_RIGHT = "infrared", "infrared_right"
#: The matched disparity in the view of the first imager, pixels, 0 = none.
DISPARITY_LAYER = "disparity"
#: The layers of a Frame; a chain without an infrared stage lacks ``infrared``.
FRAME_LAYERS = ("clean", "depth", "reason", "infrared")
#: Layer -> its value in empty pixels, where sparse stages write a value other than 0.
BLANK = {"reason": float(Reason.NO_SURFACE)}
