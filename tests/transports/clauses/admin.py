"""The contract of transports: what the admin asks of executions, and tells them."""

from __future__ import annotations

import time
from typing import Any

import pytest

from envs_app.errors import NoCapacity
from tests.servers import wait_for
from tests.transports.agents import Agent, ids
from tests.transports.engines import Engine


class Admin:
    """What the admin asks of executions, and tells them."""

    def test_the_status_says_what_executions_do(self, engine: Engine) -> None:
        agent = Agent(engine)
        player = agent.player()
        player.play(80)
        player.step()
        assert player.address is not None
        uid = player.address.uid
        wait_for(lambda: agent.status()[uid].get("steps") == 81, what="the steps")
        wait_for(lambda: agent.status()[uid].get("updates") == 4, what="two updates of two epochs")
        status = agent.status()[uid]
        assert (status["number"], status["run"], status["agent"]) == (1, agent.run, agent.id)
        assert (status["state"], status["sessions"], status["episodes"]) == ("acting", 1, 8)
        assert status["active_sessions"] == [player.session]
        assert status["mean_return"] == pytest.approx(9.0)
        assert status["memory"] > 0
        assert abs(time.time() - status["started_at"]) < 60
        assert status["advisors"] == status["advises"] == []

    def test_the_status_of_all_agents_has_them_all(self, engine: Engine) -> None:
        agents = [Agent(engine) for _ in range(2)]
        uids = {agent.launch(1).uid for agent in agents}
        assert uids <= {status["uid"] for status in agents[0].transport.status()}

    def test_executions_of_a_run_advise_each_other(self, engine: Engine) -> None:
        agent = Agent(engine, advice_method="intersection")
        players = [agent.player() for _ in range(3)]

        def advisors() -> list[Any]:
            for player in players:
                player.play(4, length=50)
            found = list(agent.status().values())
            return found if all(len(s.get("advisors", [])) == len(s["advises"]) == 2 for s in found) else []

        statuses = wait_for(advisors, what="all to advise all")
        assert [sorted([s["number"], *s["advisors"]]) for s in statuses] == [[1, 2, 3]] * 3
        assert [sorted([s["number"], *s["advises"]]) for s in statuses] == [[1, 2, 3]] * 3

    def test_the_best_by_recent_return_advises_all_others_and_the_second_best_the_best(self, engine: Engine) -> None:
        agent = Agent(engine, advice_method="intersection", advisors="best")
        players = [agent.player() for _ in range(3)]
        for player in players:
            player.step()

        def advisors() -> bool:
            for player, length in zip(players, [10, 20, 5], strict=True):
                player.play(
                    41, length
                )  # the return is the length; the last step begins an episode, and keeps the place
            return {s["number"]: s.get("advisors") for s in agent.status().values()} == {1: [2], 2: [1], 3: [2]}

        wait_for(advisors, what="the best to advise")

    def test_learning_is_switched_off_and_on(self, engine: Engine) -> None:
        agent = Agent(engine)
        player = agent.player()
        player.play(10)
        for learning in (False, True):
            agent.transport.configure(agent.id, {"learning": learning})

            def told(learning: bool = learning) -> bool:
                player.step()
                return player.end()["learning"] == learning

            wait_for(told, what="the switch")
            if not learning:
                assert len({player.step(obs=2)["action"] for _ in range(20)}) == 1

    def test_more_sessions_are_let_in(self, engine: Engine) -> None:
        agent = Agent(engine, most=1)
        one, other = agent.player(), agent.player()
        one.step()
        other.address = one.address
        assert other.step()["code"] == "busy"
        agent.places = 2
        agent.transport.configure(agent.id, {"sessions": 2})
        assert wait_for(lambda: other.step()["k"] == "answer")
        assert one.step()["k"] == "answer"

    def test_stopping_saves_and_the_next_goes_on_from_there(self, engine: Engine) -> None:
        agent = Agent(engine)
        player = agent.player()
        player.play(80)
        assert agent.transport.stop(agent.id, "restart") == 1
        [ended] = agent.wait_for_event("ended")
        assert ended["reason"] == "restart"
        kinds = [event["k"] for event in agent.events()]
        assert kinds.index("saved") < kinds.index("ended")
        player.address = None
        player.step()
        assert player.address is not None
        uid = player.address.uid
        assert wait_for(lambda: agent.status()[uid].get("updates"), what="updates that it did not make itself")

    def test_nothing_is_given_out_while_executions_are_being_saved(self, engine: Engine) -> None:
        agent = Agent(engine)
        agent.player().play(40)
        agent.transport.stop(agent.id, "restart")
        before = set(agent.status())
        try:
            given = agent.transport.acquire(agent.claim(1))
        except NoCapacity as refused:
            assert refused.retry_after is not None
            assert refused.retry_after < 1
        else:
            assert given is None
            assert not agent.status(), "an execution was given while another was being saved"
        wait_for(lambda: not before & set(agent.status()))
        assert agent.transport.acquire(agent.claim(1)) is None

    def test_a_save_is_made_when_asked_for(self, engine: Engine) -> None:
        agent = Agent(engine)
        agent.player().play(20)
        assert agent.transport.save(agent.run) == 1
        wait_for(lambda: not any(status["saving"] for status in agent.status().values()), what="the save")
        saved, *_ = agent.events("saved")
        assert (saved["agent"], saved["run"]) == (agent.id, agent.run)

    def test_what_is_saved_is_not_saved_again(self, engine: Engine) -> None:
        agent = Agent(engine)
        agent.player().play(20)
        agent.transport.configure(agent.id, {"learning": False})
        counts = []
        for _ in range(2):
            agent.transport.save(agent.run)
            wait_for(lambda: not any(status["saving"] for status in agent.status().values()), what="the save")
            counts.append(len(agent.events("saved")))
        assert counts == [1, 1]
        assert agent.transport.save(next(ids)) == 0

    def test_a_closed_session_is_forgotten(self, engine: Engine) -> None:
        agent = Agent(engine, most=1)
        one, other = agent.player(), agent.player()
        one.step()
        one.step(reward=1.0)
        agent.transport.forget(one.session, agent.id)
        assert wait_for(lambda: other.step()["k"] == "answer")
        other.end()
        wait_for(lambda: not agent.status()[other.address.uid]["active_sessions"])
        one.seq = 500  # nothing is known of it: any number is the first one
        assert wait_for(lambda: one.step()["k"] == "answer")
        assert one.end()["length"] == 1
