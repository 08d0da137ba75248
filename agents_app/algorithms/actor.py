"""The acting half of an execution: an actor works on a copy of the policy that it owns.

SB3's policies keep one distribution object that every call changes, so a policy belongs to one thread; the learner trains
its own, and hands its weights over.
"""

from __future__ import annotations

import copy
from typing import Any, Protocol

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy

from agents_app.algorithms.replay import Decision
from agents_app.algorithms.weights import flatten

Memory = Any  # what a recurrent policy remembers of one session's episode; None at its beginning


class Actor(Protocol):
    """Chooses actions for one execution. Belongs to one thread.

    Where an agent takes masks, they ride in `obs`; the argument `mask` is for MaskablePPO, which has a way of its own.
    """

    def decide(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Decision, Memory]:
        """Explore: the decision that the algorithm would take at `obs` while learning, for the record."""
        ...

    def exploit(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Any, Memory]:
        """The best action that the policy knows at `obs`, as the environment takes it. Nothing is recorded."""
        ...

    def update(self, weights: np.ndarray) -> None:
        """Act with these weights from now on."""
        ...


def own_policy(algorithm: BaseAlgorithm) -> BasePolicy:
    """A copy of the algorithm's policy for acting, without its optimiser. Made before the algorithm learns."""
    if algorithm.use_sde:  # its first exploration matrix hangs on gradients, and such a tensor cannot be copied
        with th.no_grad():
            exploring_part(algorithm.policy).reset_noise()
    policy = copy.deepcopy(algorithm.policy)
    policy.set_training_mode(False)
    for module in policy.modules():
        if hasattr(module, "optimizer"):
            module.optimizer = None  # type: ignore[assignment]
    return policy


def advising_policy(algorithm: BaseAlgorithm) -> BasePolicy:
    """Such a copy, without what is not needed to advise: its weights are `advice_weights`."""
    policy = own_policy(algorithm)
    for name in only_for_learning(policy):
        delattr(policy, name)
    return policy


def advice_weights(policy: BasePolicy) -> np.ndarray:
    """What a peer must know of a policy to take its advice, (P,)."""
    return flatten(policy, without=only_for_learning(policy))


def only_for_learning(policy: BasePolicy) -> tuple[str, ...]:
    """The modules of a policy that tell nothing of what it does, e.g. critics. A policy may name them itself."""
    return getattr(policy, "only_for_learning", ())


def exploring_part(policy: Any) -> Any:
    """What draws the exploration matrix of gSDE: the policy itself, or off the policy its actor."""
    return getattr(policy, "actor", policy)


def batch(obs: Any) -> Any:
    """The observation with a batch dimension of 1."""
    if isinstance(obs, dict):
        return {key: np.asarray(value)[None] for key, value in obs.items()}
    return np.asarray(obs)[None]


def to_env(action_space: spaces.Space, policy: BasePolicy, action: np.ndarray) -> Any:
    """An action as the environment takes it: clipped, or unscaled when the policy squashes, as SB3 does on the policy."""
    if not isinstance(action_space, spaces.Box):
        return action
    if policy.squash_output:
        return policy.unscale_action(action)
    return np.clip(action, action_space.low, action_space.high)
