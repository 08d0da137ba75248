"""Whether the parameters of an agent suit its spaces, its advice and each other. No torch."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from django.core.exceptions import ValidationError
from gymnasium import spaces

from agents_app.algorithms import mixing
from agents_app.algorithms.policies import policy_name
from agents_app.checks_agent import HAS_LEARNED, space_of

if TYPE_CHECKING:
    from agents_app.models.agent import Agent

FIXED_PARAMETERS = {
    "net_arch",
    "use_sde",
    "n_critics",
    "normalize_observations",
    "use_rms_prop",
}  # what the weights depend on
LINEAR = "LinearPolicy"
DETERMINISTIC = {"TD3", "DDPG"}  # algorithms whose policy is one action
MOST_MEMORY = 8 * 2**30  # bytes of a replay buffer


def check_parameters(agent: Agent, changes: dict[str, Any]) -> None:
    """Raise ValidationError, by parameter, where new values (None: the default) do not suit the agent or each other."""
    before, defaults = agent.parameters(), agent.algorithm.default_parameters()
    values = before | {name: defaults.get(name) if value is None else value for name, value in changes.items()}
    errors = dict(_unsuitable(agent, values))
    for name in FIXED_PARAMETERS & set(changes):
        if values[name] != before.get(name) and agent.has_learned():
            errors[name] = HAS_LEARNED
    if errors:
        raise ValidationError(errors)


def _unsuitable(agent: Agent, values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Names of parameters, and what is wrong with them."""
    if values.get("use_sde") and isinstance(agent.action_space, int):
        yield "use_sde", "This exploration needs actions that are vectors of numbers: choose no."
    in_dictionaries = isinstance(agent.observation_space, dict) or agent.action_masks
    if (values.get("n_steps") or 1) > 1 and in_dictionaries and "buffer_size" in values:
        what = "actions can be masked" if agent.action_masks else "observations are a dictionary"
        yield "n_steps", f"{agent.algorithm} takes 1 only when {what}: write 1."
    if (
        values.get("net_arch")
        and policy_name(agent.algorithm, space_of(agent, "observation_space"), agent.policy) == LINEAR
    ):
        yield "net_arch", "LinearPolicy has no hidden layers: choose MlpPolicy as the policy type first."
    yield from _single_steps(agent, values)
    if (values.get("n_top") or 0) > values.get("n_delta", 0):
        yield "n_top", f"Write at most the value of n_delta, {values['n_delta']}."
    if (values.get("learning_rate_end") or 0) > values["learning_rate"]:
        yield "learning_rate_end", f"Write at most the learning_rate, {values['learning_rate']}, from which it falls."
    if values.get("gradient_steps") == 0:
        yield "gradient_steps", "With 0 nothing would be learned: write 1 or more, or -1."
    yield from _endless(values)
    yield from _too_large(agent, values)
    by_samples = (agent.advice_method, agent.continuous_advice) == (mixing.INTERSECTION, mixing.BY_SAMPLING)
    if by_samples and agent.algorithm.name in DETERMINISTIC and _is_still(values.get("action_noise") or ""):
        yield (
            "action_noise",
            (
                f"Advice by samples needs to know how probable actions are, and {agent.algorithm} has one action only: write "
                "e.g. normal 0.1, or have advice meet half way."
            ),
        )


def _is_still(noise: str) -> bool:
    """Whether an action_noise is none, such as "normal 0"."""
    return not noise.strip() or np.float32(noise.split()[-1]) == 0


def _endless(values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Numbers in texts that are too large to be any, or of which there is no logarithm."""
    for name in ("ent_coef", "target_entropy", "action_noise"):
        number = re.split("[ _]", str(values.get(name) or "auto").strip())[-1]  # of "auto_0.1", "normal 0.1" or "-1"
        if number != "auto" and not np.isfinite(np.float32(number)):
            yield name, "This number is too large: write a smaller one."
        elif number != "auto" and np.float32(number) == 0 and str(values[name]).startswith("auto"):
            yield name, "The number behind auto_ is where it begins: write more than 0."


def _too_large(agent: Agent, values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """A memory of steps that no machine has. Each step is kept with the observation before it and the one after."""
    space = space_of(agent, "observation_space")
    parts = space.spaces.values() if isinstance(space, spaces.Dict) else [space]
    step = 2 * sum(int(np.prod(part.shape or ())) * np.dtype(part.dtype or np.int64).itemsize for part in parts)
    if (size := values.get("buffer_size") or 0) * step > MOST_MEMORY:
        most = MOST_MEMORY // step
        yield (
            "buffer_size",
            f"{size} steps of such observations take {size * step / 2**30:.0f} GiB: write at most {most}.",
        )


def _single_steps(agent: Agent, values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Where an algorithm would compute a deviation over one step, which is no number, and neither are its weights then."""
    name, batch = agent.algorithm.name, values.get("batch_size") or 0
    normalises = name in ("MaskablePPO", "RecurrentPPO") and values.get("normalize_advantage")
    if normalises and (values["n_steps"] % batch or batch) == 1:
        yield "batch_size", f"A batch of one step would be left over of {values['n_steps']}: write another number."
    if name == "CrossQ" and batch == 1:
        yield "batch_size", "CrossQ compares the steps of a batch: write at least 2."
    if 2 * values.get("sub_sampling_factor", 0) > values.get("n_steps", 0):
        yield "sub_sampling_factor", f"At least two steps must be left of {values['n_steps']}: write a smaller number."
