"""Advised algorithms off the policy, to ask what they draw."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from sb3_contrib import QRDQN, TQC
from stable_baselines3 import DDPG, DQN, SAC, TD3
from stable_baselines3.common.noise import NormalActionNoise

from agents_app.algorithms.advised_off_policy import advised_classes
from agents_app.algorithms.mixing import BY_SAMPLING, GEOMETRIC, REUSE, SHAPING, UNION, Mixing
from tests.algorithms.games import Advised, Identity, Point

SMALL: dict[str, Any] = {"learning_starts": 20, "batch_size": 8, "buffer_size": 300, "seed": 3, "device": "cpu"}
VALUES, ACTORS, NOISY = (DQN, QRDQN), (SAC, TQC, TD3, DDPG), (TD3, DDPG)
EVERY = pytest.mark.parametrize("stock", [*VALUES, *ACTORS])
METHODS: dict[str, Mixing] = {
    "intersection": Mixing(),
    "sampling": Mixing(continuous=BY_SAMPLING),
    "geometric": Mixing(GEOMETRIC, weight=4.0),
    "union": Mixing(UNION),
    "reuse": Mixing(REUSE, psi=0.9),
    "shaping": Mixing(SHAPING),
}
WIDE = 4000  # so many draws at once
WITHOUT = Mixing()


class Plane(gym.Env[Any, Any]):
    """Two numbers to say, between bounds that are not -1 and 1: its only use is its spaces."""

    observation_space = spaces.Box(-1, 1, (3,), np.float32)
    action_space = spaces.Box(np.array([-4, 0], np.float32), np.array([4, 10], np.float32))


class Choice(gym.Env[Any, Any]):
    """One of four."""

    observation_space = spaces.Box(-1, 1, (3,), np.float32)
    action_space = spaces.Discrete(4)


def small(stock: Any, **options: Any) -> dict[str, Any]:
    """Arguments with which it learns quickly; noise where there would be none."""
    noise = {"action_noise": NormalActionNoise(np.zeros(1), np.full(1, 0.2))} if stock in NOISY else {}
    return {**SMALL, **noise, "train_freq": 2, "gradient_steps": 1, **options}


def game(stock: Any) -> gym.Env:
    """One that it can play."""
    return Identity() if stock in VALUES else Point()


def advised(stock: Any, env: gym.Env, mixing: Mixing = WITHOUT, width: int = 8, **options: Any) -> Any:
    """The algorithm that takes advice, on a game that gives some."""
    algorithm, policy = advised_classes(stock, stock.policy_aliases["MlpPolicy"])
    return algorithm(policy, env, policy_kwargs={"net_arch": [width], "mixing": mixing}, **small(stock, **options))


def here(stock: Any, mixing: Mixing = WITHOUT, noise: float = 0.2, **options: Any) -> Any:
    """An advised algorithm in the plane or before a choice, past its warm-up."""
    env = Advised(Choice() if stock in VALUES else Plane())
    if stock in NOISY:
        options = {"action_noise": NormalActionNoise(np.zeros(2), np.full(2, noise)) if noise else None, **options}
    model = advised(stock, env, mixing, **options)
    model.num_timesteps = 1000
    return model


def draws(model: Any, advice: Any, count: int = WIDE, seed: int = 1) -> np.ndarray:
    """Actions drawn at one place with one advice, (count, ...)."""
    th.manual_seed(seed)
    np.random.seed(seed)
    where = np.tile(np.array([0.3, -0.5, 0.9], np.float32), (count, 1))
    model._last_obs = {"_observation": where, "advice": np.tile(np.asarray(advice, np.float32), (count, 1))}
    noise = model.action_noise
    wide = None if noise is None else lambda: np.stack([noise() for _ in range(count)])
    action, buffered = model._sample_action(model.learning_starts, wide, count)
    if isinstance(model.action_space, spaces.Box):
        assert action == pytest.approx(model.policy.unscale_action(buffered))
        assert np.abs(buffered).max() <= 1
    return action


def place() -> th.Tensor:
    """The place, as networks see it."""
    return th.tensor([[0.3, -0.5, 0.9]])


def shares(actions: np.ndarray) -> np.ndarray:
    """How often each of four is chosen."""
    return np.bincount(actions, minlength=4) / len(actions)


def set_actor(model: Any, mean: list[float], deviation: float = 0.3) -> None:
    """Let the actor's last layers say this everywhere; of SAC's, before it is squashed."""
    with th.no_grad():
        last = model.actor.mu if isinstance(model.actor.mu, th.nn.Linear) else model.actor.mu[-2]
        last.weight.zero_()
        last.bias[:] = th.tensor(mean)
        if isinstance(getattr(model.actor, "log_std", None), th.nn.Linear):
            model.actor.log_std.weight.zero_()
            model.actor.log_std.bias.fill_(np.log(deviation))


def set_values(model: Any, best: int) -> None:
    """Let one action be worth most everywhere."""
    net = model.q_net.q_net if hasattr(model, "q_net") else model.quantile_net.quantile_net
    with th.no_grad():
        net[-1].weight.zero_()
        net[-1].bias.view(-1, 4)[:] = th.nn.functional.one_hot(th.tensor(best), 4).float()
