"""The advisors: a policy per environment, trained with PPO until it is good, then frozen (thesis 3.1.2), shared by all figures.

An advisor is a file of weights and the mean return that they bring, results/advisors/<name>.npz. There is nothing else to load:
the network is built anew.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from shepherd_client.spaces import spaces_of
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv

from agents_app.algorithms.builder import build
from agents_app.algorithms.peer import Peer
from agents_app.algorithms.spec import AgentSpec
from agents_app.algorithms.teaching import Advise
from agents_app.algorithms.weights import assign, flatten
from experiments.results import advisor_path

UNIFORM = "uniform"
OURS = "shepherd_environments:"
SEED, EVALUATED, JUDGED = 1234, 30, 500  # episodes: while it is trained, and of the one that is kept


@dataclass(frozen=True)
class Advisor:
    """How one is trained: until its mean return, exploring, is `target`, or `steps` are over; the best so far is kept."""

    environment: str
    target: float
    steps: int
    parameters: dict[str, Any] = field(default_factory=dict)
    environments: int = 8
    check_every: int = 50_000  # steps
    anywhere: bool = False  # begin episodes in any cell, where the goal is hard to find from the corner


# The parameters are those of rl-baselines3-zoo for PPO, without its normalisation of observations and its gSDE.
LANDER: dict[str, Any] = {"n_steps": 1024, "batch_size": 64, "gae_lambda": 0.98, "gamma": 0.999, "n_epochs": 4}
LANDER |= {"ent_coef": 0.01}
CART_POLE = {"n_steps": 32, "batch_size": 256, "gae_lambda": 0.8, "gamma": 0.98, "n_epochs": 20, "learning_rate": 1e-3}
PENDULUM = {"n_steps": 1024, "gae_lambda": 0.95, "gamma": 0.9, "n_epochs": 10, "learning_rate": 1e-3}
ACROBOT = {"n_steps": 256, "gae_lambda": 0.94, "gamma": 0.99, "n_epochs": 4}
ROOMS = {"n_steps": 256, "batch_size": 256, "gamma": 0.99, "ent_coef": 0.01, "learning_rate": 1e-3}
ADVISORS = {
    "lunar-lander": Advisor("LunarLander-v3", 230, 1_500_000, LANDER, 16),
    "lunar-lander-continuous": Advisor("LunarLanderContinuous-v3", 230, 1_500_000, LANDER, 16),
    "cart-pole": Advisor("CartPole-v0", 198, 200_000, CART_POLE, check_every=10_000),
    "pendulum": Advisor("Pendulum-v1", -200, 400_000, PENDULUM, 4),
    "acrobot": Advisor(f"{OURS}ContinuousAcrobot-v0", -90, 1_000_000, ACROBOT, 16),
    "five-rooms-14x12": Advisor(f"{OURS}FiveRooms-14x12-v0", 73, 500_000, ROOMS, 8, 20_000, anywhere=True),
    "five-rooms-23x21": Advisor(f"{OURS}FiveRooms-23x21-v0", 54, 1_000_000, ROOMS, 8, 20_000, anywhere=True),
}


def train(name: str, saves: Path, steps: int | None = None) -> None:
    """Train an advisor and keep it. `steps` at most, if not its own number."""
    advisor = ADVISORS[name]
    env = DummyVecEnv([partial(_environment, advisor, start=True)] * advisor.environments)
    judge = gym.make(advisor.environment)
    algorithm = build(_spec(advisor), env, SEED)
    best, weights = -np.inf, flatten(algorithm.policy)
    while best < advisor.target and algorithm.num_timesteps < (steps or advisor.steps):
        algorithm.learn(advisor.check_every if steps is None else 1, reset_num_timesteps=False)
        episodes = EVALUATED if steps is None else 1
        mean = float(np.mean(evaluate_policy(algorithm, judge, episodes, deterministic=False, warn=False)[0]))
        if mean > best:
            best, weights = mean, flatten(algorithm.policy)
    note = {"steps": algorithm.num_timesteps, "target": advisor.target}
    saves.mkdir(parents=True, exist_ok=True)
    _keep(name, saves, weights, note | {"mean_return": mean_return(name, weights, JUDGED if steps is None else 1)})


def judge_again(name: str, saves: Path) -> None:
    """Say anew what a kept advisor earns."""
    with np.load(advisor_path(saves, name), allow_pickle=False) as file:
        weights, note = file["weights"], json.loads(str(file["note"]))
    _keep(name, saves, weights, note | {"mean_return": mean_return(name, weights)})


def mean_return(name: str, weights: np.ndarray, episodes: int = JUDGED) -> float:
    """What a policy earns, exploring, in episodes of which none has chosen it: the best of several trials was lucky, too."""
    advisor = ADVISORS[name]
    policy, judge = build(_spec(advisor), _environment(advisor), SEED).policy, gym.make(advisor.environment)
    assign(policy, weights)
    judge.reset(seed=SEED)
    return round(float(np.mean(evaluate_policy(policy, judge, episodes, deterministic=False, warn=False)[0])), 1)


def _keep(name: str, saves: Path, weights: np.ndarray, note: dict[str, Any]) -> None:
    new = saves / f"{name}.new.npz"
    np.savez_compressed(new, weights=weights, note=np.array(json.dumps(note)))
    new.replace(advisor_path(saves, name))


def load(name: str, saves: Path) -> Advise:
    """The advice of a trained advisor, as an execution's peer gives it."""
    advisor = ADVISORS[name]
    policy = build(_spec(advisor), _environment(advisor), SEED).policy
    with np.load(advisor_path(saves, name), allow_pickle=False) as file:
        assign(policy, file["weights"])
    return Peer(policy).advice


def uniform(space: spaces.Space) -> Advise:
    """An advisor that does not look: any action; a continuous one around the middle, as wide as half the range."""
    if isinstance(space, spaces.Discrete):
        advice = np.full(int(space.n), 1 / space.n, np.float32)
    else:
        assert isinstance(space, spaces.Box)
        advice = np.concatenate([(space.low + space.high).ravel() / 2, (space.high - space.low).ravel() / 2])
    return lambda obs: advice


def _spec(advisor: Advisor) -> AgentSpec:
    notes = spaces_of(gym.make(advisor.environment))
    return AgentSpec("PPO", notes.action_space, notes.observation_space, parameters=advisor.parameters)


def _environment(advisor: Advisor, start: bool = False) -> gym.Env:
    env = gym.make(advisor.environment)
    return AnyCell(env) if start and advisor.anywhere else env


class AnyCell(gym.Wrapper):
    """Five Rooms, begun in any cell."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Drawn evenly, the goal too: its episode ends when it is left and entered again."""
        self.env.reset(seed=seed)
        rooms: Any = self.unwrapped
        cells = rooms.free_cells()
        return self.env.reset(options={"cell": cells[rooms.np_random.integers(len(cells))]})
