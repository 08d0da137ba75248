"""Which kind of network suits which observations. No Django, no torch.

Stable-Baselines3 names its policies by what they look at: Cnn* at images, MultiInput* at dictionaries, everything else
(Mlp*, LinearPolicy) at vectors, into which it flattens whatever it gets.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from gymnasium import spaces

from agents_app.spaces import is_image

AUTO = "auto"
CNN, DICTIONARY, VECTOR = "Cnn", "MultiInput", "Mlp"
SMALLEST_IMAGE = 36  # the three convolutions of SB3's NatureCNN leave nothing of a smaller one


class HasPolicies(Protocol):
    """A row of the registry, or of the table of algorithms."""

    @property
    def policies(self) -> Sequence[str]:
        """The names of the policies that the algorithm can use."""
        ...


def policy_name(row: HasPolicies, observation_space: spaces.Space, policy: str = AUTO) -> str:
    """The policy itself, or for 'auto' the first one of the algorithm that is made for these observations."""
    if policy != AUTO:
        return policy
    wanted = kind_of_space(observation_space)
    return next((name for name in row.policies if kind_of_policy(name) == wanted), row.policies[0])


def kind_of_policy(name: str) -> str:
    """What a policy looks at: CNN, DICTIONARY or VECTOR."""
    return next((kind for kind in (CNN, DICTIONARY) if name.startswith(kind)), VECTOR)


def kind_of_space(space: spaces.Space) -> str:
    """What looks best at observations of `space`: CNN, DICTIONARY or VECTOR."""
    if isinstance(space, spaces.Dict):
        return DICTIONARY
    return CNN if is_image(space) and convolves(space) else VECTOR


def convolves(image: spaces.Space) -> bool:
    """Whether an image is large enough for SB3's NatureCNN. As there, the smallest dimension is the channels."""
    shape = image.shape or ()
    sides = shape[1:] if np.argmin(shape) == 0 else shape[:2]
    return min(sides) >= SMALLEST_IMAGE
