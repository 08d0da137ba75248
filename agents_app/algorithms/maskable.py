"""MaskablePPO: as on the policy; every decision has a mask, all ones when the client sends none."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents_app.algorithms.actor import Memory
from agents_app.algorithms.on_policy import (
    POLICY_KWARGS,
    SHARES_WEIGHTS,
    OnPolicyActor,
    allowed_lead,
    attach,
    has_long_updates,
    learner_classes,
    make_feed,
)
from agents_app.algorithms.replay import Decision

__all__ = [
    "POLICY_KWARGS",
    "SHARES_WEIGHTS",
    "allowed_lead",
    "attach",
    "has_long_updates",
    "learner_classes",
    "make_actor",
    "make_feed",
]


class MaskableActor(OnPolicyActor):
    """Draws among the allowed actions."""

    def decide(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Decision, Memory]:
        """Draw an allowed action."""
        return super().decide(obs, memory, self._all_or(mask))

    def exploit(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Any, Memory]:
        """The most probable allowed action."""
        return super().exploit(obs, memory, self._all_or(mask))

    def _all_or(self, mask: np.ndarray | None) -> np.ndarray:
        return np.ones(self.action_space.n, bool) if mask is None else mask  # type: ignore[attr-defined]


make_actor = MaskableActor
