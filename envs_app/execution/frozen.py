"""A frozen advisor: another agent of the owner, whose save advises as it acted (DESIGN.md section 1; thesis 5.2, 5.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import torch as th

from agents_app.algorithms import builder
from agents_app.algorithms.actor import advising_policy
from agents_app.algorithms.advice import advised_space
from agents_app.algorithms.mixing import INTERSECTION
from agents_app.algorithms.registry import get_row
from agents_app.algorithms.spec import AgentSpec
from envs_app.execution.saves import SaveStore
from envs_app.execution.storage import Storage


class NoAdvisor(RuntimeError):
    """The agent that should advise cannot; the message says why."""


@dataclass
class FrozenSpec:
    """What is known of the agent that advises."""

    name: str
    agent: AgentSpec
    saves: str  # where its run's saves are in the storage
    rule: str = "latest"  # which of them: or "best"

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> FrozenSpec:
        """From a message."""
        return cls(**{**data, "agent": AgentSpec(**data["agent"])})


@dataclass
class Frozen:
    """The advisor: its policy with the weights of the save, and how good that was."""

    name: str
    policy: Any
    mean_return: float | None


def load(spec: FrozenSpec, learner: AgentSpec, storage: Storage) -> Frozen:
    """The advisor for a learner, in this process. Draws no random number that others see. Raises NoAdvisor."""
    if not get_row(spec.agent.algorithm).advice:
        raise NoAdvisor(f"{spec.agent.algorithm} gives no probabilities to advise with")
    if (spec.agent.actions(), spec.agent.observations()) != (learner.actions(), learner.observations()):
        raise NoAdvisor("its actions or observations are others now")
    if (chosen := SaveStore(storage, spec.saves).choose(spec.rule)) is None:
        raise NoAdvisor("it has no save yet")
    try:
        with th.random.fork_rng(devices=[]):
            algorithm = _build(spec.agent)
            builder.restore(algorithm, chosen.model)
            for key, value in chosen.meta.extra.items():
                setattr(algorithm, key, value)
            return Frozen(spec.name, advising_policy(algorithm), chosen.meta.mean_return)
    except Exception as error:
        raise NoAdvisor(f"its save {chosen.name} cannot be loaded: {error}") from error


def _build(agent: AgentSpec) -> Any:
    """Its algorithm, of which the policy is wanted alone: without a replay buffer, and of the class that can be asked."""
    parameters = agent.parameters | ({"buffer_size": 1} if "buffer_size" in agent.parameters else {})
    spec = replace(agent, parameters=parameters, advice_method=INTERSECTION, continuous_advice="mean")
    return builder.build(spec, Nowhere(spec), None)


class Nowhere(gym.Env):
    """An environment that has spaces, and is never played."""

    def __init__(self, spec: AgentSpec) -> None:
        self.action_space = spec.actions()
        self.observation_space = advised_space(spec.observations(), self.action_space)
