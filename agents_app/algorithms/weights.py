"""The weights of a policy as one vector: what executions publish, and what copies are brought up to date with. No pickle."""

from __future__ import annotations

from collections.abc import Collection
from itertools import chain

import numpy as np
import torch as th
from torch import nn


def flatten(policy: nn.Module, without: Collection[str] = ()) -> np.ndarray:
    """All parameters and buffers of the policy in their own order, but for those modules, (P,) of float32. A copy."""
    with th.no_grad():
        return th.cat([tensor.reshape(-1).float() for tensor in _tensors(policy, without)]).numpy()


def parameters_of(policy: nn.Module) -> int:
    """How many of these numbers are learned; behind them are the buffers."""
    return sum(tensor.numel() for _, tensor in policy.named_parameters(remove_duplicate=False))


def assign(policy: nn.Module, weights: np.ndarray) -> None:
    """Set all parameters and buffers from such a vector. Raises ValueError when it is of another size."""
    tensors = _tensors(policy)
    sizes = [tensor.numel() for tensor in tensors]
    if sum(sizes) != weights.size:
        raise ValueError(f"these weights are {weights.size} numbers, the policy has {sum(sizes)}")
    with th.no_grad():
        for tensor, part in zip(tensors, th.from_numpy(weights).split(sizes), strict=True):
            tensor.copy_(part.view_as(tensor))


def _tensors(policy: nn.Module, without: Collection[str] = ()) -> list[th.Tensor]:
    """Those of its state dictionary, and the buffers that are in none since no save has them."""
    named = chain(policy.named_parameters(remove_duplicate=False), policy.named_buffers(remove_duplicate=False))
    return [tensor for name, tensor in named if name.split(".")[0] not in without]


def share(policy: nn.Module, source: nn.Module) -> None:
    """Let the policy use the very tensors of `source`, an equal module: what trains one is seen by the other at once."""
    for own, other in zip(policy.modules(), source.modules(), strict=True):
        own._parameters.update(other._parameters)
        own._buffers.update(other._buffers)
