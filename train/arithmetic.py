"""What decides the last bits of a training besides its recipe and data."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import torch
from lightning_fabric import Fabric

log = logging.getLogger(__name__)


def arithmetic(fabric: Fabric) -> dict[str, Any]:
    """Return what computes: device, number of threads, vector instructions, version of PyTorch.

    PyTorch divides a sum among its threads, so their number decides how it is rounded.
    """
    on_gpu = fabric.device.type == "cuda"
    return {
        "device": torch.cuda.get_device_name(fabric.device) if on_gpu else "cpu",
        "threads": torch.get_num_threads(),
        "instructions": torch.backends.cpu.get_cpu_capability(),
        "torch": str(torch.__version__),
    }


def continue_arithmetic(begun: Mapping[str, Any] | None, fabric: Fabric, where: object) -> None:
    """Compute with as many threads as the training began with; warn of all else that differs.

    Args:
        begun: of the checkpoint; None for one of an earlier version.
        where: names the checkpoint in the warning.
    """
    if begun is None:
        return
    torch.set_num_threads(int(begun["threads"]))
    now = arithmetic(fabric)
    if others := [f"{n} {begun.get(n)}, not {now[n]}" for n in now if begun.get(n) != now[n]]:
        log.warning(
            "%s: was computed with %s: the weights will differ in their last bits from those of "
            "a training that was not interrupted",
            where,
            ", ".join(others),
        )
