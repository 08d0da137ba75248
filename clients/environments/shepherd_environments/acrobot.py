"""Acrobot with continuous actions: Gymnasium's Acrobot (Sutton 1996), of which only the actions are others."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.envs.classic_control import AcrobotEnv


class ContinuousAcrobot(AcrobotEnv):
    """Swing the lower of two joined links above a line.

    - Actions: Box(-1, 1, (1,), float32). The torque on the joint between the links, in N m; what is outside is cut off.
    - Observations, rewards, start and end: Gymnasium's Acrobot-v1. -1 per step, 0 for the one that succeeds; truncated by
      the registered time limit after 500 steps.
    """

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def step(self, a: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Apply a torque for 0.2 s."""
        self.AVAIL_TORQUE = [float(np.clip(a, -1.0, 1.0).item())]  # the only one that there is in this step
        return super().step(0)
