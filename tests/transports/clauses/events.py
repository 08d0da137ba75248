"""The contract of transports: what is told of executions afterwards."""

from __future__ import annotations

import threading

from tests.servers import wait_for
from tests.transports.agents import Agent, ids
from tests.transports.engines import Engine


class Events:
    """What is told of executions afterwards."""

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
