"""The contract of transports: that it learns."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from tests.servers import wait_for
from tests.transports.agents import Agent, Player
from tests.transports.engines import Engine


class Learning:
    """That it learns."""

    @pytest.mark.parametrize("algorithm", ["PPO", "DQN"])
    def test_the_identity_game_is_learned(self, engine: Engine, algorithm: str) -> None:
        """Who does at `obs` what `obs` says is rewarded."""
        quick: dict[str, Any] = {"learning_rate": 0.02, "gamma": 0.0, "net_arch": "16"}
        if algorithm == "DQN":
            quick |= {"total_timesteps": 800, "exploration_fraction": 0.5, "target_update_interval": 50}
        agent = Agent(engine, algorithm=algorithm, observations=3, parameters=quick)
        player = agent.player()
        rewards = play_identity(player, 1500)
        assert np.mean(rewards[:60]) < 0.8
        assert np.mean(rewards[-100:]) > 0.85
        agent.transport.configure(agent.id, {"learning": False})
        wait_for(lambda: not next(iter(agent.status().values()))["learning"])
        assert [player.step(obs)["action"] for obs in range(3)] == [0, 1, 2]

    def test_a_newcomer_knows_what_was_learned_without_advice(self, engine: Engine) -> None:
        """Executions that average hear of each other where none advises, too."""
        steps = {"learning_rate": 0.02, "gamma": 0.0, "net_arch": "16", "n_steps": 128, "n_epochs": 10}
        agent = Agent(engine, algorithm="MaskablePPO", observations=3, parameters=steps, averaging=True)
        teacher = agent.player()
        assert any(np.mean(play_identity(teacher, 200)) > 0.85 for _ in range(30))
        newcomer, rewards = agent.player(), [0.0]
        while np.mean(rewards[-20:]) < 0.8:
            rewards += play_identity(newcomer, 10)
            assert len(rewards) < 110  # it would learn by itself
            time.sleep(0.5)


def play_identity(player: Player, steps: int) -> list[float]:
    """Play, in episodes of at most 20 steps; what was earned by each."""
    generator, reward, rewards = np.random.default_rng(1), 0.0, []
    for number in range(steps):
        ends = number % 20 == 19 or number == steps - 1
        obs = int(generator.integers(3))
        action = player.step(obs, reward, ends)["action"]
        if not ends:
            reward = float(action == obs)
            rewards.append(reward)
    return rewards
