"""Acting in NumPy while the algorithm learns in this process, as executions act: a fraction of the time of SB3's own `forward`.

The learner reads its decisions from a tape (replay.py); here the tape is the actor itself, which decides when it is read, on
the learner's own weights.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from agents_app.algorithms.replay import Decision
from agents_app.algorithms.small_actor import SmallActor
from agents_app.algorithms.small_net import SmallNet, Unsupported
from agents_app.algorithms.weights import share


class Acting:
    """In place of a tape, for an algorithm on the policy with one environment. Belongs to the learner's thread."""

    def __init__(self, algorithm: Any) -> None:
        """Raises Unsupported where the network is not small and plain."""
        self._algorithm, self._actor = algorithm, SmallActor(algorithm)
        share(self._actor.policy, algorithm.policy)
        self._actor.net = SmallNet(self._actor.policy)  # type: ignore[arg-type]

    @property
    def current(self) -> Decision:
        """A decision at the observation that the algorithm stands at."""
        obs = self._algorithm._last_obs
        plain = {key: value[0] for key, value in obs.items()} if isinstance(obs, dict) else obs[0]
        return self._actor.decide(plain, None, None)[0]


def act_in_numpy(algorithm: Any) -> None:
    """Let an algorithm on the policy decide so, if its network can be computed so."""
    if not hasattr(algorithm.policy, "tape") or algorithm.n_envs > 1:
        return
    with suppress(Unsupported):
        algorithm.policy.tape = Acting(algorithm)
