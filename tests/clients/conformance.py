"""What every client must do, whatever its language, shown against a live server. Subclasses name the program."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from typing import Any, ClassVar

import pytest

from tests.clients.driving import ClientError, Driver
from tests.clients.proxy import Answer, Cut, Proxy
from tests.servers import Server

VECTOR = [0.25, -0.5, 0.0, 1.5]
PATIENCE = 60


def problem(status: int, code: str, retry_after: float | None = None) -> Answer:
    """An error as Shepherd writes it."""
    body: dict[str, Any] = {"type": "about:blank", "title": code, "status": status, "detail": "Wait.", "code": code}
    if retry_after is not None:
        body["retry_after"] = retry_after
    headers = {"Content-Type": "application/problem+json"} | ({"Retry-After": "1"} if retry_after is not None else {})
    return Answer(status, headers, json.dumps(body).encode())


class Conformance:
    """The scenarios."""

    command: ClassVar[list[str]]

    @pytest.fixture(scope="class")
    @classmethod
    def program(cls) -> Iterator[Driver]:
        """The program under test."""
        with Driver(cls.command) as program:
            yield program

    @pytest.fixture
    def proxy(self, server: Server) -> Iterator[Proxy]:
        """A proxy before the live server."""
        with Proxy(server.url) as proxy:
            yield proxy

    @pytest.fixture
    def drive(self, program: Driver, proxy: Proxy) -> Iterator[Driver]:
        """The program under test; its session ends with the test."""
        yield program
        program("close")

    @pytest.fixture
    def other(self) -> Iterator[Driver]:
        """A second process."""
        with Driver(self.command) as other:
            yield other

    @pytest.fixture
    def playing(self, drive: Driver, proxy: Proxy, keys: dict[str, str]) -> Driver:
        """The program, through the proxy, after the first step of an episode."""
        drive("login", key=keys["vector"], url=proxy.url, patience=PATIENCE)
        drive("step", obs=VECTOR)
        return drive

    @staticmethod
    def end_of_episode(drive: Driver, reward: float = 1.0) -> float:
        """The episode's return, by its last step."""
        reply = drive("step", obs=VECTOR, reward=reward, terminated=True)
        assert reply["action"] is None
        return reply["episode_return"]

    # Sessions

    def test_it_logs_in_and_hears_of_its_agent(self, drive: Driver, server: Server, keys: dict[str, str]) -> None:
        state = drive("login", key=keys["mixed"], url=server.url, patience=PATIENCE)
        assert state["key"]
        assert state["agent"]["algorithm"] == "PPO"
        assert state["agent"]["action_space"] == [[2], -1, 1]
        assert state["agent"]["observation_space"]["camera"] == [[40, 40, 3], 0, 255]

    def test_a_wrong_key_is_a_typed_error_at_once(self, drive: Driver, server: Server) -> None:
        with pytest.raises(ClientError) as refused:
            drive("login", key="sk_wrong", url=server.url, patience=PATIENCE)
        error = refused.value
        assert (error.type, error.code, error.status, error.transient) == (
            "InvalidApiKey",
            "invalid_api_key",
            401,
            False,
        )
        assert error.message

    def test_a_closed_session_is_unknown(self, playing: Driver, proxy: Proxy, keys: dict[str, str]) -> None:
        state = playing("state")
        playing("close")
        playing("close")
        playing("resume", key=keys["vector"], url=proxy.url, patience=PATIENCE, session=state["key"], seq=state["seq"])
        with pytest.raises(ClientError) as refused:
            playing("step", obs=VECTOR)
        assert (refused.value.type, refused.value.code) == ("UnknownSession", "unknown_session")
        playing("close")  # of a session that somebody else closed: no error

    def test_another_process_resumes_the_session_in_the_middle_of_an_episode(
        self, playing: Driver, other: Driver, proxy: Proxy, keys: dict[str, str]
    ) -> None:
        playing("step", obs=VECTOR, reward=2.0)
        state = playing("state")
        other("resume", key=keys["vector"], url=proxy.url, patience=PATIENCE, session=state["key"], seq=state["seq"])
        assert other("step", obs=VECTOR, reward=3.0)["seq"] == state["seq"] + 1
        assert self.end_of_episode(other, 4.0) == 9.0

    def test_a_step_of_a_stranger_is_a_sequence_gap(
        self, playing: Driver, other: Driver, proxy: Proxy, keys: dict[str, str]
    ) -> None:
        state = playing("state")
        other(
            "resume", key=keys["vector"], url=proxy.url, patience=PATIENCE, session=state["key"], seq=state["seq"] + 5
        )
        with pytest.raises(ClientError) as refused:
            other("step", obs=VECTOR)
        assert (refused.value.type, refused.value.status) == ("SequenceGap", 409)
        assert self.end_of_episode(playing) == 1.0

    def test_it_keeps_its_connection(self, playing: Driver, proxy: Proxy) -> None:
        for _ in range(20):
            playing("step", obs=VECTOR)
        assert proxy.connections == 1

    # Episodes

    def test_a_step_gets_an_action_and_the_next_number(
        self, drive: Driver, server: Server, keys: dict[str, str]
    ) -> None:
        before = drive("login", key=keys["vector"], url=server.url, patience=PATIENCE)["seq"]
        for number in range(1, 4):
            reply = drive("step", obs=VECTOR, info={"note": "anything"})
            assert reply["action"] in (0, 1)
            assert reply["seq"] == before + number
            assert reply["episode_return"] is None
        assert drive("state")["seq"] == before + 3

    def test_the_return_is_the_sum_of_the_rewards_after_the_first_observation(
        self, drive: Driver, server: Server, keys: dict[str, str]
    ) -> None:
        drive("login", key=keys["vector"], url=server.url, patience=PATIENCE)
        for episode in range(3):
            drive("step", obs=VECTOR, reward=1000.0)
            drive("step", obs=VECTOR, reward=0.5)
            drive("step", obs=VECTOR, reward=-2.0)
            assert self.end_of_episode(drive, episode) == episode - 1.5

    def test_a_truncated_episode_has_a_return_too(self, playing: Driver) -> None:
        playing("step", obs=VECTOR, reward=1.0)
        reply = playing("step", obs=VECTOR, reward=2.0, truncated=True)
        assert (reply["action"], reply["episode_return"]) == (None, 3.0)
        assert playing("step", obs=VECTOR)["action"] in (0, 1)

    def test_act_and_observe_keep_the_books(self, drive: Driver, server: Server, keys: dict[str, str]) -> None:
        drive("login", key=keys["vector"], url=server.url, patience=PATIENCE)
        for _ in range(2):
            assert drive("act", obs=VECTOR) in (0, 1)
            assert drive("observe", obs=VECTOR, reward=1.0) is None
            assert drive("observe", obs=VECTOR, reward=0.25) is None
            assert drive("act", obs=VECTOR) in (0, 1)
            assert drive("observe", obs=VECTOR, reward=2.0, terminated=True) == 3.25

    # Spaces

    @pytest.mark.parametrize("dtype", ["", "float32"])
    def test_vectors(self, drive: Driver, server: Server, keys: dict[str, str], dtype: str) -> None:
        drive("login", key=keys["vector"], url=server.url, patience=PATIENCE)
        assert drive("step", obs=VECTOR, dtype=dtype)["action"] in (0, 1)

    @pytest.mark.parametrize("dtype", ["", "uint8"])
    def test_images(self, drive: Driver, server: Server, keys: dict[str, str], dtype: str) -> None:
        image = [[[(row + column) % 256, 255, 0] for column in range(40)] for row in range(40)]
        drive("login", key=keys["image"], url=server.url, patience=PATIENCE)
        assert drive("step", obs=image, dtype=dtype)["action"] in (0, 1, 2)

    @pytest.mark.parametrize("dtype", ["", "uint8"])
    def test_dictionaries_and_box_actions(
        self, drive: Driver, server: Server, keys: dict[str, str], dtype: str
    ) -> None:
        obs = {"camera": [[[0, 128, 255]] * 40] * 40, "speed": [3]}
        drive("login", key=keys["mixed"], url=server.url, patience=PATIENCE)
        action = drive("step", obs=obs, dtype=dtype)["action"]
        assert len(action) == 2
        assert all(-1 <= number <= 1 for number in action)

    # Refusals

    @pytest.mark.parametrize(
        ("wrong", "kind"),
        [
            ({"obs": [1.0, 2.0]}, "InvalidObservation"),
            ({"obs": ["a", "b", "c", "d"]}, "InvalidObservation"),
            ({"obs": VECTOR, "reward": "much"}, "InvalidReward"),
            ({"obs": VECTOR, "terminated": "perhaps"}, "InvalidRequest"),
        ],
    )
    def test_a_refused_step_is_a_typed_error_and_the_session_goes_on(
        self, playing: Driver, wrong: dict[str, Any], kind: str
    ) -> None:
        playing("step", obs=VECTOR, reward=1.0)
        before = playing("state")["seq"]
        with pytest.raises(ClientError) as refused:
            playing("step", **wrong)
        assert (refused.value.type, refused.value.status, refused.value.transient) == (kind, 422, False)
        assert refused.value.message
        assert playing("step", obs=VECTOR, reward=2.0)["seq"] == before + 1
        assert self.end_of_episode(playing, 3.0) == 6.0

    # Retries

    @pytest.mark.parametrize("cut", list(Cut))
    def test_a_lost_connection_is_repeated_and_nothing_is_stepped_twice(
        self, playing: Driver, proxy: Proxy, cut: Cut
    ) -> None:
        before = playing("state")["seq"]
        proxy.faults.extend([cut] * 3)
        assert playing("step", obs=VECTOR, reward=1.0)["seq"] == before + 1
        assert not proxy.faults
        proxy.faults.append(cut)
        assert playing("step", obs=VECTOR, reward=10.0)["seq"] == before + 2
        proxy.faults.append(cut)  # on the last step too: its answer is stored as any other
        assert self.end_of_episode(playing, 100.0) == 111.0

    @pytest.mark.parametrize(
        "answer",
        [
            problem(503, "no_capacity", 0.1),
            problem(503, "execution_lost", 0.1),
            problem(503, "unavailable", 0.1),
            problem(429, "quota_exceeded", 0.1),
            problem(429, "throttled", 0.1),
            problem(409, "step_pending"),
            Answer(502, {"Content-Type": "text/html"}, b"<h1>Bad gateway</h1>"),
            Answer(503),
        ],
        ids=lambda answer: f"{answer.status} {answer.body[-20:-2].decode()}",
    )
    def test_an_answer_that_asks_to_wait_is_repeated(self, playing: Driver, proxy: Proxy, answer: Answer) -> None:
        before = playing("state")["seq"]
        proxy.faults.extend([answer] * 2)
        assert playing("step", obs=VECTOR, reward=1.0)["seq"] == before + 1
        assert self.end_of_episode(playing) == 2.0

    def test_it_waits_as_long_as_retry_after_says(self, playing: Driver, proxy: Proxy) -> None:
        proxy.faults.append(Answer(503, {"Retry-After": "1"}, b'{"code": "no_capacity", "detail": "Wait."}'))
        began = time.monotonic()
        playing("step", obs=VECTOR)
        assert time.monotonic() - began >= 1.0

    def test_when_its_patience_ends_it_says_why_and_the_step_can_be_repeated(
        self, drive: Driver, proxy: Proxy, keys: dict[str, str]
    ) -> None:
        before = drive("login", key=keys["vector"], url=proxy.url, patience=0.5)["seq"]
        drive("act", obs=VECTOR)
        proxy.faults.append(problem(503, "no_capacity", 30))
        with pytest.raises(ClientError) as ended:
            drive("observe", obs=VECTOR, reward=5.0, terminated=True)
        error = ended.value
        assert (error.type, error.status, error.retry_after, error.transient) == ("NoCapacity", 503, 30, True)
        assert drive("state")["seq"] == before + 1
        assert drive("observe", obs=VECTOR, reward=5.0, terminated=True) == 5.0

    def test_a_server_that_is_not_there_is_a_lost_connection(self, drive: Driver) -> None:
        with pytest.raises(ClientError) as lost:
            drive("login", key="sk_any", url="http://127.0.0.1:1", patience=0.2)
        assert (lost.value.type, lost.value.status, lost.value.transient) == ("ConnectionLost", 0, True)
