"""The networks of many learners, stacked: Stable-Baselines3's MlpPolicy for one of A actions, L times over.

Weights are (L, in, out), so that one product serves all learners; observations are (L, B, O).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import torch as th

HIDDEN = (64, 64)  # as MlpPolicy
Layer = tuple[th.Tensor, th.Tensor]  # weights (L, in, out), biases (L, 1, out)


class Networks:
    """Actors and critics of L learners."""

    def __init__(self, learners: int, inputs: int, actions: int) -> None:
        """Orthogonal weights, drawn from torch's generator; gains as in Stable-Baselines3."""
        sizes = (inputs, *HIDDEN)
        self.actor = _layers(learners, (*sizes, actions), last_gain=0.01)
        self.critic = _layers(learners, (*sizes, 1), last_gain=1.0)

    def parameters(self) -> list[th.Tensor]:
        """All weights and biases, each with L in front."""
        return [tensor for layer in (*self.actor, *self.critic) for tensor in layer]

    def logits(self, observations: th.Tensor) -> th.Tensor:
        """(L, B, O) -> (L, B, A)."""
        return _run(self.actor, observations)

    def values(self, observations: th.Tensor) -> th.Tensor:
        """(L, B, O) -> (L, B)."""
        return _run(self.critic, observations)[..., 0]

    def begin_alike(self, size: int) -> None:
        """Give the learners of a team, `size` beside each other, the weights of its first."""
        self._replace(lambda team: team[:, :1], size)

    def average(self, size: int) -> None:
        """Give them the mean of their weights."""
        self._replace(lambda team: team.mean(1, keepdim=True), size)

    def _replace(self, by: Callable[[th.Tensor], th.Tensor], size: int) -> None:
        with th.no_grad():
            for tensor in self.parameters():
                team = tensor.view(-1, size, *tensor.shape[1:])
                team.copy_(by(team).clone().expand_as(team))


def _layers(learners: int, sizes: tuple[int, ...], last_gain: float) -> list[Layer]:
    gains = [2**0.5] * (len(sizes) - 2) + [last_gain]
    return [
        (_stack(learners, fan_in, fan_out, gain), th.zeros(learners, 1, fan_out, requires_grad=True))
        for fan_in, fan_out, gain in zip(sizes, sizes[1:], gains, strict=False)
    ]


def _stack(learners: int, fan_in: int, fan_out: int, gain: float) -> th.Tensor:
    weights = (th.nn.init.orthogonal_(th.empty(fan_out, fan_in), gain).T for _ in range(learners))
    return th.stack(list(weights)).contiguous().requires_grad_()


def _run(layers: Iterable[Layer], x: th.Tensor) -> th.Tensor:
    *hidden, (weight, bias) = layers
    for inner_weight, inner_bias in hidden:
        x = th.tanh(th.baddbmm(inner_bias, x, inner_weight))
    return th.baddbmm(bias, x, weight)


def in_numpy(layers: Iterable[Layer]) -> list[tuple[np.ndarray, np.ndarray]]:
    """The very same memory, for acting: torch spends more on calls than on numbers there."""
    return [(weight.detach().numpy(), bias.detach().numpy()) for weight, bias in layers]


def run_in_numpy(layers: Iterable[tuple[np.ndarray, np.ndarray]], x: np.ndarray) -> np.ndarray:
    """What the networks say, (..., B, O) -> (..., B, out); leading dimensions are broadcast."""
    *hidden, (weight, bias) = layers
    for inner_weight, inner_bias in hidden:
        x = np.tanh(x @ inner_weight + inner_bias)
    return x @ weight + bias
