"""The players of the study, and the settings of Shepherd's agents in it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agents_app.algorithms.spec import AgentSpec
from agents_app.demos import DEMOS
from experiments.bored.players import Chance, LinUCB, MostPopular, Oracle, Player, Shepherd, Thompson

BORED = DEMOS["Bored in the city"]  # the agent of the page
DQN: dict[str, Any] = BORED["parameters"]
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
        fields = advice | {"action_masks": True, "action_features": BORED["action_features"] if knows else None}
        spec = AgentSpec(algorithm, actions, BORED["observation_space"], parameters=parameters, **fields)
        return Shepherd(spec, executions, seed)

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
