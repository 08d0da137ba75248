"""Action masks: which actions are allowed, as the client says at each step (docs/algorithms.md).

A forbidden action has probability 0 in every policy: the one that acts, the one that learns, and each advisor's. Values of
forbidden actions are never the greatest, so that targets are those of allowed ones (Huang and Ontañón 2022, "A closer look at
invalid action masking in policy gradient algorithms"). A mask that allows everything changes nothing, to the bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces

from agents_app.algorithms.advice import Array, is_neutral, mix_logits
from agents_app.algorithms.mixing import Mixing
from agents_app.algorithms.riders import MASK, client_part, space_with_rider, with_rider

FORBIDDEN = -1e8  # a logit or a value; finite, as sb3_contrib's: infinities would make NaN of gradients and entropies


def masked_space(observation_space: spaces.Space, action_space: spaces.Space) -> spaces.Dict:
    """The observation space with the mask, (A,) of 0 and 1, beside the rest. Raises ValueError: actions are not discrete."""
    if not isinstance(action_space, spaces.Discrete):
        raise ValueError("Only one of n actions can be masked.")
    return space_with_rider(observation_space, MASK, spaces.MultiBinary(int(action_space.n)))


def with_mask(obs: Any, allowed: np.ndarray | None, actions: int) -> dict[str, Any]:
    """An observation of `masked_space`. None: all are allowed."""
    return with_rider(obs, MASK, np.ones(actions, np.int8) if allowed is None else allowed.astype(np.int8))


def allowed_of(obs: Any) -> Any:
    """The mask that rides in observations, (..., A); None: there is none."""
    return obs.get(MASK) if isinstance(obs, dict) else None


def mask_logits(logits: Array, allowed: Array | None) -> Array:
    """Logits, or values, (..., A), of which the forbidden ones are never chosen. A mask broadcasts."""
    if allowed is None:
        return logits
    if isinstance(logits, th.Tensor):
        return logits.masked_fill(allowed == 0, FORBIDDEN)
    return np.where(allowed, logits, logits.dtype.type(FORBIDDEN))


def mask_advice(advice: Array, allowed: Array | None) -> Array:
    """What advice says of the allowed actions, (..., A), of the same sum; neutral where it says nothing of them."""
    if allowed is None:
        return advice
    kept = advice * (allowed != 0)
    said, left = advice.sum(-1)[..., None], kept.sum(-1)[..., None]
    raised = kept / (left + (left == 0)) * said  # in this order: what is left may be next to nothing
    silent = is_neutral(advice) | (left == 0)
    xp: Any = th if isinstance(kept, th.Tensor) else np
    return xp.where(silent, xp.ones_like(kept), xp.where(left == said, kept, raised))


def mix_allowed(logits: Array, advice: Array | None, mixing: Mixing, allowed: Array | None) -> Array:
    """The policy that acts, as logits (..., A): both policies are masked, and then mixed.

    Where they agree on no allowed action, the one that has the last word decides among those.
    """
    own = mask_logits(logits, allowed)
    if advice is None:
        return own
    return mask_logits(mix_logits(own, mask_advice(advice, allowed), mixing), allowed)


class SeesMask:
    """Mix into a policy that is built on the client's observation, on the left: the mask stays beside it."""

    def is_vectorized_observation(self, observation: Any) -> bool:
        """Whether the client's observation is a batch of several."""
        return super().is_vectorized_observation(client_part(observation))  # type: ignore[misc]

    def obs_to_tensor(self, observation: Any) -> tuple[Any, bool]:
        """Tensors of the client's observation, and of the mask if there is one."""
        tensors, vectorized = super().obs_to_tensor(client_part(observation))  # type: ignore[misc]
        allowed = allowed_of(observation)
        if allowed is None:
            return tensors, vectorized
        return with_rider(tensors, MASK, th.as_tensor(allowed).reshape(-1, np.shape(allowed)[-1])), vectorized


class MaskedValues:
    """Mix into a network of values, on the left: those of forbidden actions are never the greatest."""

    def forward(self, obs: Any) -> th.Tensor:
        """Values, (B, A), or quantiles of them, (B, N, A)."""
        values: th.Tensor = super().forward(client_part(obs))  # type: ignore[misc]
        allowed = allowed_of(obs)
        return values if allowed is None else mask_logits(values, allowed.unsqueeze(1) if values.ndim > 2 else allowed)
