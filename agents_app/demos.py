"""The agents of `manage.py demo_data`: what they are, and how they learn. No Django: the study of Bored in the city plays one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

PLACES = json.loads((Path(__file__).parents[1] / "frontend" / "bored" / "places.json").read_text("utf-8"))["places"]
TYPES = ("restaurant", "asian_restaurant", "shop", "thriftshop", "cafe", "bar", "sightseeing")
BOX = ((50.840, 50.857), (4.338, 4.366))  # latitudes and longitudes that become -1 to 1


def features(place: dict[str, Any]) -> list[float]:
    """What the agent knows of a place, as docs/bored.md has it: its type, and where it is."""
    ends = zip((place["lat"], place["lon"]), BOX, strict=True)
    y, x = (2.0 * (value - low) / (high - low) - 1.0 for value, (low, high) in ends)
    return [*(float(kind == place["type"]) for kind in TYPES), y, x, y * y + x * x]


# The first two: PPO as in the RL Zoo of Stable-Baselines3, for one environment instead of eight or sixteen.
DEMOS: dict[str, dict[str, Any]] = {
    "CartPole demo": {
        "action_space": 2,
        "observation_space": [[4], -1000, 1000],
        "parameters": {
            "n_steps": 256,
            "batch_size": 64,
            "n_epochs": 10,
            "gamma": 0.98,
            "gae_lambda": 0.9,
            "learning_rate": 0.001,
        },
    },
    "Lunar Lander demo": {
        "action_space": 4,
        "observation_space": [[8], -100, 100],
        "parameters": {
            "n_steps": 2048,
            "batch_size": 64,
            "n_epochs": 10,
            "gamma": 0.999,
            "gae_lambda": 0.98,
            "ent_coef": 0.01,
        },
    },
    # One-step episodes of many visitors, whose page finds the agent by its name and shows its key. All share an execution:
    # docs/bored.md has the comparison.
    "Bored in the city": {
        "algorithm": "DQN",
        "action_space": len(PLACES),
        "observation_space": [[29], -1, 1],
        "action_masks": True,
        "action_features": [features(place) for place in PLACES],
        "sessions_per_execution": 1000,
        "answer_within": 15 * 60,
        "save_interval": 64,
        "public": True,  # its page is there for everybody, too
        "counted_in": "Europe/Brussels",
        "parameters": {
            "gamma": 0.0,
            "net_arch": "0",
            "learning_rate": 0.003,
            "buffer_size": 20_000,
            "learning_starts": 50,
            "batch_size": 256,
            "train_freq": 4,
            "gradient_steps": 1,
            "target_update_interval": 1,
            "exploration_fraction": 0.05,
            "exploration_final_eps": 0.05,
            "total_timesteps": 20_000,
        },
        "publishable": True,
    },
}
