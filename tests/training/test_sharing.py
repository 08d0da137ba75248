"""Who may use how much: many sessions on one execution, the agent's share of the CPU, and executions that idle."""

from __future__ import annotations

import httpx
import pytest
from shepherd_client import Client

from tests.faults.players import query
from tests.servers import Server, running_server, wait_for
from tests.training.trainees import IdentityGame, Trainee, at_once, make_trainees

AGENTS = {
    "shared": {"sessions_per_execution": 8, "save_interval": 64},
    "shared DQN": {"algorithm": "DQN", "sessions_per_execution": 8},
    "shared ARS": {"algorithm": "ARS", "sessions_per_execution": 8, "max_executions": 3},
    "frugal": {"max_percent_cpu": 2},
}


@pytest.fixture(scope="module")
def trainees(server: Server) -> dict[str, Trainee]:
    """Agents with limits."""
    return make_trainees(server, AGENTS)


@pytest.mark.parametrize("name", ["shared", "shared DQN"])
def test_eight_clients_train_one_execution(trainees: dict[str, Trainee], name: str) -> None:
    trainee = trainees[name]
    returns = trainee.train(clients=8, steps=60)
    [status] = trainee.status()
    assert returns == [10.0] * 48
    assert len(trainee.returns()) == 48
    trainee.wait_for_status(lambda status: status.get("updates") and status["episodes"] == 48)
    assert trainee.errors() == []
    assert status["number"] == 1


def test_an_algorithm_that_plays_itself_has_an_execution_for_each(trainees: dict[str, Trainee]) -> None:
    trainee = trainees["shared ARS"]
    assert len(trainee.train(clients=3, steps=20)) == 6
    assert len(trainee.status()) == 3
    assert trainee.errors() == []


def test_an_agent_that_has_used_its_share_is_told_to_wait(trainees: dict[str, Trainee]) -> None:
    trainee = trainees["frugal"]
    with Client(trainee.key, trainee.server.url) as client, httpx.Client(base_url=trainee.server.url) as http:
        session = client.session()
        headers = {"Authorization": f"Bearer {session.key}"}

        def refused() -> httpx.Response | None:
            step = {"obs": 1, "reward": 0.0, "terminated": False, "truncated": False}
            answer = http.post("api/v1/step", headers=headers, json=step)
            assert answer.status_code in (200, 429), answer.text
            return answer if answer.status_code == 429 else None

        answer = next(filter(None, (refused() for _ in range(20_000))))
        problem = answer.json()
        assert problem["code"] == "quota_exceeded"
        assert answer.headers["Content-Type"] == "application/problem+json"
        assert int(answer.headers["Retry-After"]) >= problem["retry_after"] > 0
        trainee.tell("agent.max_percent_cpu = 1000; agent.save(); services.tell_fleet(agent, ['max_percent_cpu'])")
        wait_for(lambda: refused() is None, what="the new share to count")


def test_idle_executions_end_and_their_sessions_go_on() -> None:
    with running_server(SHEPHERD_IDLE_SECONDS=2) as server:
        trainee = make_trainees(server, {"idle": {"parameters": {"learning_rate": 0.01}}})["idle"]
        with trainee.sessions(2) as [session, other]:
            at_once([lambda: IdentityGame(session, 5).play(4), lambda: IdentityGame(other, 5).play(4)])
            session.step(0)
            session.step(0, 1.0)  # in the middle of an episode
            wait_for(lambda: not trainee.status(), what="both to end")
            assert session.step(0, 1.0, terminated=True).episode_return == 2.0
            trainee.wait_for_status(lambda status: status.get("updates"))

        def ends() -> bool:
            rows = query(server, "SELECT number, end_reason FROM agents_app_execution ORDER BY number")
            return [reason for _, reason in rows[:2]] == ["idle", "idle"]

        wait_for(ends, what="the ends to be written down")
        assert trainee.errors() == []
