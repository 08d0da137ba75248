"""Actor-critic policies that take advice (thesis 3.1.2, 5.5.1) and masks: a mixin over SB3's own policies, no fork.

The network is built on the client's observation alone; `advice` and `action_mask` ride in the observation dictionary, and meet
the logits or the Gaussian. With the learning correction (LC) the update sees the mixed policy too, eq. 3.1; without it, the
learner's own.
"""

from __future__ import annotations

from typing import Any

import torch as th
from gymnasium import spaces
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy

from agents_app.algorithms.advice import intersect_mean
from agents_app.algorithms.masks import SeesMask, allowed_of, mix_allowed
from agents_app.algorithms.mixed_gaussians import Accepted, Reused
from agents_app.algorithms.mixing import REUSE, SHAPING, UNION, Mixing
from agents_app.algorithms.riders import ADVICE, client_part, plain_space


class AdvisedPolicy(SeesMask, ActorCriticPolicy):
    """Acts with its own policy, mixed with the advice, among the allowed actions. Mix into a policy class, on the left."""

    def __init__(
        self,
        observation_space: spaces.Space,
        action_space: spaces.Space,
        lr_schedule: Any,
        mixing: Mixing = Mixing(),  # noqa: B008  (frozen)
        **kwargs: Any,
    ) -> None:
        """`mixing`: how advice changes the actions, and whether the learning rule knows. Raises ValueError if it cannot."""
        if mixing.method == UNION and isinstance(action_space, spaces.Box):
            raise ValueError("Policy Union is for discrete actions: with vectors of numbers, use Policy Reuse.")
        super().__init__(plain_space(observation_space), action_space, lr_schedule, **kwargs)
        self.mixing = mixing

    def forward(self, obs: Any, deterministic: bool = False) -> tuple[th.Tensor, th.Tensor, th.Tensor]:
        """Action chosen with advice, (B, ...); value, (B, 1); log-probability that the learning rule takes for it, (B,)."""
        latent_pi, latent_vf = self._latents(obs)
        allowed = allowed_of(obs)
        mixed = self._distribution(latent_pi, self._advice(obs), allowed)
        actions = mixed.get_actions(deterministic=deterministic)
        seen = mixed if self.mixing.correction else self._distribution(latent_pi, None, allowed)
        log_prob = seen.log_prob(actions)
        return actions.reshape((-1, *(self.action_space.shape or ()))), self.value_net(latent_vf), log_prob

    def evaluate_actions(self, obs: Any, actions: th.Tensor) -> tuple[th.Tensor, th.Tensor, th.Tensor | None]:
        """Values (B, 1), log-probabilities (B,) and entropies (B,) of the policy that the learning rule sees."""
        latent_pi, latent_vf = self._latents(obs)
        advice, values = self._advice(obs) if self.mixing.correction else None, self.value_net(latent_vf)
        if isinstance(self.action_space, spaces.Discrete):
            logits = mix_allowed(self.action_net(latent_pi), advice, self.mixing, allowed_of(obs))
            return values, *judge(logits, actions)
        distribution = self._distribution(latent_pi, advice, allowed_of(obs))
        return values, distribution.log_prob(actions), distribution.entropy()

    def extract_features(self, obs: Any, features_extractor: Any = None) -> Any:
        """Features of the client's observation; advice and mask are left aside."""
        return super().extract_features(client_part(obs), features_extractor)

    def get_distribution(self, obs: Any) -> Distribution:
        """The policy that the learning rule sees, of which TRPO asks; without advice in `obs`, the learner's own."""
        latent_pi, _ = self._latents(obs)
        advice = self._advice(obs) if self.mixing.correction else None
        return self._distribution(latent_pi, advice, allowed_of(obs))

    def predict_values(self, obs: Any) -> th.Tensor:
        """Values, (B, 1); advice and mask change nothing."""
        return super().predict_values(client_part(obs))

    def _latents(self, obs: Any) -> tuple[th.Tensor, th.Tensor]:
        features = self.extract_features(obs)
        if self.share_features_extractor:
            return self.mlp_extractor(features)
        pi_features, vf_features = features
        return self.mlp_extractor.forward_actor(pi_features), self.mlp_extractor.forward_critic(vf_features)

    def _advice(self, obs: Any) -> th.Tensor | None:
        """What may change the actions, if there is any; as a reward it changes none."""
        return None if self.mixing.method == SHAPING or not isinstance(obs, dict) else obs.get(ADVICE)

    def _distribution(self, latent_pi: th.Tensor, advice: th.Tensor | None, allowed: th.Tensor | None) -> Distribution:
        """The action distribution, mixed with the advice if there is any, among the allowed actions.

        Each call makes a new Distribution-state: the policy keeps one object, so the mixed one is asked for first.
        """
        raw = self.action_net(latent_pi)
        if isinstance(self.action_space, spaces.Discrete):
            return self.action_dist.proba_distribution(action_logits=mix_allowed(raw, advice, self.mixing, allowed))
        if advice is None:
            return self._gaussian(raw, latent_pi)
        if self.mixing.by_mean:
            return self._gaussian(intersect_mean(raw, advice, self.mixing.part), latent_pi)
        if self.mixing.method == REUSE:
            return Reused(self._gaussian(raw, latent_pi), advice, self.mixing)
        return Accepted(self._gaussian(raw, latent_pi), advice, self.mixing)

    def _gaussian(self, mean: th.Tensor, latent_pi: th.Tensor) -> Distribution:
        if self.use_sde:
            return self.action_dist.proba_distribution(mean, self.log_std, latent_pi)
        return self.action_dist.proba_distribution(mean, self.log_std)


def judge(logits: th.Tensor, actions: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
    """Log-probabilities (B,) of actions (B,), and entropies (B,), under unnormalised finite logits (B, A).

    The same numbers as of torch's Categorical, without its checks and copies, which cost more than the arithmetic
    (docs/adr/0005). That the weights are finite is the learner's to check.
    """
    log_probs = logits - logits.logsumexp(-1, keepdim=True)
    chosen = log_probs.gather(-1, actions.long().unsqueeze(-1)).squeeze(-1)
    return chosen, -(log_probs * log_probs.softmax(-1)).sum(-1)
