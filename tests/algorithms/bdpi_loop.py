"""BDPI as anybody would write it first: plain torch, autograd, a network and an Adam for each Q-function, one after the other.

The batched ensemble must give the same numbers (tests/algorithms/test_bdpi.py), in a fifth of the time (benchmarks/bdpi.py).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import torch as th
from torch import nn
from torch.nn.functional import mse_loss, one_hot

from agents_app.algorithms.bdpi import BDPI, Batches
from agents_app.algorithms.ensemble import Ensemble


def networks_of(ensemble: Ensemble) -> list[nn.Sequential]:
    """Copies of the members, as ordinary networks."""
    return [_network(ensemble, member) for member in range(len(ensemble.layers[0]))]


def _network(ensemble: Ensemble, member: int) -> nn.Sequential:
    modules: list[nn.Module] = []
    for stacked in ensemble.layers:
        *weight, bias = stacked[member].detach()
        layer = nn.Linear(len(weight), len(bias), dtype=bias.dtype)
        layer.weight.data, layer.bias.data = th.stack(weight, 1), bias.clone()
        layer.bias.requires_grad_(not (ensemble.lookup and not modules))  # a table has none
        modules += [layer, nn.Tanh()]
    return nn.Sequential(*modules[:-1])


class LoopBDPI:
    """Trains copies of a BDPI's networks on the same batches; whole numbers become one-hot vectors."""

    def __init__(self, model: BDPI) -> None:
        self.model = model
        (self.actor,) = networks_of(model.actor)
        self.critics = list(zip(*map(networks_of, model.policy.critics), strict=True))  # type: ignore[arg-type]
        self.actor_adam = self._adam(self.actor)
        self.adams = [tuple(map(self._adam, pair)) for pair in self.critics]

    def train(self, batches: Batches) -> None:
        """One epoch: every critic, then the actor."""
        batches = replace(batches, inputs=self._vectors(batches.inputs), next_inputs=self._vectors(batches.next_inputs))
        for index in range(self.model.n_critics):
            self._train_critic(index, batches)
        for index in range(self.model.n_critics):
            self._train_actor(index, batches)

    def _vectors(self, inputs: th.Tensor) -> th.Tensor:
        return inputs if inputs.is_floating_point() else one_hot(inputs, self.actor[0].in_features).float()  # type: ignore[arg-type]

    def _adam(self, network: nn.Module) -> th.optim.Optimizer:
        return th.optim.Adam(network.parameters(), lr=self.model.lr_schedule(1))

    def _train_critic(self, index: int, batches: Batches) -> None:
        for iteration in range(self.model.q_loops):
            own, other = self.critics[index][iteration % 2], self.critics[index][1 - iteration % 2]
            target = self._target(own, other, *(part[index] for part in _transitions(batches)))
            for _ in range(self.model.fit_steps):
                _step(self.adams[index][iteration % 2], mse_loss(own(batches.inputs[index]), target))

    @th.no_grad()
    def _target(
        self, own: Any, other: Any, inputs: Any, actions: Any, rewards: Any, after: Any, discounts: Any
    ) -> th.Tensor:
        next_own, next_other, values = own(after), other(after), own(inputs)
        best = next_own.argmax(1, keepdim=True)
        clipped = th.min(next_own.gather(1, best), next_other.gather(1, best))
        taken = values.gather(1, actions)
        values.scatter_(1, actions, taken + self.model.alpha * (rewards + discounts * clipped - taken))
        return values

    def _train_actor(self, index: int, batches: Batches) -> None:
        inputs, rate = batches.inputs[index], 1 - math.exp(-self.model.delta)
        with th.no_grad():
            critic = self.critics[index][(self.model.q_loops - 1) % 2]
            own = self.actor(inputs).softmax(-1)
            greedy = one_hot(critic(inputs).argmax(-1), own.shape[-1]).to(own.dtype)
            if batches.advice is not None:
                greedy = th.stack(
                    [self._corrected(*each) for each in zip(greedy, own, batches.advice[index], strict=True)]
                )
            target = ((1 - rate) * own + rate * greedy).clamp(0, 1)
        for _ in range(self.model.fit_steps):
            _step(self.actor_adam, mse_loss(self.actor(inputs).softmax(-1), target))

    def _corrected(self, greedy: th.Tensor, own: th.Tensor, advice: th.Tensor) -> th.Tensor:
        """At one state, (A,): eq. 3.4, or eq. 6.1, as the thesis writes them. Advice that is 1 for each action is of nobody."""
        if bool((advice == 1).all()):
            return greedy
        if self.model.policy.mixing.method == "reuse":
            psi = self.model.policy.mixing.psi
            return (greedy - psi * advice) / (1 - psi)
        return greedy * (own * advice).sum() / advice


def _transitions(batches: Batches) -> tuple[th.Tensor, ...]:
    return batches.inputs, batches.actions, batches.rewards, batches.next_inputs, batches.discounts


def _step(adam: th.optim.Optimizer, loss: th.Tensor) -> None:
    adam.zero_grad()
    loss.backward()
    adam.step()
