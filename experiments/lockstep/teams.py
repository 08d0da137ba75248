"""Teams of learners that advise each other as executions do: with the policies published after their last updates.

Learners of a team step at the same pace and so update at the same time. At each step a learner hears one of its peers, drawn as
`advisors` says. All teams are played at once, each with its own seeds; a team that has its episodes waits for the others.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
import torch as th

from agents_app.algorithms.advice import combine, combine_logs, mix_logits
from agents_app.algorithms.mixing import ALL, BEST, GEOMETRIC, RANDOM, SEVERAL, Mixing
from envs_app.execution.advisors import SEVERAL_ARE
from experiments.figure import Episodes
from experiments.lockstep.networks import Networks, in_numpy, run_in_numpy
from experiments.lockstep.ppo import PPO, Rollout, Settings, advantages

RECENT = 20  # episodes whose mean return tells who is good


@dataclass(frozen=True)
class Rules:
    """How a team plays."""

    environment: str
    size: int = 1  # learners of a team
    mixing: Mixing = Mixing()  # noqa: RUF009  (frozen)
    advisors: str = RANDOM
    rho: float = 1.0
    settings: Settings = field(default_factory=Settings)
    averaging: bool = False  # after each update, each learner goes on from the mean of its team


class Teams:
    """S teams of K learners: L = S K, those of one team beside each other."""

    def __init__(self, rules: Rules, seeds: list[int]) -> None:
        """The seed of a team gives all of its environments other seeds; weights and actions follow from all seeds."""
        self.rules, self.count, self.size = rules, len(seeds), rules.size
        learners = self.count * self.size
        th.manual_seed(seeds[0])
        self._rng = np.random.RandomState(seeds[0])
        self._environments = [gym.make(rules.environment, disable_env_checker=True) for _ in range(learners)]
        self._observations = self._reset_all(seeds)
        space: Any = self._environments[0].action_space
        self._actions = int(space.n)
        self.networks = Networks(learners, self._observations.shape[1], self._actions)
        if rules.averaging:
            self.networks.begin_alike(self.size)
        self.ppo = PPO(self.networks, rules.settings, rules.mixing if self.size > 1 else None)
        self._starts = np.ones(learners, np.float32)
        self._totals, self._steps = np.zeros(learners), 0
        self._recent: list[deque[float]] = [deque(maxlen=RECENT) for _ in range(learners)]
        self._returns = np.full(learners, -np.inf)
        self._eligible = self._find_eligible()
        self.episodes: list[Episodes] = [[] for _ in range(learners)]

    def play(self, episodes: int, on_episode: Callable[[], None] = lambda: None) -> None:
        """Until every learner has ended so many episodes."""
        self._wanted, self._on_episode = episodes, on_episode
        while not all(len(log) >= episodes for log in self.episodes):
            rollout = self._rollout()
            last_values = self._values()
            gains = advantages(rollout, last_values, self._starts, self.rules.settings)
            self.ppo.train(rollout, gains, self._rng, np.repeat(self._playing(), self.size))
            if self.rules.averaging:
                self.networks.average(self.size)

    def returns_alone(self, episodes: int) -> np.ndarray:
        """What each learner earns by its own probabilities, without advice, (L, episodes); nothing is learned."""
        env = gym.make(self.rules.environment, disable_env_checker=True)
        return np.array([[self._alone(learner, env) for _ in range(episodes)] for learner in range(len(self.episodes))])

    def _alone(self, learner: int, env: gym.Env) -> float:
        layers = [(weight[learner], bias[learner]) for weight, bias in in_numpy(self.networks.actor)]
        total, ended = 0.0, False
        observation, _ = env.reset(seed=int(self._rng.randint(2**31 - 1)))
        while not ended:
            (action,) = self._draw(log_softmax_rows(run_in_numpy(layers, observation[None])))
            observation, reward, terminated, truncated, _ = env.step(int(action))
            total, ended = total + float(reward), terminated or truncated
        return total

    def _rollout(self) -> Rollout:
        steps = [self._step(np.repeat(self._playing(), self.size)) for _ in range(self.rules.settings.n_steps)]
        return Rollout(*(np.stack(part) for part in zip(*steps, strict=True)))

    def _playing(self) -> np.ndarray:
        """Which teams have not ended their episodes, (S,)."""
        full = np.array([len(log) >= self._wanted for log in self.episodes])
        return full.reshape(self.count, self.size).sum(1) < self.size

    def _step(self, playing: np.ndarray) -> tuple[np.ndarray, ...]:
        """One step of those who are `playing`, (L,); one row of a rollout."""
        observations, starts, values = self._observations.copy(), self._starts.copy(), self._values()
        own, advice = self._policies()
        mixed = log_softmax_rows(own if self.ppo.mixing is None else mix_logits(own, advice, self.rules.mixing))
        actions = self._draw(mixed)
        corrected = self.ppo.mixing is None or self.rules.mixing.correction
        seen = mixed if corrected else log_softmax_rows(own)
        log_probs = seen[np.arange(len(actions)), actions]
        rewards = np.zeros_like(values)
        for learner in np.flatnonzero(playing):
            rewards[learner] = self._act(int(learner), int(actions[learner]))
        self._steps += 1
        return observations, actions, rewards, starts, values, log_probs, advice

    def _act(self, learner: int, action: int) -> float:
        """A step of one environment; the reward, with the value of what comes after an episode that was cut."""
        observation, reward, terminated, truncated, _ = self._environments[learner].step(action)
        self._totals[learner] += float(reward)
        self._observations[learner], self._starts[learner] = observation, terminated or truncated
        if not (terminated or truncated):
            return float(reward)
        after = 0.0 if terminated else self.rules.settings.gamma * float(self._values()[learner])
        self._note(learner, float(self._totals[learner]))
        self._totals[learner] = 0.0
        self._observations[learner] = self._environments[learner].reset()[0]
        return float(reward) + after

    def _note(self, learner: int, total: float) -> None:
        self._recent[learner].append(total)
        self._returns[learner] = np.mean(self._recent[learner])
        self._eligible = self._find_eligible()
        self.episodes[learner].append([self._steps + 1, total])
        if len(self.episodes[learner]) <= self._wanted:
            self._on_episode()

    def _reset_all(self, seeds: list[int]) -> np.ndarray:
        each = [1000 * seed + number for seed in seeds for number in range(self.size)]
        return np.stack([env.reset(seed=seed)[0] for env, seed in zip(self._environments, each, strict=True)])

    def _values(self) -> np.ndarray:
        """Of the present observations, (L,)."""
        return run_in_numpy(in_numpy(self.networks.critic), self._observations[:, None])[:, 0, 0]

    def _policies(self) -> tuple[np.ndarray, np.ndarray]:
        """Own logits and advice, (L, A) each."""
        teams = (self.count, self.size)
        layers = [(w.reshape(*teams, *w.shape[1:]), b.reshape(*teams, 1, -1)) for w, b in in_numpy(self.networks.actor)]
        seen = self._observations.reshape(self.count, 1, self.size, -1)
        logits = run_in_numpy(layers, seen)  # (S, K who speaks, K who is there, A)
        own = own_entries(logits).reshape(-1, self._actions)
        if self.ppo.mixing is None:
            return own, np.ones_like(own)
        return own, self._advice(np.exp(log_softmax_rows(logits)))

    def _advice(self, probabilities: np.ndarray) -> np.ndarray:
        """(S, K who speaks, K who is there, A) -> (L, A)."""
        team, place = np.arange(self.count)[:, None], np.arange(self.size)[None]
        asked = {ALL: self.size - 1, SEVERAL: min(SEVERAL_ARE, self.size - 1)}.get(self.rules.advisors, 1)
        draws = self._rng.random_sample(self._eligible.shape) * self._eligible
        peers = np.moveaxis(draws.argsort(-1)[..., ::-1][..., :asked], -1, 0)  # (asked, S, K)
        mean = combine_logs if self.rules.mixing.method == GEOMETRIC else combine
        advice = mean([probabilities[team, peer, place] for peer in peers], self.rules.rho)
        return np.where(self._eligible.any(axis=-1, keepdims=True), advice, 1.0).reshape(-1, self._actions)

    def _find_eligible(self) -> np.ndarray:
        """Whom each learner may hear: (S, K who is there, K who speaks)."""
        returns = self._returns.reshape(self.count, self.size)
        others = np.broadcast_to(~np.eye(self.size, dtype=bool), (self.count, self.size, self.size))
        if self.rules.advisors == BEST:
            judged = np.where(others, returns[:, None, :], -np.inf)
            return others & (judged == judged.max(-1, keepdims=True))
        return others

    def _draw(self, log_probs: np.ndarray) -> np.ndarray:
        """An action of each learner, (L,)."""
        cumulated = np.exp(log_probs).cumsum(-1)
        thresholds = self._rng.random_sample((len(log_probs), 1)) * cumulated[:, -1:]
        return np.minimum((cumulated <= thresholds).sum(-1), self._actions - 1)


def own_entries(of_all: np.ndarray) -> np.ndarray:
    """Of those who speak where they are themselves: (S, K, K, A) -> (S, K, A)."""
    return of_all.diagonal(axis1=1, axis2=2).swapaxes(1, 2)


def log_softmax_rows(logits: np.ndarray) -> np.ndarray:
    """Logarithms of the probabilities, (..., A)."""
    shifted = logits - logits.max(-1, keepdims=True)
    return shifted - np.log(np.exp(shifted).sum(-1, keepdims=True))
