"""How advice meets the learner's policy: an agent's settings, as plain data for its policy (reference: actor_advisor.md
sections 1 and 2). No torch here: the web process checks settings too.
"""

from __future__ import annotations

from dataclasses import dataclass

INTERSECTION, UNION, REUSE, SHAPING = "intersection", "union", "reuse", "shaping"
GEOMETRIC = "geometric"  # not of the thesis: docs/adr/0006
BY_MEAN, BY_SAMPLING = "mean", "sampling"
LEARNER, ADVISOR = "learner", "advisor"
SOFT, DETERMINISTIC = "soft", "deterministic"  # advice as it is, or as an order (thesis 3.1.1)
RANDOM, BEST, SEVERAL, ALL = "random", "best", "several", "all"  # which peers advise at a step


@dataclass(frozen=True)
class Mixing:
    """`Mixing()` is what an agent does that was not told otherwise."""

    method: str = INTERSECTION  # GEOMETRIC, UNION, REUSE, or SHAPING: the advice is a reward and changes no action
    correction: bool = True  # whether the learning rule sees the mixed policy, eq. 3.1
    psi: float = 0.5  # REUSE: how often the advisor's action is taken, eq. 2.5
    continuous: str = BY_MEAN  # how continuous policies are intersected: eq. 3.5, or BY_SAMPLING, alg. 1
    samples: int = 64  # BY_SAMPLING: actions drawn from the advisor
    last_word: str = LEARNER  # whose policy stands where the intersection is empty
    weight: float = 1.0  # GEOMETRIC: of each advisor in the mean, where that of the learner is 1

    @property
    def by_mean(self) -> bool:
        """Whether vectors of numbers meet between both means."""
        return self.method == GEOMETRIC or (self.method, self.continuous) == (INTERSECTION, BY_MEAN)

    @property
    def part(self) -> float:
        """Of the advisor's mean, where vectors of numbers meet between both: one half in Policy Intersection, eq. 3.5."""
        return self.weight / (1.0 + self.weight) if self.method == GEOMETRIC else 0.5

    @property
    def share(self) -> float:
        """Of the advisor, where the mixed policy is a weighted mean: psi, or one half in Policy Union, eq. 3.2."""
        return 0.5 if self.method == UNION else self.psi
