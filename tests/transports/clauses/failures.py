"""The contract of transports: what is killed, fails or is restarted."""

from __future__ import annotations

import signal

import pytest

from envs_app.errors import NoCapacity
from tests.servers import wait_for
from tests.transports.agents import Agent
from tests.transports.engines import Engine


class Failures:
    """What is killed, fails or is restarted."""

    def test_a_killed_execution_is_replaced_and_the_episode_goes_on(self, engine: Engine) -> None:
        agent = Agent(engine)
        player = agent.player()
        player.step()
        answer = player.step(reward=1.0)
        killed = player.address
        assert killed is not None
        engine.signal(killed.uid, signal.SIGKILL)
        [ended] = agent.wait_for_event("ended")
        assert (ended["uid"], ended["reason"]) == (killed.uid, "crash")
        with pytest.raises(ConnectionError):
            player.step(reward=1.0)
        player.address = None
        player.seq = answer["seq"]
        assert player.step(reward=1.0)["k"] == "answer"
        assert player.address != killed
        assert player.end(1.0) | {"execution": ""} == {
            "number": 1, "return": 3.0, "length": 3, "learning": True, "run": agent.run, "execution": ""
        }  # fmt: skip

    def test_an_execution_that_fails_is_reported_with_its_traceback(self, engine: Engine) -> None:
        agent = Agent(engine, parameters={"gamme": 0.9})
        agent.launch(1)
        [error] = agent.wait_for_event("error")
        assert "gamme" in error["summary"]
        assert "Traceback" in error["traceback"]
        [ended] = agent.wait_for_event("ended")
        assert ended["reason"] == "crash"

    def test_an_agent_whose_executions_fail_again_and_again_waits(self, engine: Engine) -> None:
        agent = Agent(engine, parameters={"gamme": 0.9})
        for count in (1, 2, 3):
            agent.launch(count)
            agent.wait_for_event("ended", count)
        with pytest.raises(NoCapacity, match="fail"):
            agent.launch(4)
        assert agent.transport.stop(agent.id, "restart") == 0  # the owner has mended it
        assert agent.transport.acquire(agent.claim(4)) is None

    @pytest.mark.parametrize("gently", [True, False], ids=["ended", "killed"])
    def test_everything_may_be_restarted(self, engine: Engine, gently: bool) -> None:
        agent = Agent(engine)
        player = agent.player()
        player.play(64, length=100)
        before = player.address
        engine.restart(gently)
        player.address = None
        assert player.step(reward=1.0)["k"] == "answer"
        assert player.address != before
        assert player.end()["return"] == 64.0
        if gently:
            assert wait_for(lambda: agent.status()[player.address.uid].get("updates"), what="those of the save")
