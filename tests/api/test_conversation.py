"""Whole conversations with a real server: what is promised of both protocols, from log-in to the curve."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from itertools import count
from typing import Any
from uuid import uuid4

import httpx
import pytest

from tests.servers import Server

OBS = [0.1, -0.2, 0.3, 0.4]


class Player:
    """A client's session, spoken by hand."""

    def __init__(self, server: Server, api_key: str) -> None:
        self.http = httpx.Client(base_url=server.url, timeout=30)
        self.login = self.http.post("api/v1/sessions", headers={"Authorization": f"Bearer {api_key}"})
        self.key = self.login.json()["session_key"]

    def step(self, obs: Any = None, reward: Any = 1.0, **changes: Any) -> httpx.Response:
        """The answer to a step; while an execution is not there yet, the step is repeated as the API asks for."""
        body = {"obs": OBS if obs is None else obs, "reward": reward, "terminated": False, "truncated": False} | changes
        for _ in range(60):
            answer = self.http.post("api/v1/step", json=body, headers={"Authorization": f"Bearer {self.key}"})
            if answer.status_code != 503:
                break
            time.sleep(answer.json()["retry_after"])
        return answer

    def raw(self, body: bytes) -> httpx.Response:
        """The answer to a body that no JSON encoder makes."""
        return self.http.post("api/v1/step", content=body, headers={"Authorization": f"Bearer {self.key}"})


@pytest.fixture(scope="module")
def api_key(server: Server) -> str:
    """A key of an agent with 4 numbers to see and 2 actions."""
    return server.create_agent()[1]


@pytest.fixture
def player(server: Server, api_key: str) -> Iterator[Player]:
    """A new session."""
    player = Player(server, api_key)
    yield player
    player.http.delete("api/v1/session", headers={"Authorization": f"Bearer {player.key}"})
    player.http.close()


def code_of(answer: httpx.Response) -> tuple[int, str]:
    assert answer.headers["Content-Type"] == "application/problem+json", answer.text
    return answer.status_code, answer.json()["code"]


def test_an_episode_from_log_in_to_the_curve(player, api_key):
    assert player.login.status_code == 201
    assert player.login.json()["agent"]["algorithm"] == "PPO"
    first = player.step(reward=100.0, seq=1).json()  # ignored: no action led to it
    assert first["action"] in (0, 1)
    assert first["seq"] == 1
    assert player.step(reward=1.5, seq=2).json()["action"] in (0, 1)
    assert player.step(reward=2.0, seq=3, terminated=True).json() == {"action": None, "seq": 3, "episode_return": 3.5}
    assert player.step(seq=4).json()["action"] in (0, 1)
    rows = player.http.get("api/v1/agent/returns", headers={"Authorization": f"Bearer {api_key}"}).json()["results"]
    assert (rows[-1]["return"], rows[-1]["length"], rows[-1]["episode"]) == (3.5, 2, 1)


def test_a_repeated_step_gets_its_stored_answer(player):
    player.step(seq=1)
    once = player.step(seq=2).json()
    assert [player.step(seq=2).json() for _ in range(20)] == [once] * 20
    player.step(seq=3, terminated=True)
    assert player.step(seq=3, terminated=True).json()["episode_return"] == 2.0


@pytest.mark.parametrize("zone", ["UTC", ""])
def test_actions_of_episodes_of_one_step_are_counted_once_if_the_owner_asks_for_it(server, zone):
    agent, key = server.create_agent(public="true", counted_in=zone)
    player = Player(server, key)
    action = player.step(seq=1).json()["action"]
    for _ in range(2):  # as if the first answer had been lost
        assert player.step(seq=2, reward=0.5, terminated=True).json()["episode_return"] == 0.5
    for seq in (3, 4):
        player.step(seq=seq)
    player.step(seq=5, terminated=True)  # an episode of two steps
    rows = player.http.get(f"agents/{agent}/actions.json").json()["rows"]
    assert [(row[0], *row[2:]) for row in rows] == ([(action, 1, 0.5)] if zone else [])


def test_a_gap_is_refused_and_the_session_goes_on(player):
    player.step(seq=1)
    assert code_of(player.step(seq=3)) == (409, "sequence_gap")
    assert player.step(seq=2).status_code == 200


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ({"obs": [1, 2, 3]}, "invalid_observation"),
        ({"obs": [[1, 2, 3, 4]]}, "invalid_observation"),
        ({"obs": [1, 2, 3, "4"]}, "invalid_observation"),
        ({"obs": [1, 2, 3, None]}, "invalid_observation"),
        ({"obs": [1, 2, 3, True]}, "invalid_observation"),
        ({"obs": [1, 2, 3, float("nan")]}, "invalid_observation"),
        ({"obs": [1, 2, 3, float("-inf")]}, "invalid_observation"),
        ({"obs": [1, 2, 3, 1e300]}, "invalid_observation"),
        ({"obs": {"a": 1}}, "invalid_observation"),
        ({"obs": None}, "invalid_observation"),
        ({"reward": float("nan")}, "invalid_reward"),
        ({"reward": None}, "invalid_reward"),
        ({"terminated": 1}, "invalid_request"),
        ({"seq": -1}, "invalid_request"),
        ({"typo": 1}, "invalid_request"),
        ({"action_mask": [True, True]}, "invalid_request"),
    ],
)
def test_the_session_goes_on_as_if_a_bad_request_had_never_come(player, body, code):
    player.step(seq=1)
    good = {"obs": OBS, "reward": 1.0, "terminated": False, "truncated": False, "seq": 2}
    bad = json.dumps(good | body).encode()
    assert code_of(player.raw(bad)) == (422, code)
    player.raw(b"{")
    assert player.step(seq=2).json()["seq"] == 2
    assert player.step(seq=3, reward=5.0, truncated=True).json()["episode_return"] == 6.0


def test_a_body_that_is_too_large_is_refused_and_the_session_goes_on(player):
    assert code_of(player.raw(b" " * (9 * 2**20))) == (413, "request_too_large")
    assert player.step(seq=1).status_code == 200


def test_two_clients_on_one_session_are_told_apart(server, player):
    player.step(seq=1)
    player.step(seq=2)
    assert code_of(player.step(seq=4)) == (409, "sequence_gap")
    assert code_of(player.step(seq=1)) == (409, "sequence_gap")


def test_a_closed_session_is_unknown(player):
    player.step(seq=1)
    closed = player.http.delete("api/v1/session", headers={"Authorization": f"Bearer {player.key}"})
    assert closed.status_code == 204
    assert code_of(player.step(seq=2)) == (401, "unknown_session")


def test_an_api_key_does_not_step_and_a_session_key_does_not_log_in(player, api_key):
    session_key, player.key = player.key, api_key
    assert code_of(player.step(seq=1)) == (401, "unknown_session")
    login = player.http.post("api/v1/sessions", headers={"Authorization": f"Bearer {session_key}"})
    assert code_of(login) == (401, "invalid_api_key")
    player.key = session_key


def test_the_original_protocol_from_log_in_to_the_end(server, api_key):
    with httpx.Client(base_url=server.url, timeout=30) as http:
        login = http.post("shepherd/login_user/", content=json.dumps({"apikey": api_key})).json()
        assert login.keys() == {"ok", "session_key"}

        def step(**changes):
            body = {"session_key": login["session_key"], "obs": OBS, "reward": 0.0, "done": False, "info": {}} | changes
            for _ in range(60):
                answer = http.post("shepherd/env/", content=json.dumps(body))
                if answer.status_code != 503:
                    break
                time.sleep(int(answer.headers["Retry-After"]))
            return answer

        assert step().json()["action"] in (0, 1)
        assert step(reward=1.0).json()["action"] in (0, 1)
        assert step(reward=1.0, done=True).json() == {"action": None}
        assert step().json()["action"] in (0, 1)
        refused = step(obs=[float("nan")] * 4)
        assert (refused.status_code, refused.json()["ok"]) == (422, False)
        assert step(obs=None).json() == {"action": None}
        assert (step().status_code, step().json()["ok"]) == (401, False)


def test_no_log_tells_a_key(server, player, api_key):
    for seq in count(1):
        player.step(seq=seq)
        if seq == 5:
            break
    player.step(seq=99)
    wrong = f"sk_{uuid4().hex}"
    player.http.post("api/v1/sessions", headers={"Authorization": f"Bearer {wrong}"})
    player.http.post("shepherd/login_user/", json={"apikey": wrong})
    player.http.post("shepherd/env/", json={"session_key": player.key, "obs": OBS})
    logs = "".join(path.read_text(errors="replace") for path in (server.data / "logs").iterdir())
    assert "session opened" in logs
    assert [key for key in (api_key, player.key, wrong) if key in logs] == []


def test_steps_are_not_logged_one_by_one(server, player):
    player.step(seq=1)
    log = server.data / "logs" / "web.log"
    before = log.stat().st_size
    for seq in range(2, 20):
        player.step(seq=seq)
    assert log.stat().st_size == before


def test_metrics_count_the_steps_of_real_sessions(server, player):
    player.step(seq=1)
    text = player.http.get("metrics").text
    assert 'shepherd_step_seconds_count{code="ok"}' in text
    assert "shepherd_sessions " in text
    assert "shepherd_executions{agent=" in text
