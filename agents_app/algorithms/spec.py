"""What an execution must know of its agent, as plain data that travels between processes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from gymnasium import spaces

from agents_app.algorithms.mixing import SHAPING, Mixing
from agents_app.spaces import is_image, parse_space


@dataclass
class AgentSpec:
    """An agent's configuration. Spaces are in the notation of the wire."""

    algorithm: str
    action_space: Any
    observation_space: Any
    policy: str = "auto"
    parameters: dict[str, Any] = field(default_factory=dict)
    action_masks: bool = False
    action_features: list[list[float]] | None = None  # a row per action
    advice_method: str = "none"
    learning_correction: bool = True
    continuous_advice: str = "mean"
    advice_samples: int = 64
    last_word: str = "learner"
    advice_form: str = "soft"
    shaping_scale: float = 1.0
    rho: float = 1.0
    psi: float = 0.5
    advice_weight: float = 1.0
    advisors: str = "random"
    peers_advise: bool = True
    averaging: bool = False

    def to_dict(self) -> dict[str, Any]:
        """The fields, for a message."""
        return asdict(self)

    def mixing(self) -> Mixing:
        """How its policy takes advice."""
        correction = self.learning_correction and self.advice_method != SHAPING
        return Mixing(
            self.advice_method,
            correction,
            self.psi,
            self.continuous_advice,
            self.advice_samples,
            self.last_word,
            self.advice_weight,
        )

    def actions(self) -> spaces.Space:
        """The action space."""
        return parse_space(self.action_space)

    def observations(self) -> spaces.Space:
        """The observation space as the algorithm sees it, without advice: images have their channels first."""
        space = parse_space(self.observation_space)
        if isinstance(space, spaces.Dict):
            return spaces.Dict({key: _channels_first(sub) for key, sub in space.spaces.items()})
        return _channels_first(space)


def _channels_axis(space: spaces.Space) -> int:
    """Where an image has its channels: its smallest dimension, as SB3 decides. 0 for what is no image."""
    return int(np.argmin(space.shape or ())) if is_image(space) else 0


def _channels_first(space: spaces.Space) -> spaces.Space:
    if (axis := _channels_axis(space)) == 0:
        return space
    shape = space.shape or ()
    return spaces.Box(0, 255, (shape[axis], *shape[:axis], *shape[axis + 1 :]), np.uint8)


def see(spec_space: spaces.Space, obs: Any) -> Any:
    """An observation of the client's space as the algorithm sees it."""
    if isinstance(spec_space, spaces.Dict):
        return {key: see(sub, obs[key]) for key, sub in spec_space.spaces.items()}
    axis = _channels_axis(spec_space)
    return np.ascontiguousarray(np.moveaxis(obs, axis, 0)) if axis else obs
