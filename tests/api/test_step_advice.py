"""Advice and info that the client itself sends with a step."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from shepherd_client import Client, InvalidRequest, Session

from tests.servers import Server

OBS = [0.1, -0.2, 0.3, 0.4]


def session_of(server: Server, **agent: object) -> Session:
    """A session of a new agent with four numbers to see."""
    key = server.create_agent(observation_space=[[4], -10, 10], **agent)[1]
    return Client(key, url=server.url).session()


@pytest.fixture
def advised(server: Server) -> Iterator[Session]:
    """A session of an agent with four actions that takes advice."""
    with session_of(server, action_space=4, advice="intersection") as session:
        yield session


def test_an_untrained_agent_follows_certain_advice(advised: Session) -> None:
    actions = [advised.step(OBS, advice=[0, 0, 1, 0]).action for _ in range(50)]
    assert actions.count(2) >= 49  # the rest of the probability is a floor of a millionth


def test_advice_lasts_for_one_step(advised: Session) -> None:
    advised.step(OBS, advice=[0, 0, 1, 0])
    assert len({advised.step(OBS).action for _ in range(60)}) > 1


def test_continuous_advice_draws_the_action_half_way(server: Server) -> None:
    with session_of(server, action_space=[[1], -10, 10], advice="intersection") as session:
        advice = {"mean": [9.0], "std": [1.0]}
        actions = [session.step(OBS, advice=advice).action[0] for _ in range(50)]
    assert 3.5 < sum(actions) / len(actions) < 5.5


@pytest.mark.parametrize(
    "advice", [[1, 0, 0], [0, 0, 0, 0], [-1, 1, 1, 1], "left", {"mean": [1], "std": [1]}, [None] * 4]
)
def test_advice_that_is_none_is_refused_and_the_session_goes_on(advised: Session, advice: object) -> None:
    with pytest.raises(InvalidRequest, match="advice"):
        advised.step(OBS, advice=advice)
    assert advised.step(OBS).action in range(4)


def test_an_agent_without_advice_refuses_it(server: Server) -> None:
    with (
        session_of(server, action_space=4, advice="none") as session,
        pytest.raises(InvalidRequest, match="takes none"),
    ):
        session.step(OBS, advice=[1, 0, 0, 0])


def test_info_travels_with_a_step(advised: Session) -> None:
    advised.step(OBS)
    assert advised.step(OBS, info={"note": "windy", "nested": {"list": [1, None]}}).action in range(4)
