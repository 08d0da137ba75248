"""The players of the study, and the settings of Shepherd's agents in it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agents_app.algorithms.spec import AgentSpec
from experiments.bored.players import Chance, MostPopular, Oracle, Player, Shepherd, linucb, thompson

OBSERVATIONS = [[29], -1, 1]
DQN: dict[str, Any] = {
    "gamma": 0.0,
    "learning_rate": 1e-3,
    "buffer_size": 20_000,
    "learning_starts": 50,
    "batch_size": 128,
    "train_freq": 1,
    "gradient_steps": 2,
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
}
PPO |= {"learning_rate": 1e-3}


def shepherd(
    algorithm: str, parameters: dict[str, Any], executions: int, **advice: Any
) -> Callable[[int, int], Player]:
    """Shepherd's agent; neither number is known before."""

    def make(actions: int, seed: int) -> Player:
        spec = AgentSpec(algorithm, actions, OBSERVATIONS, parameters=parameters, action_masks=True, **advice)
        return Shepherd(spec, executions, seed)

    return make


PLAYERS: dict[str, Callable[[int, int], Player]] = {
    "random": Chance,
    "most popular": MostPopular,
    "LinUCB": linucb,
    "Thompson sampling": thompson,
    "DQN, one execution": shepherd("DQN", DQN, 1),
    "DQN, four, with advice": shepherd("DQN", DQN, 4, advice_method="intersection"),
    "DQN, four, without": shepherd("DQN", DQN, 4),
    "PPO, one execution": shepherd("PPO", PPO, 1),
    "PPO, four, with advice": shepherd("PPO", PPO, 4, advice_method="geometric"),
    "PPO, four, without": shepherd("PPO", PPO, 4),
    "oracle": Oracle,
}
