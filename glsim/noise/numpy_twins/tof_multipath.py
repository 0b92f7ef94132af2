"""Twin of tof_multipath: light reflected by a second surface."""

from __future__ import annotations

import numpy as np

from glsim.noise.frame_context import Layers, StageView
from glsim.noise.numpy_twins.layers import Image, Parameters, pixels
from glsim.noise.numpy_twins.tof_light import correlate

_PI = np.float32(3.14159265359)
_GOLDEN_ANGLE = np.float32(2.39996322973)
_MM = np.float32(0.001)


def tof_multipath(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds light that one other visible surface has reflected once."""
    x, y = pixels(view.window)
    left, top, width, height = view.window
    one = np.ones((height, width, 1), np.float32)
    z, shape = layers["clean"], layers["normal"]
    rays = np.concatenate([layers["rays"], one], axis=-1)
    points = z[..., None] * rays
    emitter = np.asarray(view.optics.emitter_m, np.float32)
    focal = np.float32(view.optics.focal_px)
    count = int(p["samples"])
    per_point = _PI * p["radius_px"] * p["radius_px"] / np.float32(count)
    light_a, light_b = layers["light_a"].copy(), layers["light_b"].copy()
    for k in range(count):
        turn = _GOLDEN_ANGLE * np.float32(k)
        far = p["radius_px"] * np.sqrt((np.float32(k) + np.float32(0.5)) / np.float32(count))
        column = x + int(np.floor(far * np.cos(turn) + np.float32(0.5))) - left
        row = y + int(np.floor(far * np.sin(turn) + np.float32(0.5))) - top
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        at = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
        there, there_shape = points[at], shape[at]
        way = there - points
        squared = (way * way).sum(axis=-1)
        apart = np.sqrt(np.maximum(squared, np.float32(1e-12)))
        arriving = np.maximum((shape[..., :3] * way).sum(axis=-1), np.float32(0.0)) / apart
        leaving = np.maximum(-(there_shape[..., :3] * way).sum(axis=-1), np.float32(0.0)) / apart
        slant = -(there_shape[..., :3] * rays[at]).sum(axis=-1)
        area = per_point * z[at] * z[at] / (focal * focal) / np.maximum(slant, np.float32(0.05))
        seen = inside & (z[at] > 0) & (z > 0)
        share = arriving * leaving * area / np.where(seen, _PI * squared + area, np.float32(1.0))
        amplitude = p["strength"] * shape[..., 3] * layers["light_b"][at][..., 2] * share
        amplitude = np.where(seen, amplitude, np.float32(0.0))[..., None]
        outwards = np.sqrt(((there - emitter) ** 2).sum(axis=-1))
        back = np.sqrt((points * points).sum(axis=-1))
        delay = _MM * (p["offset_mm"] + p["subsurface_mm"])
        real, imaginary = correlate(view, p, np.float32(0.5) * (outwards + apart + back) + delay)
        both = np.stack([real, imaginary], axis=-1).reshape(height, width, 6)
        light_a += amplitude * both[..., :4]
        light_b[..., :3] += amplitude * np.concatenate([both[..., 4:], one], axis=-1)
    return {"light_a": light_a, "light_b": light_b}
