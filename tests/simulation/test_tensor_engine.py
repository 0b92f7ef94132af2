"""Noise on batches of tensors: agreement with OpenGL, seeds, draws, gradients, errors."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim import DepthNoise, Reason, load_settings
from glsim.core.depth_map import lit_by_marching, lit_share, normals
from glsim.core.errors import ConfigError
from tests.support.stage_harness import Z_MAX, z_mean

torch: Any = pytest.importorskip("torch")

CAMERA = {"fx": 365.456, "fy": 365.456, "cx": 64.0, "cy": 48.0}

#: Sensor -> the least shares of pixels that have the same reason by OpenGL and on tensors, and of
#: depths that differ by 1 mm at most. The light's code of 11 bits rounds otherwise where a number
#: differs in its last bit, and shadows end at pixels' centres and not at a mesh's edge: by NumPy,
#: the Kinect V2 has 0.986 of OpenGL's reasons on these domes with their wide shadows.
AGREEMENT = {
    "realsense-d4xx-fast": (0.99, 0.99),
    "kinect-v2": (0.985, 0.96),
    "kinect-v2-fast": (0.999, 0.999),
    "azure-kinect": (0.99, 0.99),
    "any-depth-camera": (0.99, 0.999),
    "kinect-v2-fankhauser": (0.99, 0.998),
}


def heads(count: int = 2, height: int = 96, width: int = 128) -> NDArray[np.float32]:
    """Domes before a slanted wall, and nothing in the first rows."""
    y, x = np.mgrid[:height, :width]
    dome = 1 - ((x - 64) / 40) ** 2 - ((y - 48) / 40) ** 2
    depth = np.where(dome > 0, 0.9 - 0.08 * np.sqrt(np.maximum(dome, 0)), 1.5 + x / 300)
    depth[:8] = 0
    return np.stack([depth * (1 + 0.05 * n) for n in range(count)]).astype(np.float32)


@pytest.mark.parametrize("sensor", AGREEMENT)
def test_it_agrees_with_opengl(sensor: str) -> None:
    clean = heads()
    on_tensors = DepthNoise(sensor, backend="torch")
    layers = on_tensors.layers(torch.from_numpy(clean), frame=3, sequence="a")
    with DepthNoise(sensor) as drawn:
        frames = [
            drawn.corrupt_depth(clean[n], frame=3 + n, sequence="a") for n in range(len(clean))
        ]
    same, close = AGREEMENT[sensor]
    for number, frame in enumerate(frames):
        depth = layers["depth"][number].numpy()
        reason = layers["reason"][number].numpy()
        assert (reason == frame.reason_codes).mean() >= same
        both = (depth > 0) & (frame.noisy_m > 0)
        assert both.mean() > 0.6
        apart = depth[both] - frame.noisy_m[both]
        assert (np.abs(apart) < 1.01e-3).mean() >= close
        assert abs(np.median(apart)) < 1e-6
    noisy = on_tensors(torch.from_numpy(clean), frame=3, sequence="a")
    assert torch.equal(noisy, layers["depth"])
    np.testing.assert_array_equal(on_tensors(clean, frame=3, sequence="a"), noisy.numpy())


def test_a_map_has_the_noise_of_its_seed_and_frame_in_any_batch() -> None:
    clean = torch.from_numpy(heads(1)).expand(4, -1, -1)
    noise = DepthNoise("any-depth-camera", seed=5)
    made = noise(clean, seeds=[3, 9, 3, 9], frame=[0, 0, 1, 1])
    assert len({bytes(one.numpy().tobytes()) for one in made}) == 4
    alone = noise(clean[:1], seeds=torch.tensor([9]), frame=1)
    assert torch.equal(alone[0], made[3])
    assert not torch.equal(DepthNoise("any-depth-camera", seed=6)(clean[:1], seeds=9), made[1])


def test_noise_is_that_of_the_sensor() -> None:
    """Axial noise alone follows its formula; devices have parameters of their own."""
    only = {"axial": {"angle_mm": 0, "base_sigma_mm": {"uniform": [1, 4], "per": "device"}}}
    names = ("lateral", "fixed_pattern", "edge_dropout", "shadow", "millimetre_quantise")
    off = {name: {"enabled": False} for name in names}
    settings = load_settings(overrides={"sensor": "kinect-v2-fankhauser", "stage": only | off})
    wall = torch.full((64, 64, 64), 1.0)
    made = DepthNoise(settings)(wall, seeds=range(64), frame=0)
    again = DepthNoise(settings)(wall, seeds=range(64), frame=1)
    sigma = [1000 * (one - wall).std(dim=(1, 2)).numpy() for one in (made, again)]
    np.testing.assert_allclose(sigma[0], sigma[1], rtol=0.1)
    low = sigma[0].min()
    assert 2.3 < sigma[0].max() - low < 3.05
    share = (sigma[0] - low) / 3
    assert abs(z_mean(share, 0.5 - 0.03)) < Z_MAX
    error = 1000 * (made - wall).numpy()
    assert abs(z_mean(error / sigma[0][:, None, None])) < Z_MAX


def test_draws_follow_their_distributions() -> None:
    """Each kind of distribution, over 4,000 maps, by the depth's offset."""
    wall = torch.full((4000, 2, 2), 1.0)
    kinds: dict[str, tuple[dict[str, Any], float, float]] = {
        "uniform": ({"uniform": [-3, 5]}, 1.0, 8 / np.sqrt(12)),
        "normal": ({"normal": [2, 0.5]}, 2.0, 0.4933),  # cut at 3 standard deviations
        "choice": ({"choice": [0, 0, 3]}, 1.0, np.sqrt(2)),
        "loguniform": ({"loguniform": [1, np.e]}, np.e - 1, 0.4920),
    }
    off = {"any_camera_edges", "fixed_pattern", "any_camera_losses", "millimetre_quantise"}
    for setting, mean, deviation in kinds.values():
        quiet = dict.fromkeys(
            ("floor_mm", "light_mm", "inverse_per_m", "smooth_mm", "wiggle_mm", "scale_mm_per_m",
             "outlier_share", "tilt_x_mm", "tilt_y_mm"), 0,
        )  # fmt: skip
        stage: dict[str, Any] = {name: {"enabled": False} for name in off}
        stage["any_camera_noise"] = {**quiet, "offset_mm": setting}
        noise = DepthNoise(load_settings(overrides={"sensor": "any-depth-camera", "stage": stage}))
        offset_mm = 1000 * (noise(wall, seeds=range(4000)) - wall)[:, 0, 0].numpy()
        assert abs(z_mean(offset_mm, mean)) < Z_MAX
        assert abs(offset_mm.std() / deviation - 1) < 0.05


def test_cameras_normals_and_albedo_of_the_simulator_are_used() -> None:
    clean = torch.from_numpy(heads(2))
    noise = DepthNoise("kinect-v2-fast")
    camera = {**CAMERA, "fx": torch.tensor([365.456, 180.0])}
    usual = noise.layers(clean, seeds=[1, 1])
    given = noise.layers(clean, seeds=[1, 1], **camera)
    assert torch.equal(given["depth"][0], usual["depth"][0])
    assert not torch.equal(given["depth"][1], usual["depth"][1])
    dark = noise.layers(clean, seeds=[1, 1], albedo=torch.full_like(clean, 0.06))
    lit = dark["infrared"] > 0
    ratio = (dark["infrared"] / usual["infrared"])[lit]
    assert abs(ratio.median().item() - 0.1) < 1e-4
    away = torch.zeros(*clean.shape, 3)
    away[..., 2] = -1.0
    facing = noise.layers(clean, seeds=[1, 1], normal=away)
    assert facing["infrared"][0, 40, 28] > usual["infrared"][0, 40, 28]  # the dome's side


def test_normals_and_shadows_of_batches_are_those_of_maps() -> None:
    from glsim.noise.twins.batch import beside_camera

    clean = heads(2)
    rig = DepthNoise("kinect-v2").rig(clean.shape[1:])
    rays = torch.from_numpy(rig.rays().copy())[None]
    found = normals(torch.from_numpy(clean), rays).numpy()
    emitter = rig.emitters[0]
    lights = [(*beside_camera([*point]), share) for point, share in emitter.shared_points_m()]
    lit = lit_share(torch.from_numpy(clean), rig.intrinsics.fx, lights).numpy()
    for number in range(2):
        np.testing.assert_allclose(found[number], normals(clean[number], rig.rays()), atol=2e-5)
        apart = np.abs(lit[number] - lit_by_marching(clean[number], rig))
        assert (apart > 0.01).mean() < 0.01  # the march takes half pixels
        assert (lit[number][clean[number] > 0] == 0).mean() > 0.01


def test_values_have_a_gradient_and_lost_pixels_have_none() -> None:
    clean = torch.from_numpy(heads(1)).requires_grad_()
    noisy = DepthNoise("kinect-v2", backend="torch")(clean, frame=0)
    noisy.sum().backward()
    assert torch.equal(clean.grad, (noisy > 0).float())
    assert 0 < (noisy > 0).float().mean() < 1


def test_reasons_fit_depths_and_p_is_a_share_of_maps() -> None:
    clean = torch.from_numpy(heads(1)).expand(200, -1, -1)[:, ::8, ::8]
    layers = DepthNoise("kinect-v2-fast").layers(clean, seeds=range(200))
    with_depth = torch.isin(layers["reason"], torch.tensor([r for r in Reason if r.has_depth]))
    assert torch.equal(with_depth, layers["depth"] > 0)
    made = DepthNoise("kinect-v2-fast", p=0.3)(clean, seeds=range(200))
    changed = (made != clean).flatten(1).any(1).sum()
    assert 40 < changed < 80  # 60 +- 3 standard deviations of 6.5


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of torch, in itself
@pytest.mark.long
def test_a_compiled_function_of_the_user_may_call_it() -> None:
    clean, noise = torch.from_numpy(heads(2)), DepthNoise("kinect-v2-fast")
    expected = noise(clean, seeds=[1, 2])  # the first call reads the sensor's file
    doubled = torch.compile(lambda depth_m: 2 * noise(depth_m, seeds=[1, 2]), backend="eager")
    assert torch.equal(doubled(clean), 2 * expected)


@pytest.mark.parametrize(
    ("sensor", "given", "message"),
    [
        ("kinect-v2", {"seeds": [1, 2, 3]}, r"seeds: has the shape \(3,\), not \(2,\)"),
        ("kinect-v2", {"seeds": [1.5, 2]}, "seeds: must be integers"),
        ("kinect-v2", {"seeds": "ab"}, "seeds: must be numbers"),
        ("kinect-v2", {"seeds": 1, "focal": 3}, "focal: known are fx, fy"),
        ("kinect-v2", {"seeds": 1, "normal": np.zeros((2, 3))}, r"normal: has the shape \(2, 3\)"),
        ("azure-kinect-wfov", {"seeds": 1, **CAMERA}, "image of its lens"),
        ("kinect-v2", {"seeds": 1, "fx": 60.0}, "cx, cy, fy: a camera needs fx, fy, cx and cy"),
        ("kinect-v2", {"seeds": 1, **CAMERA, "fx": 0.9}, "focal lengths 0.9"),
        ("realsense-d435", {"seeds": 1}, "'stereo_light' does not run on tensors"),
    ],
)
def test_what_does_not_fit_is_named(sensor: str, given: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        DepthNoise(sensor)(torch.from_numpy(heads(2)), **given)


def test_backends_are_chosen_and_forced() -> None:
    clean = torch.from_numpy(heads(1))
    assert DepthNoise().backend_for(clean) == "gl"
    assert DepthNoise().backend_for(clean, seeds=[1]) == "torch"
    assert DepthNoise(backend="numpy").backend_for(clean, seeds=[1]) == "numpy"
    assert DepthNoise(device="cpu").backend_for(clean) == "torch"
    on_gpu = torch.empty(1, 2, 2, device="meta")
    assert DepthNoise().backend_for(on_gpu) == "torch"
    assert DepthNoise("realsense-d435").backend_for(on_gpu) == "gl"
    assert "backend='torch'" in repr(DepthNoise(device="cpu"))
    with pytest.raises(ConfigError, match=r'seeds: only with backend="torch"'):
        DepthNoise(backend="numpy")(clean, seeds=1)
    with pytest.raises(ConfigError, match="device 'nowhere': Expected one of"):
        DepthNoise(device="nowhere")(clean)
    with pytest.raises(ConfigError, match="there is no map in it"):
        DepthNoise()(clean[:0])
    with pytest.raises(ConfigError, match="has no device"):
        DepthNoise(backend="egl", device="cpu")
