"""Small networks in NumPy, on the memory of their torch tensors, and the actor-critic policies made of them.

At a batch of one, torch spends its time on calls, not on numbers: SB3's `forward` of a 64-64 network takes 0.26 ms, this one
0.04 ms (docs/adr/0004). The weights are the very same memory, so `assign` changes both. Networks of other kinds (images,
dictionaries, gSDE, other activations) raise Unsupported, and the policy itself is called. Those of algorithms off the policy:
small_policies.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from agents_app.algorithms.action_features import ScoresFeatures
from agents_app.algorithms.masks import allowed_of, mask_logits
from agents_app.algorithms.normalising import Normaliser, NormalisingExtractor
from agents_app.algorithms.riders import PLAIN, plain_space

ACTIVATIONS: dict[type[nn.Module], Callable[[np.ndarray], np.ndarray]] = {
    nn.Tanh: np.tanh,
    nn.ReLU: lambda x: np.maximum(x, 0),
}
Layer = tuple[np.ndarray, np.ndarray, Callable[[np.ndarray], np.ndarray] | None]


class Unsupported(TypeError):
    """The network is of another kind."""


class SmallNet:
    """What the policy's networks say of one observation."""

    def __init__(self, policy: ActorCriticPolicy) -> None:
        """Raises Unsupported."""
        if not hasattr(policy, "action_net") or policy.use_sde or policy.squash_output:
            raise Unsupported
        if not isinstance(policy.action_space, spaces.Discrete | spaces.Box):
            raise Unsupported
        self._vector = vectoriser(policy.features_extractor, policy.observation_space)
        extractor = policy.mlp_extractor
        self._actor = layers([*extractor.policy_net, policy.action_net])
        self._critic = layers([*extractor.value_net, policy.value_net])
        self._log_std = policy.log_std.detach().numpy() if isinstance(policy.action_space, spaces.Box) else None

    def act(self, obs: Any) -> np.ndarray:
        """Logits (A,), or means (A,)."""
        return run(self._actor, self._vector(obs))

    def act_and_value(self, obs: Any) -> tuple[np.ndarray, np.ndarray]:
        """Logits or means, (A,); and the value, (1,)."""
        vector = self._vector(obs)
        return run(self._actor, vector), run(self._critic, vector)

    def probabilities(self, obs: Any) -> np.ndarray:
        """Of each action, (A,); 0 for those that are not allowed."""
        return np.exp(log_softmax(mask_logits(self.act(obs), allowed_of(obs))))

    def gaussian(self, obs: Any) -> tuple[np.ndarray, np.ndarray]:
        """Means (A,) and standard deviations (A,)."""
        return self.act(obs), self.deviations()

    def deviations(self) -> np.ndarray:
        """Standard deviations of continuous actions, (A,)."""
        assert self._log_std is not None
        return np.exp(self._log_std)


def log_softmax(logits: np.ndarray) -> np.ndarray:
    """Logarithms of the probabilities, (A,)."""
    shifted = logits - logits.max()
    return shifted - np.log(np.exp(shifted).sum())


def draw(log_probs: np.ndarray) -> int:
    """An index by its probability, from NumPy's generator."""
    cumulated = np.exp(log_probs).cumsum()
    drawn = np.random.random() * float(cumulated[-1])  # in float64: below the sum, however near to it
    return min(int(np.searchsorted(cumulated, drawn, side="right")), log_probs.size - 1)


def vectoriser(extractor: nn.Module, space: spaces.Space) -> Callable[[Any], np.ndarray]:
    """From an observation to the input of the first layer, (I,), as SB3's preprocess_obs and the extractor do.

    The observation is of `space`, with riders or without, or a batch of one of them. Raises Unsupported.
    """
    if type(extractor) not in (FlattenExtractor, NormalisingExtractor):
        raise Unsupported
    vector = flattener(plain_space(space))
    return _normalised(vector, extractor.normaliser) if isinstance(extractor, NormalisingExtractor) else vector


def flattener(space: spaces.Space) -> Callable[[Any], np.ndarray]:
    """From an observation of what the client sends to a vector, (I,). Raises Unsupported."""
    if isinstance(space, spaces.Box) and space.dtype == np.float32:
        return lambda obs: _plain(obs).reshape(-1)
    if isinstance(space, spaces.Discrete) and space.n <= 4096:
        eye = np.eye(int(space.n), dtype=np.float32)
        return lambda obs: eye[whole_number(obs)]
    raise Unsupported


def _normalised(vector: Callable[[Any], np.ndarray], normaliser: Normaliser) -> Callable[[Any], np.ndarray]:
    mean, scale = normaliser.mean.numpy(), normaliser.scale.numpy()
    return lambda obs: (vector(obs) - mean) * scale


def whole_number(obs: Any) -> int:
    """What the client sent, where that is one."""
    return np.asarray(_plain(obs)).item()


def _plain(obs: Any) -> Any:
    return obs[PLAIN] if isinstance(obs, dict) else obs


def layers(modules: Iterable[nn.Module]) -> list[Layer]:
    """What is to be computed one after the other. Raises Unsupported."""
    found: list[Layer] = []
    for module in modules:
        if isinstance(module, nn.Linear):
            found.append((module.weight.detach().numpy(), module.bias.detach().numpy(), None))
        elif isinstance(module, ScoresFeatures) and module.outputs_each == 1:
            found += [(weight, bias, None) for weight, bias in module.in_numpy()]
        elif type(module) in ACTIVATIONS and found:
            found[-1] = (*found[-1][:2], ACTIVATIONS[type(module)])
        else:
            raise Unsupported
    return found


def run(network: list[Layer], x: np.ndarray) -> np.ndarray:
    """The output for one input, (I,) -> (O,)."""
    for weight, bias, activation in network:
        x = weight @ x + bias
        if activation is not None:
            x = activation(x)
    return x
