"""PPO's update (Schulman et al. 2017) of many learners at once, as Stable-Baselines3's `PPO.train` makes it for one.

The same losses, clipping, normalisation and Adam; tests/experiments/test_lockstep.py compares the weights after an update.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch as th

from agents_app.algorithms.advice import mix_logits
from agents_app.algorithms.mixing import Mixing
from experiments.lockstep.networks import Networks


@dataclass(frozen=True)
class Settings:
    """The names and the defaults of Stable-Baselines3."""

    n_steps: int = 2048
    batch_size: int = 64
    n_epochs: int = 10
    learning_rate: float = 3e-4
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    ent_coef: float = 0.0
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5


class Rollout(NamedTuple):
    """T steps of L learners."""

    observations: np.ndarray  # (T, L, O)
    actions: np.ndarray  # (T, L)
    rewards: np.ndarray  # (T, L); of truncated episodes with the value of what comes after
    starts: np.ndarray  # (T, L), whether an episode begins here
    values: np.ndarray  # (T, L)
    log_probs: np.ndarray  # (T, L), as the learning rule sees them
    advice: np.ndarray  # (T, L, A)


def advantages(rollout: Rollout, last_values: np.ndarray, last_starts: np.ndarray, settings: Settings) -> np.ndarray:
    """Generalised advantage estimation (Schulman et al. 2016), (T, L). `last_*`: of the step after, (L,)."""
    result = np.zeros_like(rollout.rewards)
    values = np.concatenate([rollout.values, last_values[None]])
    goes_on = 1.0 - np.concatenate([rollout.starts, last_starts[None]])
    sums = np.zeros_like(last_values)
    for t in reversed(range(len(result))):
        error = rollout.rewards[t] + settings.gamma * values[t + 1] * goes_on[t + 1] - values[t]
        sums = error + settings.gamma * settings.gae_lambda * goes_on[t + 1] * sums
        result[t] = sums
    return result


class PPO:
    """Trains stacked networks."""

    def __init__(self, networks: Networks, settings: Settings, mixing: Mixing | None) -> None:
        """`mixing` None: without advice."""
        self.networks, self.settings, self.mixing = networks, settings, mixing
        self._adam = th.optim.Adam(networks.parameters(), settings.learning_rate, eps=1e-5, fused=True)

    def train(
        self, rollout: Rollout, gains: np.ndarray, rng: np.random.RandomState, learning: np.ndarray | None = None
    ) -> None:
        """All epochs. `gains`: the advantages, (T, L). Each learner draws its own minibatches.

        `learning`, (L,): who learns; the others' rollouts mean nothing, and move them by no more than Adam's momentum. None: all.
        """
        observations, actions, log_probs, advice, advantage, returns = (
            th.from_numpy(np.ascontiguousarray(part.swapaxes(0, 1)))
            for part in (*_needed(rollout), gains, gains + rollout.values)
        )
        learners, steps = actions.shape
        row = th.arange(learners)[:, None]
        counts = th.ones(learners) if learning is None else th.from_numpy(learning.astype(np.float32))
        for _ in range(self.settings.n_epochs):
            order = th.from_numpy(np.stack([rng.permutation(steps) for _ in range(learners)]))
            for picked in order.split(self.settings.batch_size, dim=1):
                parts = (part[row, picked] for part in (observations, actions, log_probs, advice, advantage, returns))
                self._step(counts, *parts)

    def _step(self, counts: th.Tensor, *parts: th.Tensor) -> None:
        losses = self._losses(*parts)  # (L,)
        self._adam.zero_grad()
        (losses * counts).sum().backward()
        _clip_gradients(self.networks.parameters(), self.settings.max_grad_norm)
        self._adam.step()

    def _losses(
        self,
        observations: th.Tensor,  # (L, B, O); the others (L, B), the advice (L, B, A)
        actions: th.Tensor,
        old_log_probs: th.Tensor,
        advice: th.Tensor,
        advantage: th.Tensor,
        returns: th.Tensor,
    ) -> th.Tensor:
        settings, mixing = self.settings, self.mixing
        own = self.networks.logits(observations)
        seen = mix_logits(own, advice, mixing) if mixing is not None and mixing.correction else own
        log_probs = seen.log_softmax(-1)
        taken = log_probs.gather(-1, actions[..., None])[..., 0]
        scaled = (advantage - advantage.mean(1, keepdim=True)) / (advantage.std(1, keepdim=True) + 1e-8)
        ratio = th.exp(taken - old_log_probs)
        clipped = ratio.clamp(1 - settings.clip_range, 1 + settings.clip_range)
        gain = th.minimum(scaled * ratio, scaled * clipped).mean(1)
        entropy = -(log_probs.exp() * log_probs).sum(-1).mean(1)
        error = ((returns - self.networks.values(observations)) ** 2).mean(1)
        return -gain - settings.ent_coef * entropy + settings.vf_coef * error


def _needed(rollout: Rollout) -> tuple[np.ndarray, ...]:
    return rollout.observations, rollout.actions, rollout.log_probs, rollout.advice


def _clip_gradients(parameters: list[th.Tensor], largest: float) -> None:
    """As clip_grad_norm_, for each learner by itself."""
    gradients = [tensor.grad for tensor in parameters if tensor.grad is not None]
    squares = sum(gradient.pow(2).sum((1, 2)) for gradient in gradients)
    assert isinstance(squares, th.Tensor)
    share = (largest / (squares.sqrt() + 1e-6)).clamp(max=1.0)
    for gradient in gradients:
        gradient.mul_(share[:, None, None])
