"""Where an execution serves its sessions: out of turn, refused; too early, parked; else answered and recorded."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents_app.algorithms.replay import Outcome, Segment
from agents_app.algorithms.spec import see
from envs_app import errors
from envs_app.execution.ledger import Ledger, SessionState
from envs_app.execution.worker import Worker
from envs_app.messages import Message, decode_advice, decode_observation
from envs_app.observations import write_action

CATCH_UP_SECONDS = 10.0
PIECE = 128  # steps after which the segment of a session is cut, when several share an execution
NOT_MINE, BUSY = "not_mine", "busy"  # for the web process only: ask the transport for another execution


@dataclass(slots=True)
class Track:
    """What the execution holds of a session in the middle of an episode."""

    segment: Segment
    memory: Any = None
    direct: bool = False  # the algorithm's own episode is under way
    used_at: float = 0.0


@dataclass(slots=True)
class Waiting:
    """A step that is not answered yet."""

    message: Message
    to: Any
    state: SessionState
    acted: bool = False  # ShepherdEnv has the observation; the algorithm will choose the action
    seq: int = 0


class Desk:
    """Answers steps. Belongs to the actor's thread; `answer(to, message)` must not fail when the asker is gone."""

    def __init__(
        self,
        worker: Worker,
        ledger: Ledger,
        answer: Callable[[Any, Message], None],
        report: Callable[[Message], None],
    ) -> None:
        self.worker, self.ledger, self._answer, self._report = worker, ledger, answer, report
        self.tracks: dict[int, Track] = {}
        self.parked: dict[int, Waiting] = {}
        self.throttled_until = 0.0
        self.crowded_until = 0.0  # others wait for a place: whoever begins an episode must ask for one again
        self.used_at = self.caught_up_at = time.monotonic()

    def step(self, message: Message, to: Any) -> None:
        """Serve one step, now or as soon as the learner allows."""
        try:
            self._admit(message, to)
        except errors.ShepherdError as error:
            self._answer(to, refusal(error.code, error.detail, error.retry_after))

    def wake(self) -> None:
        """Go on with parked steps, when the learner has caught up or the algorithm has chosen an action."""
        for session, waiting in list(self.parked.items()):
            if waiting.acted:
                self._give_chosen_action(session, waiting)
            elif not self._must_wait():
                del self.parked[session]
                self._proceed(waiting)

    def next_due(self) -> float | None:
        """Seconds until a parked step may go on though nobody wakes the desk; None when there is none."""
        if self._learner_is_behind() or all(waiting.acted for waiting in self.parked.values()):
            return None
        return max(0.0, self._seconds_early())

    def release(self, session: int) -> None:
        """The session is closed or served elsewhere: forget it."""
        if waiting := self.parked.pop(session, None):
            self._answer(waiting.to, refusal("execution_lost", "The session went elsewhere; repeat the step.", 0.2))
        if track := self.tracks.pop(session, None):
            track.segment.break_off()
        self.ledger.close(session)

    def set_sessions(self, most: int) -> None:
        """So many sessions may be in the middle of an episode from now on; the others find another execution."""
        if self.worker.direct or most == self.worker.spec.sessions:
            return
        self.worker.spec.sessions = most
        for session in list(self._places())[most:]:
            self._evict(session)
        for track in self.tracks.values():  # one that streams must not share the tape
            track.segment.break_off()
            track.segment = self._new_segment()

    def end_unanswered(self) -> None:
        """End the episodes whose clients have been silent for too long, as the agent's owner says.

        The learner gets the outcome that stands for no answer. The session keeps its state: an answer that comes after all ends
        its episode for the curve.
        """
        spec, now = self.worker.spec, time.monotonic()
        self._hand_over_what_is_silent(now)
        if not spec.answer_within or self.worker.direct:
            return
        for session, track in list(self.tracks.items()):
            if session not in self.parked and now - track.used_at >= spec.answer_within:
                if (last := track.segment.last) is not None:
                    track.segment.end(spec.unanswered_reward, last.obs, terminated=True, truncated=False)
                self._evict(session)

    def catch_up(self) -> None:
        """Where nobody has asked for a while, learn what others know by now: whoever asks next shall not begin behind them."""
        now = time.monotonic()
        if now - max(self.used_at, self.caught_up_at) >= CATCH_UP_SECONDS:
            self.caught_up_at = now
            self.worker.catch_up()

    def _hand_over_what_is_silent(self, now: float) -> None:
        """What a session did that will perhaps never come back is learned from all the same."""
        for session, track in self.tracks.items():
            if session not in self.parked and now - track.used_at >= self.worker.spec.reclaim_seconds:
                track.segment.hand_over()

    def abandon(self) -> None:
        """The execution ends: answer what is parked, and let the learner have what is known of running episodes."""
        for waiting in self.parked.values():
            self._answer(waiting.to, refusal("execution_lost", "The execution ended; repeat the step.", 0.2))
        self.parked.clear()
        for track in self.tracks.values():
            track.segment.break_off()

    def status(self) -> Message:
        """What the desk says of itself: how many it serves, and since when (of the monotonic clock) the stalest is silent."""
        silent = [track.used_at for session, track in self.tracks.items() if session not in self.parked]
        return {
            "sessions": len(self.tracks),
            "waiting": len(self.parked),
            "silent_since": min(silent, default=None),
        }

    # --- admission ---
    def _admit(self, message: Message, to: Any) -> None:
        session = message["session"]
        state = self.ledger.load(session)
        if state.owner != self.worker.spec.uid:
            if not message["claim"]:
                self._answer(to, refusal(NOT_MINE, "", None))
                return
            self.release(session)
            state.episode = max(state.episode, message.get("episodes", 0))
        if self._was_answered(message, state):
            self._answer(to, state.reply or {})
            return
        if session in self.parked:
            self._attach_again(self.parked[session], message, to)
            return
        seq = self._next_number(message, state)
        if not message["claim"] and not state.in_episode and time.monotonic() < self.crowded_until:
            self._answer(to, refusal(NOT_MINE, "", None))
            return
        if not self._has_place_for(session):
            self._answer(to, refusal(BUSY, "", None))
            return
        self._check_quota()
        state.owner = self.worker.spec.uid
        waiting = Waiting(message, to, state, seq=seq)
        if self._must_wait():
            self.parked[session] = waiting
            if not self._must_wait():  # it caught up just before there was anybody to wake
                self.wake()
        else:
            self._proceed(waiting)

    def _was_answered(self, message: Message, state: SessionState) -> bool:
        """A retry: of the web process, by its own number; or of the client, by `seq`."""
        if state.reply is None:
            return False
        return message["request"] == state.request or (message["seq"] is not None and message["seq"] == state.seq)

    def _attach_again(self, waiting: Waiting, message: Message, to: Any) -> None:
        """The asker of a parked step lost its connection and asks again; anybody else is too early."""
        same_number = message["seq"] is not None and message["seq"] == waiting.seq
        if message["request"] != waiting.message["request"] and not same_number:
            raise errors.StepPending
        if to != waiting.to:
            text = "The same step was sent again; wait for its answer."
            self._answer(waiting.to, refusal("step_pending", text, None))
        waiting.to = to

    def _next_number(self, message: Message, state: SessionState) -> int:
        expected = None if state.seq is None else state.seq + 1
        given = message["seq"]
        if given is not None and expected is not None and given != expected:
            raise errors.SequenceGap(f"seq is {given}; the next number of this session is {expected}.")
        return given if given is not None else (expected or 0)

    def _has_place_for(self, session: int) -> bool:
        """Whether the session has a place, or one is free, or somebody has been silent for so long that they lose theirs."""
        places = self._places()
        if session in places or len(places) < self.worker.spec.sessions:
            return True
        silent = [other for other in self.tracks if other not in self.parked]
        stalest = min(silent, key=lambda other: self.tracks[other].used_at, default=None)
        if stalest is None or time.monotonic() - self.tracks[stalest].used_at < self.worker.spec.reclaim_seconds:
            return False
        self._evict(stalest)
        return True

    def _places(self) -> dict[int, None]:
        """The sessions that have a place, also those whose first step still waits for the learner."""
        return dict.fromkeys([*self.tracks, *self.parked])

    def _evict(self, session: int) -> None:
        self.release(session)
        self._report({"k": "released", "session": session})

    def _check_quota(self) -> None:
        if (seconds := self.throttled_until - time.monotonic()) > 0:
            raise errors.QuotaExceeded(retry_after=round(seconds, 3))

    def _must_wait(self) -> bool:
        return self._learner_is_behind() or self._seconds_early() > 0

    def _seconds_early(self) -> float:
        """How long it is until the next decision is due."""
        pace = self.worker.pace()
        return self.used_at + pace - time.monotonic() if pace else 0.0

    def _learner_is_behind(self) -> bool:
        worker = self.worker
        return worker.learning and not worker.direct and worker.feed.backlog > worker.allowed_lead

    # --- the step itself ---
    def _proceed(self, waiting: Waiting) -> None:
        message, state = waiting.message, waiting.state
        obs = decode_observation(self.worker.client_space, message["obs"])
        ends = message["terminated"] or message["truncated"]
        if state.in_episode:
            state.sum += message["reward"]
            state.length += 1
        elif not ends:
            state.in_episode, state.episode, state.sum, state.length = True, state.episode + 1, 0.0, 0
            state.began = time.time()
        if ends:
            self._end(waiting, obs)
        else:
            self._go_on(waiting, obs)

    def _go_on(self, waiting: Waiting, obs: Any) -> None:
        """Choose an action; the record of it comes after the answer."""
        worker, message = self.worker, waiting.message
        track = self._track(message["session"])
        mask = _mask(message)
        if not worker.learning:
            track.segment.break_off()
            track.direct = False
            worker.refresh()
            action, track.memory = worker.actor.exploit(worker.show(obs, mask), track.memory, mask)
            self._finish(waiting, action)
        elif worker.direct:
            self._ask_algorithm(waiting, track, see(worker.client_space, obs))
        else:
            worker.refresh()
            seen = worker.see(obs, decode_advice(message.get("advice")), mask)
            decision, track.memory = worker.actor.decide(seen, track.memory, mask)
            self._finish(waiting, decision.action)
            decision.bonus = worker.bonus(decision)
            if track.segment.last is None:
                track.segment.begin(decision)
            else:
                track.segment.follow(message["reward"], seen, decision, message.get("info"))

    def _end(self, waiting: Waiting, obs: Any) -> None:
        """The episode ends; one that ends before it began leaves no trace."""
        worker, message, state = self.worker, waiting.message, waiting.state
        track = self.tracks.pop(message["session"], None)
        played, state.in_episode = state.in_episode, False
        if played:
            worker.counters.episodes += 1
            worker.counters.returns.append(state.sum)
        self._finish(waiting, None, self._episode(state) if played else self._last_episode(message, state))
        self._report({"k": "released", "session": message["session"]})
        if track is None:
            return
        seen = see(worker.client_space, obs)
        if track.direct:
            ends = message["terminated"], not message["terminated"]
            outcome = Outcome(message["reward"], seen, *ends, None, message.get("info"))
            worker.feed.follow(outcome)
        elif track.segment.last is not None:
            ends = message["terminated"], message["truncated"]
            track.segment.end(message["reward"], worker.see(obs, None, _mask(message)), *ends, message.get("info"))

    def _episode(self, state: SessionState) -> dict[str, Any]:
        """What is kept of the episode that ends now."""
        spec, learning = self.worker.spec, self.worker.learning
        facts = {"number": state.episode, "return": state.sum, "length": state.length, "learning": learning}
        return facts | {"run": spec.run, "execution": spec.uid} | _only_action(state)

    def _last_episode(self, message: Message, state: SessionState) -> dict[str, Any] | None:
        """A client without `seq` that ends an episode twice heard no answer: perhaps the return could not be kept."""
        return state.reply["episode"] if message["seq"] is None and state.reply else None

    def _finish(self, waiting: Waiting, action: Any, episode: dict[str, Any] | None = None) -> None:
        """Write the answer into the ledger, then send it."""
        message, state = waiting.message, waiting.state
        sent = None if action is None else write_action(self.worker.action_space, action)
        reply = {"k": "answer", "action": sent, "seq": waiting.seq, "episode": episode, "ended": action is None}
        state.seq, state.request, state.reply = waiting.seq, message["request"], reply
        self.ledger.store(message["session"], state)
        self._answer(waiting.to, reply)
        self.worker.counters.steps += 1
        self.used_at = time.monotonic()

    def _track(self, session: int) -> Track:
        track = self.tracks.get(session)
        if track is None:
            track = self.tracks[session] = Track(self._new_segment())
            self._report({"k": "took", "session": session})
        track.used_at = time.monotonic()
        return track

    def _new_segment(self) -> Segment:
        return Segment(self.worker.feed, stream=self.worker.spec.sessions == 1, piece=min(PIECE, self.worker.rollout))

    # --- algorithms that play themselves ---
    def _ask_algorithm(self, waiting: Waiting, track: Track, seen: Any) -> None:
        feed, message = self.worker.feed, waiting.message
        feed.mask = _mask(message)
        if track.direct:
            feed.follow(Outcome(message["reward"], seen, False, False, None, message.get("info")))
        else:
            feed.begin(seen)
            track.direct = True
        waiting.acted = True
        self.parked[message["session"]] = waiting
        self.wake()

    def _give_chosen_action(self, session: int, waiting: Waiting) -> None:
        action = self.worker.feed.take_action()
        if action is not None:
            del self.parked[session]
            self._finish(waiting, action)


def _only_action(state: SessionState) -> dict[str, Any]:
    """Of an episode of one step, the action if it was one of n, and when it was chosen: what can be counted."""
    action = state.reply["action"] if state.reply and state.length == 1 else None
    return {"action": action, "chosen_at": state.began} if isinstance(action, int) else {}


def _mask(message: Message) -> np.ndarray | None:
    """Which actions the client allows; None: all."""
    return None if message.get("mask") is None else np.array(message["mask"], bool)


def refusal(code: str, detail: str, retry_after: float | None) -> Message:
    """An answer that is no action."""
    if retry_after is not None and not math.isfinite(retry_after):
        retry_after = None
    return {"k": "error", "code": code, "detail": detail, "retry_after": retry_after}
