"""Between Gymnasium's spaces and Shepherd's notation of them.

An integer n is Discrete(n); `[shape, low, high]` is a Box, an image when the bounds are exactly the integers 0 and 255;
a dictionary of those is a Dict. Needs gymnasium and numpy (the extra `gym`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import gymnasium
    import numpy as np

INFINITY = 3.4e38  # close to the largest float32; JSON has no infinity


class SpaceNotes(NamedTuple):
    """The two spaces that `manage.py create_agent` and the admin ask for."""

    action_space: Any
    observation_space: Any


def spaces_of(env: gymnasium.Env) -> SpaceNotes:
    """The spaces of an environment in Shepherd's notation. Raises ValueError for a space that it has no word for."""
    return SpaceNotes(note(env.action_space), note(env.observation_space))


def note(space: gymnasium.Space) -> Any:
    """One space in Shepherd's notation."""
    from gymnasium import spaces

    if isinstance(space, spaces.Discrete):
        return int(space.n)
    if isinstance(space, spaces.Box) and space.shape:
        return _box(space)
    if isinstance(space, spaces.Dict) and not any(isinstance(sub, spaces.Dict) for sub in space.values()):
        return {key: note(sub) for key, sub in space.items()}
    raise ValueError(
        f"Shepherd has no word for {space}: wrap the environment so that its spaces are Discrete, Box, or a Dict of "
        "those (e.g. gymnasium.wrappers.FlattenObservation)."
    )


def to_wire(space: gymnasium.Space, obs: Any) -> Any:
    """An observation as Shepherd counts it: Discrete spaces begin at 0."""
    from gymnasium import spaces

    if isinstance(space, spaces.Discrete):
        return int(obs) - int(space.start)
    if isinstance(space, spaces.Dict):
        return {key: to_wire(sub, obs[key]) for key, sub in space.items()}
    return obs


def from_wire(space: gymnasium.Space, action: Any) -> Any:
    """An action of Shepherd as the environment takes it."""
    import numpy as np

    if isinstance(action, int):
        return int(action + getattr(space, "start", 0))
    return np.asarray(action, dtype=space.dtype).reshape(space.shape)


def check_spaces(env: gymnasium.Env, agent: dict[str, Any]) -> None:
    """Raise ValueError when the agent was made for an environment with other spaces."""
    notes = spaces_of(env)
    same = _outline(notes.observation_space) == _outline(agent["observation_space"])
    if not same or not _same_actions(notes.action_space, agent["action_space"]):
        raise ValueError(
            f"The agent {agent['name']!r} is for another environment. It has action space {agent['action_space']} and "
            f"observation space {agent['observation_space']}; this environment has {notes.action_space} and "
            f"{notes.observation_space}."
        )


def _box(space: Any) -> list[Any]:
    low, high = _bound(space.low), _bound(space.high)
    if space.dtype == "uint8" and (low, high) == (0, 255):
        return [list(space.shape), 0, 255]
    return [list(space.shape), low, high]


def _bound(array: np.ndarray) -> Any:
    """A bound as a float where all are equal, else as nested lists; with the digits that a float32 has."""
    import numpy as np

    finite = np.clip(array, -INFINITY, INFINITY).astype(np.float32)
    numbers = [float(str(number)) + 0.0 for number in finite.flat]  # + 0.0: no negative zeros
    if len(set(numbers)) == 1:
        return numbers[0]
    return np.array(numbers).reshape(array.shape).tolist()


def _outline(spec: Any) -> Any:
    """What must be the same for an observation to be understood: kinds and shapes, but not the bounds."""
    if isinstance(spec, dict):
        return {key: _outline(sub) for key, sub in spec.items()}
    return spec if isinstance(spec, int) else tuple(spec[0])


def _same_actions(mine: Any, its: Any) -> bool:
    """Whether actions mean the same: the bounds too, since an action outside them is another one."""
    import numpy as np

    if isinstance(mine, int) or isinstance(its, int):
        return mine == its
    bounds = zip(mine[1:], its[1:], strict=True)
    return mine[0] == its[0] and all(bool(np.isclose(a, b).all()) for a, b in bounds)
