"""What rides in an observation beside what the client sends: advice, and the mask of allowed actions.

Both meet the policy's output, and the network never sees them. In the observation dictionary they go wherever the observation
goes: to the actor, onto the record, into buffers, to the update.
"""

from __future__ import annotations

from typing import Any

from gymnasium import spaces

PLAIN = "_observation"  # the key of what the client sends, when it sends no dictionary
ADVICE, MASK = "advice", "action_mask"


def with_rider(obs: Any, key: str, rider: Any) -> dict[str, Any]:
    """The observation as a dictionary with the rider."""
    return {**(obs if isinstance(obs, dict) else {PLAIN: obs}), key: rider}


def without_riders(obs: Any, *keys: str) -> Any:
    """The observation without these riders; without any, as the client sent it."""
    if not isinstance(obs, dict) or obs.keys().isdisjoint(keys):
        return obs
    rest = {key: value for key, value in obs.items() if key not in keys}
    return rest[PLAIN] if rest.keys() == {PLAIN} else rest


def space_with_rider(space: spaces.Space, key: str, rider: spaces.Space) -> spaces.Dict:
    """The space of such observations."""
    return spaces.Dict(with_rider(space.spaces if isinstance(space, spaces.Dict) else space, key, rider))


def space_without_riders(space: spaces.Space, *keys: str) -> spaces.Space:
    """The space of the observations that are left."""
    if not isinstance(space, spaces.Dict):
        return space
    rest = without_riders(space.spaces, *keys)
    return space if rest is space.spaces else spaces.Dict(rest) if isinstance(rest, dict) else rest


def client_part(obs: Any) -> Any:
    """What the client sent: all that the network sees."""
    return without_riders(obs, ADVICE, MASK)


def plain_space(space: spaces.Space) -> spaces.Space:
    """The space of what the client sends."""
    return space_without_riders(space, ADVICE, MASK)
