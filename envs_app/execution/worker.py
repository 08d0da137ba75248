"""An execution, but for its sockets: it builds the agent's algorithm, acts, records, and lets the learner learn."""

from __future__ import annotations

import logging
import os
import random
import sys
import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zlib import crc32

import gymnasium as gym
import numpy as np
import torch as th

import envs_app.shepherd_env  # noqa: F401  (registers ShepherdEnv-v0)
from agents_app.algorithms import builder, maskable, on_policy
from agents_app.algorithms.actor import advice_weights
from agents_app.algorithms.advice import shaping_reward, with_advice
from agents_app.algorithms.direct import LiveFeed
from agents_app.algorithms.masks import with_mask
from agents_app.algorithms.mixing import SHAPING
from agents_app.algorithms.replay import Decision
from agents_app.algorithms.spec import AgentSpec, see
from agents_app.algorithms.weights import flatten
from agents_app.spaces import parse_space
from envs_app.execution.advisors import Advisors, Peers
from envs_app.execution.averaging import Averaging
from envs_app.execution.frozen import Frozen, FrozenSpec, NoAdvisor, load
from envs_app.execution.lane import Lane
from envs_app.execution.learner import Learner
from envs_app.execution.saves import SaveMeta, SaveStore
from envs_app.execution.storage import Storage
from envs_app.execution.turns import Turns, cores

PACE_SECONDS, BRAKE_SECONDS = (
    0.003,
    0.3,
)  # between decisions while an update is made: as it begins, and at the full lead

LEARN_BY_ROLLOUTS = (on_policy, maskable)  # and lose nothing where these are cut, as a memory of the episode would
COUNTED = ("exploration_rate", "_n_calls")  # of DQN and QR-DQN; by the calls the slow copy of the network is renewed

log = logging.getLogger("shepherd.execution")


@dataclass
class ExecutionSpec:
    """What an execution is started with."""

    uid: str
    number: int
    run: int
    agent_id: str
    agent: AgentSpec
    saves: str  # where the run's saves are in the storage
    turns: str = ""  # folder of the machine's turns for long updates; empty: everybody trains at will
    learning: bool = True
    start_from: str = "latest"
    save_interval: int = 10_000
    saves_kept: int = 5
    sessions: int = 1  # that may be in the middle of an episode at once
    reclaim_seconds: float = 120.0
    answer_within: float = 0.0  # seconds of silence that end an episode; 0: none do
    unanswered_reward: float = 0.0  # of its last action
    seed: int | None = None
    advisor: FrozenSpec | None = None  # another agent

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> ExecutionSpec:
        """From a message."""
        advisor = data.get("advisor")
        frozen = None if advisor is None else FrozenSpec.from_dict(advisor)
        return cls(**{**data, "agent": AgentSpec(**data["agent"]), "advisor": frozen})


@dataclass
class Counters:
    """What the execution has done; restored from the save it began with, but for what is said otherwise."""

    steps: int = 0  # answered since the execution began
    episodes: int = 0  # ended since the run began, as this line of saves knows
    returns: deque[float] = field(default_factory=lambda: deque(maxlen=100))

    def mean_return(self) -> float | None:
        """Over the last 100 episodes."""
        return float(np.mean(self.returns)) if self.returns else None


class Worker:
    """The algorithm, its actor and its learner. Everything but the learner belongs to the thread that makes it."""

    def __init__(
        self,
        spec: ExecutionSpec,
        storage: Storage,
        peers: Peers,
        publish: Callable[[np.ndarray], bool],
        wake: Callable[[], None],
        report: Callable[[dict[str, Any]], None],
    ) -> None:
        """`publish`, `wake` and `report` are called from the learner's thread; `publish` returns whether it went out."""
        self.spec, self.counters = spec, Counters()
        self.learning = spec.learning
        self.client_space = parse_space(spec.agent.observation_space)
        self.action_space = spec.agent.actions()
        self._report, self._wake, self._publish_weights = report, wake, publish
        self.failure: str | None = None
        self.save_error = ""
        family = builder.family_of(spec.agent)
        self.feed: Any = family.make_feed()
        self.direct = isinstance(self.feed, LiveFeed)
        self.masked = builder.is_masked(spec.agent)
        self.algorithm = self._build()
        self.storage, self.store = storage, SaveStore(storage, spec.saves)
        knows = self._restore()
        self.actor = family.make_actor(self.algorithm)
        self.rollout = self.algorithm.n_steps if family in LEARN_BY_ROLLOUTS else sys.maxsize
        self.allowed_lead = family.allowed_lead(self.algorithm)
        self.advisors = None
        if builder.is_advised(spec.agent):
            self.advisors = Advisors(self.algorithm, peers, spec.agent, self._frozen_advisor())
        averaged = builder.is_averaged(spec.agent)
        self.averaging = Averaging(self.algorithm.policy, peers, knows) if averaged else None
        family.attach(self.algorithm, self.feed)
        self.learner = Learner(
            self.algorithm,
            self._needed_weights(family),
            spec.save_interval,
            self._save,
            self._published,
            self._failed,
            self._turns(family),
            self.averaging,
        )
        self._has_long_updates = family.has_long_updates(self.algorithm)
        self._seen: np.ndarray | None = None
        self._needs_warming_up(family)
        self.feed.on_action = self.feed.on_taken = wake
        self.feed.pause(not self.learning)
        self.learner.start()

    def pace(self) -> float:
        """Seconds that should lie between two decisions now: what is decided during an update is decided by an old policy.

        It begins with next to nothing and rises steeply towards the bound of the lead, so that nobody runs into it
        (docs/adr/0003)."""
        if not (self._has_long_updates and self.learner.updating and self.learning):
            return 0.0
        return min(BRAKE_SECONDS, PACE_SECONDS + BRAKE_SECONDS * (self.feed.backlog / self.allowed_lead) ** 4)

    def set_learning(self, learning: bool) -> None:
        """Learn, or only act, from now on, with what was learned until now; an update that is being made is part of that.

        What was learned is saved as learning ends: it publishes no more, and newcomers shall know it too.
        """
        self.learning = learning
        self.feed.pause(not learning)
        if not learning:
            self.feed.send_errand(lambda: self.learner.save_if_newer(1))

    def show(self, obs: Any, mask: np.ndarray | None = None) -> Any:
        """A client's observation as the algorithm sees it, with the mask if the agent takes any; advice is not asked for."""
        seen = see(self.client_space, obs)
        return with_mask(seen, mask, self.action_space.n) if self.masked else seen  # type: ignore[attr-defined]

    def see(self, obs: Any, advice: np.ndarray | None = None, mask: np.ndarray | None = None) -> Any:
        """The same, with the client's advice or a peer's if the agent takes any."""
        seen = self.show(obs, mask)
        if self.advisors is None:
            return seen
        return with_advice(seen, self.advisors.advise(seen) if advice is None else self.advisors.temper(advice, seen))

    def bonus(self, decision: Decision) -> float:
        """What the learner is given on top of the client's reward: reward shaping, thesis 5.2.1."""
        if self.advisors is None or self.spec.agent.advice_method != SHAPING:
            return 0.0
        return self.spec.agent.shaping_scale * shaping_reward(decision.obs["advice"], decision.action)

    def refresh(self) -> None:
        """Let the actor act with what was learned last."""
        if self.learner.published is not self._seen:
            self._seen = self.learner.published
            self.actor.update(self._seen)

    def save_now(self, ticket: int = 0) -> None:
        """Have the learner save what is unsaved as soon as its policy is whole, and say so."""
        self.feed.send_errand(lambda: self._save_for(ticket))

    def catch_up(self) -> None:
        """Take over what other executions have learned meanwhile, if this one learns with them, and nobody uses it."""
        if self.averaging is not None and self.learning:
            self.feed.send_errand(self.learner.catch_up)

    def _save_for(self, ticket: int) -> None:
        self.learner.save_if_newer(1)
        self._report({"k": "save_answered", "ticket": ticket})

    def stop(self, patience: float) -> bool:
        """End the learner, which saves; wait for it `patience` seconds. Returns whether it ended."""
        self.learner.ending = True
        self.feed.close()
        self.learner.join(patience)
        return not self.learner.is_alive()

    def status(self) -> dict[str, Any]:
        """What the execution says of itself, for the admin."""
        return {
            "steps": self.counters.steps,
            "episodes": self.counters.episodes,
            "updates": int(self.algorithm._n_updates),
            "mean_return": self.counters.mean_return(),
            "advisors": self.advisors.names() if self.advisors and self.learning else [],
            "learning": self.learning,
            "save_error": self.save_error,
        }

    def _needed_weights(self, family: Any) -> Callable[[], np.ndarray] | None:
        """What is published after an update: for the actor the whole policy, unless it shares it; for peers what advises."""
        policy = self.algorithm.policy
        if family.SHARES_WEIGHTS:
            return (lambda: advice_weights(policy)) if self.advisors else None
        return lambda: flatten(policy)

    def _turns(self, family: Any) -> Turns | None:
        """Where this learner waits before an update; None if its updates are short."""
        if not self.spec.turns or not family.has_long_updates(self.algorithm):
            return None
        return Turns(Path(self.spec.turns), cores())

    def _build(self) -> Any:
        """The algorithm, with seeds of its own. Those that average begin alike: of unrelated networks no mean is any good."""
        spec = self.spec
        seed = seed_everything(spec.seed, spec.number)
        if not builder.is_averaged(spec.agent):
            return builder.build(spec.agent, self._environment(), seed)
        of_all = crc32(f"{spec.agent_id} {spec.run}".encode()) if spec.seed is None else spec.seed
        algorithm = builder.build(spec.agent, self._environment(), of_all)
        algorithm.set_random_seed(seed)
        return algorithm

    def _environment(self) -> gym.Env | Lane:
        space = builder.seen_space(self.spec.agent)
        env = gym.make("ShepherdEnv-v0", observation_space=space, action_space=self.action_space, feed=self.feed)
        return env if self.direct else Lane(env)

    def _restore(self) -> int:
        """Go on from a save of the run: weights, optimisers, counters. A save that does not fit is passed over, and said.

        Returns what it knows, as averaging.py counts that.
        """
        if (chosen := self.store.choose(self.spec.start_from)) is None:
            return 0
        name, meta, model = chosen
        try:
            builder.restore(self.algorithm, model)
        except Exception:
            self._report({"k": "error", "summary": f"save {name} does not fit", "traceback": traceback.format_exc()})
            self.algorithm = self._build()  # half of the save may be in it
            return 0
        self.algorithm.num_timesteps = meta.steps
        self.algorithm._n_updates = meta.updates
        self.algorithm._episode_num = meta.episodes
        for key, value in meta.extra.items():
            setattr(self.algorithm, key, value)
        self.counters.episodes = meta.episodes
        self.counters.returns.extend(meta.recent_returns)
        return meta.knows

    def _frozen_advisor(self) -> Frozen | None:
        """Another agent, if one shall advise; one that cannot is passed over, and said."""
        if self.spec.advisor is None:
            return None
        try:
            return load(self.spec.advisor, self.spec.agent, self.storage)
        except NoAdvisor as error:
            summary = f"{self.spec.advisor.name} does not advise: {error}"
            self._report({"k": "error", "summary": summary, "traceback": traceback.format_exc()})
            return None

    def _needs_warming_up(self, family: Any) -> None:
        """Off the policy, a restored execution has an empty replay buffer: it acts as it learned to, and fills it first."""
        algorithm = self.algorithm
        if family.SHARES_WEIGHTS and algorithm.num_timesteps > 0:
            algorithm.learning_starts += algorithm.num_timesteps

    def _published(self) -> bool:
        if (weights := self.learner.published) is None:
            return False
        if self.averaging is not None:
            return self._publish_weights(self.averaging.publication(weights))
        return self.advisors is not None and self._publish_weights(weights)

    def _failed(self, text: str) -> None:
        self.failure = text
        self._wake()

    def _save(self) -> bool:
        """In the learner's thread, between updates. Returns whether it could."""
        algorithm, counters = self.algorithm, self.counters
        meta = SaveMeta(
            execution=self.spec.uid,
            number=self.spec.number,
            steps=algorithm.num_timesteps,
            updates=int(algorithm._n_updates),
            episodes=counters.episodes,
            mean_return=counters.mean_return(),
            recent_returns=list(counters.returns),
            knows=self.averaging.knows if self.averaging else 0,
            idle=time.monotonic() - self.learner.learned_at,
            extra={name: getattr(algorithm, name) for name in COUNTED if hasattr(algorithm, name)},
        )
        try:
            name = self.store.write(meta, lambda model: builder.export(algorithm, self.spec.agent, model))
            self.store.prune(self.spec.saves_kept)
            self.save_error = ""
            self._report({"k": "saved", "name": name})
            return True
        except Exception as error:
            log.warning("execution %s could not save: %s", self.spec.number, error)
            self.save_error = str(error)
            self._report({"k": "error", "summary": f"could not save: {error}", "traceback": traceback.format_exc()})
            return False


def seed_everything(seed: int | None, number: int) -> int:
    """Seed all generators anew: a forked process inherits its parent's. Returns the algorithm's own seed."""
    chosen = int.from_bytes(os.urandom(4), "big") if seed is None else seed + 7919 * number
    chosen %= 2**31
    random.seed(chosen)
    np.random.seed(chosen)
    th.manual_seed(chosen)
    return chosen
