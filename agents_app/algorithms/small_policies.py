"""Policies of DQN, QR-DQN, BDPI, SAC, TQC, TD3 and DDPG with small networks, in NumPy (small_net.py).

Each stands in for a policy, on the memory of its tensors: it answers what is asked at a step, a batch of one, and leaves all
else to the policy. The arithmetic is that of explorers.py and advised_off_policy.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from stable_baselines3.sac.policies import LOG_STD_MAX, LOG_STD_MIN

from agents_app.algorithms.advised_off_policy import epsilon_greedy
from agents_app.algorithms.bdpi_policies import BDPIPolicy
from agents_app.algorithms.explorers import EDGE, Noisy, Squashed, from_unit_bounds
from agents_app.algorithms.masks import allowed_of, mask_logits, mix_allowed
from agents_app.algorithms.riders import ADVICE
from agents_app.algorithms.small_net import (
    Layer,
    SmallNet,
    Unsupported,
    draw,
    flattener,
    layers,
    log_softmax,
    run,
    vectoriser,
    whole_number,
)


class Small(Protocol):
    """What a policy in NumPy says to others: what it would do, without advice of its own, at one observation."""

    def probabilities(self, obs: Any) -> np.ndarray:
        """Of each action, (A,); 0 for those that are not allowed."""
        ...

    def gaussian(self, obs: Any) -> tuple[np.ndarray, np.ndarray]:
        """Means (A,) and standard deviations (A,)."""
        ...


class StandIn:
    """For a policy, which is asked for all that is not here."""

    def __init__(self, policy: Any) -> None:
        self.policy = policy

    def __getattr__(self, name: str) -> Any:
        return getattr(self.policy, name)


class SmallValues(StandIn):
    """DQN and QR-DQN."""

    def __init__(self, policy: Any) -> None:
        """Raises Unsupported."""
        super().__init__(policy)
        network = policy.q_net if hasattr(policy, "q_net") else policy.quantile_net
        self._vector = vectoriser(network.features_extractor, policy.observation_space)
        self._layers = layers(network.q_net if hasattr(network, "q_net") else network.quantile_net)
        self._actions = int(policy.action_space.n)

    def values(self, obs: Any) -> np.ndarray:
        """Of each action, (A,); those of forbidden ones are never the greatest."""
        quantiles = run(self._layers, self._vector(obs)).reshape(-1, self._actions)
        return mask_logits(quantiles.mean(0), allowed_of(obs)).reshape(-1)

    def predict(self, observation: Any, *args: Any, **kwargs: Any) -> tuple[np.ndarray, None]:
        """The greedy action, (1,), as SB3's for a batch of one."""
        return self.values(observation).argmax(0, keepdims=True), None

    def chances(self, obs: Any, exploration: float) -> np.ndarray:
        """Of each action, (1, A), at that epsilon."""
        return epsilon_greedy(self.predict(obs)[0], allowed_of(obs), self._actions, exploration)

    def probabilities(self, obs: Any) -> np.ndarray:
        """As Small."""
        return self.chances(obs, float(self.policy.exploration))[0]


class SmallDual(StandIn):
    """BDPI: the one member of its actor."""

    def __init__(self, policy: Any) -> None:
        """Raises Unsupported."""
        super().__init__(policy)
        first, *others = (layer.detach()[0].numpy() for layer in policy.actor.layers)
        vector = whole_number if policy.lookup else flattener(policy.observation_space)
        self._enter = lambda obs: first[:-1][vector(obs)] if policy.lookup else vector(obs) @ first[:-1]
        self._bias = first[-1]
        self._layers: list[Layer] = [(layer[:-1].T, layer[-1], np.tanh) for layer in others]
        self._layers[-1] = (*self._layers[-1][:2], None)

    def logits(self, obs: Any) -> np.ndarray:
        """Logarithms of the probabilities of the learner's own policy, (A,)."""
        values = run(self._layers, np.tanh(self._enter(obs) + self._bias))
        return log_softmax(mask_logits(values, allowed_of(obs)).reshape(-1))

    def sample(self, obs: Any) -> np.ndarray:
        """An action drawn from the mixed policy, (1,)."""
        advice = obs.get(ADVICE) if isinstance(obs, dict) else None
        mixed = mix_allowed(self.logits(obs), advice, self.policy.mixing, allowed_of(obs)).reshape(-1)
        return np.array([draw(log_softmax(mixed))])

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[np.ndarray, None]:
        """An action of the learner's own policy, (1,), as SB3's for a batch of one."""
        logits = self.logits(observation)
        return np.array([logits.argmax() if deterministic else draw(logits)]), None

    def probabilities(self, obs: Any) -> np.ndarray:
        """As Small."""
        return np.exp(self.logits(obs))


class SmallActions(StandIn):
    """The algorithms that choose vectors of numbers."""

    def explorer(self, obs: Any) -> Squashed | Noisy:
        """How it explores at one observation."""
        raise NotImplementedError

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[np.ndarray, None]:
        """An action as the environment takes it, (1, ...), as SB3's for a batch of one."""
        explorer = self.explorer(observation)
        scaled = explorer.greedy() if deterministic else explorer.draw()
        return self.policy.unscale_action(scaled.reshape(1, *self.policy.action_space.shape)), None

    def gaussian(self, obs: Any) -> tuple[np.ndarray, np.ndarray]:
        """As Small."""
        explorer = self.explorer(obs)
        means, deviations = from_unit_bounds(self.policy.action_space, explorer.greedy()[0], explorer.straying()[0])
        return means, np.maximum(deviations, EDGE)


class SmallSquashed(SmallActions):
    """SAC and TQC."""

    def __init__(self, policy: Any) -> None:
        """Raises Unsupported."""
        super().__init__(policy)
        actor = policy.actor
        if actor.use_sde:
            raise Unsupported
        self._vector = vectoriser(actor.features_extractor, policy.observation_space)
        self._latent, self._mean, self._log_std = layers(actor.latent_pi), layers([actor.mu]), layers([actor.log_std])

    def explorer(self, obs: Any) -> Squashed:
        """How it explores at one observation."""
        latent = run(self._latent, self._vector(obs))
        log_std = np.clip(run(self._log_std, latent), LOG_STD_MIN, LOG_STD_MAX)
        return Squashed(run(self._mean, latent)[None], np.exp(log_std)[None])


class SmallDeterministic(SmallActions):
    """TD3 and DDPG."""

    def __init__(self, policy: Any) -> None:
        """Raises Unsupported."""
        super().__init__(policy)
        self._vector = vectoriser(policy.actor.features_extractor, policy.observation_space)
        self._layers = layers(policy.actor.mu)
        self._deviation = getattr(policy, "deviation", np.zeros(1, np.float32))  # one that takes no advice knows none

    def explorer(self, obs: Any) -> Noisy:
        """How it explores at one observation."""
        return Noisy(run(self._layers, self._vector(obs))[None], self._deviation)


def small(policy: Any) -> Any:
    """The policy in NumPy, a Small; None where its networks are of another kind."""
    try:
        return _kind(policy)(policy)
    except Unsupported:
        return None


def quickened(policy: Any) -> Any:
    """What stands in for a policy off the policy at a batch of one; the policy itself where its networks are of another kind."""
    return small(policy) or policy


def _kind(policy: Any) -> Callable[[Any], Small]:
    if hasattr(policy, "q_net") or hasattr(policy, "quantile_net"):
        return SmallValues
    if isinstance(policy, BDPIPolicy):
        return SmallDual
    actor = getattr(policy, "actor", None)
    if hasattr(actor, "latent_pi"):
        return SmallSquashed
    return SmallDeterministic if hasattr(actor, "mu") else SmallNet
