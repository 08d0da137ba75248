"""The contract of transports: that it learns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.servers import wait_for
from tests.transports.agents import Agent
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
        player, generator = agent.player(), np.random.default_rng(1)
        reward, rewards = 0.0, []
        for number in range(1500):
            ends = number % 20 == 19
            obs = int(generator.integers(3))
            action = player.step(obs, reward, ends)["action"]
            if not ends:
                reward = float(action == obs)
                rewards.append(reward)
        assert np.mean(rewards[:60]) < 0.8
        assert np.mean(rewards[-100:]) > 0.85
        agent.transport.configure(agent.id, {"learning": False})
        wait_for(lambda: not next(iter(agent.status().values()))["learning"])
        assert [player.step(obs)["action"] for obs in range(3)] == [0, 1, 2]
