"""Weights as safetensors: tensors and a table of text, in which no code can hide.

The file of a checkpoint has its weights, and in the table under ``glsim`` the rest as JSON: format,
version, recipe, data, progress, validation, and the CRC32 of all this and of the tensors in the
order of their names, because the format has no checksum. ``format: pt`` tells other readers of
PyTorch weights that the tensors are theirs.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import torch

from glsim.errors import TrainError

SUFFIX: Final = ".safetensors"
_TABLE: Final = "glsim"


def safetensors_bytes(content: Mapping[str, Any]) -> bytes:
    """Return the file of a checkpoint: ``model`` (weights by name) and what JSON can hold.

    Raises TrainError without the package safetensors.
    """
    try:
        from safetensors.torch import save
    except ImportError:
        raise _missing() from None
    weights = {
        name: value.detach().cpu().contiguous().clone() for name, value in content["model"].items()
    }
    rest = {name: value for name, value in content.items() if name != "model"}
    table = json.dumps(rest | {"crc32": _checksum(rest, weights)})
    return bytes(save(weights, {"format": "pt", _TABLE: table}))


def read_safetensors(path: Path, data: bytes) -> dict[str, Any]:
    """Read the bytes that ``safetensors_bytes`` made. path: the file, named in messages.

    Raises TrainError without the package safetensors, and for a foreign or damaged file.
    """
    try:
        from safetensors.torch import load
    except ImportError:
        raise _missing() from None
    try:
        weights = load(data)
        # The reader has checked the header, a JSON table behind its length in eight bytes; it
        # gives the text in it only for files that it opens itself.
        header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
        table = header.get("__metadata__", {}).get(_TABLE)
        content = None if table is None else json.loads(table)
    except Exception:  # safetensors' own errors, those of JSON, and RecursionError
        raise TrainError(f"{path}: is cut short, damaged, or no safetensors file") from None
    if not isinstance(content, dict):
        raise TrainError(
            f"{path}: has no recipe: give a file of glsim export CHECKPOINT -o NAME{SUFFIX}"
        )
    if content.pop("crc32", None) != _checksum(content, weights):
        raise TrainError(
            f"{path}: is damaged: its CRC32 differs: copy it again, or name another checkpoint"
        )
    return content | {"model": weights}


def _checksum(rest: Mapping[str, Any], weights: Mapping[str, torch.Tensor]) -> int:
    """Return the CRC32 of what is no tensor, and of each tensor's name, type, shape and bytes."""
    crc = zlib.crc32(json.dumps(rest, sort_keys=True).encode())
    for name in sorted(weights):
        value = weights[name]
        crc = zlib.crc32(f"{name} {value.dtype} {list(value.shape)}".encode(), crc)
        crc = zlib.crc32(value.contiguous().reshape(-1).view(torch.uint8).numpy().data, crc)
    return crc


def _missing() -> TrainError:
    return TrainError(f"{SUFFIX} files need safetensors: pip install 'glsim[train]'")
