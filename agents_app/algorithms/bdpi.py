"""Bootstrapped Dual Policy Iteration (Steckelmacher et al. 2019; thesis 2.4), with advice (thesis 3.1.3, 6.3.1).

An actor off the policy, for discrete actions: it moves towards the greedy policies of several critics, each of which learns
from batches of its own.

Source of the defaults: thesis 5.3.2 has 8 critics trained at every time-step "for 4 training epochs", here read as N_t = 4, 10
gradient steps, one hidden layer of 256 tanh, Adam 1e-4. It does not say alpha, delta, the batch and the size of the memory:
these are ours. Also known to work, on Lunar Lander and Table: 16 critics, net_arch [32], batches of 256, N_t = 4, 20 gradient
steps, Adam 1e-4, 16 loops, here read as one training of each critic. They cost about 0.1 s of CPU a step of the environment
(benchmarks/bdpi.py), and three times that on 812 states looked up, most of it Adam on the table: raise train_freq where that is
too much.

What differs: the critics are one batched ensemble (ensemble.py), with the same result as one by one. The actor's corrected
targets are clipped to [0, 1]: its output is a probability, and advice of nearly 0 would otherwise outweigh the whole batch.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback, Schedule

from agents_app.algorithms.advice import is_neutral
from agents_app.algorithms.bdpi_policies import BDPIPolicy
from agents_app.algorithms.ensemble import Ensemble, probabilities
from agents_app.algorithms.masks import mask_advice, mask_logits
from agents_app.algorithms.mixing import GEOMETRIC, INTERSECTION, SHAPING
from agents_app.algorithms.riders import ADVICE, MASK

EPSILON = 1e-6  # keeps eq. 3.4 and eq. 6.1 from dividing by zero


@dataclass
class Batches:
    """A batch for each of N critics, drawn independently."""

    inputs: th.Tensor  # (N, B, I), or whole numbers, (N, B)
    actions: th.Tensor  # (N, B, 1) of int64
    rewards: th.Tensor  # (N, B, 1)
    next_inputs: th.Tensor  # as inputs
    discounts: th.Tensor  # (N, B, 1): gamma, or 0 where the episode ended
    advice: th.Tensor | None = None  # (N, B, A)
    allowed: th.Tensor | None = None  # (N, B, A): which actions are, at the states; None: all
    next_allowed: th.Tensor | None = None  # and at those after them

    def of(self, critic: int) -> Batches:
        """The batch of one critic."""
        parts: dict[str, Any] = {
            name: None if it is None else it[critic : critic + 1] for name, it in vars(self).items()
        }
        return Batches(**parts)


class BDPI(OffPolicyAlgorithm):
    """Bootstrapped Dual Policy Iteration: several critics teach one actor. Sample-efficient, and costly per step.

    :param policy: MlpPolicy, or MultiInputPolicy for dictionaries; both flatten what they get
    :param env: the environment; its actions are discrete
    :param learning_rate: of Adam, for the actor and the critics
    :param buffer_size: how many steps are remembered
    :param learning_starts: how many steps are collected before learning starts
    :param batch_size: steps in the batch of each critic
    :param gamma: the discount factor
    :param train_freq: learn every so many steps
    :param gradient_steps: training epochs each time; in each, every critic learns once, and then teaches the actor
    :param n_critics: N_c, the number of critics; each has two Q-functions
    :param q_loops: N_t, iterations of each critic in an epoch; its two Q-functions take turns
    :param fit_steps: gradient steps of the regression to each target, of the critics and of the actor
    :param alpha: how far a critic's target moves towards the new estimate of a value, eq. 2.3
    :param delta: how far the actor may move for one critic, as a KL divergence: lambda = 1 - exp(-delta), eq. 2.4
    """

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"MlpPolicy": BDPIPolicy, "MultiInputPolicy": BDPIPolicy}
    policy: BDPIPolicy
    actor: Ensemble

    def __init__(
        self,
        policy: str | type[BDPIPolicy],
        env: GymEnv | str,
        learning_rate: float | Schedule = 1e-4,
        buffer_size: int = 20_000,
        learning_starts: int = 256,
        batch_size: int = 256,
        gamma: float = 0.99,
        train_freq: int | tuple[int, str] = 1,
        gradient_steps: int = 1,
        n_critics: int = 8,
        q_loops: int = 4,
        fit_steps: int = 10,
        alpha: float = 0.2,
        delta: float = 0.05,
        replay_buffer_class: Any = None,
        replay_buffer_kwargs: dict[str, Any] | None = None,
        policy_kwargs: dict[str, Any] | None = None,
        stats_window_size: int = 100,
        tensorboard_log: str | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: th.device | str = "cpu",  # the networks are computed in NumPy
        _init_setup_model: bool = True,
    ) -> None:
        super().__init__(
            policy,
            env,
            learning_rate,
            buffer_size=buffer_size,
            learning_starts=learning_starts,
            batch_size=batch_size,
            gamma=gamma,
            train_freq=train_freq,
            gradient_steps=gradient_steps,
            replay_buffer_class=replay_buffer_class,
            replay_buffer_kwargs=replay_buffer_kwargs,
            policy_kwargs=policy_kwargs,
            stats_window_size=stats_window_size,
            tensorboard_log=tensorboard_log,
            verbose=verbose,
            seed=seed,
            device=device,
            support_multi_env=True,
            sde_support=False,
            supported_action_spaces=(spaces.Discrete,),
        )
        self.n_critics, self.q_loops, self.fit_steps = n_critics, q_loops, fit_steps
        self.alpha, self.delta = alpha, delta
        self.policy_kwargs["n_critics"] = n_critics
        if _init_setup_model:
            self._setup_model()

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 4,
        tb_log_name: str = "BDPI",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> BDPI:
        """As Stable-Baselines3's."""
        return super().learn(total_timesteps, callback, log_interval, tb_log_name, reset_num_timesteps, progress_bar)

    def train(self, gradient_steps: int, batch_size: int = 256) -> None:
        """Training epochs: the critics learn from a batch each, then the actor from each critic in turn."""
        self._update_learning_rate(self.policy.optimizers())
        with _denormals_flushed():
            for _ in range(gradient_steps):
                self.train_epoch(self.draw_batches(batch_size))
                self._n_updates += 1
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")

    @th.no_grad()
    def train_epoch(self, batches: Batches) -> None:
        """One training epoch."""
        self._train_critics(batches)
        self._train_actor(batches)

    def draw_batches(self, batch_size: int) -> Batches:
        """Independent batches, one for each critic."""
        assert self.replay_buffer is not None
        drawn = self.replay_buffer.sample(self.n_critics * batch_size, env=self._vec_normalize_env)
        observations: Any = drawn.observations
        return Batches(
            self._split(self.policy.vector(observations)),
            self._split(drawn.actions.long()),
            self._split(drawn.rewards),
            self._split(self.policy.vector(drawn.next_observations)),
            self._split(self.gamma * (1.0 - drawn.dones)),
            self._rider(observations, ADVICE),
            self._rider(observations, MASK),
            self._rider(drawn.next_observations, MASK),
        )

    def _train_critics(self, batches: Batches) -> None:
        """N_t iterations; the two Q-functions of each critic swap in between."""
        for iteration in range(self.q_loops):
            learning, other = self._critics(iteration)
            learning.fit(batches.inputs, critic_targets(learning, other, batches, self.alpha), self.fit_steps)

    def _train_actor(self, batches: Batches) -> None:
        """Eq. 2.4 for each critic in turn: pi <- (1 - lambda) pi + lambda Gamma(Q), on the critic's batch."""
        learned_last, _ = self._critics(self.q_loops - 1)
        greedy = mask_logits(learned_last(batches.inputs), batches.allowed).argmax(-1)  # (N, B)
        rate = 1.0 - math.exp(-self.delta)
        for critic in range(self.n_critics):
            batch = batches.of(critic)
            logits = self.actor(batch.inputs)
            own = probabilities(logits)  # (1, B, A)
            wanted = th.nn.functional.one_hot(greedy[critic : critic + 1], own.shape[-1]).to(own.dtype)
            wanted = self._correct(wanted, logits, batch)
            self.actor.fit(batch.inputs, ((1.0 - rate) * own + rate * wanted).clamp(0.0, 1.0), self.fit_steps)

    def _correct(self, greedy: th.Tensor, logits: th.Tensor, batch: Batches) -> th.Tensor:
        """What the actor moves towards, knowing that it acts with advice, among the allowed actions."""
        mixing = self.policy.mixing
        if batch.advice is None or not mixing.correction or mixing.method == SHAPING:  # the advice changed no action
            return greedy
        advice = mask_advice(batch.advice, batch.allowed)
        allowed = probabilities(mask_logits(logits, batch.allowed))
        if mixing.method == INTERSECTION:
            return correct_intersection(greedy, allowed, advice)
        if mixing.method == GEOMETRIC:
            return correct_intersection(greedy, allowed, as_intersected(advice, mixing.weight))
        return correct_reuse(greedy, advice, mixing.share)

    def _critics(self, iteration: int) -> tuple[Ensemble, Ensemble]:
        """The Q-functions that learn in this iteration of an epoch, and the other ones. They take turns across epochs, too."""
        first, second = self.policy.critics
        before = self._n_updates * self.q_loops
        return (first, second) if (before + iteration) % 2 == 0 else (second, first)  # type: ignore[return-value]

    def _rider(self, observations: Any, key: str) -> th.Tensor | None:
        """What rides in the observations, (N, B, A), if it does."""
        return self._split(observations[key]) if isinstance(observations, dict) and key in observations else None

    def _split(self, tensor: th.Tensor) -> th.Tensor:
        return tensor.view(self.n_critics, -1, *tensor.shape[1:])

    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw from the actor, mixed with the advice if there is any; from the first step on."""
        action = self.policy.sample(self._last_obs)
        return action, action

    def _setup_model(self) -> None:
        super()._setup_model()
        self._create_aliases()

    def _create_aliases(self) -> None:
        self.actor = self.policy.actor

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "actor"]

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        critics = [f"policy.critics.{index}.optimizer" for index in range(2)]
        return ["policy", "policy.actor.optimizer", *critics], []


def critic_targets(learning: Ensemble, other: Ensemble, batches: Batches, alpha: float) -> th.Tensor:
    """Eq. 2.3, (N, B, A): the values of the actions taken move by alpha; those of the others stay.

    Q(s, a) + alpha (r + gamma min_l Q_l(s', argmax_a' QA(s', a')) - Q(s, a)), where QA is `learning`.
    """
    next_learning, next_other = learning(batches.next_inputs), other(batches.next_inputs)
    best = mask_logits(next_learning, batches.next_allowed).argmax(-1, keepdim=True)
    next_values = th.minimum(next_learning, next_other).gather(-1, best)
    values = learning(batches.inputs)
    taken = values.gather(-1, batches.actions)
    moved = taken + alpha * (batches.rewards + batches.discounts * next_values - taken)
    return values.scatter(-1, batches.actions, moved)


def correct_intersection(greedy: th.Tensor, own: th.Tensor, advice: th.Tensor) -> th.Tensor:
    """Eq. 3.4, (..., A): Gamma(Q) (pi_L . pi_A) / pi_A. The more the advice opposes the greedy action, the stronger the pull.

    With w = pi_A / pi_A(greedy), (pi_L . pi_A) / pi_A(greedy) is 1 + pi_L . (w - 1): exactly 1 where the advice is neutral.
    """
    chosen = (greedy * advice).sum(-1, keepdim=True).clamp_min(EPSILON)
    pull = 1.0 + (own * (advice / chosen - 1.0)).sum(-1, keepdim=True)
    return greedy * pull.clamp_min(0.0)


def as_intersected(advice: th.Tensor, weight: float) -> th.Tensor:
    """The advice with which Policy Intersection prefers the same actions as the geometric mean, (..., A): pi_A^(w N).

    pi_L^(1 / (1 + w N)) pi_A^(w N / (1 + w N)) is a power of pi_L pi_A^(w N). N is the sum of the advice. Brought to a largest
    number of 1, for a power of even advice on many actions would be nearly 0; eq. 3.4 has ratios alone.
    """
    advisors = advice.sum(-1, keepdim=True)
    return (advice / advice.amax(-1, keepdim=True)) ** (weight * advisors)


def correct_reuse(greedy: th.Tensor, advice: th.Tensor, psi: float) -> th.Tensor:
    """Eq. 6.1, (..., A): (Gamma(Q) - psi pi_A) / (1 - psi). Without advice, Gamma(Q)."""
    advised = advice / advice.sum(-1, keepdim=True)
    corrected = (greedy - psi * advised) / max(1.0 - psi, EPSILON)
    return th.where(is_neutral(advice), greedy, corrected)


@contextmanager
def _denormals_flushed() -> Iterator[None]:
    """Adam's means of states long unseen end in denormal numbers, where a CPU is ten times slower: here they are zero."""
    th.set_flush_denormal(True)
    try:
        yield
    finally:
        th.set_flush_denormal(False)  # it holds for all that this thread computes
