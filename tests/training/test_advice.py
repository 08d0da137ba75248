"""Executions advise each other over HTTP, whatever they look at and however they act, and nobody fails of it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import Any

import pytest

from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS
from tests.servers import Server, wait_for
from tests.training.trainees import PATIENCE, Trainee, make_trainees

CLIENTS = 3
AGENTS: dict[str, dict[str, Any]] = {
    f"{algorithm}, {kind}, {'discrete' if actions == DISCRETE else 'continuous'}, {'LC' if correction else 'no LC'}": {
        "algorithm": algorithm,
        "action_space": actions,
        "observation_space": OBSERVATIONS[kind],
        "learning_correction": correction,
        "parameters": {"n_steps": 16} | ({"n_epochs": 1} if algorithm == "PPO" else {}),
    }
    for algorithm, kind, actions, correction in product(
        ["PPO", "A2C"], OBSERVATIONS, [DISCRETE, CONTINUOUS], [True, False]
    )
}
AGENTS |= {
    "PolicyGradient, discrete": {"algorithm": "PolicyGradient"},
    "PolicyGradient, continuous, no LC": {
        "algorithm": "PolicyGradient",
        "action_space": CONTINUOUS,
        "observation_space": OBSERVATIONS["vector"],
        "learning_correction": False,
    },
    "BDPI, vector": {"algorithm": "BDPI", "observation_space": OBSERVATIONS["vector"]},
    "BDPI, dict, reuse": {
        "algorithm": "BDPI",
        "observation_space": OBSERVATIONS["dict"],
        "advice_method": "reuse",
        "psi": 0.3,
    },
}
AGENTS |= {
    f"{algorithm}, {kind}": {
        "algorithm": algorithm,
        "action_space": DISCRETE if algorithm in ("DQN", "QR-DQN") else CONTINUOUS,
        "observation_space": OBSERVATIONS[kind],
    }
    for algorithm, kind in [
        ("DQN", "dict"),
        ("QR-DQN", "vector"),
        ("SAC", "image"),
        ("TQC", "vector"),
        ("TD3", "dict"),
        ("DDPG", "discrete"),
    ]
}
AGENTS |= {
    f"{algorithm}, {', '.join(settings.values())}": {
        "algorithm": algorithm,
        "action_space": actions,
        "observation_space": OBSERVATIONS["vector"],
        **settings,
    }
    for algorithm, actions, settings in [
        ("TRPO", DISCRETE, {"advice_method": "intersection", "last_word": "advisor", "advisors": "all"}),
        ("TRPO", CONTINUOUS, {"advice_method": "reuse"}),
        ("PPO", DISCRETE, {"advice_method": "geometric", "advisors": "several"}),
        ("PPO", DISCRETE, {"advice_method": "union", "advisors": "all"}),
        ("PPO", CONTINUOUS, {"advice_method": "intersection", "continuous_advice": "sampling"}),
        ("A2C", DISCRETE, {"advice_method": "reuse", "advice_form": "deterministic"}),
        ("PPO", CONTINUOUS, {"advice_method": "shaping"}),
        ("DQN", DISCRETE, {"advice_method": "shaping"}),
        ("SAC", CONTINUOUS, {"advice_method": "shaping"}),
        ("BDPI", DISCRETE, {"advice_method": "union"}),
    ]
}


@pytest.fixture(scope="module")
def trainees(server: Server) -> dict[str, Trainee]:
    """An agent of each; they take advice by default."""
    agents: dict[str, dict[str, Any]] = {"without": {"advice_method": "none"}, "less": {"rho": 0.3}}
    return make_trainees(server, AGENTS | agents)


def mutual(trainee: Trainee) -> bool:
    """Whether all executions take advice of all others, and learn."""
    numbers = set(range(1, CLIENTS + 1))
    statuses = trainee.status()
    return len(statuses) == CLIENTS and all(
        {status["number"], *status.get("advisors", [])} == numbers and status["updates"] for status in statuses
    )


def train_until_mutual(trainee: Trainee) -> int:
    """Have three clients play until all advise all; returns how many episodes there were."""
    episodes = 0
    with trainee.sessions(CLIENTS) as sessions, ThreadPoolExecutor(CLIENTS) as pool:

        def played() -> bool:
            nonlocal episodes
            episodes += sum(len(returns) for returns in pool.map(lambda session: trainee.play(session, 20), sessions))
            return mutual(trainee)

        wait_for(played, PATIENCE, "all to advise all")
    return episodes


@pytest.mark.parametrize("name", AGENTS)
def test_one_client_alone_then_three_that_advise_each_other(trainees: dict[str, Trainee], name: str) -> None:
    trainee = trainees[name]
    alone = trainee.train(clients=1, steps=20)
    assert [status.get("advisors", []) for status in trainee.status()] == [[]]
    episodes = train_until_mutual(trainee)
    assert trainee.errors() == []
    assert len(trainee.returns()) == len(alone) + episodes
    assert {status["number"] for status in trainee.status()} == {1, 2, 3}
    trainee.restart()


def test_less_influence_is_advice_too(trainees: dict[str, Trainee]) -> None:
    train_until_mutual(trainees["less"])
    assert trainees["less"].errors() == []


def test_without_advice_nobody_advises(trainees: dict[str, Trainee]) -> None:
    trainee = trainees["without"]
    trainee.train(clients=CLIENTS, steps=60)
    trainee.wait_for_status(lambda status: status.get("updates"), CLIENTS)
    assert all(status["advisors"] == status["advises"] == [] for status in trainee.status())
