"""Registry of models and backbones by the names in the table ``[model]`` of a recipe."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any, Final, get_type_hints

import torch
from pydantic import TypeAdapter, ValidationError
from torch import nn

from glsim.core.errors import ConfigError, did_you_mean
from glsim.networks.inputs import NetworkInputs
from glsim.train.models.backbone import Backbone
from glsim.train.models.base import DepthModel, PaperInput
from glsim.train.models.dncnn import DnCNN
from glsim.train.models.mask_aware import MaskAware
from glsim.train.models.restormer import Restormer
from glsim.train.models.small_unet import SmallUNet
from glsim.train.models.unet import UNet

MODELS: Final[dict[str, type[PaperInput] | type[MaskAware]]] = {
    "paper_input": PaperInput,
    "mask_aware": MaskAware,
}
BACKBONES: Final[dict[str, type[Backbone]]] = {
    "dncnn": DnCNN,
    "unet": UNet,
    "restormer": Restormer,
    "small_unet": SmallUNet,
}


def build_model(spec: Mapping[str, Any]) -> DepthModel:
    """Build a model from nested tables: ``{"kind": "mask_aware", "backbone": {"kind": "dncnn"}}``.

    Initial weights come from torch's global generator. Raises ConfigError for an unknown kind or
    parameter, a value out of range, and a parameter of the backbone that the model sets.
    """
    kind = _kind(spec, MODELS, "model")
    values = _parameters(kind, spec, {}, "model")
    settings = kind.backbone_settings(**values)
    model: DepthModel = kind(_backbone(spec.get("backbone"), settings, "model.backbone"), **values)
    return model


def inputs_of(spec: Mapping[str, Any]) -> NetworkInputs:
    """Return the inputs besides depth of the network of a table. Raises ConfigError."""
    with torch.device("meta"):
        return build_model(spec).inputs


def parameter_count(model: nn.Module) -> int:
    """Count the trainable values of a network."""
    return sum(p.numel() for p in model.parameters() if p.requires_grad)


def _backbone(spec: Any, settings: Mapping[str, Any], where: str) -> Backbone:
    if not isinstance(spec, Mapping):
        raise ConfigError(f"{where}: give a table with a kind ({', '.join(BACKBONES)})")
    kind = _kind(spec, BACKBONES, where)
    if "backbone" in spec:
        raise ConfigError(f"{where}: {spec['kind']} has no backbone; remove the table")
    backbone: Backbone = kind(**_parameters(kind, spec, settings, where), **settings)
    return backbone


def _kind(spec: Mapping[str, Any], kinds: Mapping[str, type], where: str) -> Any:
    name = spec.get("kind")
    if not isinstance(name, str) or name not in kinds:
        raise ConfigError(
            f"{where}.kind: no such kind {name!r:.60} ({did_you_mean(str(name)[:60], kinds)})"
        )
    return kinds[name]


def _parameters(
    kind: type, spec: Mapping[str, Any], settings: Mapping[str, Any], where: str
) -> dict[str, Any]:
    """Read parameters from a table, and check them against the annotations of the class."""
    hints = get_type_hints(kind.__init__, include_extras=True)  # type: ignore[misc]
    known = set(inspect.signature(kind).parameters) - {"backbone"}
    values = {}
    for name, value in spec.items():
        if not isinstance(name, str):
            raise ConfigError(f"{where}: {name!r:.60} is no name of a parameter")
        if name in ("kind", "backbone"):
            continue
        if name in settings:
            raise ConfigError(f"{where}.{name}: set by the model around it; remove it")
        if name not in known:
            suggestion = did_you_mean(name, known - set(settings))
            raise ConfigError(f"{where}: {spec['kind']} has no parameter {name!r} ({suggestion})")
        try:
            values[name] = TypeAdapter(hints[name]).validate_python(value)
        except ValidationError as error:
            problem = error.errors()[0]["msg"]
            raise ConfigError(f"{where}.{name} = {value!r:.60}: {problem}") from None
    return values
