"""How an execution begins: a fork of the warmed parent, with a socket for web processes and one end of a pair to the parent."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Callable

from envs_app.messages import Message
from envs_app.transports.local import unix
from envs_app.transports.local.fleet_state import LocalExecution
from envs_app.transports.local.places import Places
from envs_app.transports.measure import Meter

log = logging.getLogger("shepherd.parent")


def fork(spec: Message, places: Places, let_go: Callable[[], None]) -> LocalExecution:
    """A new execution; `let_go` closes, in the child, what is the parent's alone."""
    listener = unix.listen(places.execution(spec["uid"]))
    ours, theirs = socket.socketpair()
    pid = os.fork()
    if pid == 0:
        ours.close()
        _live(spec, places, listener, theirs, let_go)
    listener.close()
    theirs.close()
    return LocalExecution(
        uid=spec["uid"],
        number=spec["number"],
        run=spec["run"],
        agent=spec["agent_id"],
        meter=Meter(pid),
        control=ours,
        sessions_allowed=spec["sessions"],
        reclaim_seconds=spec["reclaim_seconds"],
    )


def _live(
    spec: Message, places: Places, listener: socket.socket, control: socket.socket, let_go: Callable[[], None]
) -> None:
    """In the forked process: live, and never come back."""
    code = 1
    try:
        parent = os.getppid()
        let_go()
        from envs_app.transports.local import child

        code = child.main(spec, places, listener, control, parent)
    except BaseException:
        log.exception("execution %s could not begin", spec.get("number"))
    finally:
        logging.shutdown()
        os._exit(code)
