"""What the owner knows of each of n actions: policies that score actions by their features, and so learn of all from each.

Stock networks end in a layer with a row of weights per action, and what is learned of one action tells nothing of another. Here
row a is f_a S, where f_a (K,) are the features of the action and S (K, H + 1) is learned: a bilinear score, as in Li et al. 2010
("A contextual-bandit approach to personalized news article recommendation", the hybrid model). Each action keeps a bias of its
own. As many tensors are learned as in a stock layer, and the product is a stock layer: a saved model has that one, with S and
what the optimiser knows of it beside.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch as th
from torch import nn
from torch.nn import functional

from agents_app.algorithms import beside

MEMBER = "action_features.npz"  # in a saved ZIP: what the product no longer tells
STACKS = ("q_net", "quantile_net")  # of SB3's networks of values
LEARNED = {"shared": "weight", "own": "bias"}  # in place of which tensors of a stock layer


class ScoresFeatures(nn.Module):
    """The last layer of a network, for A actions; N outputs of each, one behind the other (the quantiles of QR-DQN), or 1."""

    features: th.Tensor  # (A, K)

    def __init__(self, features: th.Tensor, inputs: int, outputs: int) -> None:
        """`inputs`: H; `outputs`: N A. Every score is 0 at first."""
        super().__init__()
        actions, known = features.shape
        self.outputs_each = outputs // actions  # N
        self.register_buffer("features", features, persistent=False)
        self.shared = nn.Parameter(th.zeros(self.outputs_each * known, inputs + 1))  # the last column: a constant's
        self.own = nn.Parameter(th.zeros(outputs))

    def forward(self, x: th.Tensor) -> th.Tensor:
        """(B, H) -> (B, N A)."""
        weighted = functional.linear(x, self.shared[:, :-1], self.shared[:, -1])  # (B, N K)
        scores = weighted.unflatten(-1, (-1, self.features.shape[1])) @ self.features.T  # (B, N, A)
        return scores.flatten(-2) + self.own

    def stock(self) -> dict[str, th.Tensor]:
        """Weight (N A, H) and bias (N A,) of the stock layer that does the same."""
        rows = self.shared.detach().unflatten(0, (-1, self.features.shape[1]))  # (N, K, H + 1)
        rows = (self.features.double() @ rows.double()).flatten(0, 1)
        return {"weight": rows[:, :-1].float(), "bias": (self.own.detach().double() + rows[:, -1]).float()}

    def in_numpy(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The same as two layers, weights and biases, on the very memory; for N = 1."""
        shared = self.shared.detach().numpy()
        return [(shared[:, :-1], shared[:, -1]), (self.features.numpy(), self.own.detach().numpy())]


def attach(algorithm: Any, features: Sequence[Sequence[float]]) -> None:
    """Let the networks of an algorithm that was just made end in such layers. `features`: (A, K)."""
    table = th.tensor(features, dtype=th.float32)
    for owner, name in _last_layers(algorithm.policy):
        stock: Any = getattr(owner, name)
        layer = ScoresFeatures(table, stock.in_features, stock.out_features)
        setattr(owner, name, layer)
        _swap(algorithm.policy.optimizer, {stock.weight: layer.shared, stock.bias: layer.own})


def _last_layers(policy: nn.Module) -> list[tuple[nn.Module, str]]:
    """Modules, and under which name each has a last layer: one network of logits, or networks of values and their targets."""
    if hasattr(policy, "action_net"):
        return [(policy, "action_net")]
    stacks: list[Any] = [getattr(net, name) for net in policy.children() for name in STACKS if hasattr(net, name)]
    return [(stack, str(len(stack) - 1)) for stack in stacks]


def _swap(optimizer: th.optim.Optimizer, others: dict[Any, nn.Parameter]) -> None:
    for group in optimizer.param_groups:
        group["params"] = [others.get(tensor, tensor) for tensor in group["params"]]


def _layers(policy: nn.Module) -> dict[str, ScoresFeatures]:
    return {name: module for name, module in policy.named_modules() if isinstance(module, ScoresFeatures)}


def fold(policy: nn.Module, params: dict[str, Any]) -> dict[str, Any]:
    """Parameters as `get_parameters` gives them, for stock networks, whose optimiser begins anew with the last layer."""
    state = dict(params["policy"])
    for name, layer in _layers(policy).items():
        state = {key: tensor for key, tensor in state.items() if not key.startswith(f"{name}.")}
        state |= {f"{name}.{kind}": tensor for kind, tensor in layer.stock().items()}
    known, replaced = params["policy.optimizer"], _replaced(policy)
    kept = {index: moments for index, moments in known["state"].items() if index not in replaced}
    return params | {"policy": state, "policy.optimizer": known | {"state": kept}}


def _replaced(policy: nn.Module) -> set[int]:
    """Which numbers the optimiser gives to tensors of ours."""
    ours = {id(tensor) for layer in _layers(policy).values() for tensor in layer.parameters()}
    optimizer: Any = policy.optimizer
    tensors = [tensor for group in optimizer.param_groups for tensor in group["params"]]
    return {index for index, tensor in enumerate(tensors) if id(tensor) in ours}


def write_beside(path: Path | BytesIO, policy: nn.Module, params: dict[str, Any]) -> None:
    """Add to a saved ZIP what was learned; stock SB3 does not look at it. `params`: before the folding."""
    learned = [f"{name}.{kind}" for name in _layers(policy) for kind in LEARNED]
    arrays = {f"policy/{name}": params["policy"][name].numpy() for name in learned}
    for index in _replaced(policy) & params["policy.optimizer"]["state"].keys():
        moments = params["policy.optimizer"]["state"][index]
        arrays |= {f"optimizer/{index}/{name}": np.asarray(value) for name, value in moments.items()}
    beside.write(path, MEMBER, arrays)


def read_beside(path: Path | BytesIO, policy: nn.Module, params: dict[str, Any]) -> None:
    """Put it into the parameters of a save, in place of what is folded. Without it they are left as they are."""
    arrays = beside.read(path, MEMBER) if _layers(policy) else {}
    moments = params.get("policy.optimizer", {}).get("state", {})
    for key, array in arrays.items():
        kind, *names = key.split("/")
        if kind == "policy":
            layer, name = names[0].rsplit(".", 1)
            params["policy"].pop(f"{layer}.{LEARNED[name]}")
            params["policy"][names[0]] = th.from_numpy(array)
        else:
            index, name = names
            moments.setdefault(int(index), {})[name] = th.from_numpy(array)
    if arrays:
        params["policy.optimizer"]["state"] = dict(sorted(moments.items()))
