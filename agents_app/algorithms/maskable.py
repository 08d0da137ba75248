"""MaskablePPO: as on the policy, but that it has a way of its own for masks; all ones when the client sends none."""

from __future__ import annotations

from typing import Any

import numpy as np

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
    """Draws among the allowed actions: sb3_contrib's policy takes the mask as an argument."""

    def _masked(self, mask: np.ndarray | None) -> dict[str, Any]:
        actions: Any = self.action_space
        return {"action_masks": np.ones(int(actions.n), bool) if mask is None else mask}


make_actor = MaskableActor
