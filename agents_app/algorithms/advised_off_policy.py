"""Advice and masks for the algorithms off the policy (DQN, QR-DQN, SAC, TQC, TD3, DDPG): mixins over SB3's own classes, no fork.

What they learn from may come from any policy, so that there is nothing to correct (reference: actor_advisor.md section 2), and
the advice ends where the action is drawn: the networks, the replay buffer and the updates see the client's observation alone.
A mask is in the replay buffer, and the networks of values keep to it, so that targets are those of allowed actions.
Where nobody says anything and nothing is forbidden, the action is drawn by SB3 itself, with the same random numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces
from sb3_contrib.qrdqn.policies import QuantileNetwork
from stable_baselines3.common.distributions import CategoricalDistribution, DiagGaussianDistribution
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.utils import obs_as_tensor
from stable_baselines3.dqn.policies import QNetwork

from agents_app.algorithms.advice import TINY, is_neutral, says_nothing, without_advice
from agents_app.algorithms.explorers import (
    EDGE,
    Noisy,
    Squashed,
    Uniform,
    draw_mixed,
    from_unit_bounds,
    noise_deviation,
    to_unit_bounds,
)
from agents_app.algorithms.masks import MaskedValues, SeesMask, allowed_of, mix_allowed
from agents_app.algorithms.mixing import BY_SAMPLING, INTERSECTION, SHAPING, UNION, Mixing
from agents_app.algorithms.riders import ADVICE, plain_space, space_without_riders


class AdvisedSampling:
    """Mix into an algorithm class, on the left: it acts with its own policy, mixed with `advice`; nothing else sees that."""

    observation_space: spaces.Space
    action_space: Any
    policy: Any
    action_noise: ActionNoise | None
    _last_obs: Any
    device: Any

    def __init__(self, *args: Any, policy_kwargs: dict[str, Any] | None = None, **kwargs: Any) -> None:
        """`mixing` among the `policy_kwargs`: how the advice changes the actions. Raises ValueError when it cannot."""
        kept = dict(policy_kwargs or {})
        self.mixing: Mixing = kept.pop("mixing", Mixing())
        super().__init__(*args, policy_kwargs=kept, **kwargs)  # type: ignore[call-arg]

    def predict(self, observation: Any, *args: Any, **kwargs: Any) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """As SB3's: the learner's own policy, without advice."""
        return super().predict(without_advice(observation), *args, **kwargs)  # type: ignore[misc]

    def _setup_model(self) -> None:
        self.observation_space = space_without_riders(self.observation_space, ADVICE)
        super()._setup_model()  # type: ignore[misc]

    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        """The action, and what goes into the replay buffer: SB3's own, or where there is advice, of the mixed policy."""
        observed = self._last_obs
        advice = observed.get(ADVICE) if self.mixing.method != SHAPING else None
        self._last_obs = without_advice(observed)
        try:
            if not self._says(advice):
                return super()._sample_action(learning_starts, action_noise, n_envs)  # type: ignore[misc]
            with th.no_grad():
                return self._sample_mixed(advice, self._warms_up(learning_starts), action_noise)
        finally:
            self._last_obs = observed

    def _store_transition(self, replay_buffer: Any, *args: Any) -> None:
        super()._store_transition(_WithoutAdvice(replay_buffer), *args)  # type: ignore[misc]

    def _warms_up(self, learning_starts: int) -> bool:
        """Whether SB3 acts at random still."""
        own: Any = self
        return own.num_timesteps < learning_starts and not (own.use_sde and own.use_sde_at_warmup)

    def _says(self, advice: np.ndarray | None) -> bool:
        """Whether any of this advice, (B, ...), is not neutral, or anything is forbidden."""
        raise NotImplementedError

    def _sample_mixed(
        self, advice: Any, warms_up: bool, action_noise: ActionNoise | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """The action and what goes into the replay buffer, of the mixed policy."""
        raise NotImplementedError


class _WithoutAdvice:
    """Hands transitions on to a replay buffer."""

    def __init__(self, replay_buffer: Any) -> None:
        self._buffer = replay_buffer

    def add(self, obs: Any, next_obs: Any, *rest: Any) -> None:
        """As the buffer's own."""
        self._buffer.add(without_advice(obs), without_advice(next_obs), *rest)


# --- discrete actions: DQN, QR-DQN ---


class MaskedQNetwork(MaskedValues, QNetwork):
    """DQN's own."""


class MaskedQuantileNetwork(MaskedValues, QuantileNetwork):
    """QR-DQN's own."""


class EpsilonGreedy(SeesMask):
    """Mix into the policy of DQN or QR-DQN: the probabilities with which it acts.

    They are those of epsilon-greedy exploration, for the learner and for the peers that it advises alike. A peer that still
    explores says little, one that has learned says much and leaves room to push back; a greedy vector would be an order from the
    first step on, and a softmax of the values would need a temperature that suits the unknown scale of the rewards.
    """

    exploration: th.Tensor

    def __init__(self, observation_space: spaces.Space, *args: Any, **kwargs: Any) -> None:
        super().__init__(plain_space(observation_space), *args, **kwargs)  # type: ignore[call-arg]
        # Published to the peers with the weights (weights.py), but none of those that stock SB3 loads.
        self.register_buffer("exploration", th.ones(()), persistent=False)  # type: ignore[attr-defined]

    @property
    def only_for_learning(self) -> tuple[str, ...]:
        """What a peer need not know (actor.py)."""
        return tuple(name for name in ("q_net_target", "quantile_net_target") if hasattr(self, name))

    def chances(self, obs: Any, exploration: float) -> np.ndarray:
        """Of each action, (B, A), at that epsilon. `obs`: tensors or arrays."""
        own: Any = self
        greedy = own._predict(as_tensors(obs, own.device), deterministic=True).cpu().numpy()
        return epsilon_greedy(greedy, allowed_of(obs), int(own.action_space.n), exploration)

    def make_q_net(self) -> MaskedQNetwork:
        """As DQN does."""
        return self._network(MaskedQNetwork)

    def make_quantile_net(self) -> MaskedQuantileNetwork:
        """As QR-DQN does."""
        return self._network(MaskedQuantileNetwork)

    def _network(self, network: Any) -> Any:
        own: Any = self
        return network(**own._update_features_extractor(own.net_args, features_extractor=None)).to(own.device)

    def get_distribution(self, obs: Any) -> CategoricalDistribution:
        """What it does without advice, at the rate of exploration that it has now."""
        chances = th.from_numpy(self.chances(without_advice(obs), float(self.exploration)))
        return CategoricalDistribution(chances.shape[-1]).proba_distribution(chances.log())


def epsilon_greedy(greedy: np.ndarray, allowed: Any, actions: int, exploration: float) -> np.ndarray:
    """Probabilities, (B, A): (1 - epsilon) for the greedy action, (B,), and epsilon in equal parts for all that are allowed."""
    anywhere = np.ones((len(greedy), actions)) if allowed is None else np.atleast_2d(allowed)
    chances = (exploration / anywhere.sum(-1, keepdims=True) * anywhere).astype(np.float32)
    chances[np.arange(len(greedy)), greedy] += 1.0 - exploration
    return chances


class AdvisedValues(AdvisedSampling):
    """Mix into DQN or QR-DQN, on the left."""

    @property
    def exploration_rate(self) -> float:
        """Epsilon; the policy is told."""
        return self.__dict__["exploration_rate"]  # where SB3 saves it from

    @exploration_rate.setter
    def exploration_rate(self, rate: float) -> None:
        self.__dict__["exploration_rate"] = rate
        if hasattr(self, "policy"):
            self.policy.exploration.fill_(rate)

    def _says(self, advice: np.ndarray | None) -> bool:
        allowed = allowed_of(self._last_obs)
        forbids = allowed is not None and not allowed.all()
        return forbids or (advice is not None and not is_neutral(advice).all())

    def _sample_mixed(
        self, advice: np.ndarray | None, warms_up: bool, action_noise: ActionNoise | None
    ) -> tuple[np.ndarray, np.ndarray]:
        own = self.policy.chances(self._last_obs, 1.0 if warms_up else self.exploration_rate)
        mixed = mix_allowed(np.log(np.maximum(own, TINY)), advice, self.mixing, allowed_of(self._last_obs))
        action = (mixed + np.random.gumbel(size=mixed.shape)).argmax(-1)  # drawn by exp(mixed)
        return action, action


# --- continuous actions: SAC, TQC, TD3, DDPG; the arithmetic is in explorers.py ---


class SquashedPolicy:
    """Mix into the policy of SAC or TQC."""

    only_for_learning = ("critic", "critic_target")
    actor: Any
    action_space: spaces.Box

    def explorer(self, obs: Any) -> Squashed:
        """How it explores at a batch of observations."""
        mean, log_std, others = self.actor.get_action_dist_params(as_tensors(obs, self.actor.device))
        distribution = self.actor.action_dist

        def draw(around: np.ndarray) -> np.ndarray:
            """With the noise of the distribution itself, which may be gSDE's."""
            return distribution.actions_from_params(th.from_numpy(around), log_std, **others).cpu().numpy()

        deviation = distribution.proba_distribution(mean, log_std, **others).distribution.stddev
        return Squashed(mean.detach().cpu().numpy(), deviation.detach().cpu().numpy(), draw)

    def get_distribution(self, obs: Any) -> DiagGaussianDistribution:
        """What it does without advice, as means and deviations of actions: those around the greedy action."""
        return _in_action_units(self.action_space, self.explorer(without_advice(obs)))


class DeterministicPolicy:
    """Mix into the policy of TD3 or DDPG."""

    only_for_learning = ("critic", "critic_target", "actor_target")
    actor: Any
    action_space: spaces.Box
    deviation: np.ndarray  # of the noise, (A,) in SB3's units; 0: there is none

    def explorer(self, obs: Any) -> Noisy:
        """How it explores at a batch of observations."""
        return Noisy(self.actor(as_tensors(obs, self.actor.device)).detach().cpu().numpy(), self.deviation)

    def get_distribution(self, obs: Any) -> DiagGaussianDistribution:
        """What it does without advice: the deviation is that of its noise."""
        return _in_action_units(self.action_space, self.explorer(without_advice(obs)))


class AdvisedActions(AdvisedSampling):
    """Mix into SAC, TQC, TD3 or DDPG, on the left."""

    def _setup_model(self) -> None:
        super()._setup_model()
        if self.mixing.method == UNION:
            raise ValueError("Policy Union is for discrete actions: with vectors of numbers, use Policy Reuse.")
        if isinstance(self.policy, DeterministicPolicy):
            self.policy.deviation = noise_deviation(self.action_noise, self.action_space)
            by_sampling = (self.mixing.method, self.mixing.continuous) == (INTERSECTION, BY_SAMPLING)
            if by_sampling and not (self.policy.deviation > 0).all():
                raise ValueError(NO_DENSITY)

    def _says(self, advice: np.ndarray | None) -> bool:
        return advice is not None and not says_nothing(advice).all()

    def _sample_mixed(
        self, advice: np.ndarray, warms_up: bool, action_noise: ActionNoise | None
    ) -> tuple[np.ndarray, np.ndarray]:
        heard = to_unit_bounds(self.action_space, advice)
        explorer = Uniform() if warms_up else self.policy.explorer(self._last_obs)
        noise = 0.0 if action_noise is None else action_noise().reshape(-1, advice.shape[-1] // 2)
        scaled = draw_mixed(explorer, heard, noise, self.mixing).reshape(-1, *self.action_space.shape)
        return self.policy.unscale_action(scaled), scaled


NO_DENSITY = (
    "Advice by sampling weighs the advisor's actions by how probable they are for the learner, and this algorithm chooses one "
    "action only: set action_noise (for instance 'normal 0.1'), or mix by the mean."
)


def _in_action_units(action_space: spaces.Box, explorer: Squashed | Noisy) -> DiagGaussianDistribution:
    """Means and deviations, (B, A), of actions between the bounds of the space."""
    mean, deviation = map(th.from_numpy, from_unit_bounds(action_space, explorer.greedy(), explorer.straying()))
    return DiagGaussianDistribution(mean.shape[-1]).proba_distribution(mean, deviation.clamp_min(EDGE).log())


def as_tensors(obs: Any, device: Any) -> Any:
    """Observations, arrays or tensors, as tensors."""
    some = next(iter(obs.values())) if isinstance(obs, dict) else obs
    return obs if isinstance(some, th.Tensor) else obs_as_tensor(obs, device)


MIXINS: dict[str, tuple[type[Any], type[Any]]] = {
    "DQN": (AdvisedValues, EpsilonGreedy),
    "QRDQN": (AdvisedValues, EpsilonGreedy),
    "SAC": (AdvisedActions, SquashedPolicy),
    "TQC": (AdvisedActions, SquashedPolicy),
    "TD3": (AdvisedActions, DeterministicPolicy),
    "DDPG": (AdvisedActions, DeterministicPolicy),
}


def advised_classes(algorithm: type[Any], policy: type[Any]) -> tuple[type[Any], type[Any]]:
    """The classes that take advice, of stock ones."""
    sampling, exploring = MIXINS[algorithm.__name__]
    return (
        type(algorithm.__name__, (sampling, algorithm), {}),
        type(f"Advised{policy.__name__}", (exploring, policy), {}),
    )
