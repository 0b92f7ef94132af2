"""The autoencoder of partial convolutions, and the wrapper that keeps the input's mask."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import torch.nn.functional as F  # noqa: N812

from glsim.denoise import checkpoint
from glsim.denoise.inference import load_network
from glsim.denoise.onnx_file import Runtime, load_onnx
from glsim.train.models.base import DepthModel
from glsim.train.models.masked_depth import MaskedDepth
from glsim.train.models.partial_autoencoder import PartialAutoencoder, PreactivatedBlock
from glsim.train.models.partial_conv import PartialConv2d
from glsim.train.models.registry import build_model
from glsim.train.onnx_export import TOLERANCE_MM, export_onnx
from tests.support.networks import build, frames

SPEC = {"kind": "masked_depth", "backbone": {"kind": "partial_autoencoder", "width": 2}}


def trained() -> DepthModel:
    """The whole model with a last layer that is not 0: corrections of some millimetres."""
    torch.manual_seed(3)
    model: Any = build_model(SPEC)
    with torch.no_grad():
        model.backbone.last.weight.normal_(std=0.01)
    return model.eval()


def network() -> PartialAutoencoder:
    torch.manual_seed(1)
    return PartialAutoencoder(width=2).eval()


@pytest.mark.parametrize(("size", "stride"), [(3, 2), (5, 1), (7, 1)])
def test_partial_convolutions_of_any_window_and_stride(size: int, stride: int) -> None:
    """Equation 1 of their paper, window by window."""
    torch.manual_seed(0)
    layer = PartialConv2d(2, 3, size=size, stride=stride)
    x, mask = torch.randn(1, 2, 12, 16), (torch.rand(1, 1, 12, 16) < 0.2).float()
    mask[..., :6, :8] = 0
    out, grown = layer(x, mask)
    columns = F.unfold(x * mask, size, padding=size // 2, stride=stride)
    seen = F.unfold(mask, size, padding=size // 2, stride=stride).sum(1)
    sums = torch.einsum("oi,bil->bol", layer.weight.flatten(1), columns)
    expected = sums * (size**2 / seen.clamp_min(1))[:, None] + layer.bias[None, :, None]
    expected = torch.where(seen[:, None] > 0, expected, 0.0)
    torch.testing.assert_close(out.flatten(2), expected)
    assert torch.equal(grown.flatten(1), (seen > 0).float())
    assert not grown.all()


def test_the_layers_are_those_of_the_paper() -> None:
    """Nine partial convolutions down, two residual blocks of two, nine up; three strides."""
    layers = [layer for layer in network().modules() if isinstance(layer, PartialConv2d)]
    assert len(layers) == 9 + 2 * 2 + 9
    assert [layer.kernel_size[0] for layer in layers[:2]] == [7, 5]
    assert {layer.kernel_size[0] for layer in layers[2:]} == {3}
    assert sum(layer.stride == (2, 2) for layer in layers) == 3
    block = PreactivatedBlock(4)
    x, mask = torch.randn(1, 4, 8, 8), torch.ones(1, 1, 8, 8)
    inner = block.two(F.elu(block.one(F.elu(x), mask)[0]), mask)[0]
    torch.testing.assert_close(block(x, mask)[0], x + inner)


def test_a_pixel_sees_the_scales_above_and_no_farther() -> None:
    """Padding of a frame whose sides 8 does not divide is a hole: a crop at the origin agrees."""
    x, mask = torch.randn(1, 1, 200, 24), torch.ones(1, 1, 200, 24)
    with torch.no_grad():
        near, far = x.clone(), x.clone()
        near[..., 20, :] += 1
        far[..., 190, :] += 1
        out = [network()(image, mask)[..., 8, :] for image in (x, near, far)]
    assert not torch.equal(out[0], out[1])
    assert torch.equal(out[0], out[2])


def test_the_mask_of_the_input_is_kept_and_holes_are_not_read() -> None:
    model = trained()
    noisy = frames()
    with torch.no_grad():
        expected = model(noisy).depth_mm
        assert torch.equal(expected > 0, noisy > 0)
        for code in (torch.nan, -5.0, -torch.inf):
            assert torch.equal(model(torch.where(noisy > 0, noisy, code)).depth_mm, expected)
        shifted = model(torch.where(noisy > 0, noisy + 512, 0.0)).depth_mm
    there = noisy > 0
    torch.testing.assert_close(shifted[there], expected[there] + 512, rtol=0, atol=0.1)
    empty = model(torch.zeros(1, 1, 16, 16)).depth_mm
    assert torch.equal(empty, torch.zeros_like(empty))


def test_training_starts_from_the_measured_depth() -> None:
    settings = MaskedDepth.backbone_settings()
    model = MaskedDepth(PartialAutoencoder(width=2, **settings)).eval()
    with torch.no_grad():
        assert torch.equal(model(frames()).depth_mm, frames())


def test_a_crop_sees_what_the_frame_sees() -> None:
    """Features are local: far surfaces do not change those of a face."""
    model = build("kept mask", "partial_conv").eval()
    frame = frames(1, 64, 96)
    with torch.no_grad():
        whole, crop = model(frame).depth_mm, model(frame[..., 8:56, 16:80]).depth_mm
    inner = (slice(None), slice(None), slice(10, -10), slice(10, -10))
    torch.testing.assert_close(crop[inner], whole[..., 8:56, 16:80][inner], rtol=0, atol=1e-3)


def test_gradient_reaches_every_layer() -> None:
    model = trained().train()
    model(frames()).depth_mm.square().mean().backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.isfinite().all(), name
        assert parameter.grad.any(), name


@pytest.mark.parametrize("runtime", ["opencv", "onnxruntime"])
def test_an_exported_file_gives_the_results_of_pytorch(tmp_path: Path, runtime: Runtime) -> None:
    content = {"recipe": {"model": SPEC}, "model": trained().state_dict()}
    path = tmp_path / "best.pt"
    checkpoint.save(path, content | {"data": {}, "progress": {}, "validation": {}})
    export_onnx(path, tmp_path / "net.onnx")
    expected, exported = load_network(path), load_onnx(tmp_path / "net.onnx", runtime=runtime)
    frame = frames(1, 37, 44)[0, 0].numpy()
    depth_mm, validity = expected(frame, frame > 0)
    exported_mm, exported_validity = exported(frame, frame > 0)
    assert np.abs(depth_mm - frame).max() > 1, "it does something"
    np.testing.assert_allclose(exported_mm, depth_mm, atol=TOLERANCE_MM, rtol=0)
    np.testing.assert_array_equal(exported_validity, validity)
    np.testing.assert_array_equal(validity, frame > 0)
