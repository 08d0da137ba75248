"""What every transport must do. A subclass gives the fixture `engine`: the executions' side, running, for tests to break."""

from __future__ import annotations

import itertools
import signal
import threading
import time
import uuid
from abc import ABC, abstractmethod
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from agents_app.spaces import parse_space
from envs_app.errors import NoCapacity
from envs_app.execution.worker import ExecutionSpec
from envs_app.messages import Message, encode_observation
from envs_app.transports.base import Address, Claim, Transport
from tests.algorithms.specs import make_spec
from tests.servers import wait_for

TIMEOUT = 20.0
GIVEN_BY_TRANSPORT = {"turns"}
ids = itertools.count(1)


class Engine(ABC):
    """The executions' side of a transport."""

    @abstractmethod
    def connect(self) -> Transport:
        """A transport of its own, as another web process has one."""

    @abstractmethod
    def signal(self, uid: str, number: int) -> None:
        """Send a signal to an execution."""

    @abstractmethod
    def restart(self, gently: bool) -> None:
        """End everything, after saving or by a kill, and start it again."""


class Agent:
    """An agent that only the transport knows, its run, and the numbers of its executions."""

    def __init__(self, engine: Engine, most: int = 4, places: int = 1, **options: Any) -> None:
        self.engine, self.transport = engine, engine.connect()
        self.most, self.places = most, places
        self.id, self.run = str(uuid.uuid4()), next(ids)
        names = {"learning", "start_from", "save_interval", "reclaim_seconds", "seed"}
        self.facts = {name: options.pop(name) for name in list(options) if name in names}
        self.spec = make_spec(**{"advice_method": "none", "observations": 5} | options)
        self.numbers = itertools.count(1)

    def claim(self, session: int) -> Claim:
        """A session's claim."""
        return Claim(self.id, self.run, session, self.most, self.places)

    def launch(self, session: int, exclude: Any = (), transport: Transport | None = None) -> Address:
        """Start an execution for the session, unless there is one for it."""
        number = next(self.numbers)
        facts: dict[str, Any] = {"seed": 1, "sessions": self.places} | self.facts
        spec = ExecutionSpec(str(uuid.uuid4()), number, self.run, self.id, self.spec, f"{self.id}/{self.run}", **facts)
        given = {name: value for name, value in asdict(spec).items() if name not in GIVEN_BY_TRANSPORT}
        return (transport or self.transport).launch(self.claim(session), given, 10_000, exclude)

    def find(self, session: int, transport: Transport | None = None) -> Address:
        """As sessions do it: take what is there, or launch; wait while executions are being saved."""

        def found() -> Address | None:
            try:
                used = transport or self.transport
                return used.acquire(self.claim(session)) or self.launch(session, transport=used)
            except (NoCapacity, OSError):
                return None

        return wait_for(found, what="an execution")

    def status(self) -> dict[str, dict[str, Any]]:
        """The live executions, by uid."""
        return {status["uid"]: status for status in self.transport.status(self.id)}

    def player(self) -> Player:
        """A session with an execution."""
        return Player(self)

    def events(self, *kinds: str) -> list[dict[str, Any]]:
        """What happened to this agent."""
        return [e for e in self.transport.events(0) if e["agent"] == self.id and (not kinds or e["k"] in kinds)]

    def wait_for_event(self, kind: str, count: int = 1) -> list[dict[str, Any]]:
        """The events of a kind, when there are so many."""
        wait_for(lambda: len(self.events(kind)) >= count, what=f"{count} x {kind}")
        return self.events(kind)


class Player:
    """A session that steps over the transport."""

    def __init__(self, agent: Agent) -> None:
        self.agent, self.session = agent, next(ids)
        self.space = parse_space(agent.spec.observation_space)
        self.address: Address | None = None
        self.seq = 0

    def message(self, obs: Any = 0, reward: float = 0.0, terminated: bool = False, **fields: Any) -> Message:
        """The next step."""
        message: Message = {"k": "step", "session": self.session, "request": uuid.uuid4().hex, "seq": self.seq + 1}
        message |= {"claim": True, "obs": encode_observation(obs), "reward": reward, "mask": None}
        return message | {"terminated": terminated, "truncated": False} | fields

    def send(self, message: Message, timeout: float = TIMEOUT) -> Message:
        """Send it to the execution that the session has."""
        self.address = self.address or self.agent.find(self.session)
        answer = self.agent.transport.call(self.address, message, timeout)
        if answer["k"] == "answer":
            self.seq = answer["seq"]
        return answer

    def step(self, obs: Any = 0, reward: float = 0.0, terminated: bool = False, **fields: Any) -> Message:
        """Take the next step."""
        return self.send(self.message(obs, reward, terminated, **fields))

    def end(self, reward: float = 0.0) -> dict[str, Any]:
        """End the episode; returns what is known of it."""
        return self.step(0, reward, terminated=True)["episode"]

    def play(self, steps: int, length: int = 10) -> None:
        """Take so many steps, in episodes of this length."""
        for number in range(steps):
            assert self.step(number % 5, 1.0, number % length == length - 1)["k"] == "answer"


class TransportContract:
    """The tests. They share the engine, and each has agents of its own."""

    # --- finding an execution ---
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

    # --- steps ---
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

    # --- what goes wrong ---
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

    # --- what the admin asks ---
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

    # --- events ---
    def test_events_come_in_order_and_until_they_are_acknowledged(self, engine: Engine) -> None:
        agent = Agent(engine)
        agent.player().play(20)
        agent.transport.save(agent.run)
        agent.wait_for_event("saved")
        agent.transport.stop(agent.id, "stop")
        agent.wait_for_event("ended")
        events = agent.transport.events(0)
        numbers = [event["id"] for event in events]
        assert numbers == sorted(set(numbers))
        assert agent.transport.events(0)[: len(events)] == events, "a poll whose answer was lost is repeated"
        middle, last = numbers[len(numbers) // 2], numbers[-1]
        assert all(event["id"] > middle for event in agent.transport.events(middle))
        assert all(event["id"] > last for event in agent.transport.events(last))

    def test_no_event_is_lost_between_polls(self, engine: Engine) -> None:
        agent, read, seen, over = Agent(engine, most=6), 0, [], threading.Event()

        def poll() -> None:
            nonlocal read
            transport = engine.connect()
            while not over.is_set():
                events = transport.events(read)
                seen.extend(event for event in events if event["agent"] == agent.id)
                read = events[-1]["id"] if events else read

        poller = threading.Thread(target=poll)
        poller.start()
        try:
            for _ in range(6):
                agent.launch(next(ids))
            agent.transport.stop(agent.id, "stop")
            wait_for(lambda: len([event for event in seen if event["k"] == "ended"]) == 6, what="six ends")
        finally:
            over.set()
            poller.join()
        assert len({event["id"] for event in seen}) == len(seen), "none comes twice"

    # --- and it learns ---
    @pytest.mark.parametrize("algorithm", ["PPO", "DQN"])
    def test_the_identity_game_is_learned(self, engine: Engine, algorithm: str) -> None:
        """Who does at `obs` what `obs` says is rewarded."""
        quick: dict[str, Any] = {"learning_rate": 0.02, "gamma": 0.0, "net_arch": "16"}
        if algorithm == "DQN":
            quick |= {"total_timesteps": 800, "exploration_fraction": 0.5, "target_update_interval": 50}
        agent = Agent(engine, algorithm=algorithm, observations=3, parameters=quick)
        player, generator = agent.player(), np.random.default_rng(1)
        reward, rewards = 0.0, []
        for number in range(1500):
            ends = number % 20 == 19
            obs = int(generator.integers(3))
            action = player.step(obs, reward, ends)["action"]
            if not ends:
                reward = float(action == obs)
                rewards.append(reward)
        assert np.mean(rewards[:60]) < 0.8
        assert np.mean(rewards[-100:]) > 0.85
        agent.transport.configure(agent.id, {"learning": False})
        wait_for(lambda: not next(iter(agent.status().values()))["learning"])
        assert [player.step(obs)["action"] for obs in range(3)] == [0, 1, 2]
