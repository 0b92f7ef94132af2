"""Every network: shapes of any size, parameter counts, gradients, repeatability, half precision."""

from typing import Any

import pytest
import torch
from torch import nn

from glsim.core.errors import ConfigError
from glsim.train.models.dncnn import DnCNN
from glsim.train.models.registry import build_model, parameter_count
from glsim.train.models.restormer import TransposedAttention
from tests.support.networks import BACKBONES, WRAPPERS, build, frames, parts

every_model = pytest.mark.parametrize("backbone", BACKBONES)
every_wrapper = pytest.mark.parametrize("wrapper", WRAPPERS)


@every_model
@every_wrapper
def test_shapes_and_types(wrapper: str, backbone: str) -> None:
    model = build(wrapper, backbone).eval()
    for noisy_mm in (frames(), frames(1, 32, 32), frames(1, 9, 40)):
        prediction = model(noisy_mm)
        given = [part is not None for part in prediction]
        chooses, sure = wrapper == "surfaces", wrapper in ("uncertain", "surfaces")
        masks = wrapper != "paper"
        assert given == [True, masks, sure, chooses, chooses]
        for number, part in enumerate(parts(model, noisy_mm)):
            candidates = 3 if number >= 3 else 1
            assert part.shape == (len(noisy_mm), candidates, *noisy_mm.shape[2:])
            assert part.dtype == torch.float32
            assert part.isfinite().all()


@every_model
@every_wrapper
def test_gradient_reaches_every_parameter(wrapper: str, backbone: str) -> None:
    model = build(wrapper, backbone)
    sum(part.square().mean() for part in parts(model, frames())).backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.isfinite().all(), name
        assert parameter.grad.any(), name


@every_model
@every_wrapper
def test_frames_do_not_influence_each_other(wrapper: str, backbone: str) -> None:
    """Nor does a second run differ from the first."""
    model = build(wrapper, backbone).eval()
    four = frames(4)
    with torch.no_grad():
        together, again, alone = parts(model, four), parts(model, four), parts(model, four[2:3])
    for all_four, second, one in zip(together, again, alone, strict=True):
        assert torch.equal(all_four, second)
        torch.testing.assert_close(all_four[2:3], one, rtol=1e-4, atol=1e-3)


@every_model
@every_wrapper
def test_half_precision(wrapper: str, backbone: str) -> None:
    """bfloat16 inside; what comes out is float32 and, but for raw millimetres, close."""
    model = build(wrapper, backbone).eval()
    with torch.no_grad():
        exact = model(frames())
        with torch.autocast("cpu", torch.bfloat16):
            half = model(frames())
    assert half.depth_mm.dtype == torch.float32
    assert half.depth_mm.isfinite().all()
    if wrapper != "paper":
        difference = (half.depth_mm - exact.depth_mm).abs().max()
        assert 0.0 < difference < 0.15 * (exact.depth_mm - frames())[frames() > 0].abs().max()


@pytest.mark.parametrize(
    ("spec", "count"),
    [  # as deepinv 0.5's networks have them, which the paper's rows seem to be
        ({"kind": "dncnn", "depth": 7}, 185_857),
        ({"kind": "dncnn", "depth": 64}, 2_290_753),
        ({"kind": "unet"}, 8_562_881),
        ({"kind": "restormer"}, 26_109_076),
        ({"kind": "restormer", "dim": 16, "blocks": [1, 1, 1, 2], "refinement": 1}, 1_004_819),
    ],
    ids=lambda value: value["kind"] if isinstance(value, dict) else str(value),
)
def test_parameter_counts(spec: dict[str, Any], count: int) -> None:
    with torch.device("meta"):
        model = build_model({"kind": "paper_input", "backbone": spec})
    assert parameter_count(model) == count


def test_dncnn_is_the_stack_of_its_paper() -> None:
    torch.manual_seed(0)
    model = DnCNN(2, 2, depth=3, width=5)
    layers: list[Any] = [layer for layer in model.modules() if isinstance(layer, nn.Conv2d)]
    x = torch.randn(1, 2, 8, 9)
    expected = x + layers[2](layers[1](layers[0](x).relu()).relu())
    torch.testing.assert_close(model(x), expected)
    wide: Any = DnCNN(64, 64, depth=2)
    assert wide.layers[0].weight.detach().std().item() == pytest.approx(
        (2 / (9 * 64)) ** 0.5, rel=0.02
    )


def test_transposed_attention_weighs_channels() -> None:
    """Against the paper's formula, written out for one head."""
    torch.manual_seed(0)
    layer = TransposedAttention(4, heads=2)
    x = torch.randn(1, 4, 5, 6)
    query, key, value = layer.project(x).flatten(2)[0].split(4)
    rows = []
    for head in (slice(0, 2), slice(2, 4)):
        q, k = query[head], key[head]
        cosine = (q @ k.T) / (q.norm(dim=1)[:, None] * k.norm(dim=1)[None])
        rows.append(cosine.softmax(dim=1) @ value[head])
    expected = layer.out(torch.cat(rows).view(1, 4, 5, 6))
    torch.testing.assert_close(layer(x), expected)


def paper_input(**backbone: Any) -> dict[str, Any]:
    return {"kind": "paper_input", "backbone": {"kind": "dncnn"} | backbone}


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ({"kind": "mask_awar", "backbone": {"kind": "dncnn"}}, "did you mean 'mask_aware'"),
        ({"kind": "mask_aware", "filters": ["slopes", "robust"]}, "in the order guided_1"),
        ({"kind": "paper_input"}, "model.backbone: give a table"),
        (paper_input(kind="dncn"), "did you mean 'dncnn'"),
        (paper_input(deptt=7), "no parameter 'deptt' .did you mean 'depth'"),
        (paper_input(depth=1), "model.backbone.depth = 1: .*greater than or equal to 2"),
        (paper_input(in_channels=2), "model.backbone.in_channels: set by the model around it"),
        (paper_input(backbone={"kind": "unet"}), "dncnn has no backbone"),
        (paper_input() | {"uncertainty": True}, "no parameter 'uncertainty'"),
        (paper_input(kind="restormer", heads=[1, 2, 4, 7]), "do not divide"),
    ],
)
def test_wrong_specifications(spec: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        build_model(spec)
