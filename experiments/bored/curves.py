"""The players of the study, and the settings of Shepherd's agents in it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from shepherd_environments.bored import features

from agents_app.algorithms.spec import AgentSpec
from experiments.bored.city import read_places
from experiments.bored.players import Chance, LinUCB, MostPopular, Oracle, Player, Shepherd, Thompson

OBSERVATIONS = [[29], -1, 1]
DQN: dict[str, Any] = {
    "gamma": 0.0,
    "net_arch": "0",
    "learning_rate": 3e-3,
    "buffer_size": 20_000,
    "learning_starts": 50,
    "batch_size": 256,
    "train_freq": 4,
    "gradient_steps": 1,
    "target_update_interval": 1,
    "exploration_fraction": 0.05,
    "exploration_final_eps": 0.05,
    "total_timesteps": 20_000,
}
PPO: dict[str, Any] = {
    "gamma": 0.0,
    "gae_lambda": 0.0,
    "n_steps": 64,
    "batch_size": 64,
    "n_epochs": 10,
    "ent_coef": 0.01,
    "learning_rate": 1e-3,
}
LINEAR_PPO = PPO | {"net_arch": "0", "learning_rate": 1e-2}


def shepherd(
    algorithm: str, parameters: dict[str, Any], executions: int = 1, knows: bool = True, **advice: Any
) -> Callable[[int, int], Player]:
    """Shepherd's agent, whose executions share the visitors; neither number is known before. `knows` its places' features."""

    def make(actions: int, seed: int) -> Player:
        fields = advice | {"action_masks": True, "action_features": features(read_places()) if knows else None}
        return Shepherd(AgentSpec(algorithm, actions, OBSERVATIONS, parameters=parameters, **fields), executions, seed)

    return make


PLAYERS: dict[str, Callable[[int, int], Player]] = {
    "random": Chance,
    "most popular": MostPopular,
    "LinUCB": LinUCB,
    "Thompson sampling": Thompson,
    "PPO": shepherd("PPO", PPO, knows=False),
    "PPO, with features": shepherd("PPO", LINEAR_PPO),
    "DQN, with features": shepherd("DQN", DQN),
    "DQN, with features, four with advice": shepherd("DQN", DQN, 4, advice_method="intersection"),
    "DQN, with features, four without": shepherd("DQN", DQN, 4),
    "oracle": Oracle,
}
