"""The contract of transports: who gets which execution."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from envs_app.errors import NoCapacity
from tests.servers import wait_for
from tests.transports.agents import TIMEOUT, Agent, ids
from tests.transports.engines import Engine


class Finding:
    """Who gets which execution."""

    def test_the_first_session_launches_an_execution(self, engine: Engine) -> None:
        agent = Agent(engine)
        assert agent.transport.acquire(agent.claim(1)) is None
        assert agent.status() == {}
        address = agent.launch(1)
        assert set(agent.status()) == {address.uid}

    def test_an_execution_answers(self, engine: Engine) -> None:
        player = Agent(engine).player()
        answer = player.step(obs=3)
        assert answer["k"] == "answer"
        assert answer["action"] in range(3)

    def test_a_session_keeps_the_execution_that_it_has(self, engine: Engine) -> None:
        agent = Agent(engine)
        player = agent.player()
        player.step()
        for _ in range(3):
            assert agent.transport.acquire(agent.claim(player.session)) == player.address
            player.step()

    def test_two_sessions_have_two_executions(self, engine: Engine) -> None:
        agent = Agent(engine)
        first, second = agent.launch(1), agent.launch(2)
        assert first.uid != second.uid
        assert [status["number"] for status in agent.status().values()] == [1, 2]

    def test_two_claims_at_once_get_two_executions(self, engine: Engine) -> None:
        agent, barrier = Agent(engine), threading.Barrier(2)
        transports = [engine.connect(), engine.connect()]

        def take(session: int) -> str:
            barrier.wait(TIMEOUT)
            return agent.find(session, transports[session]).uid

        with ThreadPoolExecutor(2) as pool:
            assert len(set(pool.map(take, (0, 1)))) == 2
        assert len(agent.status()) == 2

    def test_claims_of_one_session_at_once_get_one_execution(self, engine: Engine) -> None:
        agent = Agent(engine)
        with ThreadPoolExecutor(4) as pool:
            assert len({address.uid for address in pool.map(agent.launch, [1] * 4)}) == 1
        assert len(agent.status()) == 1

    def test_sessions_share_an_execution_where_they_may(self, engine: Engine) -> None:
        agent = Agent(engine, places=3)
        players = [agent.player() for _ in range(4)]
        for player in players:
            player.step()
        addresses = [player.address for player in players]
        assert addresses[0] == addresses[1] == addresses[2] != addresses[3]

    def test_no_more_are_launched_than_the_agent_may_have(self, engine: Engine) -> None:
        agent = Agent(engine, most=2)
        for _ in range(2):
            agent.player().step()
        with pytest.raises(NoCapacity) as refused:
            agent.transport.acquire(agent.claim(next(ids)))
        assert 0 < (refused.value.retry_after or 0) <= 10
        with pytest.raises(NoCapacity):
            agent.launch(next(ids))
        assert len(agent.status()) == 2

    def test_an_execution_is_free_for_others_after_an_episode(self, engine: Engine) -> None:
        agent = Agent(engine, most=1)
        one, other = agent.player(), agent.player()
        one.step()
        one.end()
        other.step()
        assert other.address == one.address

    def test_a_session_returns_to_the_execution_that_it_had(self, engine: Engine) -> None:
        agent = Agent(engine)
        players = [agent.player() for _ in range(3)]
        for player in players:
            player.step()
        for player in players:
            player.end()
        wait_for(lambda: not any(status["active_sessions"] for status in agent.status().values()))
        for player in players[::-1]:
            assert agent.transport.acquire(agent.claim(player.session)) == player.address

    def test_an_execution_that_refused_is_not_given_again(self, engine: Engine) -> None:
        agent = Agent(engine)
        address = agent.launch(1)
        assert agent.transport.acquire(agent.claim(1), [address.uid]) is None
        assert agent.launch(1, [address.uid]).uid != address.uid

    def test_agents_and_runs_share_no_execution(self, engine: Engine) -> None:
        agent, other = Agent(engine), Agent(engine)
        agent.launch(1)
        assert other.transport.acquire(other.claim(1)) is None
        agent.run = next(ids)
        assert agent.transport.acquire(agent.claim(1)) is None
