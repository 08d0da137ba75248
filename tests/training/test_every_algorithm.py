"""Every algorithm that is listed trains over HTTP: its learner updates, episodes end, and their returns are recorded."""

from __future__ import annotations

from typing import Any

import pytest

from agents_app.algorithms.registry import ROWS
from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS, actions_of
from tests.faults.players import query
from tests.servers import Server
from tests.training.trainees import Trainee, make_trainees

STEPS = 90
AGENTS = {
    f"{row.name}, {'discrete' if actions == DISCRETE else 'continuous'}": {
        "algorithm": row.name,
        "action_space": actions,
        "observation_space": OBSERVATIONS["vector"],
    }
    for row in ROWS
    for actions in actions_of(row)
}
LOOKING: dict[str, dict[str, Any]] = {
    "DQN, dict": {"algorithm": "DQN", "observation_space": OBSERVATIONS["dict"]},
    "SAC, image": {"algorithm": "SAC", "action_space": CONTINUOUS, "observation_space": OBSERVATIONS["image"]},
    "RecurrentPPO, dict": {"algorithm": "RecurrentPPO", "observation_space": OBSERVATIONS["dict"]},
    "MaskablePPO, image": {"algorithm": "MaskablePPO", "observation_space": OBSERVATIONS["image"]},
    "TQC, discrete": {"algorithm": "TQC", "action_space": CONTINUOUS, "observation_space": 5},
    "PPO, gSDE": {"action_space": CONTINUOUS, "parameters": {"use_sde": True, "sde_sample_freq": 4}},
}


@pytest.fixture(scope="module")
def trainees(server: Server) -> dict[str, Trainee]:
    """An agent of each."""
    return make_trainees(server, AGENTS | LOOKING)


@pytest.mark.parametrize("name", [*AGENTS, *LOOKING])
def test_it_trains(trainees: dict[str, Trainee], name: str) -> None:
    trainee = trainees[name]
    returns = trainee.train(clients=1, steps=STEPS)
    trainee.wait_for_status(lambda status: status.get("updates"))
    assert returns == [10.0] * (STEPS // 10)
    recorded = trainee.returns()
    assert [row["return"] for row in recorded] == returns
    assert {row["length"] for row in recorded} == {10}
    assert trainee.errors() == []
    trainee.restart()


def test_masks_are_kept_over_http(trainees: dict[str, Trainee]) -> None:
    trainee = trainees["MaskablePPO, discrete"]
    with trainee.sessions() as [session]:
        for number in range(80):
            mask = [number % 3 != 0, number % 3 != 1, number % 3 != 2]
            ends = number % 10 == 9
            action = session.step(trainee.somewhere(), 1.0, terminated=ends, action_mask=mask).action
            assert ends or mask[action]
    assert trainee.errors() == []


def test_the_catalogue_lists_what_is_tested_here(server: Server) -> None:
    listed = query(server, "SELECT name FROM agents_app_algorithm WHERE listed")
    assert {name for (name,) in listed} == {agent["algorithm"] for agent in AGENTS.values()}
