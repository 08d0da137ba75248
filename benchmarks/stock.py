"""A history of stock Stable-Baselines3, in process."""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium as gym

from benchmarks.histories import FIRST_EXECUTION, Case, Log, Recorder
from benchmarks.rig import ROLLOUT


def learn(case: Case, seed: int, environments: int) -> list[list[float]]:
    """The episodes. Environments and algorithm have the seeds that they have over HTTP, and rollouts the same length."""
    import stable_baselines3
    import torch as th
    from stable_baselines3.common.vec_env import DummyVecEnv

    th.set_num_threads(1)  # as in an execution
    log, parameters = Log(), dict(case.parameters)
    parameters.pop("total_timesteps", None)
    if layers := parameters.pop("net_arch", None):
        parameters["policy_kwargs"] = {"net_arch": [int(size) for size in layers.split(",")]}
    algorithm: type[Any] = getattr(stable_baselines3, case.algorithm)
    if environments > 1:
        parameters["n_steps"] = parameters.get("n_steps", ROLLOUT) // environments
    env = DummyVecEnv([partial(_environment, case, log, seed + 1000 * number) for number in range(environments)])
    algorithm("MlpPolicy", env, seed=seed + FIRST_EXECUTION, device="cpu", **parameters).learn(case.steps)
    return log.episodes


def _environment(case: Case, log: Log, seed: int) -> gym.Env:
    return SeedOnce(Recorder(gym.make(case.environment), log), seed)


class SeedOnce(gym.Wrapper):
    """Resets with this seed at first, whatever the algorithm says: as the client over HTTP does."""

    def __init__(self, env: gym.Env, seed: int) -> None:
        super().__init__(env)
        self.first: int | None = seed

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        """As the environment."""
        seed, self.first = self.first, None
        return self.env.reset(seed=seed, options=kwargs.get("options"))
