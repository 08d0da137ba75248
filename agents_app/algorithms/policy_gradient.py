"""Policy Gradient, or REINFORCE (Williams 1992; thesis 2.3, eq. 2.1), with advice (thesis 3.1.2, eq. 3.1).

Plays whole episodes, then makes one step up the gradient of sum_t R_t log pi(a_t|s_t), with R_t the discounted return from t
on; then forgets them. Advice and the learning correction are in the policy (advised.py): its log-probability is that of the
mixed policy, and the same loss is eq. 3.1.

The thesis is silent about its settings. With baseline=False the update is its eq. 2.1; the default compares returns with a
learned expectation, which on Cart Pole gives 241 to 305 in steps 6,000 to 8,000 where eq. 2.1 gives 143 to 155 (two seeds each).
Without a baseline, the value network says 0 and stays so: what comes after a truncated episode counts as nothing.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.buffers import DictRolloutBuffer, RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import (
    ActorCriticCnnPolicy,
    ActorCriticPolicy,
    BasePolicy,
    MultiInputActorCriticPolicy,
)
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback, Schedule
from stable_baselines3.common.utils import obs_as_tensor
from stable_baselines3.common.vec_env import VecEnv


class EpisodeBuffer(RolloutBuffer):
    """A rollout that may end before the buffer is full."""

    def __init__(self, buffer_size: int, *args: Any, **kwargs: Any) -> None:
        self.capacity = buffer_size
        super().__init__(buffer_size, *args, **kwargs)

    def reset(self) -> None:
        """Empty, of full length."""
        self.buffer_size = self.capacity
        super().reset()

    def trim(self) -> None:
        """Forget the part that was not filled."""
        for name, array in vars(self).items():
            if isinstance(array, np.ndarray):
                setattr(self, name, array[: self.pos])
        self.buffer_size, self.full = self.pos, True


class DictEpisodeBuffer(EpisodeBuffer, DictRolloutBuffer):
    """The same for observations that are dictionaries."""

    def trim(self) -> None:
        """Forget the part that was not filled."""
        super().trim()
        self.observations = {key: array[: self.pos] for key, array in self.observations.items()}


class PolicyGradient(OnPolicyAlgorithm):
    """Policy Gradient (REINFORCE): plays whole episodes, then makes what led to high returns more probable.

    :param policy: MlpPolicy, CnnPolicy or MultiInputPolicy
    :param env: the environment, a single one
    :param learning_rate: of Adam
    :param n_episodes: how many episodes are played before each update
    :param n_steps: an update comes after so many steps at the latest; an episode that is longer is cut there
    :param gamma: the discount factor
    :param baseline: whether to learn the expected return of each state and to compare returns with it
    :param baseline_steps: gradient steps of the baseline for each update of the policy
    :param normalize_advantage: whether to bring the returns of an update (less the baseline) to mean 0 and deviation 1
    :param ent_coef: reward for trying different actions
    :param max_grad_norm: the largest step of the gradient that is taken; None: no limit
    """

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {
        "MlpPolicy": ActorCriticPolicy,
        "CnnPolicy": ActorCriticCnnPolicy,
        "MultiInputPolicy": MultiInputActorCriticPolicy,
    }
    max_lead: ClassVar[int] = (
        8  # its updates come with the ends of episodes; what was chosen before one is foreign after it
    )
    rollout_buffer: EpisodeBuffer
    policy: ActorCriticPolicy

    def __init__(
        self,
        policy: str | type[ActorCriticPolicy],
        env: GymEnv | str,
        learning_rate: float | Schedule = 1e-3,
        n_episodes: int = 1,
        n_steps: int = 10_000,
        gamma: float = 0.99,
        baseline: bool = True,
        baseline_steps: int = 10,
        normalize_advantage: bool = False,
        ent_coef: float = 0.0,
        max_grad_norm: float | None = None,
        policy_kwargs: dict[str, Any] | None = None,
        stats_window_size: int = 100,
        tensorboard_log: str | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: th.device | str = "auto",
        _init_setup_model: bool = True,
    ) -> None:
        super().__init__(
            policy,
            env,
            learning_rate=learning_rate,
            n_steps=n_steps,
            gamma=gamma,
            gae_lambda=1.0,  # advantages are whole returns, less the baseline
            ent_coef=ent_coef,
            vf_coef=1.0,
            max_grad_norm=np.inf if max_grad_norm is None else max_grad_norm,
            use_sde=False,
            sde_sample_freq=-1,
            policy_kwargs=policy_kwargs,
            stats_window_size=stats_window_size,
            tensorboard_log=tensorboard_log,
            verbose=verbose,
            seed=seed,
            device=device,
            supported_action_spaces=(spaces.Discrete, spaces.Box, spaces.MultiDiscrete, spaces.MultiBinary),
            _init_setup_model=False,
        )
        self.n_episodes, self.baseline, self.baseline_steps = n_episodes, baseline, baseline_steps
        self.normalize_advantage = normalize_advantage
        if _init_setup_model:
            self._setup_model()

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 100,
        tb_log_name: str = "PolicyGradient",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> PolicyGradient:
        """As Stable-Baselines3's; ends with the first update after `total_timesteps`."""
        return super().learn(total_timesteps, callback, log_interval, tb_log_name, reset_num_timesteps, progress_bar)

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Play n_episodes. The policy's `forward` is called once a step, as in Stable-Baselines3. False: a callback stopped."""
        assert isinstance(rollout_buffer, EpisodeBuffer)
        self.policy.set_training_mode(False)
        rollout_buffer.reset()
        callback.on_rollout_start()
        episodes = 0
        while episodes < self.n_episodes and rollout_buffer.pos < n_rollout_steps:
            if not self._collect_step(env, callback, rollout_buffer):
                return False
            episodes += int(self._last_episode_starts[0])  # type: ignore[index]
        rollout_buffer.trim()
        with th.no_grad():
            last_values = self.policy.predict_values(obs_as_tensor(self._last_obs, self.device))  # type: ignore[arg-type]
        rollout_buffer.compute_returns_and_advantage(last_values, self._last_episode_starts)  # type: ignore[arg-type]
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def train(self) -> None:
        """One step on the policy, with all episodes; some on the baseline."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        (data,) = self.rollout_buffer.get()
        actions = data.actions.long().flatten() if isinstance(self.action_space, spaces.Discrete) else data.actions
        _, log_prob, entropy = self.policy.evaluate_actions(data.observations, actions)
        episodes = max(1, int(self.rollout_buffer.episode_starts.sum()))
        randomness = -log_prob if entropy is None else entropy
        gain = (self._scale(data.advantages) * log_prob + self.ent_coef * randomness).sum()
        self._step(-gain / episodes)
        if self.baseline:
            self._fit_baseline(data.observations, data.returns)
        self._n_updates += 1
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/entropy", randomness.mean().item())

    def _collect_step(self, env: VecEnv, callback: BaseCallback, rollout_buffer: EpisodeBuffer) -> bool:
        """One step, into the buffer. False: the callback wants to stop."""
        with th.no_grad():
            actions, values, log_probs = self.policy(obs_as_tensor(self._last_obs, self.device))  # type: ignore[arg-type]
        taken = actions.cpu().numpy()
        new_obs, rewards, dones, infos = env.step(self._to_env(taken))
        self.num_timesteps += env.num_envs
        callback.update_locals(locals())
        if not callback.on_step():
            return False
        self._update_info_buffer(infos, dones)
        if infos[0].get("TimeLimit.truncated", False):
            rewards = rewards + self.gamma * self._value_after(infos[0]["terminal_observation"])
        rollout_buffer.add(self._last_obs, taken, rewards, self._last_episode_starts, values, log_probs)  # type: ignore[arg-type]
        self._last_obs, self._last_episode_starts = new_obs, dones  # type: ignore[assignment]
        return True

    def _to_env(self, actions: np.ndarray) -> np.ndarray:
        if not isinstance(self.action_space, spaces.Box):
            return actions
        if self.policy.squash_output:
            return self.policy.unscale_action(actions)
        return np.clip(actions, self.action_space.low, self.action_space.high)

    def _value_after(self, observation: Any) -> float:
        """What the baseline expects after a truncated episode."""
        with th.no_grad():
            return self.policy.predict_values(self.policy.obs_to_tensor(observation)[0]).item()

    def _scale(self, advantages: th.Tensor) -> th.Tensor:
        if not self.normalize_advantage or len(advantages) < 2:
            return advantages
        return (advantages - advantages.mean()) / (advantages.std() + 1e-8)

    def _fit_baseline(self, observations: Any, returns: th.Tensor) -> None:
        for _ in range(self.baseline_steps):
            values = self.policy.predict_values(observations).flatten()
            self._step(th.nn.functional.mse_loss(values, returns))

    def _step(self, loss: th.Tensor) -> None:
        """Parameters that the loss does not touch have no gradient, and stay."""
        self.policy.optimizer.zero_grad()
        loss.backward()
        th.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
        self.policy.optimizer.step()

    def _setup_model(self) -> None:
        dictionary = isinstance(self.observation_space, spaces.Dict)
        self.rollout_buffer_class = DictEpisodeBuffer if dictionary else EpisodeBuffer
        super()._setup_model()
        if self.n_envs > 1:
            raise ValueError("Policy Gradient plays whole episodes, in one environment at a time.")
        if not self.baseline:
            for parameter in self.policy.value_net.parameters():
                th.nn.init.zeros_(parameter)
