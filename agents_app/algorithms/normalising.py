"""Observation normalisation: vectors of numbers are brought to mean 0 and deviation 1 before the networks see them.

The statistics are buffers of the policy, beside its weights, so that they travel with them: to the actor, to the peers (whose
advice is evaluated with statistics of their own) and into every copy. On the policy they change after an update only, with the
observations that it learned from: a decision is recorded and learned from under the same statistics, and log-probabilities stay
exact. But the first update has seen its observations before: learning from numbers in the thousands would spoil the networks, and
a fresh policy decides by chance however it sees them (docs/adr/0013). Off the policy, where nothing hangs on that, they change
with each step, before the first update too.

Nothing is clipped, so that a saved model can have them folded into its first layers and be a stock one.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.preprocessing import is_image_space
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from agents_app.algorithms import beside
from agents_app.algorithms.action_features import ScoresFeatures
from agents_app.algorithms.riders import client_part

MEMBER = "normaliser.npz"  # in a saved ZIP: the statistics, and what the folding replaced
SMALLEST = 1e-6  # a deviation smaller than this part of the mean is rounding: that dimension keeps its scale
BORROWED = 100.0  # observations, as which the statistics of another execution count


class Normaliser(nn.Module):
    """Running mean and deviation of a vector, by Chan, Golub and LeVeque (1979). Before it has seen anything: as it is."""

    mean: th.Tensor  # (I,)
    scale: th.Tensor  # (I,), one over the deviation

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("mean", th.zeros(size), persistent=False)  # in no save of stock SB3
        self.register_buffer("scale", th.ones(size), persistent=False)
        self.statistics = {"count": np.zeros(()), "mean": np.zeros(size), "squares": np.zeros(size)}

    def forward(self, x: th.Tensor) -> th.Tensor:
        """(B, I), normalised."""
        return (x - self.mean) * self.scale

    @property
    def has_seen(self) -> bool:
        """Whether it has statistics of its own."""
        return bool(self.statistics["count"])

    @property
    def is_blank(self) -> bool:
        """Whether nothing is known of the scale, not even by others."""
        return not (self.mean.any() or (self.scale != 1.0).any())

    def known(self) -> dict[str, np.ndarray]:
        """The statistics. Those that came with the weights of another execution count as a few observations."""
        if self.has_seen or self.is_blank:
            return self.statistics
        mean, scale = self.mean.numpy().astype(np.float64), self.scale.numpy().astype(np.float64)
        return {"count": np.array(BORROWED), "mean": mean, "squares": np.where(scale == 1.0, 0.0, BORROWED * scale**-2)}

    def observe(self, observations: np.ndarray) -> None:
        """Learn from a batch, (..., I). Belongs to the learner."""
        rows = np.asarray(observations, np.float64).reshape(-1, len(self.mean))
        known, new = self.known(), len(rows)
        count = known["count"] + new
        apart = rows.mean(0) - known["mean"]
        spread = ((rows - rows.mean(0)) ** 2).sum(0) + apart**2 * known["count"] * new / count
        self.take({"count": count, "mean": known["mean"] + apart * new / count, "squares": known["squares"] + spread})

    def take(self, statistics: dict[str, np.ndarray]) -> None:
        """Go on from these."""
        self.statistics = statistics
        mean, deviation = statistics["mean"], np.sqrt(statistics["squares"] / max(1.0, float(statistics["count"])))
        known = deviation > SMALLEST * np.maximum(np.abs(mean), SMALLEST)
        self.mean.copy_(th.from_numpy(mean))
        self.scale.copy_(th.from_numpy(1.0 / np.where(known, deviation, 1.0)))


class NormalisingExtractor(FlattenExtractor):
    """SB3's own for vectors, with a normaliser that all networks of the policy share."""

    def __init__(self, observation_space: spaces.Space, normaliser: Normaliser) -> None:
        super().__init__(observation_space)
        self.normaliser = normaliser

    def forward(self, observations: th.Tensor) -> th.Tensor:
        """(B, I)."""
        return self.normaliser(super().forward(observations))


class NormalisesRollouts:
    """Mix into an algorithm on the policy, on the left."""

    normaliser: Normaliser

    def train(self, *args: Any, **kwargs: Any) -> None:
        """An update; what it learned from counts from then on, and where nothing was known, before it."""
        observations, is_first = client_part(self.rollout_buffer.observations), self.normaliser.is_blank  # type: ignore[attr-defined]
        if is_first:
            self.normaliser.observe(observations)
        super().train(*args, **kwargs)  # type: ignore[misc]
        if not is_first:
            self.normaliser.observe(observations)


class NormalisesSteps:
    """Mix into an algorithm off the policy, on the left. The replay buffer keeps observations as they came."""

    normaliser: Normaliser

    def _store_transition(self, *args: Any, **kwargs: Any) -> None:
        self.normaliser.observe(client_part(self._last_obs))  # type: ignore[attr-defined]
        super()._store_transition(*args, **kwargs)  # type: ignore[misc]


def can_normalise(space: spaces.Space) -> bool:
    """Whether these observations are vectors of numbers. Images and whole numbers have a scale already."""
    return isinstance(space, spaces.Box) and space.dtype == np.float32 and not is_image_space(space)


def extractor_kwargs(normaliser: Normaliser) -> dict[str, Any]:
    """What makes a policy normalise, among its `policy_kwargs`."""
    return {
        "features_extractor_class": NormalisingExtractor,
        "features_extractor_kwargs": {"normaliser": normaliser},
    }


def fold(normaliser: Normaliser, policy: nn.Module, state: dict[str, th.Tensor]) -> dict[str, th.Tensor]:
    """The policy's state for a network that sees observations as they are: W' = W scale, b' = b - W scale mean.

    The first layers are those that begin a stack; critics see the action behind the observation, which is left alone.
    """
    folded, size = dict(state), len(normaliser.mean)
    for name in first_layers(policy):
        weight, bias = state[f"{name}.weight"].double(), state[f"{name}.bias"]
        seen = weight[:, :size] * normaliser.scale.double()
        folded[f"{name}.weight"] = th.cat([seen, weight[:, size:]], 1).float()
        folded[f"{name}.bias"] = (bias.double() - seen @ normaliser.mean.double()).float()
    return folded


def first_layers(policy: nn.Module) -> list[str]:
    """The names of the layers that see the observation: the first of each stack, or without hidden layers what is behind it."""
    stacks = [(name, module) for name, module in policy.named_modules() if isinstance(module, nn.Sequential)]
    hidden = {name.removesuffix("latent_pi") + "mu" for name, _ in stacks if name.endswith("latent_pi")}
    stacks = [(name, stack) for name, stack in stacks if name not in hidden]  # gSDE makes SAC's last layer a stack, too
    names = [f"{name}.0" for name, stack in stacks if len(stack) and isinstance(stack[0], nn.Linear | ScoresFeatures)]
    behind = {"mlp_extractor.policy_net": ["action_net"], "mlp_extractor.value_net": ["value_net"]}
    layers = dict(policy.named_modules())
    for name in [name for name, _ in stacks if name.endswith("latent_pi")]:
        outputs = [name.removesuffix("latent_pi") + kind for kind in ("mu", "log_std")]
        behind[name] = [f"{it}.0" if isinstance(layers[it], nn.Sequential) else it for it in outputs if it in layers]
    return names + [layer for name, stack in stacks if not len(stack) for layer in behind.get(name, [])]


def write_beside(path: Path | BytesIO, algorithm: Any) -> None:
    """Add to a saved ZIP what its folded network no longer tells; stock SB3 does not look at it."""
    state = algorithm.policy.state_dict()
    names = [f"{layer}.{kind}" for layer in first_layers(algorithm.policy) for kind in ("weight", "bias")]
    arrays = {f"policy/{name}": state[name].numpy() for name in names if name in state} | algorithm.normaliser.known()
    beside.write(path, MEMBER, arrays)


def read_beside(path: Path | BytesIO, algorithm: Any, state: dict[str, th.Tensor]) -> None:
    """Take the statistics back, and put into `state` what the folding replaced. A save without them is taken as it is."""
    arrays = beside.read(path, MEMBER)
    if not arrays:
        return
    algorithm.normaliser.take({name: arrays[name] for name in ("count", "mean", "squares")})
    for name, array in arrays.items():
        if name.startswith("policy/"):
            state[name.removeprefix("policy/")] = th.from_numpy(array)
