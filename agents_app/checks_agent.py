"""Whether an agent's algorithm, policy, spaces and advice fit together. No torch."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from django.core.exceptions import ValidationError
from gymnasium import spaces

from agents_app.algorithms import mixing
from agents_app.algorithms.policies import (
    AUTO,
    CNN,
    DICTIONARY,
    SMALLEST_IMAGE,
    VECTOR,
    convolves,
    kind_of_policy,
)
from agents_app.algorithms.registry import get_row
from agents_app.spaces import is_image, parse_space

if TYPE_CHECKING:
    from agents_app.models.agent import Agent
    from agents_app.models.catalogue import Algorithm

SPACES = ("action_space", "observation_space")
FIXED = ("policy", *SPACES, "action_features")  # what the weights depend on
HAS_LEARNED = "The agent has learned with another value: reset its learning first, or make a new agent."
NO_ADVICE = "none"
REACH = 10.0  # half of the widest bounds in which an algorithm on the policy soon finds its way


def check_agent(agent: Agent) -> None:
    """Raise ValidationError with a sentence that says what to write."""
    algorithm = agent.algorithm if agent.algorithm_id else None
    if algorithm and agent._state.adding and not algorithm.listed:
        raise ValidationError({"algorithm": f"{algorithm} is no longer offered: choose another algorithm."})
    _check_numbers(agent)
    if agent.action_space is None or agent.observation_space is None:
        return  # the field itself says that it is needed
    action_space = space_of(agent, "action_space")
    observation_space = space_of(agent, "observation_space")
    if algorithm is None:
        return
    _check_actions(algorithm, action_space)
    if agent._state.adding:
        _check_reach(algorithm, action_space)
    _check_observations(algorithm, observation_space)
    _check_policy(algorithm, observation_space, agent.policy)
    _check_advice(agent, algorithm, action_space)
    _check_averaging(agent, algorithm)
    _check_masks(agent, algorithm, action_space)
    _check_features(agent, algorithm, action_space)
    _check_answers(agent, algorithm)


def _check_numbers(agent: Agent) -> None:
    """No database takes NaN, and no reward may be infinite."""
    for name in ("psi", "rho", "advice_weight", "shaping_scale", "unanswered_reward"):
        if not math.isfinite(getattr(agent, name)):
            raise ValidationError({name: "Write a finite number."})


def _check_answers(agent: Agent, algorithm: Algorithm) -> None:
    """Episodes that shall end by themselves."""
    if agent.answer_within and get_row(algorithm.name).family == "direct":
        sentence = f"{algorithm} plays its episodes itself, and cannot end one for a client: write 0."
        raise ValidationError({"answer_within": sentence})


def check_fixed(before: Agent, after: Agent) -> None:
    """Raise ValidationError when spaces or policy of an agent change that has learned with the old ones."""
    changed = [name for name in FIXED if getattr(before, name) != getattr(after, name)]
    if changed and after.has_learned():
        raise ValidationError(dict.fromkeys(changed, HAS_LEARNED))


def space_of(agent: Agent, field: str) -> spaces.Space:
    """The space that a field describes. Raises ValidationError where it describes none."""
    specification = getattr(agent, field)
    try:
        _check_finite(specification)
        return parse_space(specification)
    except (ValueError, OverflowError) as error:
        raise ValidationError({field: str(error)}) from None


def _check_finite(specification: Any) -> None:
    """JSON, and so the database, knows neither infinity nor NaN."""
    if isinstance(specification, float) and not math.isfinite(specification):
        raise ValueError("A bound must be finite: write a large number, e.g. -1e9 and 1e9, instead of infinity.")
    if isinstance(specification, dict):
        specification = list(specification.values())
    if isinstance(specification, list):
        for part in specification:
            _check_finite(part)


def _check_actions(algorithm: Algorithm, space: spaces.Space) -> None:
    sentence = ""
    if isinstance(space, spaces.Dict):
        sentence = "Actions cannot be a dictionary: write a number of choices, or [shape, low, high]."
    elif isinstance(space, spaces.Discrete) and not algorithm.discrete:
        sentence = f"{algorithm} cannot choose one of n actions: write [shape, low, high], e.g. [[2], -1, 1]."
    elif isinstance(space, spaces.Box):
        sentence = _what_is_wrong_with_numbers(algorithm, space)
    if sentence:
        raise ValidationError({"action_space": sentence})


def _check_reach(algorithm: Algorithm, space: spaces.Space) -> None:
    """On the policy, the first actions are drawn around 0 with a deviation of 1, and cut to the bounds, as in SB3."""
    if not isinstance(space, spaces.Box) or get_row(algorithm.name).family not in ("on_policy", "recurrent"):
        return
    if (space.low > 2).any() or (space.high < -2).any() or (space.high - space.low > 2 * REACH).any():
        sentence = (
            f"{algorithm} begins with actions of about -2 to 2, and would hardly find others: write bounds of about -1 and 1 and "
            "have your client scale what it gets, or choose SAC, which scales by itself."
        )
        raise ValidationError({"action_space": sentence})


def _what_is_wrong_with_numbers(algorithm: Algorithm, space: spaces.Box) -> str:
    if not algorithm.continuous:
        return f"{algorithm} can only choose one of n actions: write a whole number n, e.g. 4."
    if space.dtype == np.uint8:
        return "The bounds 0 and 255 mean an image, and no action is one: write 0.0 and 255.0 for numbers."
    if not (np.isfinite(space.low).all() and np.isfinite(space.high).all()):
        return "The bounds of an action are too large for 32 bits: write smaller ones, e.g. -1 and 1."
    return ""


def _check_observations(algorithm: Algorithm, space: spaces.Space) -> None:
    """Dictionaries and images need an algorithm with a network for them."""
    kinds = {kind_of_policy(name) for name in algorithm.policies}
    sentence = ""
    if isinstance(space, spaces.Dict) and DICTIONARY not in kinds:
        sentence = f"{algorithm} takes no dictionaries: write one vector, e.g. [[8], -10, 10]."
    elif is_image(space) and CNN not in kinds:
        sentence = f"{algorithm} takes no images: write one vector, e.g. [[8], -10, 10], or choose another algorithm."
    elif isinstance(space, spaces.Dict):
        sentence = _small_image(space)
    if sentence:
        raise ValidationError({"observation_space": sentence})


def _small_image(space: spaces.Dict) -> str:
    for key, sub in space.spaces.items():
        if is_image(sub) and not convolves(sub):
            return (
                f"The image {key!r} is too small for a convolutional network, which needs {SMALLEST_IMAGE} by "
                f"{SMALLEST_IMAGE}: enlarge it, or write the bounds 0.0 and 255.0 to have it as plain numbers."
            )
    return ""


def _check_policy(algorithm: Algorithm, space: spaces.Space, policy: str) -> None:
    if policy == AUTO:
        return
    fitting = [name for name in algorithm.policies if _looks_at(name, space)]
    if policy not in fitting:
        raise ValidationError(
            {"policy": f"{policy} does not fit {_describe(space)}: write {' or '.join([AUTO, *fitting])}."}
            if policy in algorithm.policies
            else {"policy": f"{algorithm} has no {policy}: write {' or '.join([AUTO, *fitting])}."}
        )


def _check_masks(agent: Agent, algorithm: Algorithm, space: spaces.Space) -> None:
    """Masks that the algorithm or the actions cannot take."""
    if agent.action_masks:
        nowhere = "Only one of n actions can be forbidden: write no."
        unable = f"{algorithm} cannot be told which actions are allowed: write no, or choose e.g. PPO."
        _check_of_choices("action_masks", space, nowhere, get_row(algorithm.name).masks, unable)


def _check_features(agent: Agent, algorithm: Algorithm, space: spaces.Space) -> None:
    """Features of actions that the algorithm or the actions cannot have, or that are no table."""
    if agent.action_features is None:
        return
    nowhere = "Only one of n actions can have features: leave it empty."
    unable = f"{algorithm} cannot use features of actions: leave it empty, or choose e.g. DQN."
    count = _check_of_choices("action_features", space, nowhere, get_row(algorithm.name).scores, unable)
    if not _is_table(agent.action_features, count):
        sentence = f"Write {count} rows, one for each action, of as many finite numbers each."
        raise ValidationError({"action_features": sentence})


def _check_of_choices(field: str, space: spaces.Space, nowhere: str, able: bool, unable: str) -> int:
    """How many actions a field is about, one of which is chosen; where there are none, or the algorithm is unable, it says so."""
    if not isinstance(space, spaces.Discrete):
        raise ValidationError({field: nowhere})
    if not able:
        raise ValidationError({field: unable})
    return int(space.n)


def _is_table(rows: Any, count: int) -> bool:
    """Whether these are `count` rows of equally many finite numbers, at least one."""
    if not isinstance(rows, list) or len(rows) != count or not all(isinstance(row, list) and row for row in rows):
        return False
    numbers = [number for row in rows for number in row]
    plain = all(isinstance(number, int | float) and not isinstance(number, bool) for number in numbers)
    return plain and len({len(row) for row in rows}) == 1 and bool(np.isfinite(np.array(numbers, np.float32)).all())


def _check_advice(agent: Agent, algorithm: Algorithm, space: spaces.Space) -> None:
    """Advice that the algorithm or the actions cannot take. A new agent whose algorithm takes none begins with none."""
    if not algorithm.advice and agent._state.adding and agent.advice_method == mixing.INTERSECTION:
        agent.advice_method = NO_ADVICE
    if not algorithm.advice and agent.advice_method != NO_ADVICE:
        raise ValidationError({"advice_method": takes_no_advice(algorithm)})
    if agent.advisor is not None:
        _check_advisor(agent, agent.advisor)
    if isinstance(space, spaces.Discrete):
        _check_orders(agent, algorithm)
        return
    if agent.advice_method == mixing.UNION:
        sentence = "Policy union is for one of n actions: with vectors of numbers, write intersection or reuse."
        raise ValidationError({"advice_method": sentence})
    if (agent.advice_method, agent.advice_form) == (mixing.SHAPING, mixing.DETERMINISTIC):
        sentence = "An order has no density to be rewarded by: write soft, or another advice method."
        raise ValidationError({"advice_form": sentence})


def _check_orders(agent: Agent, algorithm: Algorithm) -> None:
    """Advice at each step that is always followed: the policy that acts is the advisor's, and its gradient nothing (eq. 3.1)."""
    learns_what_acts = get_row(algorithm.name).family == "on_policy" and agent.learning_correction
    heard = learns_what_acts and (agent.peers_advise or agent.advisor is not None)
    if heard and (agent.advice_method, agent.psi) == (mixing.REUSE, 1):
        raise ValidationError(
            {"psi": "With 1 the agent would only imitate and learn nothing itself: write less, e.g. 0.5."}
        )
    obeys = agent.advice_method == mixing.INTERSECTION or (
        agent.advice_method == mixing.GEOMETRIC and agent.advice_weight
    )
    if heard and obeys and agent.advice_form == mixing.DETERMINISTIC:
        sentence = (
            "An order at each step leaves nothing to learn: write soft, or let only clients advise, now and then."
        )
        raise ValidationError({"advice_form": sentence})


def _check_averaging(agent: Agent, algorithm: Algorithm) -> None:
    """Averages where the algorithm makes none. A new agent with such an algorithm begins without."""
    unable = not get_row(algorithm.name).averages
    if unable and agent._state.adding:
        agent.averaging = False
    elif unable and agent.averaging:
        raise ValidationError({"averaging": averages_nothing(algorithm)})


def _check_advisor(agent: Agent, advisor: Agent) -> None:
    """Another agent of the same owner, that sees and does the same, and whose policy has probabilities."""
    sentence = ""
    if advisor.owner_id != agent.owner_id:
        sentence = "It belongs to somebody else: choose an agent of the same owner."
    elif advisor.pk == agent.pk:
        sentence = "An agent cannot be its own advisor: its executions advise each other."
    elif not advisor.algorithm.advice:
        sentence = f"{advisor} cannot advise, for {advisor.algorithm} gives no probabilities: choose another agent."
    elif not have_same_spaces(agent, advisor):
        sentence = f"{advisor} has other actions or observations: choose an agent with the same."
    if sentence:
        raise ValidationError({"advisor": sentence})


def have_same_spaces(one: Agent, other: Agent) -> bool:
    """Whether two agents see and do the same, however they have it written down."""
    try:
        return [space_of(one, name) for name in SPACES] == [space_of(other, name) for name in SPACES]
    except ValidationError:
        return False


def averages_nothing(algorithm: Algorithm) -> str:
    """What to write instead."""
    return f"{algorithm} learns at every step, not after many: write no."


def takes_no_advice(algorithm: Algorithm) -> str:
    """What to write instead."""
    return f"{algorithm} takes no advice: write {NO_ADVICE}, or choose another algorithm."


def _looks_at(policy: str, space: spaces.Space) -> bool:
    kind = kind_of_policy(policy)
    if kind == DICTIONARY:
        return isinstance(space, spaces.Dict)
    if kind == CNN:
        return is_image(space) and convolves(space)
    return kind == VECTOR and not isinstance(space, spaces.Dict)


def _describe(space: spaces.Space) -> str:
    if isinstance(space, spaces.Dict):
        return "observations that are a dictionary"
    if is_image(space):
        return f"images (CnnPolicy needs {SMALLEST_IMAGE} by {SMALLEST_IMAGE} or more)"
    return "observations that are neither images nor a dictionary"
