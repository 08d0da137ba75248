"""The weights of a policy as one vector: what executions publish, and what copies are brought up to date with. No pickle."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import torch as th
from torch import nn


def flatten(policy: nn.Module, without: Collection[str] = ()) -> np.ndarray:
    """All parameters and buffers of the policy in their own order, but for those modules, (P,) of float32. A copy."""
    state = policy.state_dict().items()
    with th.no_grad():
        return th.cat([t.reshape(-1).float() for name, t in state if name.split(".")[0] not in without]).numpy()


def assign(policy: nn.Module, weights: np.ndarray) -> None:
    """Set all parameters and buffers from such a vector. Raises ValueError when it is of another size."""
    tensors = list(policy.state_dict().values())
    sizes = [tensor.numel() for tensor in tensors]
    if sum(sizes) != weights.size:
        raise ValueError(f"these weights are {weights.size} numbers, the policy has {sum(sizes)}")
    with th.no_grad():
        for tensor, part in zip(tensors, th.from_numpy(weights).split(sizes), strict=True):
            tensor.copy_(part.view_as(tensor))


def share(policy: nn.Module, source: nn.Module) -> None:
    """Let the policy use the very tensors of `source`, an equal module: what trains one is seen by the other at once."""
    for own, other in zip(policy.modules(), source.modules(), strict=True):
        own._parameters.update(other._parameters)
        own._buffers.update(other._buffers)
