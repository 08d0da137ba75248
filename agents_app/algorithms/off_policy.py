"""Algorithms off the policy (DQN, QR-DQN, SAC, TQC, CrossQ, TD3, DDPG): record what was sampled, return it again.

SB3's `collect_rollouts` asks `_sample_action` for the action and for what goes into the replay buffer. The actor calls that very
method, on a shallow copy of the algorithm with a policy, noise and counters of its own; the learner's returns the record. The
actor's policy has objects of its own but the learner's weights, so it is never older than the last gradient step; where its
network is small and plain, it is computed in NumPy (small_policies.py).
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from stable_baselines3.common.noise import ActionNoise

from agents_app.algorithms.actor import Memory, batch, own_policy
from agents_app.algorithms.replay import Decision, Tape
from agents_app.algorithms.small_policies import quickened
from agents_app.algorithms.weights import share

make_feed = Tape
POLICY_KWARGS: dict[str, Any] = {}
SHARES_WEIGHTS = True


class ReplayedSampling:
    """Mix into an algorithm class, on the left: with a tape, sampling is reading the record."""

    tape: Tape | None = None

    def _sample_action(self, *args: Any, **kwargs: Any) -> tuple[np.ndarray, np.ndarray]:
        if self.tape is None:
            return super()._sample_action(*args, **kwargs)  # type: ignore[misc]
        assert self.tape.current is not None
        return self.tape.current.replay


def learner_classes(algorithm: type[Any], policy: type[Any]) -> tuple[type[Any], type[Any]]:
    """The classes that learn from a tape."""
    return type(algorithm.__name__, (ReplayedSampling, algorithm), {}), policy


def attach(algorithm: Any, tape: Tape) -> None:
    """Let the algorithm learn from the tape; make its actor before."""
    algorithm.tape = tape


def has_long_updates(algorithm: Any) -> bool:
    """No."""
    return False


def allowed_lead(algorithm: Any) -> int:
    """How many decisions the actor may be ahead of the learner (docs/adr/0003)."""
    return max(16, 2 * algorithm.train_freq.frequency)


class OffPolicyActor:
    """A shallow copy of the algorithm, with a policy and an exploration of its own. The memory of an episode is its noise."""

    def __init__(self, algorithm: Any) -> None:
        self.algorithm = copy.copy(algorithm)
        policy = own_policy(algorithm)
        share(policy, algorithm.policy)
        self.algorithm.policy = quickened(policy)
        self.algorithm._create_aliases()
        self.noise = algorithm.action_noise
        self.algorithm.action_space = copy.deepcopy(algorithm.action_space)  # it has a random generator of its own
        self.steps = 0

    def decide(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Decision, Memory]:
        """Sample an action; the record is the action and what goes into the replay buffer."""
        own = self.algorithm
        self._explore_anew()
        own._last_obs = batch(obs)
        own.action_noise = self._noise_of(memory)
        action, buffered = own._sample_action(own.learning_starts, own.action_noise, 1)
        own.num_timesteps += 1
        self.steps += 1
        self._anneal()
        return Decision(obs, action[0], (action, buffered)), own.action_noise

    def exploit(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Any, Memory]:
        """The greedy action."""
        return self.algorithm.policy.predict(batch(obs), deterministic=True)[0][0], memory

    def update(self, weights: np.ndarray) -> None:
        """Nothing to do: the weights are shared."""

    def _noise_of(self, memory: Memory) -> ActionNoise | None:
        """Each session's own, for noise may be correlated in time; it begins anew with each episode."""
        if memory is not None or self.noise is None:
            return memory
        noise = copy.deepcopy(self.noise)
        noise.reset()
        return noise

    def _explore_anew(self) -> None:
        """Draw the exploration matrix of gSDE when `collect_rollouts` would: first, and every sde_sample_freq steps."""
        own = self.algorithm
        if own.use_sde:
            collected = self.steps % own.train_freq.frequency
            if collected == 0 or (own.sde_sample_freq > 0 and collected % own.sde_sample_freq == 0):
                own.actor.reset_noise()

    def _anneal(self) -> None:
        own = self.algorithm
        if hasattr(own, "exploration_schedule"):
            own._update_current_progress_remaining(own.num_timesteps, own.horizon)
            own.exploration_rate = own.exploration_schedule(own._current_progress_remaining)


make_actor = OffPolicyActor
