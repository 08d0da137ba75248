"""Algorithms off the policy learn in spite of wrong advice, mixed in other ways than in test_learning.py; from good at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th
from stable_baselines3 import DQN, SAC

from agents_app.algorithms.mixing import REUSE, Mixing
from tests.algorithms.games import Advised, Identity, Point, mean_return
from tests.algorithms.off_policy import METHODS, NOISY, advised, small


class TestLearning:
    QUICK: dict[str, Any] = {"learning_rate": 0.01, "gamma": 0.0, "learning_starts": 100}

    def test_a_choice_is_learned_in_spite_of_wrong_advice(self) -> None:
        wrong = np.array([0.8, 0.1, 0.1], np.float32)
        model = advised(DQN, Advised(Identity(), wrong), METHODS["union"], target_update_interval=50, **self.QUICK)
        assert mean_return(model.learn(1200), Advised(Identity(), wrong)) == 10

    def test_so_is_a_number(self) -> None:
        env = Advised(Point(), np.array([0.9, 0.3], np.float32))
        model = advised(SAC, env, METHODS["sampling"], width=32, batch_size=32, buffer_size=2000, **self.QUICK)
        assert mean_return(model.learn(1000), env) > -1  # doing nothing brings -3.3

    @pytest.mark.parametrize("stock", NOISY)
    def test_so_it_is_where_actions_are_deterministic(self, stock: Any) -> None:
        """Seen with the seeds 0 to 2. By sampling it is not sure to (docs/advice.md)."""
        env = Advised(Point(), np.array([0.9, 0.3], np.float32))
        options = self.QUICK | {"width": 32, "batch_size": 32, "buffer_size": 2000, "seed": 1}
        model = advised(stock, env, Mixing(REUSE), **options)
        assert mean_return(model.learn(1000), env) > -1

    def test_a_newcomer_does_what_a_trained_peer_does(self) -> None:
        trained = advised(DQN, Advised(Identity()), target_update_interval=50, **self.QUICK).learn(1500)
        newcomer = advised(DQN, Advised(Identity()), learning_starts=10_000)
        for seen in range(3):
            obs = np.full(500, seen)
            advice = trained.policy.get_distribution(th.as_tensor(obs)).distribution.probs.numpy()
            newcomer._last_obs = {"_observation": obs, "advice": advice}
            assert (newcomer._sample_action(10_000, None, 500)[0] == seen).mean() > 0.9

    def test_returns_over_several_steps_are_learned_from_too(self) -> None:
        """SB3 has no replay buffer of them for dictionaries; without advice in it, none is needed."""
        plain = DQN("MlpPolicy", Identity(), policy_kwargs={"net_arch": [8]}, **small(DQN, n_steps=3)).learn(100)
        ours = advised(DQN, Advised(Identity()), n_steps=3).learn(100)
        assert type(ours.replay_buffer) is type(plain.replay_buffer)
        assert th.equal(ours.q_net.q_net[0].weight, plain.q_net.q_net[0].weight)
