"""What web processes ask of the parent, and its answers."""

from __future__ import annotations

import logging
import os
import selectors
import socket
import time

from envs_app.errors import NoCapacity, ShepherdError
from envs_app.execution.desk import refusal
from envs_app.messages import FrameReader, Message, pack
from envs_app.transports.local.fleet import Fleet
from envs_app.transports.quota import Bucket

REPLY_SECONDS = 1.0  # a web process reads its replies at once, or loses its connection

log = logging.getLogger("shepherd.parent")


class Answers:
    """Takes connections of web processes, and answers each message of theirs."""

    def __init__(self, fleet: Fleet) -> None:
        self.fleet, self.population = fleet, fleet.population

    def accept(self, listener: socket.socket) -> None:
        """A web process connects."""
        try:
            connection, _ = listener.accept()
        except OSError as error:
            log.error("no connection can be taken: %s", error)
            time.sleep(0.01)
            return
        connection.settimeout(REPLY_SECONDS)
        reader = FrameReader()
        self.fleet.selector.register(connection, selectors.EVENT_READ, lambda sock: self._hear(sock, reader))

    def _hear(self, connection: socket.socket, reader: FrameReader) -> None:
        try:
            data = connection.recv(2**18)
            messages = reader.feed(data)
        except OSError:
            data, messages = b"", []
        try:
            for message in messages:
                connection.sendall(pack(self._answer(message)))
        except OSError:  # also when half a reply was sent
            data = b""
        if not data:
            self.fleet.selector.unregister(connection)
            connection.close()

    def _answer(self, message: Message) -> Message:
        try:
            return getattr(self, f"_do_{message['k']}")(message)
        except ShepherdError as error:
            return refusal(error.code, error.detail, error.retry_after)
        except Exception as error:
            log.exception("the parent could not serve %s", message["k"])
            return refusal("no_capacity", f"the executions' parent failed: {type(error).__name__}", 1.0)

    def _do_ping(self, message: Message) -> Message:
        return {"k": "pong", "pid": os.getpid()}

    # --- a session's execution ---
    def _do_acquire(self, message: Message) -> Message:
        self._refuse_when_stopping()
        execution = self.population.find(message["claim"], message["exclude"])
        if execution is None:
            return {"k": "launch"}
        execution.gives(message["claim"]["session"], time.monotonic())
        return {"k": "execution", "uid": execution.uid}

    def _do_launch(self, message: Message) -> Message:
        self._refuse_when_stopping()
        claim, spec = message["claim"], message["spec"]
        execution = self.population.find(claim, message["exclude"])  # another thread may have launched one meanwhile
        if execution is None:
            self.fleet.buckets.setdefault(claim["agent"], Bucket(message["max_percent_cpu"]))
            execution = self.fleet.launch(spec)
        execution.gives(claim["session"], time.monotonic())
        return {"k": "execution", "uid": execution.uid}

    def _refuse_when_stopping(self) -> None:
        if self.fleet.stopping:
            raise NoCapacity("The server is stopping; repeat the step.", 1.0)

    def _do_forget(self, message: Message) -> Message:
        for execution in self.population.of_agent(message["agent"]):
            if message["session"] in execution.homes | execution.reserved.keys() | execution.active:
                execution.drop(message["session"])
                execution.homes.discard(message["session"])
                execution.tell({"k": "forget", "session": message["session"]})
        (self.fleet.places.ledger / str(int(message["session"]))).unlink(missing_ok=True)
        return {"k": "ok"}

    # --- what the admin and the housekeeper ask ---
    def _do_status(self, message: Message) -> Message:
        agent, population = message["agent"], self.population
        chosen = population.by_uid.values() if agent is None else population.of_agent(agent)
        return {"k": "status", "executions": [population.describe(e, e.meter.figures()) for e in chosen]}

    def _do_configure(self, message: Message) -> Message:
        settings = message["settings"]
        if percent := settings.get("max_percent_cpu"):
            self.fleet.buckets[message["agent"]] = Bucket(percent)
        for execution in self.population.of_agent(message["agent"]):
            execution.tell({"k": "configure", **settings})
        return {"k": "ok"}

    def _do_stop(self, message: Message) -> Message:
        executions = self.population.of_agent(message["agent"])
        self.population.failures.pop(message["agent"], None)
        for execution in executions:
            self.fleet.stop(execution, message["reason"])
        return {"k": "ok", "count": len(executions)}

    def _do_save(self, message: Message) -> Message:
        executions = [e for e in self.population.by_uid.values() if e.run == message["run"]]
        for execution in executions:
            execution.saves_asked += 1
            execution.tell({"k": "save", "ticket": execution.saves_asked})
        return {"k": "ok", "count": len(executions)}

    def _do_events(self, message: Message) -> Message:
        return {"k": "events", "events": self.fleet.events.after(message["after"])}
