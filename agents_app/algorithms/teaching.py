"""Who helps an algorithm beside its peers, for whoever uses the algorithms without the server: a policy that was learned before,
also by itself (Self-Transfer), and a simulated human, who advises or punishes.

On the server the first is another agent of the owner (envs_app/execution/frozen.py), and people teach by the client's rewards.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from stable_baselines3.common.callbacks import StopTrainingOnMaxEpisodes

from agents_app.algorithms.actor import advising_policy
from agents_app.algorithms.advice import advised_space, neutral_advice, shaping_reward, with_advice
from agents_app.algorithms.builder import ENDLESS, build, is_advised
from agents_app.algorithms.mixing import SHAPING
from agents_app.algorithms.peer import Peer
from agents_app.algorithms.spec import AgentSpec, see
from agents_app.spaces import parse_space

Advise = Callable[[Any], np.ndarray]  # from an observation to advice (advice.py), (A,), or (2A,) for vectors of numbers
PUNISHMENT = -5.0  # thesis 4.3.2


class Advised(gym.ObservationWrapper):
    """An environment in which somebody advises: the advice rides beside each observation, as in ShepherdEnv."""

    def __init__(self, env: gym.Env, advise: Advise) -> None:
        super().__init__(env)
        self.observation_space = advised_space(env.observation_space, env.action_space)
        self._advise = advise

    def observation(self, observation: Any) -> dict[str, Any]:
        """What the advisor says here."""
        return with_advice(observation, self._advise(observation))


class Judge(Protocol):
    """What somebody gives for an action, beside the environment."""

    def __call__(self, obs: Any, action: Any) -> float:
        """The extra reward."""
        ...


class Judged(gym.Wrapper):
    """An environment whose rewards somebody adds to, seeing what the learner saw and what it did then (thesis 4.3.2, 5.2.1)."""

    def __init__(self, env: gym.Env, judge: Judge) -> None:
        super().__init__(env)
        self._judge, self._seen = judge, None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin anew."""
        self._seen, info = self.env.reset(seed=seed, options=options)
        return self._seen, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """With the extra reward."""
        extra = self._judge(self._seen, action)
        self._seen, reward, terminated, truncated, info = self.env.step(action)
        return self._seen, float(reward) + extra, terminated, truncated, info


def shaped_by(advise: Advise) -> Judge:
    """Reward shaping from an advisor: pi_A(s, a) is added to the reward (thesis 5.2.1)."""
    return lambda obs, action: shaping_reward(advise(obs), action)


@dataclass
class Human:
    """A simulated human who knows what is right, for one of n actions (thesis 4.3.2). Looks up with probability `attentive`.

    :param right: the action that is right at an observation
    :param actions: n
    :param attentive: L, how often something is said
    :param knowing: P(right), how often advice is right
    :param wrong: the action that is advised otherwise; whatever it is, the learner should recover from it
    :param pieces: of advice and punishments together, before no more is said; None: as many as it takes
    :param seed: of what the human draws
    """

    right: Callable[[Any], int]
    actions: int
    attentive: float = 1.0
    knowing: float = 1.0
    wrong: Callable[[Any], int] | None = None
    pieces: int | None = None
    seed: int | None = None
    said: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        """Raises ValueError for one who may be wrong, and would not know what to say then."""
        if self.knowing < 1.0 and self.wrong is None:
            raise ValueError("Somebody who is not always right needs something wrong to say.")
        self._random = np.random.default_rng(self.seed)
        self._nothing = neutral_advice(spaces.Discrete(self.actions))

    def advise(self, obs: Any) -> np.ndarray:
        """An order, (A,), or nothing."""
        if not self._looks_up():
            return self._nothing
        self.said += 1
        wrong = self.wrong is not None and self._random.random() >= self.knowing
        action = self.wrong(obs) if wrong and self.wrong is not None else self.right(obs)
        return np.eye(self.actions, dtype=np.float32)[action]

    def judge(self, obs: Any, action: Any) -> float:
        """-5 for an action that is not right, else 0."""
        if not self._looks_up() or int(action) == self.right(obs):
            return 0.0
        self.said += 1
        return PUNISHMENT

    def _looks_up(self) -> bool:
        attends = self._random.random() < self.attentive
        return attends and (self.pieces is None or self.said < self.pieces)


def advice_of(algorithm: Any) -> Advise:
    """The advice of a policy as it is now, whatever is learned later; of an algorithm that was built to take advice itself.

    It is asked with observations as the network sees them: images with their channels first (`spec.see`).
    """
    if hasattr(algorithm.policy, "action_dist"):  # that of the last batch hangs on gradients, and cannot be copied
        algorithm.policy.action_dist.distribution = None
    return Peer(advising_policy(algorithm)).advice


def self_transfer(spec: AgentSpec, env: gym.Env, seed: int | None, episodes: int) -> Any:
    """Self-Transfer (thesis 6.1, algorithm 2): a fresh algorithm on `env`, advised by what it would have learned in `episodes`.

    The first one learns alone, and is frozen; the second begins with fresh weights, critics and memory, and is returned before it
    has learned anything. Raises ValueError for an agent that takes no advice.
    """
    if not is_advised(spec) or spec.advice_method == SHAPING:
        raise ValueError("Self-Transfer needs an agent that takes advice: choose e.g. intersection.")
    nobody = neutral_advice(env.action_space)
    first = build(spec, Advised(env, lambda obs: nobody), seed)
    first.learn(ENDLESS, callback=StopTrainingOnMaxEpisodes(episodes))
    advise, space = advice_of(first), parse_space(spec.observation_space)
    return build(spec, Advised(env, lambda obs: advise(see(space, obs))), None if seed is None else seed + 1)
