"""Algorithms on the policy (PPO, A2C, TRPO, and MaskablePPO): record what the policy returned, return it again.

SB3's `collect_rollouts` calls the policy once a step, for the action, its value and its log-probability, and nowhere else;
`train` calls `evaluate_actions`. So a policy whose `forward` returns the record is all that replaying takes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch as th
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import obs_as_tensor

from agents_app.algorithms.actor import Memory, batch, own_policy, to_env
from agents_app.algorithms.minibatches import slice_minibatches
from agents_app.algorithms.replay import Decision, Tape
from agents_app.algorithms.small_net import Unsupported
from agents_app.algorithms.weights import assign

make_feed = Tape
LONG_ROLLOUT = 128  # steps
POLICY_KWARGS = {
    "optimizer_kwargs": {"eps": 1e-5, "fused": True}
}  # SB3's Adam in one call: an update takes 0.8 of the time
SHARES_WEIGHTS = False  # the actor changes its policy between rollouts only, as the learner publishes it


class ReplayedPolicy:
    """Mix into a policy class, on the left: with a tape, acting is reading the record."""

    tape: Tape | None = None

    def forward(self, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """What the actor's copy returned for the decision that is replayed now."""
        if self.tape is None:
            return super().forward(*args, **kwargs)  # type: ignore[misc]
        current = self.tape.current
        assert current is not None
        return current.replay


def learner_classes(algorithm: type[Any], policy: type[Any]) -> tuple[type[Any], type[Any]]:
    """The classes that learn from a tape."""
    return algorithm, type(policy.__name__, (ReplayedPolicy, policy), {})


def attach(algorithm: Any, tape: Tape) -> None:
    """Let the algorithm learn from the tape; make its actor before."""
    algorithm.policy.tape = tape
    slice_minibatches(algorithm.rollout_buffer)
    tape.batch = max(1, min(64, allowed_lead(algorithm) // 8))


def allowed_lead(algorithm: Any) -> int:
    """How many decisions the actor may be ahead of the learner: half a rollout (docs/adr/0003), or the algorithm's limit."""
    lead = max(algorithm.n_steps // 2, min(algorithm.n_steps, 8))
    return min(lead, getattr(algorithm, "max_lead", lead))


def has_long_updates(algorithm: Any) -> bool:
    """Whether an update takes so long that learners should take turns: PPO's, not that of A2C after 5 steps."""
    return algorithm.n_steps >= LONG_ROLLOUT


class OnPolicyActor:
    """Calls its copy of the policy as `collect_rollouts` would."""

    def __init__(self, algorithm: BaseAlgorithm) -> None:
        self.policy = own_policy(algorithm)
        self.action_space = algorithm.action_space
        self.noise_every = algorithm.sde_sample_freq if algorithm.use_sde else 0
        self.steps = 0

    def decide(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Decision, Memory]:
        """Draw an action; the record is what `forward` returned."""
        self._explore_anew()
        with th.no_grad():
            replay = self.policy(obs_as_tensor(batch(obs), self.policy.device), **self._masked(mask))
        action = to_env(self.action_space, self.policy, replay[0].numpy()[0])
        return Decision(obs, action, replay, mask), None

    def exploit(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Any, Memory]:
        """The most probable action of the learner's own policy."""
        return self.policy.predict(obs, deterministic=True, **self._masked(mask))[0], None

    def update(self, weights: np.ndarray) -> None:
        """Act with these weights from now on."""
        assign(self.policy, weights)
        if self.noise_every:
            self.policy.reset_noise()  # type: ignore[operator]

    def _explore_anew(self) -> None:
        """Draw the exploration matrix of gSDE every sde_sample_freq steps."""
        if self.noise_every > 0 and self.steps % self.noise_every == 0:
            self.policy.reset_noise()  # type: ignore[operator]
        self.steps += 1

    def _masked(self, mask: np.ndarray | None) -> dict[str, Any]:
        """What the policy is told beside the observation, in which the mask rides."""
        return {}


def make_actor(algorithm: BaseAlgorithm) -> OnPolicyActor:
    """The actor in NumPy where the network is small and plain, else the general one."""
    from agents_app.algorithms.small_actor import SmallActor

    try:
        return SmallActor(algorithm)
    except Unsupported:
        return OnPolicyActor(algorithm)
