"""What a way of mixing brings: the mean return per 100 episodes together, and what each learner then earns alone.

python -m experiments.lockstep --size 4 --seeds 200 201 --episodes 220 advice_method=geometric advisors=all n_epochs=4
"""

from __future__ import annotations

import argparse
import json
from dataclasses import fields
from typing import Any

import numpy as np
import torch as th

from agents_app.algorithms.spec import AgentSpec
from experiments.lockstep.ppo import Settings
from experiments.lockstep.teams import Rules, Teams

ALONE = 4  # episodes of each learner


def main() -> None:
    """Play the teams, and print."""
    parser = argparse.ArgumentParser("python -m experiments.lockstep", description=__doc__)
    parser.add_argument("--environment", default="LunarLander-v3")
    parser.add_argument("--size", type=int, default=4, help="learners of a team")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="of the teams")
    parser.add_argument("--episodes", type=int, default=300, help="of each learner, 100 at least")
    parser.add_argument("fields", nargs="*", metavar="FIELD=VALUE", help="of AgentSpec, or a parameter of PPO")
    options = parser.parse_args()
    given = dict(field(text) for text in options.fields)
    settings = Settings(**{it.name: given.pop(it.name) for it in fields(Settings) if it.name in given})
    spec = AgentSpec("PPO", 0, 0, **{"advice_method": "intersection"} | given)
    th.set_num_threads(1)
    rules = Rules(options.environment, options.size, spec.mixing(), spec.advisors, spec.rho, settings, spec.averaging)
    teams = Teams(rules, options.seeds)
    teams.play(options.episodes)
    print(together(teams, options.episodes), f"alone {teams.returns_alone(ALONE).mean():.0f}")


def field(text: str) -> tuple[str, Any]:
    """A field of AgentSpec and its value, a number or a word."""
    name, value = text.split("=", 1)
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value


def together(teams: Teams, episodes: int) -> str:
    """Means per 100 episodes, and their deviations over the teams."""
    returns = np.array([[value for _, value in log[: episodes // 100 * 100]] for log in teams.episodes])
    means = returns.reshape(teams.count, teams.size, -1, 100).mean((1, 3))
    return ", ".join(
        f"{mean:.0f} ({deviation:.0f})" for mean, deviation in zip(means.mean(0), means.std(0), strict=True)
    )


if __name__ == "__main__":
    main()
