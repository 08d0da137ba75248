"""Sessions: a client's conversation with an agent, over whichever executions serve it.

What every view calls. The database knows the sessions; this process keeps a handle of each one that it meets (envs_app.handles),
so that a step reads and writes no table but at an episode's end.
"""

from __future__ import annotations

import itertools
import os
import threading
import time
import uuid
from contextlib import AbstractContextManager, nullcontext
from datetime import timedelta
from typing import Any

import structlog
from django.conf import settings
from django.db import IntegrityError, connection, transaction
from django.db.models import Max
from django.utils import timezone

from agents_app import tallies
from agents_app.models import Agent, APIKey, EpisodeReturn, Execution, Session, hash_key, make_key
from envs_app.errors import ExecutionLost, InvalidRequest, NoCapacity, ShepherdError, UnknownSession, from_code
from envs_app.executions import record_launch
from envs_app.handles import Handle, handles
from envs_app.messages import Message, encode_observation
from envs_app.observations import read_advice, read_mask, read_observation, read_reward
from envs_app.requests import Caller
from envs_app.steps import Reply, Step
from envs_app.transports.base import Address, Away
from envs_app.transports.choice import get_transport

TRIES = 4  # executions that a step may find lost or busy before the client is asked to repeat it
SOON_SECONDS = 0.7  # a wait for capacity that is shorter than the client's would be; within a second it hears something
PAUSE_SECONDS, LONG_PAUSE_SECONDS = 0.05, 0.1  # between two looks: those at the end of a queue look less often
ACTIVITY_EVERY = timedelta(minutes=1)

_writer = threading.Lock()
PROCESS = uuid.uuid4().hex[:16]  # with its id and a number, names each request of this process
_requests = itertools.count()

log = structlog.get_logger("shepherd.sessions")


def open_session(api_key: APIKey) -> tuple[Session, str]:
    """A new session of the key's agent; the second value opens it and is shown once. An execution gets ready meanwhile."""
    secret = make_key("ss")
    session = Session.objects.create(agent=api_key.agent, api_key=api_key, hash=hash_key(secret))
    log.info("session opened", session=session.pk, agent=str(api_key.agent_id))
    handle = handles.get(secret)
    try:
        handle.address = _find_execution(handle, [], waits=False)
    except (ShepherdError, OSError) as error:
        log.info("no execution yet", session=session.pk, agent=handle.agent, reason=str(error))
    return session, secret


def close_session(session_key: str) -> None:
    """End the session: its key opens nothing any more. Raises UnknownSession."""
    handle = handles.get(session_key)
    Session.objects.filter(pk=handle.session, closed_at=None).update(closed_at=timezone.now())
    handles.drop(hash_key(session_key))
    try:
        get_transport().forget(handle.session, handle.agent)
    except OSError as error:
        log.warning("the executions were not told", session=handle.session, reason=str(error))
    log.info("session closed", session=handle.session, agent=handle.agent)


def step(session_key: str, step: Step, caller: Caller) -> Reply:
    """Give the agent an observation and get its action. Raises ShepherdError; the same step may then be repeated."""
    handle = handles.get(session_key)
    if handle.guard is not None:
        handle.guard.admit(caller, handle.session)
    message = _message(handle, step)
    try:
        answer = _send(handle, message)
        if answer["k"] == "error":
            raise from_code(answer["code"], answer["detail"], answer["retry_after"])
        episode = answer["episode"]
        if episode is not None:
            record_return(handle, episode)
    except (IntegrityError, Agent.DoesNotExist, Execution.DoesNotExist):
        raise UnknownSession("The agent or its run was deleted; log in again.") from None
    ended = answer["ended"]
    return Reply(answer["action"], answer["seq"], (episode["return"] if episode else 0.0) if ended else None)


def _message(handle: Handle, step: Step) -> Message:
    """The step as executions take it. Raises InvalidObservation, InvalidReward, InvalidRequest."""
    obs = read_observation(handle.observation_space, step.obs)
    return {
        "k": "step",
        "session": handle.session,
        "request": f"{PROCESS}-{os.getpid()}-{next(_requests)}",
        "seq": step.seq,
        "claim": False,
        "obs": encode_observation(obs),
        "reward": read_reward(step.reward),
        "terminated": step.terminated,
        "truncated": step.truncated,
        "mask": _mask(handle, step.action_mask),
        "advice": _advice(handle, step.advice),
        "info": step.info or None,
    }


def _mask(handle: Handle, mask: list[bool] | None) -> list[bool] | None:
    if mask is None:
        return None
    if handle.actions is None:
        raise InvalidRequest(
            "action_mask: the agent takes none; its owner can tick that some actions are forbidden at times."
        )
    return read_mask(mask, handle.actions).tolist()


def _advice(handle: Handle, advice: Any) -> bytes | None:
    if advice is None:
        return None
    if handle.advised_actions is None:
        raise InvalidRequest("advice: the agent takes none; its owner can choose an advice method in the admin.")
    return read_advice(handle.advised_actions, advice).tobytes()


def _send(handle: Handle, message: Message) -> Message:
    """Send the message to the session's execution; find it another one when that is lost, busy or somebody else's."""
    refused: list[str] = []
    lost = False
    for _ in range(TRIES):
        if handle.address is None:
            handle.address = _find_execution(handle, refused)
            message |= {"claim": True, "episodes": _episodes_recorded(handle)}
            _give_back_connection()
        address = handle.address
        try:
            answer = get_transport().call(address, message, settings.STEP_TIMEOUT)
        except TimeoutError:
            raise ExecutionLost("The execution did not answer in time; repeat the step.", 1.0) from None
        except Away:
            raise  # nobody says that the execution is lost: the session keeps it
        except OSError:
            log.warning("execution lost", session=handle.session, agent=handle.agent, execution=address.uid)
            answer, lost = {"k": "error", "code": "busy"}, True
        if answer["k"] != "error" or answer["code"] not in ("busy", "not_mine"):
            return answer
        if answer["code"] == "busy":
            refused.append(address.uid)
        handle.address = None
    if answer["code"] == "busy" and not lost:
        raise NoCapacity("All executions of the agent are in use; repeat the step later.", 1.0)
    raise ExecutionLost("The session's executions were lost; repeat the step.", 0.5)


def _episodes_recorded(handle: Handle) -> int:
    """How many the session has: an execution whose ledger was lost must not use their numbers again."""
    return EpisodeReturn.objects.filter(session=handle.session).aggregate(last=Max("episode"))["last"] or 0


def _find_execution(handle: Handle, refused: list[str], waits: bool = True) -> Address:
    """The transport's choice, or a new execution. Raises NoCapacity; if it waits, then only when that does not help soon."""
    handles.renew(handle)
    transport, claim = get_transport(), handle.claim(waits)
    deadline = time.monotonic() + (SOON_SECONDS if waits else 0.0)
    while True:
        pause = PAUSE_SECONDS
        try:
            return transport.acquire(claim, refused) or record_launch(transport, claim, refused)
        except NoCapacity as error:
            soon = error.retry_after or 1.0
            pause = min(max(pause, soon / 2), LONG_PAUSE_SECONDS)
            if soon >= 1.0 or time.monotonic() > deadline:
                raise
        except OSError as error:
            if time.monotonic() > deadline:
                raise ExecutionLost("The executions are restarting; repeat the step.", 1.0) from error
        _give_back_connection()
        time.sleep(pause)


def _give_back_connection() -> None:
    """Where threads share some connections to the database: who waits for an execution must not hold one meanwhile."""
    if "pool" in connection.settings_dict["OPTIONS"]:
        connection.close()


def record_return(handle: Handle, episode: dict[str, Any]) -> None:
    """Keep the return of an ended episode, once: a repeated step finds it there. Durable when this returns."""
    execution = Execution.objects.only("pk").get(uid=episode["execution"])
    with _turn_to_write(), transaction.atomic():
        _, created = EpisodeReturn.objects.get_or_create(
            session_id=handle.session,
            episode=episode["number"],
            defaults={
                "run_id": episode["run"],
                "execution": execution,
                "value": episode["return"],
                "length": episode["length"],
                "learning": episode["learning"],
            },
        )
        if created:
            _count(handle, episode)
            _note_activity(handle)


def _count(handle: Handle, episode: dict[str, Any]) -> None:
    """Into the sums of the agent's actions, if its owner wants them and the episode has a single action."""
    if handle.counted_in and "action" in episode:
        tallies.count(episode["run"], handle.counted_in, episode["action"], episode["chosen_at"], episode["return"])


def _turn_to_write() -> AbstractContextManager[Any]:
    """SQLite has one writer, and who finds it busy asks again after ever longer pauses: of 16 threads whose episodes ended
    together, the unlucky ones stood still for 1.2 s. Here they queue. Other databases need no queue.
    """
    return _writer if connection.vendor == "sqlite" else nullcontext()


def _note_activity(handle: Handle) -> None:
    now = timezone.now()
    Agent.objects.filter(pk=handle.agent).exclude(last_activity_at__gt=now - ACTIVITY_EVERY).update(
        last_activity_at=now
    )
    Session.objects.filter(pk=handle.session, last_activity_at__lt=now - ACTIVITY_EVERY).update(last_activity_at=now)
