"""Advice for the algorithms off the policy (DQN, QR-DQN, SAC, TQC, TD3, DDPG): mixins over SB3's own classes, no fork.

What they learn from may come from any policy, so that there is nothing to correct (reference: actor_advisor.md section 2), and
the advice ends where the action is drawn: the networks, the replay buffer and the updates see the client's observation alone.
Where nobody says anything, the action is drawn by SB3 itself, with the same random numbers.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.distributions import CategoricalDistribution, DiagGaussianDistribution
from stable_baselines3.common.noise import ActionNoise, OrnsteinUhlenbeckActionNoise
from stable_baselines3.common.utils import obs_as_tensor

from agents_app.algorithms.advice import (
    NOTHING,
    intersect_mean,
    is_neutral,
    mix_logits,
    plain_space,
    says_nothing,
    without_advice,
)
from agents_app.algorithms.mixing import BY_SAMPLING, INTERSECTION, LEARNER, REUSE, SHAPING, UNION, Mixing

EDGE = 1e-6  # how near to the bounds a squashed action may be asked for: at the bounds themselves atanh is infinite
NODES, WEIGHTS = (th.tensor(part, dtype=th.float32) for part in np.polynomial.hermite_e.hermegauss(9))
WEIGHTS /= WEIGHTS.sum()  # sum_k WEIGHTS_k f(NODES_k) is the expectation of f under a standard Gaussian


class AdvisedSampling:
    """Mix into an algorithm class, on the left: it acts with its own policy, mixed with `advice`; nothing else sees it."""

    observation_space: spaces.Space
    action_space: Any
    policy: Any
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
        self.observation_space = plain_space(self.observation_space)
        super()._setup_model()  # type: ignore[misc]

    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        """The action, and what goes into the replay buffer: SB3's own, or where there is advice, of the mixed policy."""
        observed = self._last_obs
        advice = th.as_tensor(observed["advice"], device=self.device)
        self._last_obs = without_advice(observed)
        try:
            if self.mixing.method == SHAPING or not self._says(advice):
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

    def _says(self, advice: th.Tensor) -> bool:
        """Whether any of this advice, (B, ...), is not neutral."""
        raise NotImplementedError

    def _sample_mixed(
        self, advice: th.Tensor, warms_up: bool, action_noise: ActionNoise | None
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


class EpsilonGreedy:
    """Mix into the policy of DQN or QR-DQN: the probabilities with which it acts.

    They are those of epsilon-greedy exploration, for the learner and for the peers that it advises alike. A peer that still
    explores says little, one that has learned says much and leaves room to push back; a greedy vector would be an order from the
    first step on, and a softmax of the values would need a temperature that suits the unknown scale of the rewards.
    """

    exploration: th.Tensor

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        # Published to the peers with the weights (weights.py), but none of those that stock SB3 loads.
        self.register_buffer("exploration", th.ones(()), persistent=False)  # type: ignore[attr-defined]

    @property
    def only_for_learning(self) -> tuple[str, ...]:
        """What a peer need not know (actor.py)."""
        return tuple(name for name in ("q_net_target", "quantile_net_target") if hasattr(self, name))

    def probabilities(self, obs: Any, exploration: Any) -> th.Tensor:
        """Of each action, (B, A): (1 - epsilon) for the greedy one, and epsilon / A for all."""
        own: Any = self
        greedy = own._predict(obs, deterministic=True)
        actions = int(own.action_space.n)
        return (1.0 - exploration) * th.nn.functional.one_hot(greedy, actions) + exploration / actions

    def get_distribution(self, obs: Any) -> CategoricalDistribution:
        """What it does without advice, at the rate of exploration that it has now."""
        chances = self.probabilities(without_advice(obs), self.exploration)
        return CategoricalDistribution(chances.shape[-1]).proba_distribution(chances.log())


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

    def _says(self, advice: th.Tensor) -> bool:
        return not is_neutral(advice).all()

    def _sample_mixed(
        self, advice: th.Tensor, warms_up: bool, action_noise: ActionNoise | None
    ) -> tuple[np.ndarray, np.ndarray]:
        observed = obs_as_tensor(self._last_obs, self.device)
        own = self.policy.probabilities(observed, 1.0 if warms_up else self.exploration_rate)
        mixed = mix_logits(own.log(), advice, self.mixing)
        action = th.multinomial(mixed.softmax(-1), 1).squeeze(-1).cpu().numpy()
        return action, action


# --- continuous actions: SAC, TQC, TD3, DDPG. All arithmetic is in SB3's units: the bounds of the actions are -1 and 1. ---


class Explorer(Protocol):
    """How a policy explores."""

    def explore(self, obs: Any, advice: th.Tensor) -> th.Tensor:
        """Actions (B, A) drawn from the analytic intersection with the advice (B, 2A), eq. 3.5, without action noise."""
        ...

    def log_density(self, obs: Any, actions: th.Tensor) -> th.Tensor:
        """Of each component of actions (N, B, A) when exploring, less a constant, (N, B, A)."""
        ...


class Uniform:
    """SB3's warm-up: any action within the bounds, whose mean is the middle."""

    def explore(self, obs: Any, advice: th.Tensor) -> th.Tensor:
        """Around half the advice."""
        middle = advice.new_zeros(advice.shape[0], advice.shape[1] // 2)
        return intersect_mean(middle, advice) + (2.0 * th.rand_like(middle) - 1.0)

    def log_density(self, obs: Any, actions: th.Tensor) -> th.Tensor:
        """The same everywhere."""
        return th.zeros_like(actions)


class Squashed:
    """Mix into the policy of SAC or TQC: a Gaussian, squashed by tanh.

    The mean that is mixed is that of the greedy action, tanh(mu). Half way to the advice, it is unsquashed again; to that the
    learner's own Gaussian noise is added (of its own deviation, or gSDE's), and the sum is squashed.
    """

    only_for_learning = ("critic", "critic_target")
    actor: Any
    action_space: spaces.Box

    def explore(self, obs: Any, advice: th.Tensor) -> th.Tensor:
        """Drawn half way to the advice, (B, A)."""
        mean, log_std, others = self.actor.get_action_dist_params(obs)
        half_way = th.atanh(intersect_mean(mean.tanh(), advice).clamp(EDGE - 1.0, 1.0 - EDGE))
        mixed = th.where(advice.chunk(2, dim=-1)[1].isinf(), mean, half_way)
        return self.actor.action_dist.actions_from_params(mixed, log_std, **others)

    def log_density(self, obs: Any, actions: th.Tensor) -> th.Tensor:
        """Of the Gaussian where the action comes from, over the slope of tanh there."""
        gaussian, inside = self._gaussian(obs), actions.clamp(EDGE - 1.0, 1.0 - EDGE)
        return -0.5 * ((inside.atanh() - gaussian.mean) / gaussian.stddev) ** 2 - (1.0 - inside**2).log()

    def get_distribution(self, obs: Any) -> DiagGaussianDistribution:
        """What it does without advice, as means and deviations of actions: around the greedy one, by quadrature."""
        gaussian = self._gaussian(without_advice(obs))
        greedy = gaussian.mean.tanh()
        drawn = (gaussian.mean[..., None] + gaussian.stddev[..., None] * NODES).tanh()
        deviation = ((drawn - greedy[..., None]) ** 2 @ WEIGHTS).sqrt()
        return _in_action_units(self.action_space, greedy, deviation)

    def _gaussian(self, obs: Any) -> Any:
        """Before it is squashed, (B, A)."""
        mean, log_std, others = self.actor.get_action_dist_params(obs)
        return self.actor.action_dist.proba_distribution(mean, log_std, **others).distribution


class Deterministic:
    """Mix into the policy of TD3 or DDPG: one action; the noise that the algorithm adds to it makes it a Gaussian."""

    only_for_learning = ("critic", "critic_target", "actor_target")
    actor: Any
    action_space: spaces.Box
    deviation: th.Tensor  # of the noise, (A,); 0: there is none

    def explore(self, obs: Any, advice: th.Tensor) -> th.Tensor:
        """Half way to the advice, (B, A); the algorithm adds the noise."""
        return intersect_mean(self.actor(obs), advice)

    def log_density(self, obs: Any, actions: th.Tensor) -> th.Tensor:
        """Of the noise."""
        return -0.5 * ((actions - self.actor(obs)) / self.deviation) ** 2

    def get_distribution(self, obs: Any) -> DiagGaussianDistribution:
        """What it does without advice: the deviation is that of its noise."""
        greedy = self.actor(without_advice(obs))
        return _in_action_units(self.action_space, greedy, self.deviation.expand_as(greedy))


class AdvisedActions(AdvisedSampling):
    """Mix into SAC, TQC, TD3 or DDPG, on the left."""

    def _setup_model(self) -> None:
        super()._setup_model()
        own: Any = self
        if self.mixing.method == UNION:
            raise ValueError("Policy Union is for discrete actions: with vectors of numbers, use Policy Reuse.")
        if isinstance(self.policy, Deterministic):
            self.policy.deviation = noise_deviation(own.action_noise, self.action_space)
            if self._samples() and not (self.policy.deviation > 0).all():
                raise ValueError(NO_DENSITY)

    def _samples(self) -> bool:
        return self.mixing.method == INTERSECTION and self.mixing.continuous == BY_SAMPLING

    def _says(self, advice: th.Tensor) -> bool:
        return not says_nothing(advice).all()

    def _sample_mixed(
        self, advice: th.Tensor, warms_up: bool, action_noise: ActionNoise | None
    ) -> tuple[np.ndarray, np.ndarray]:
        observed = obs_as_tensor(self._last_obs, self.device)
        explorer: Explorer = Uniform() if warms_up else self.policy
        noise = 0.0 if action_noise is None else th.as_tensor(action_noise()).reshape(-1, advice.shape[-1] // 2)
        scaled_advice = _in_unit_bounds(self.action_space, advice)
        mixed = self._mix(explorer, observed, scaled_advice, noise).clamp(-1.0, 1.0)
        scaled = mixed.cpu().numpy().reshape(-1, *self.action_space.shape)
        return self.policy.unscale_action(scaled), scaled

    def _mix(self, explorer: Explorer, obs: Any, advice: th.Tensor, noise: Any) -> th.Tensor:
        """Actions of the mixed policy, (B, A). The noise belongs to the learner's own action."""
        if self.mixing.method != REUSE and not self._samples():
            return explorer.explore(obs, advice) + noise
        own = (explorer.explore(obs, th.full_like(advice, th.inf)) + noise).clamp(-1.0, 1.0)
        if self._samples():
            return intersect_by_sampling(explorer, obs, own, advice, self.mixing)
        return reuse_action(own, advice, self.mixing.psi)


NO_DENSITY = (
    "Advice by sampling weighs the advisor's actions by how probable they are for the learner, and this algorithm chooses one "
    "action only: set action_noise (for instance 'normal 0.1'), or mix by the mean."
)


def intersect_by_sampling(explorer: Explorer, obs: Any, own: th.Tensor, advice: th.Tensor, mixing: Mixing) -> th.Tensor:
    """Policy Intersection of continuous policies, algorithm 1, (B, A).

    Draws actions from the advisor, clipped to the bounds, weighs each by the learner's density of it, and draws one by its
    weight. Components without advice are the learner's `own`, (B, A), in all of them. Where beside `own` the learner would do
    none of them, the action is that of whoever has the last word.
    """
    candidates = draw_advice(own, advice, mixing.samples)  # (N, B, A)
    *likings, usual = explorer.log_density(obs, th.cat([candidates, own[None]])).sum(-1)  # (N, B), (B,)
    weights = th.stack(likings)
    accepted = th.distributions.Categorical(logits=weights.T).sample()  # (B,)
    rest = own if mixing.last_word == LEARNER else candidates[0]
    empty = weights.amax(0) - usual < NOTHING
    return th.where(empty[:, None], rest, candidates[accepted, th.arange(len(own))])


def reuse_action(own: th.Tensor, advice: th.Tensor, psi: float) -> th.Tensor:
    """Probabilistic Policy Reuse, eq. 2.5, (B, A): with probability psi the advisor's action, else the learner's own."""
    heeded = th.rand(len(own), 1) < psi
    return th.where(heeded, draw_advice(own, advice, 1)[0], own)


def draw_advice(own: th.Tensor, advice: th.Tensor, samples: int) -> th.Tensor:
    """Actions of the advisor, (N, B, A), clipped to the bounds; the learner's `own`, (B, A), where there is no advice."""
    mean, deviation = advice.chunk(2, dim=-1)
    said = deviation.isfinite()
    drawn = mean + deviation.where(said, th.zeros(())) * th.randn(samples, *mean.shape)
    return th.where(said, drawn.clamp(-1.0, 1.0), own)


def noise_deviation(noise: ActionNoise | None, action_space: spaces.Box) -> th.Tensor:
    """The deviation of action noise in SB3's units, (A,), 0 without. That of Ornstein-Uhlenbeck's is what it comes to in time."""
    sigma: Any = getattr(noise, "_sigma", 0.0)
    if isinstance(noise, OrnsteinUhlenbeckActionNoise):
        kept = 1.0 - noise._theta * noise._dt
        sigma = sigma * np.sqrt(noise._dt / (1.0 - kept**2))
    return th.tensor(np.broadcast_to(sigma, action_space.shape).reshape(-1), dtype=th.float32)


def _middle_and_half(action_space: spaces.Box) -> tuple[th.Tensor, th.Tensor]:
    low, high = th.as_tensor(action_space.low).flatten(), th.as_tensor(action_space.high).flatten()
    return (low + high) / 2, (high - low) / 2


def _in_unit_bounds(action_space: spaces.Box, advice: th.Tensor) -> th.Tensor:
    """Advice on actions between -1 and 1, (B, 2A)."""
    middle, half = _middle_and_half(action_space)
    mean, deviation = advice.chunk(2, dim=-1)
    return th.cat([(mean - middle) / half, deviation / half], dim=-1)


def _in_action_units(action_space: spaces.Box, mean: th.Tensor, deviation: th.Tensor) -> DiagGaussianDistribution:
    """Means and deviations, (B, A), of actions between the bounds of the space."""
    middle, half = _middle_and_half(action_space)
    log_std = (deviation * half).clamp_min(EDGE).log()
    return DiagGaussianDistribution(mean.shape[-1]).proba_distribution(middle + half * mean, log_std)


MIXINS: dict[str, tuple[type[Any], type[Any]]] = {
    "DQN": (AdvisedValues, EpsilonGreedy),
    "QRDQN": (AdvisedValues, EpsilonGreedy),
    "SAC": (AdvisedActions, Squashed),
    "TQC": (AdvisedActions, Squashed),
    "TD3": (AdvisedActions, Deterministic),
    "DDPG": (AdvisedActions, Deterministic),
}


def advised_classes(algorithm: type[Any], policy: type[Any]) -> tuple[type[Any], type[Any]]:
    """The classes that take advice, of stock ones."""
    sampling, exploring = MIXINS[algorithm.__name__]
    return (
        type(algorithm.__name__, (sampling, algorithm), {}),
        type(f"Advised{policy.__name__}", (exploring, policy), {}),
    )
