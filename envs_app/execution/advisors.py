"""Advisors: the other executions of the run, whose published policies are evaluated here (DESIGN.md section 4), and a frozen one.

Nobody is asked and nobody waits: each peer's latest weights lie where the transport put them, and are taken over when it is
that peer's turn.
"""

from __future__ import annotations

import random
import sys
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from agents_app.algorithms.actor import advising_policy
from agents_app.algorithms.advice import as_order, combine, combine_logs, is_neutral, neutral_advice
from agents_app.algorithms.builder import is_averaged
from agents_app.algorithms.masks import allowed_of, mask_advice
from agents_app.algorithms.mixing import ALL, BEST, GEOMETRIC, SEVERAL, SOFT
from agents_app.algorithms.peer import Peer
from agents_app.algorithms.spec import AgentSpec
from agents_app.algorithms.weights import assign, flatten, parameters_of
from envs_app.execution.averaging import TAIL
from envs_app.execution.frozen import Frozen

SEVERAL_ARE = 3  # docs/adr/0006
FROZEN = 0  # its number; those of executions begin with 1


class Peers(Protocol):
    """Where the policies that other executions published are found."""

    def versions(self) -> dict[int, int]:
        """The live peers that have published: number of the execution, and a version that grows."""
        ...

    def mean_returns(self) -> dict[int, float]:
        """Of the peers that have ended an episode: the mean over their last 100."""
        ...

    def weights(self, number: int) -> np.ndarray | None:
        """The latest weights of a peer; None when it has just gone."""
        ...


class Advisors:
    """Asks a live peer, or all of them, at each step. Belongs to the actor's thread."""

    def __init__(self, algorithm: Any, peers: Peers, spec: AgentSpec, frozen: Frozen | None = None) -> None:
        """Made before the algorithm learns: its policy is copied here, not while another thread trains it.

        `frozen` advises beside the peers, or if the agent wants none, in their place.
        """
        self._template, self._peers, self._spec = advising_policy(algorithm), peers, spec
        self._frozen = frozen
        self._frozen_peer = None if frozen is None else Peer(frozen.policy)
        self._action_space = algorithm.action_space
        self._discrete = isinstance(self._action_space, spaces.Discrete)
        self._at_most = self._how_many()
        self._size, self._behind = self._sizes()
        self._known: dict[int, Peer] = {}
        self._versions: dict[int, int] = {}
        self._neutral = neutral_advice(algorithm.action_space)
        self._random = random.Random()  # not the algorithm's: advice must not change what it draws

    def advise(self, obs: Any) -> np.ndarray:
        """What peers would do here: (A,) probabilities or (2A,) means and deviations; neutral when alone."""
        numbers = self._eligible()
        if len(numbers) > self._at_most:
            numbers = self._random.sample(numbers, self._at_most)
        peers = [self._up_to_date(number) for number in numbers]
        answers = [self._ask(peer, obs) for peer in peers if peer is not None]
        return self._combine(answers) if answers else self._neutral

    def temper(self, advice: np.ndarray, obs: Any = None) -> np.ndarray:
        """Advice from outside, as `advise` gives a peer's; what it says of actions that are not allowed does not count."""
        return self._combine([mask_advice(advice, allowed_of(obs))])

    def names(self) -> list[int | str]:
        """Whose advice is taken now: numbers of executions, and the name of a frozen advisor."""
        return [self._frozen.name if it == FROZEN and self._frozen else it for it in sorted(self._eligible())]

    def _eligible(self) -> list[int]:
        """Who may be asked: all, or the best of those that have ended an episode."""
        versions = self._peers.versions() if self._spec.peers_advise else {}
        numbers = [
            number for number, version in versions.items() if number in self._known or self._is_news(number, version)
        ]
        numbers += [] if self._frozen is None else [FROZEN]
        if self._spec.advisors == BEST:
            returns = self._mean_returns()
            return [max(judged, key=returns.__getitem__)] if (judged := returns.keys() & numbers) else numbers
        return numbers

    def _mean_returns(self) -> dict[int, float]:
        if self._frozen is None or self._frozen.mean_return is None:
            return self._peers.mean_returns()
        return self._peers.mean_returns() | {FROZEN: self._frozen.mean_return}

    def _how_many(self) -> int:
        """May be asked at one step."""
        if self._spec.advisors == ALL and (self._discrete or self._spec.mixing().by_mean):
            return sys.maxsize
        return SEVERAL_ARE if self._spec.advisors == SEVERAL and self._discrete else 1

    def _sizes(self) -> tuple[int, int]:
        """How many numbers a peer's weights are, and how many follow them that are none of an advisor's (averaging.py)."""
        behind = parameters_of(self._template) + TAIL if is_averaged(self._spec) else 0
        return flatten(self._template).size, behind

    def _combine(self, answers: list[np.ndarray]) -> np.ndarray:
        """One piece of advice from several: eq. 5.1, or the mean that the method asks; as an order, if the agent wants orders.

        Who says nothing is left out, and is no distribution to be mixed.
        """
        if self._discrete and not (answers := [answer for answer in answers if not is_neutral(answer)]):
            return self._neutral
        if not self._discrete:
            advice = np.stack(answers).mean(0)
        elif self._spec.advice_method == GEOMETRIC:
            advice = combine_logs(answers, self._spec.rho)
        else:
            advice = combine(answers, self._spec.rho)
        if self._spec.advice_form == SOFT:
            return advice
        order = as_order(advice, self._action_space)
        return order * len(answers) if self._discrete and not is_neutral(order) else order

    def _up_to_date(self, number: int) -> Peer | None:
        """The peer with its latest policy; None when it has just gone, or is from before the agent was changed."""
        if number == FROZEN:
            return self._frozen_peer
        versions = self._peers.versions()
        for gone in self._versions.keys() - versions.keys():
            del self._versions[gone]
            self._known.pop(gone, None)
        if self._is_news(number, versions[number]) and (weights := self._peers.weights(number)) is not None:
            self._versions[number] = versions[number]
            if weights.size != self._size + self._behind:
                self._known.pop(number, None)
                return None
            if number not in self._known:
                self._known[number] = Peer(self._template)
            assign(self._known[number].policy, weights[: self._size])
        return self._known.get(number)

    def _is_news(self, number: int, version: int) -> bool:
        """Whether a peer has published since it was looked at; what does not fit is not looked at twice."""
        return self._versions.get(number) != version

    def _ask(self, peer: Peer, obs: Any) -> np.ndarray:
        return peer.probabilities(obs) if self._discrete else np.concatenate(peer.gaussian(obs))
