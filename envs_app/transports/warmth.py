"""What a process does before it forks executions: DESIGN.md section 3, "An execution is cheap"."""

from __future__ import annotations

import gc
from typing import Any


def warm_up() -> None:
    """Import what executions need, train one small model of each kind, and freeze the garbage collector's view of it."""
    import torch as th

    th.set_num_threads(1)
    import gymnasium as gym
    import sb3_contrib  # noqa: F401
    import stable_baselines3 as sb3

    import envs_app.transports.loop  # noqa: F401
    from agents_app.algorithms import eager

    eager.sleep()

    for algorithm, environment in ((sb3.PPO, "CartPole-v1"), (sb3.DQN, "CartPole-v1")):
        sizes: dict[str, Any] = {"n_steps": 16, "batch_size": 16} if algorithm is sb3.PPO else {"learning_starts": 4}
        algorithm("MlpPolicy", gym.make(environment), device="cpu", **sizes).learn(16)
    gc.collect()
    gc.freeze()
