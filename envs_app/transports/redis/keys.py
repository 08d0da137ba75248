"""The names of what lies in Redis, and how long each lives: every key expires."""

from __future__ import annotations

PREFIX = "shepherd"

LEASE = 10.0  # seconds without a sign of life, and an execution or a machine is dead to the others
START_LEASE = 20.0  # from the launch until a worker must have taken it
BUILD_LEASE = 60.0  # from then until the algorithm must have been built
STOP_LEASE = 25.0  # while it saves, and says nothing
SETTLE = 4.5  # after Redis lost its memory: until the living have said that they live, who may be in the middle of an attempt
REPLY = 60.0  # an answer that nobody fetches
AGENT = 3600.0  # what is shared of an agent that nobody uses
EVENTS = 24 * 3600.0  # what happened, and no housekeeper read


def lease(uid: str) -> str:
    """There while the execution serves. Its value: the run of Redis in which it is listened for at `alive`, if it is."""
    return f"{PREFIX}:lease:{uid}"


def alive(uid: str) -> str:
    """A channel, to which the execution listens for as long as its process lives; nothing is ever said there."""
    return f"{PREFIX}:alive:{uid}"


def inbox(uid: str) -> str:
    """A list: what the execution shall do."""
    return f"{PREFIX}:inbox:{uid}"


def pending(uid: str) -> str:
    """A set: the reply lists of the steps that the execution has not answered."""
    return f"{PREFIX}:pending:{uid}"


def reply(number: str) -> str:
    """A list: the answer to one call."""
    return f"{PREFIX}:reply:{number}"


def ledger(session: int) -> str:
    """A hash: where a session stands, its owner, and the generation of that ownership."""
    return f"{PREFIX}:ledger:{session}"


def weights(uid: str) -> str:
    """The policy that an execution published."""
    return f"{PREFIX}:weights:{uid}"


def peers(run: int) -> str:
    """A hash: who has published in a run."""
    return f"{PREFIX}:peers:{run}"


def agent(name: str) -> str:
    """What is changed by compare-and-set: promised places, queues, failures, launches."""
    return f"{PREFIX}:agent:{name}"


def executions(agent: str) -> str:
    """A hash: what each live execution of an agent says of itself. Only the execution writes its field."""
    return f"{PREFIX}:executions:{agent}"


def bucket(agent: str) -> str:
    """The CPU quota of an agent."""
    return f"{PREFIX}:bucket:{agent}"


AGENTS = f"{PREFIX}:agents"  # sorted: agents with executions, by the last sign of life
RUNNING = f"{PREFIX}:running"  # sorted by queue: executions, by the end of their lease
MACHINES = f"{PREFIX}:machines"  # hash: what each worker says of itself
KNOWN = f"{PREFIX}:known"  # there while somebody gives signs of life: Redis has not lost its memory
SETTLING = f"{PREFIX}:settling"  # there while the living say that they live
STREAM = f"{PREFIX}:events"  # stream: what happened


def running(queue: str) -> str:
    """The executions of a queue."""
    return f"{RUNNING}:{queue}"


def ms(seconds: float) -> int:
    """As Redis counts."""
    return round(seconds * 1000)
