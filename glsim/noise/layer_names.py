"""Fixed names of layers in a chain, and special values of pixels in them."""

from __future__ import annotations

import numpy as np

from glsim.core.reason import Reason

#: The layers that exist before the first stage.
INITIAL_LAYERS = ("clean", "depth", "normal", "albedo", "lit", "reason", "rays", "expected")

#: Layers of rigs that supersample -> the layer bound in their place for other rigs, whose stages do
#: not read it. fine_seen: depth and albedo of the samples; uneven: how much these differ.
FINE_LAYERS = {"fine_seen": "clean", "uneven": "clean"}

#: Layers of rigs with imagers: depth, m, normal with albedo, and the share of the light of each of
#: the two projectors, as the first (left) and the second (right) imager see them.
IMAGER_LAYERS = tuple(
    f"{side}_{n}" for side in ("left", "right") for n in ("clean", "normal", "lit")
)

#: The map of the device's own fixed pattern, mm, of the whole frame; NO_PATTERN where unknown.
PATTERN_LAYER = "pattern_map"
#: Projector texture in [0, 1], in projector pixels; replaces generated dots.
PROJECTOR_LAYER = "projector_image"
#: Images that are the same in every frame of a sensor -> the constant that shaders see. Only chains
#: of sensors that have such an image have its layer and its constant.
IMAGE_CONSTANTS = {PATTERN_LAYER: "PATTERN_MAP", PROJECTOR_LAYER: "PROJECTOR_IMAGE"}

#: Depth with the device's systematic error and without everything random: clean before the first
#: stage. Stages write it only in chains that need it: their shaders see the constant EXPECTED.
#: tof_light, tof_fast and any_camera_noise do. The other stages add noise with a mean of 0 or a
#: pattern to be removed, blur, move, drop or round depth, or depend on the scene.
EXPECTED_LAYER, EXPECTED_CONSTANT = "expected", "EXPECTED"

#: Depth of N earlier frames of the same still scene, (h, w, N) metres, oldest first: other draws of
#: the noise of the same device, a function of the frame's seed. Drawn after the matcher if a later
#: stage reads it, as temporal_filter does (glsim.noise.array_chain); a stage on arrays may too.
EARLIER_LAYER = "earlier_depth"

#: Stands for NaN, which GLSL compilers may assume away: larger than any error.
NO_PATTERN = np.float32(1e6)

#: The infrared image, and the second one of a stereo camera.
INFRARED, INFRARED_RIGHT = "infrared", "infrared_right"

#: The disparity that the matcher found, pixels, 0 = none; in the view of the first imager.
DISPARITY_LAYER = "disparity"

#: The layers that a Frame is made of; a chain without an infrared stage has no ``infrared``.
FRAME_LAYERS = ("clean", "depth", "reason", "infrared")

#: The values other than 0 that sparse stages write in empty pixels.
BLANK = {"reason": float(Reason.NO_SURFACE)}
