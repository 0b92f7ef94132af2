"""The noise chain of a sensor on PyTorch tensors: whole batches, on the device of the depth."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch

from glsim.core.arrays import of
from glsim.core.camera import SensorRig
from glsim.core.depth_map import lit_share, normals
from glsim.core.errors import ConfigError
from glsim.core.mesh import SKIN_ALBEDO
from glsim.core.rect import Rect
from glsim.core.seeds import stable_seed
from glsim.noise.array_chain import without_tensors
from glsim.noise.layer_names import EXPECTED_LAYER
from glsim.noise.stage import ENABLED, Stage, sample_values
from glsim.noise.twins import find_twin
from glsim.noise.twins.batch import WordContext, beside_camera, map_words, sample, seed_word
from glsim.noise.twins.layers import pcg_word, uniform01
from glsim.sensors.sensor import Sensor
from glsim.settings.distribution import ScopeSeeds
from glsim.simulation.assembly import reconcile_reasons
from glsim.simulation.frame import refuse_millimetres

#: Stage -> parameter -> its value for a batch: a number for all maps, or (B, 1, 1).
Values = Mapping[str, Mapping[str, Any]]
#: Number of pixels computed together on a CPU: their layers fit the cache. Measured: fastest.
_CACHED_PX = 2**17
#: What simulators may give with their maps: the camera, and properties of the surface.
_CAMERA, _SURFACE = ("fx", "fy", "cx", "cy"), ("normal", "albedo")


def batch_inputs(maps: Any, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tensors that a chain starts from, by name, on the device of the maps.

    Maps are (B, H, W) float32 metres. ``given`` may hold seeds, frames, fx, fy, cx, cy (numbers or
    (B,)), normal (B, H, W, 3) and albedo (B, H, W). Raises ConfigError for another name or shape.
    """
    count, device = len(maps), maps.device
    known = (*_CAMERA, *_SURFACE)
    shapes = {"normal": (*maps.shape, 3), "albedo": tuple(maps.shape)}
    if unknown := given.keys() - {*known, "seeds", "frames"}:
        raise ConfigError(f"{', '.join(sorted(unknown))}: known are {', '.join(known)}")
    given = {name: value for name, value in given.items() if value is not None}
    if 0 < len(missing := {*_CAMERA} - given.keys()) < len(_CAMERA):
        raise ConfigError(f"{', '.join(sorted(missing))}: a camera needs fx, fy, cx and cy")
    inputs = {"maps": maps.detach()}
    for name, value in given.items():
        kind = torch.int64 if name in ("seeds", "frames") else torch.float32
        try:
            tensor = torch.as_tensor(value, device=device)
        except (TypeError, ValueError, RuntimeError) as error:
            raise ConfigError(f"{name}: must be numbers: {str(error).splitlines()[0]}") from None
        if kind == torch.int64 and (tensor.is_floating_point() or tensor.dtype == torch.bool):
            raise ConfigError(f"{name}: must be integers, not {tensor.dtype}")
        wanted = shapes.get(name, (count,))
        if tensor.ndim == 0 and len(wanted) == 1:
            tensor = tensor.expand(count)
        if tuple(tensor.shape) != wanted:
            raise ConfigError(f"{name}: has the shape {tuple(tensor.shape)}, not {wanted}")
        tensor = tensor.to(kind)
        inputs[name] = tensor[:, None, None] if name in _CAMERA else tensor
    return inputs


class TensorEngine:
    """The noise chain of a sensor for maps of one size; ConfigError for a stage without twin."""

    def __init__(self, sensor: Sensor, rig: SensorRig) -> None:
        self.sensor, self.rig = sensor, rig
        self._stages = [s for s in sensor.stages if s.settings[ENABLED].bounds()[1] > 0]
        if (stage := without_tensors(sensor.stages)) is not None:
            raise ConfigError(
                f"{sensor.name}: stage {stage.name!r} does not run on tensors: take "
                'backend="egl" or "osmesa", or switch the stage off'
            )
        self._lights = [
            (*beside_camera((*point[:2].tolist(), 0.0)), share / len(rig.emitters))
            for emitter in rig.emitters
            for point, share in emitter.shared_points_m()
        ]
        self._rays: dict[Any, Any] = {}
        self._size = rig.intrinsics.height, rig.intrinsics.width
        self._compared = False  # whether the values of a batch have been checked

    @torch.compiler.disable  # type: ignore[untyped-decorator]  # a function of the user's that is compiled calls it as it is
    def measure(
        self,
        depth_m: Any,
        device: Any,
        keys: Sequence[ScopeSeeds] | None,
        seed: int,
        p: float,
        *,
        expected: bool = False,
        **given: Any,
    ) -> tuple[Any, dict[str, Any]]:
        """Return noisy depth in the form of the clean depth, and its layers, each (B, H, W).

        Args:
            device: device to compute on; default: the depth's.
            keys: the maps' 64-bit seeds, or None if ``given`` has seeds.
            p: probability that a map is changed, if ``given`` has seeds.
        """
        array = not isinstance(depth_m, torch.Tensor)
        whole = torch.from_numpy(np.require(depth_m, None, ("C", "W"))) if array else depth_m
        try:
            whole = whole.to(device)
        except (RuntimeError, AssertionError) as error:
            raise ConfigError(f"device {device!r}: {str(error).splitlines()[0]}") from None
        maps = whole.reshape(-1, *self._size).to(torch.float32)
        inputs = batch_inputs(maps, given)
        if whole.device.type == "cpu" or not self._compared:  # once, since a GPU stalls
            refuse_millimetres(inputs["maps"].cpu().numpy(), self.rig.near_m, self.rig.far_m)
            if "fx" in inputs:
                shortest_px = float(inputs["fx"].min()), float(inputs["fy"].min())
                self.rig.intrinsics.for_map(self._size, shortest_px)
            self._compared = True
        count = len(maps) if maps.is_cuda else max(_CACHED_PX // math.prod(self._size), 1)
        parts = []
        with torch.no_grad():
            if expected:
                inputs[EXPECTED_LAYER] = inputs["maps"]
            for start in range(0, len(maps), count):
                part = {name: tensor[start : start + count] for name, tensor in inputs.items()}
                if keys is None:
                    parts.append(self._seeded(seed, p, part))
                else:
                    parts.append(self._named(seed, part, keys[start : start + count]))
        layers = {name: torch.cat([part[name] for part in parts]) for name in parts[0]}
        noisy = layers["depth"]
        if maps.requires_grad:  # straight through: rounding alone would make all gradients 0
            noisy = noisy + torch.where(noisy > 0, maps - maps.detach(), 0.0)
        noisy = noisy.to(whole.dtype).reshape(whole.shape)
        return (noisy.cpu().numpy() if array else noisy), layers

    def _named(
        self, seed: int, inputs: Mapping[str, Any], keys: Sequence[ScopeSeeds]
    ) -> dict[str, Any]:
        """Return the layers of a batch whose maps have 64-bit seeds, as in frames by OpenGL."""
        maps = inputs["maps"]
        samples = [sample_values(self._stages, key)[1] for key in keys]
        values = self._values(
            lambda stage, name: maps.new_tensor(
                np.array([v[stage.name][name] for v in samples], np.float32)
            )
        )
        word = of(maps).word
        words = [
            maps.new_tensor([word(seed_word(s)) for s in seeds], dtype=of(maps).int32)
            for seeds in (
                [key.frame for key in keys],
                [key.sequence for key in keys],
                [stable_seed("device", seed, 0)],
            )
        ]
        return self._answer(inputs, words, values)

    def _seeded(self, seed: int, p: float, inputs: Mapping[str, Any]) -> dict[str, Any]:
        frame, held = map_words(seed, inputs["seeds"], inputs["frames"])
        words = {"frame": frame, "held": held}

        def number(stage: Stage, name: str) -> Any:
            number = sample(stage.settings[name], f"{stage.name}.{name}", words)
            parameter = stage.spec.parameters.get(name)
            return number if parameter is not None and parameter.type == "float" else number.round()

        layers = self._answer(inputs, (frame, held, held), self._values(number))
        if p < 1:
            changed = (uniform01(pcg_word(frame)) < p)[:, None, None]
            layers["depth"] = of(frame).where(changed, layers["depth"], layers["clean"])
        return layers

    def _values(self, sampled: Callable[[Stage, str], Any]) -> Values:
        """Return all parameters of all stages; ``sampled`` gives (B,) numbers of varying ones."""
        return {
            stage.name: {
                name: float(np.float32(setting.constant))
                if setting.constant is not None
                else sampled(stage, name)[:, None, None]
                for name, setting in stage.settings.items()
            }
            for stage in self._stages
        }

    def _answer(
        self, inputs: Mapping[str, Any], words: Sequence[Any], values: Values
    ) -> dict[str, Any]:
        """Run the chain; ``words`` belong to frames, sequences and devices, (B,) or (1,)."""
        maps = inputs["maps"]
        clean = torch.where((maps > 0) & (maps <= self.rig.far_m), maps, 0.0)  # NaN compares False
        image, (_, height, width) = self.rig.intrinsics, maps.shape
        rays, focal_px = self._rays_of(clean, inputs), inputs.get("fx", image.fx)
        frame, sequence, device = (word[:, None, None] for word in words)
        view = WordContext.for_frame(
            rig=self.rig,
            window=Rect(0, 0, width, height),
            seed=frame,
            sequence_seed=sequence,
            device_seed=device,
            supersample=1,
            focal_px=focal_px,
            focal_baseline_px_m=focal_px * self.rig.baseline_m,
        )
        albedo = torch.where(clean > 0, inputs.get("albedo", SKIN_ALBEDO), 0.0)
        normal = inputs.get("normal")
        if normal is None:
            normal = normals(clean, rays)
        planes = [*(normal[..., k] for k in range(3)), albedo]
        lit = torch.ones_like(clean)
        if self.rig.shadow_map and self._lights:
            lit = lit_share(clean, focal_px, self._lights)
        layers: dict[str, Any] = {
            **{n: torch.from_numpy(v).to(clean.device) for n, v in self.sensor.images.items()},
            "clean": clean,
            "depth": clean,
            **({EXPECTED_LAYER: clean} if EXPECTED_LAYER in inputs else {}),
            "reason": torch.zeros_like(clean),
            "normal": torch.stack(planes).movedim(0, -1),
            "albedo": albedo,
            "lit": lit,
            "rays": rays,
        }
        for stage in self._stages:
            twin, p = find_twin(stage.spec.name), values[stage.name]
            assert twin is not None, "takes_tensors"
            written: dict[str, Any] = twin(view.view(stage.name), layers, p)
            runs = p[ENABLED]
            for name, layer in written.items():
                if not isinstance(runs, float) and name in layers:
                    layer = torch.where(runs > 0, layer, layers[name])
                layers[name] = layer
        depth = layers["depth"].clamp(min=0.0)
        codes: Any = reconcile_reasons(layers["clean"], depth, layers["reason"])
        reason = codes.to(torch.uint8)
        more = {n: layers[n] for n in ("infrared", EXPECTED_LAYER) if n in layers}
        return {"clean": clean, "depth": depth, "reason": reason, **more}

    def _rays_of(self, depth_m: Any, camera: Mapping[str, Any]) -> Any:
        """Return the rays x/z and y/z of each pixel, (1 or B, H, W, 2)."""
        if "fx" not in camera:
            if depth_m.device not in self._rays:
                rays = torch.from_numpy(np.moveaxis(self.rig.rays(), -1, 0).copy())
                self._rays[depth_m.device] = rays[:, None].to(depth_m.device).movedim(0, -1)
            return self._rays[depth_m.device]
        if self.rig.keeps_distortion:
            raise ConfigError(
                "fx, fy, cx, cy: the sensor delivers the image of its lens: leave out"
            )
        _, height, width = depth_m.shape
        x, y = (torch.arange(side, device=depth_m.device) + 0.5 for side in (width, height))
        sides = (x - camera["cx"]) / camera["fx"], (y[:, None] - camera["cy"]) / camera["fy"]
        return of(depth_m).stack(sides, -1).reshape(-1, height, width, 2)
