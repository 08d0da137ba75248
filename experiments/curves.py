"""Curves that several figures share: environments, their advisors, and the settings of Policy Gradient and PPO on them.

The thesis says nothing of its settings. PPO has the defaults of Stable-Baselines3, save where it does not learn with them.
"""

from __future__ import annotations

from typing import Any

from experiments.advisors import OURS, PENDULUM
from experiments.in_process import InProcess

LANDER, CART_POLE = ("LunarLander-v3", "lunar-lander"), ("CartPole-v0", "cart-pole")
SMALL_ROOMS = (f"{OURS}FiveRooms-14x12-v0", "five-rooms-14x12")
LARGE_ROOMS = (f"{OURS}FiveRooms-23x21-v0", "five-rooms-23x21")
CONTINUOUS_LANDER = ("LunarLanderContinuous-v3", "lunar-lander-continuous")
ACROBOT, SWING = (f"{OURS}ContinuousAcrobot-v0", "acrobot"), ("Pendulum-v1", "pendulum")

PPO: dict[str, Any] = {"algorithm": "PPO"}
SWINGING_PPO: dict[str, Any] = {"algorithm": "PPO", "parameters": PENDULUM}  # the defaults do not learn Pendulum
# Its defaults learn Cart Pole as well, but Lunar Lander more slowly: 59 at the end of 800 episodes, where this has 138 (seed 0).
POLICY_GRADIENT: dict[str, Any] = {"algorithm": "PolicyGradient", "parameters": {"normalize_advantage": True}}

ALONE, WITHOUT, WITH = "no advice", "PI without LC", "PI with LC"


def advised(where: tuple[str, str], episodes: int, learner: dict[str, Any], **agent: Any) -> InProcess:
    """Advised by the environment's trained advisor; `agent`: the fields of AgentSpec that say how."""
    environment, advisor = where
    return InProcess(environment, episodes, **learner, agent=agent, advisor=advisor)


def with_and_without_correction(where: tuple[str, str], episodes: int, learner: dict[str, Any]) -> dict[str, InProcess]:
    """Three curves: no advice, Policy Intersection (PI) without the learning correction (LC), and with it."""
    return {
        ALONE: InProcess(where[0], episodes, **learner),
        WITHOUT: advised(where, episodes, learner, advice_method="intersection", learning_correction=False),
        WITH: advised(where, episodes, learner, advice_method="intersection", learning_correction=True),
    }


def disturbed(environment: str, episodes: int, learner: dict[str, Any], share: float = 0.01) -> dict[str, InProcess]:
    """Two curves: undisturbed, and with a share of arbitrary actions.

    An arbitrary action is Probabilistic Policy Reuse of an advisor that does not look, without a learning correction: the
    action is recorded as what it is, with the probability that the learner's own policy has for it.
    """
    agent = {"advice_method": "reuse", "psi": share, "learning_correction": False}
    return {
        "own actions": InProcess(environment, episodes, **learner),
        f"{share:.0%} arbitrary actions": InProcess(environment, episodes, **learner, agent=agent, advisor="uniform"),
    }
