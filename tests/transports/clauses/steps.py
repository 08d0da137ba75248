"""The contract of transports: what comes of a step."""

from __future__ import annotations

import signal
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from envs_app.messages import encode_observation
from tests.transports.agents import Agent, Player
from tests.transports.engines import Engine


class Steps:
    """What comes of a step."""

    def test_a_foreign_session_is_told_so(self, engine: Engine) -> None:
        agent = Agent(engine)
        one, other = agent.player(), agent.player()
        one.step()
        other.address = one.address
        assert other.step(claim=False)["code"] == "not_mine"
        assert other.step(claim=True)["code"] == "busy"
        assert one.step()["k"] == "answer"

    def test_a_repeated_step_is_answered_once_more(self, engine: Engine) -> None:
        player = Agent(engine).player()
        player.step()
        message = player.message(reward=1.0)
        assert player.send(message) == player.send(message)
        assert player.end()["return"] == 1.0

    def test_a_step_may_be_a_megabyte(self, engine: Engine) -> None:
        numbers = 2**18
        parameters = {"net_arch": "1", "n_steps": 8, "batch_size": 8}
        player = Agent(engine, observations=[[numbers], -1, 1], parameters=parameters).player()
        obs = np.linspace(-1, 1, numbers, dtype=np.float32)
        assert len(encode_observation(obs)) == 2**20
        for _ in range(3):
            assert player.step(obs)["k"] == "answer"

    def test_many_threads_share_a_transport(self, engine: Engine) -> None:
        agent = Agent(engine, places=4)
        players = [agent.player() for _ in range(4)]

        def play(player: Player) -> float:
            player.play(60, length=30)
            player.step()
            return player.end(float(player.session))["return"]

        with ThreadPoolExecutor(4) as pool:
            assert list(pool.map(play, players)) == [float(player.session) for player in players]

    def test_a_hung_execution_is_late_and_goes_on_later(self, engine: Engine) -> None:
        player = Agent(engine).player()
        player.step()
        assert player.address is not None
        engine.signal(player.address.uid, signal.SIGSTOP)
        message = player.message(reward=1.0)
        with pytest.raises(TimeoutError):
            engine.connect().call(player.address, message, 0.3)
        engine.signal(player.address.uid, signal.SIGCONT)
        assert player.send(message)["k"] == "answer"
        assert player.end()["return"] == 1.0

    def test_connections_that_died_meanwhile_are_replaced(self, engine: Engine) -> None:
        agent = Agent(engine)
        player = agent.player()
        player.step()
        agent.transport.stop(agent.id, "restart")
        agent.wait_for_event("ended")
        with pytest.raises(ConnectionError):
            player.step()
        player.address = None
        assert player.step()["k"] == "answer"
