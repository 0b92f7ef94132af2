"""Start a network from the weights of another one that sees fewer inputs."""

from __future__ import annotations

from collections.abc import Mapping

from torch import Size, Tensor, nn

from glsim.core.errors import ConfigError

#: Buffers that describe a trained network; a new training begins without them.
NOT_COPIED = ("sigma_scale",)


def copy_weights(weights: Mapping[str, Tensor], network: nn.Module, where: str) -> None:
    """Copy weights, by name and shape, into a network with further inputs.

    The weights of further input channels become 0, so that both networks give the same depth.

    Args:
        weights: weights of a network with fewer inputs, by name.
        network: the network to fill.
        where: the file of the weights, for messages.

    Raises:
        ConfigError: if the networks differ in more than their inputs.
    """
    own = network.state_dict()  # detached, and in the same memory as the parameters
    if odd := sorted((own.keys() ^ weights.keys()) - set(NOT_COPIED)):
        raise ConfigError(
            f"{where}: is another architecture (it {'has' if odd[0] in weights else 'lacks'} "
            f"{odd[0]}): start from a network with the same [model], or without --from"
        )
    extended = []
    for name, target in own.items():
        given = weights.get(name)
        if name in NOT_COPIED or given is None:
            continue
        if given.shape == target.shape:
            target.copy_(given)
        elif _has_more_inputs(target.shape, given.shape):
            target.zero_()
            target[:, : given.shape[1]].copy_(given)
            extended.append(name)
        else:
            raise ConfigError(
                f"{where}: {name} is {tuple(given.shape)}, this network needs "
                f"{tuple(target.shape)}: start from a network with the same [model.backbone]"
            )
    if len(extended) > 1:
        raise ConfigError(
            f"{where}: {', '.join(extended)} have fewer inputs than in this network: only its "
            "first layer may; start from a network with the same [model.backbone]"
        )


def _has_more_inputs(target: Size, given: Size) -> bool:
    """Return whether ``target`` has the shape ``given`` with more input channels."""
    return (
        len(target) == len(given) > 1
        and target[1] > given[1]
        and (target[0], *target[2:]) == (given[0], *given[2:])
    )
