"""RecurrentPPO: as on the policy; the actor carries the LSTM's state of each session's episode from step to step."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import torch as th
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import obs_as_tensor

from agents_app.algorithms.actor import Memory, batch, to_env
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


class RecurrentActor(OnPolicyActor):
    """The memory is SB3's RNNStates; at the beginning of an episode it is zero."""

    def __init__(self, algorithm: BaseAlgorithm) -> None:
        super().__init__(algorithm)
        self.blank: RNNStates = copy.deepcopy(algorithm._last_lstm_states)  # type: ignore[attr-defined]

    def decide(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Decision, Memory]:
        """Draw an action; the record includes the LSTM's next state, the new memory."""
        self._explore_anew()
        start = th.tensor([float(memory is None)])
        with th.no_grad():
            tensors = obs_as_tensor(batch(obs), self.policy.device)
            replay = self.policy(tensors, self.blank if memory is None else memory, start)
        return Decision(obs, to_env(self.action_space, self.policy, replay[0].numpy()[0]), replay), replay[3]

    def exploit(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Any, Memory]:
        """The most probable action."""
        start = th.tensor([float(memory is None)])
        with th.no_grad():
            tensors = obs_as_tensor(batch(obs), self.policy.device)
            states = self.blank if memory is None else memory
            actions, _, _, states = self.policy(tensors, states, start, deterministic=True)
        return to_env(self.action_space, self.policy, actions.numpy()[0]), states


make_actor = RecurrentActor
