"""What was learned stays through restarts, rests while learning is off, and is put aside by a reset."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.faults.inside import saves_of
from tests.faults.players import query
from tests.servers import Server, wait_for
from tests.training.trainees import IdentityGame, Trainee, make_trainees

STATES = 3
QUICK = {"learning_rate": 0.02, "gamma": 0.0, "net_arch": "16"}
ANNEALED = {"total_timesteps": 700, "exploration_fraction": 0.5, "target_update_interval": 50}
AGENTS: dict[str, dict[str, Any]] = {
    "PPO": {"parameters": QUICK},
    "RecurrentPPO": {"algorithm": "RecurrentPPO", "parameters": QUICK | {"learning_rate": 0.003}},  # LSTMs want less
    "DQN": {"algorithm": "DQN", "parameters": QUICK | ANNEALED},
    "switched": {"parameters": QUICK},
    "reset": {"parameters": QUICK},
    "best": {"parameters": QUICK, "start_from": "best", "save_interval": 32},
}


@pytest.fixture(scope="module")
def trainees(server: Server) -> dict[str, Trainee]:
    """Agents that play the identity game."""
    return make_trainees(server, {name: fields | {"observation_space": STATES} for name, fields in AGENTS.items()})


def learned(trainee: Trainee, game: IdentityGame) -> None:
    """Play until the game is won nearly always."""
    assert np.mean(game.play(3)) < 0.85
    wait_for(lambda: np.mean(game.play(5)) > 0.9, 60, "learning")
    assert trainee.errors() == []


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    """Whether two models have the same weights."""
    return one.keys() == other.keys() and all(np.array_equal(one[layer], other[layer]) for layer in one)


@pytest.mark.parametrize("name", ["PPO", "RecurrentPPO", "DQN"])
def test_a_restart_keeps_what_was_learned(trainees: dict[str, Trainee], name: str) -> None:
    trainee = trainees[name]
    with trainee.sessions() as [session]:
        game = IdentityGame(session, STATES)
        learned(trainee, game)
        trainee.restart()
        before, [(_, meta), *_] = trainee.policy(), list(saves_of(trainee.server, trainee.id).metas())
        game.play(1)  # in a new execution; too short for an update
        assert same(trainee.policy(), before)
        [status] = trainee.status()
        assert status["number"] == 2
        trainee.wait_for_status(lambda status: status["updates"] == meta.updates > 0)
        # Random play has a third; what has 0.9 may have 0.8 of 100 answers by chance.
        assert np.mean(game.play(5)) > 0.7, "it was random again"
        trainee.restart()
    [(_, later), *_] = saves_of(trainee.server, trainee.id).metas()
    assert later.steps > meta.steps
    assert later.updates > meta.updates
    assert later.episodes == meta.episodes + 6


def test_learning_switched_off_takes_effect_at_once(trainees: dict[str, Trainee]) -> None:
    trainee = trainees["switched"]
    with trainee.sessions() as [session]:
        game = IdentityGame(session, STATES)
        learned(trainee, game)
        trainee.tell("services.set_learning(agent, False)")
        trainee.wait_for_status(lambda status: not status["learning"])
        before = trainee.policy()
        assert game.play(8) == [1.0] * 8, "it explores"
        assert game.answers() == [0, 1, 2]
        assert same(trainee.policy(), before)
        assert [row["learning"] for row in trainee.returns()[-8:]] == [False] * 8
        trainee.restart()
        assert game.play(2) == [1.0] * 2, "a new execution learns not either"
        trainee.tell("services.set_learning(agent, True)")
        game.play(8)
        assert not same(trainee.policy(), before)


def test_a_reset_begins_at_random_and_keeps_the_old_run(trainees: dict[str, Trainee]) -> None:
    trainee = trainees["reset"]
    with trainee.sessions() as [session]:
        game = IdentityGame(session, STATES)
        learned(trainee, game)
        count = len(trainee.returns())
        trainee.tell("services.reset_learning(agent)")
        assert np.mean(game.play(3)) < 0.85
        assert len(trainee.returns()) == 3
        assert len(trainee.get("/returns?run=1&limit=10000").json()["results"]) == count
        [status] = trainee.status()
        assert status["number"] == 1
        assert trainee.get("/model?run=1").content
    assert trainee.errors() == []


def test_it_may_start_from_its_best_save(trainees: dict[str, Trainee]) -> None:
    trainee = trainees["best"]
    with trainee.sessions() as [session]:
        trainee.play(session, 200, reward=1.0)
        wait_for(lambda: saves_of(trainee.server, trainee.id).names(), what="a save of the good times")
        trainee.play(session, 200, reward=-5.0)
        trainee.restart()
        saves = [meta for _, meta in saves_of(trainee.server, trainee.id).metas()]
        best = max(saves, key=lambda meta: -1e9 if meta.mean_return is None else meta.mean_return)
        assert best.steps < saves[0].steps
        trainee.play(session, 10)
        trainee.wait_for_status(lambda status: status["number"] == 2 and status["updates"] == best.updates)
    recorded = query(trainee.server, "SELECT steps FROM agents_app_save")
    assert (best.steps,) in recorded
