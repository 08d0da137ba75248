"""The networks of BDPI: one actor, and two ensembles of critics. The policy takes advice itself, as `advice` beside the rest.

Observations of every kind are flattened into one vector; a single whole number is looked up, which is the same as its
one-hot vector and many times faster.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.distributions import CategoricalDistribution
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.preprocessing import get_flattened_obs_dim, preprocess_obs
from stable_baselines3.common.type_aliases import PyTorchObs, Schedule

from agents_app.algorithms.ensemble import Ensemble, StackedAdam
from agents_app.algorithms.masks import SeesMask, allowed_of, mask_logits, mix_allowed
from agents_app.algorithms.mixing import Mixing
from agents_app.algorithms.riders import ADVICE, client_part, plain_space


class BDPIPolicy(SeesMask, BasePolicy):
    """`predict` is the learner's own policy; `sample` mixes it with the advice, if there is any. Both keep to the mask."""

    takes_advice = True  # needs no mixin
    only_for_learning = ("critics",)
    action_space: spaces.Discrete

    def __init__(
        self,
        observation_space: spaces.Space,
        action_space: spaces.Discrete,
        lr_schedule: Schedule,
        net_arch: list[int] | None = None,
        n_critics: int = 8,
        mixing: Mixing = Mixing(),  # noqa: B008  (frozen)
        normalize_images: bool = True,
        optimizer_kwargs: dict[str, Any] | None = None,
    ) -> None:
        """`mixing`: how advice changes the actions, and whether the actor's target knows."""
        super().__init__(
            plain_space(observation_space),
            action_space,
            normalize_images=normalize_images,
            optimizer_kwargs=optimizer_kwargs,
        )
        self.net_arch, self.n_critics = net_arch or [256], n_critics
        self.mixing = mixing
        self.lookup = isinstance(self.observation_space, spaces.Discrete)
        if self.lookup and self.observation_space.start != 0:  # type: ignore[attr-defined]
            raise ValueError("states that are numbers must be counted from 0")
        self.actor = self._network(1, lr_schedule, softmax=True)
        self.critics = th.nn.ModuleList(self._network(n_critics, lr_schedule) for _ in "AB")

    def forward(self, obs: PyTorchObs, deterministic: bool = False) -> th.Tensor:
        """Actions of the learner's own policy, (B,)."""
        return self._predict(obs, deterministic)

    def vector(self, obs: PyTorchObs) -> th.Tensor:
        """What the networks look at, without advice and mask: (B, I), or whole numbers, (B,)."""
        plain = client_part(obs)
        if self.lookup:
            return plain.long().flatten()
        parts = preprocess_obs(plain, self.observation_space, normalize_images=self.normalize_images)
        if isinstance(parts, dict):
            return th.cat([parts[key].flatten(1) for key in self.observation_space], dim=1)  # type: ignore[attr-defined]
        return parts.flatten(1)

    def logits(self, obs: PyTorchObs) -> th.Tensor:
        """Logarithms of the probabilities of the learner's own policy, (B, A)."""
        return mask_logits(self.actor(self.vector(obs)[None])[0], allowed_of(obs)).log_softmax(-1)

    def get_distribution(self, obs: PyTorchObs) -> CategoricalDistribution:
        """The learner's own policy."""
        return CategoricalDistribution(int(self.action_space.n)).proba_distribution(self.logits(obs))

    def sample(self, observation: Any) -> np.ndarray:
        """Actions drawn from the mixed policy at a batch of observations, (B,)."""
        tensors, _ = self.obs_to_tensor(observation)
        with th.no_grad():
            logits = self.logits(tensors)
            if isinstance(observation, dict) and ADVICE in observation:
                logits = self.mix(logits, th.as_tensor(observation[ADVICE], device=self.device), allowed_of(tensors))
            return _draw(logits).cpu().numpy()

    def mix(self, logits: th.Tensor, advice: th.Tensor, allowed: th.Tensor | None = None) -> th.Tensor:
        """Unnormalised log-probabilities of the policy that acts, (B, A)."""
        return mix_allowed(logits, advice, self.mixing, allowed)

    def optimizers(self) -> list[th.optim.Optimizer]:
        """Of the actor and of both ensembles."""
        return [network.optimizer for network in (self.actor, *self.critics)]

    def _predict(self, observation: PyTorchObs, deterministic: bool = False) -> th.Tensor:
        logits = self.logits(observation)
        return logits.argmax(-1) if deterministic else _draw(logits)

    def _network(self, members: int, lr_schedule: Schedule, softmax: bool = False) -> Ensemble:
        sizes = [_inputs(self.observation_space), *self.net_arch, int(self.action_space.n)]
        network = Ensemble(members, sizes, self.lookup, softmax)
        network.optimizer = StackedAdam(network.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)
        return network

    def _get_constructor_parameters(self) -> dict[str, Any]:
        own = {name: getattr(self, name) for name in ("net_arch", "n_critics", "mixing")}
        return {
            "observation_space": self.observation_space,
            "action_space": self.action_space,
            "normalize_images": self.normalize_images,
            "lr_schedule": self._dummy_schedule,
            **own,
        }


def _draw(logits: th.Tensor) -> th.Tensor:
    return th.multinomial(logits.softmax(-1), 1).squeeze(-1)


def _inputs(space: spaces.Space) -> int:
    if isinstance(space, spaces.Dict):
        return sum(get_flattened_obs_dim(part) for part in space.spaces.values())
    return get_flattened_obs_dim(space)
