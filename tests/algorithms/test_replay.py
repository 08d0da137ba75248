"""The tape gives the learner what the actor recorded, in order; segments come whole, whatever becomes of their sessions."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents_app.algorithms import replay
from agents_app.algorithms.replay import Decision, Segment, Tape, TapeClosed

PATIENCE = 10.0


def decide(obs: Any, action: Any = 0) -> Decision:
    """A decision."""
    return Decision(obs, action, ())


def record(tape: Tape, stream: bool, length: int, terminated: bool = True, piece: int = 1000, name: str = "s") -> None:
    """An episode whose observations are s0, s1... and whose reward and action at step n are n."""
    segment = Segment(tape, stream, piece)
    segment.begin(decide(f"{name}0", 0))
    for number in range(1, length):
        segment.follow(number, f"{name}{number}", decide(f"{name}{number}", number))
    segment.end(length, f"{name}{length}", terminated, not terminated)


def play(tape: Tape) -> list[tuple[Any, ...]]:
    """Replay one segment as an algorithm would: the first observation, then what every step returned."""
    seen: list[tuple[Any, ...]] = [(tape.first(),)]
    while True:
        assert tape.current is not None
        outcome = tape.advance(tape.current.action)
        seen.append((outcome.obs, outcome.reward, outcome.terminated, outcome.truncated))
        if outcome.terminated or outcome.truncated:
            return seen


def in_thread(call: Callable[[], Any]) -> Callable[..., Any]:
    """Run in another thread; returns what waits for the result, or raises what was raised."""
    done: list[Any] = []

    def run() -> None:
        try:
            done.append(call())
        except BaseException as error:
            done.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()

    def wait(patience: float = PATIENCE) -> Any:
        thread.join(patience)
        assert done, "it still waits"
        if isinstance(done[0], BaseException):
            raise done[0]
        return done[0]

    return wait


@pytest.mark.parametrize("stream", [True, False])
class TestEpisodes:
    def test_an_episode_is_replayed_as_it_was_played(self, stream: bool) -> None:
        tape = Tape()
        record(tape, stream, 3)
        assert play(tape) == [("s0",), ("s1", 1, False, False), ("s2", 2, False, False), ("s3", 3, True, False)]
        assert tape.backlog == 0

    def test_truncation_is_told_from_termination(self, stream: bool) -> None:
        tape = Tape()
        record(tape, stream, 2, terminated=False)
        assert play(tape)[-1] == ("s2", 2, False, True)

    def test_what_is_both_terminated_and_truncated_is_terminated(self, stream: bool) -> None:
        tape = Tape()
        segment = Segment(tape, stream, 10)
        segment.begin(decide("s0"))
        segment.end(1.0, "s1", True, True)
        assert play(tape)[-1] == ("s1", 1.0, True, False)

    def test_episodes_follow_each_other(self, stream: bool) -> None:
        tape = Tape()
        for name in "abc":
            record(tape, stream, 2, name=name)
        assert [play(tape)[0] for _ in range(3)] == [("a0",), ("b0",), ("c0",)]

    def test_an_episode_of_one_step(self, stream: bool) -> None:
        tape = Tape()
        record(tape, stream, 1)
        assert play(tape) == [("s0",), ("s1", 1, True, False)]

    def test_an_episode_that_breaks_off_is_truncated_at_the_last_state_known(self, stream: bool) -> None:
        tape = Tape()
        segment = Segment(tape, stream, 10)
        segment.begin(decide("s0"))
        for number in (1, 2):
            segment.follow(number, f"s{number}", decide(f"s{number}"))
        segment.break_off()
        assert play(tape) == [("s0",), ("s1", 1, False, False), ("s2", 2, False, True)]
        assert segment.last is None

    def test_one_that_breaks_off_before_any_outcome_leaves_nothing(self, stream: bool) -> None:
        tape = Tape()
        segment = Segment(tape, stream, 10)
        segment.begin(decide("s0"))
        segment.break_off()
        segment.break_off()
        assert tape.backlog == 0
        segment.begin(decide("t0"))
        segment.end(1.0, "t1", True, False)
        assert play(tape)[0] == ("t0",)


class TestStreaming:
    def test_outcomes_come_one_step_late(self) -> None:
        tape = Tape()
        segment = Segment(tape, True, 1000)
        segment.begin(decide("s0"))
        assert tape.backlog == 0
        segment.follow(1, "s1", decide("s1"))
        assert tape.backlog == 1  # the first decision
        segment.follow(2, "s2", decide("s2"))
        assert tape.backlog == 2

    def test_nothing_comes_of_an_episode_that_shares_the_tape_until_it_ends(self) -> None:
        tape = Tape()
        segment = Segment(tape, False, 1000)
        segment.begin(decide("s0"))
        for number in range(1, 50):
            segment.follow(number, f"s{number}", decide(f"s{number}"))
        assert tape.backlog == 0
        segment.end(50, "s50", True, False)
        assert tape.backlog == 51

    def test_long_episodes_come_in_pieces(self) -> None:
        tape = Tape()
        record(tape, False, 7, piece=3)
        assert [len(play(tape)) - 1 for _ in range(3)] == [3, 3, 1]

    def test_each_piece_begins_where_the_one_before_was_truncated(self) -> None:
        tape = Tape()
        record(tape, False, 7, piece=3)
        pieces = [play(tape) for _ in range(3)]
        assert [piece[0][0] for piece in pieces] == ["s0", "s3", "s6"]
        assert [piece[-1][0] for piece in pieces] == ["s3", "s6", "s7"]
        assert [piece[-1][2:] for piece in pieces] == [(False, True), (False, True), (True, False)]

    @settings(max_examples=100, deadline=None)
    @given(
        st.lists(st.tuples(st.integers(0, 2), st.sampled_from(["step", "step", "step", "end", "break"])), max_size=80)
    )
    def test_sessions_that_share_the_tape_are_never_mixed(self, events: list[tuple[int, str]]) -> None:
        tape = Tape()
        segments = [Segment(tape, False, 4) for _ in range(3)]
        counts, expected = [0] * 3, 0
        for session, event in events:
            segment, here = segments[session], (session, counts[session])
            counts[session] += 1
            if event == "break":
                segment.break_off()
            elif segment.last is None:
                segment.begin(decide(here))
            elif event == "end":
                segment.end(0.0, here, True, False)
                expected += 1
            else:
                segment.follow(0.0, here, decide(here))
                expected += 1
        for segment in segments:
            segment.break_off()
        transitions = 0
        while tape.backlog:
            seen = play(tape)
            assert [step[0] for step in seen] == [(seen[0][0][0], seen[0][0][1] + n) for n in range(len(seen))]
            transitions += len(seen) - 1
        assert transitions == expected


class TestTape:
    def test_the_action_must_be_the_recorded_one(self) -> None:
        tape = Tape()
        record(tape, True, 3)
        tape.first()
        with pytest.raises(ValueError, match="the algorithm acts 1, the record says 0"):
            tape.advance(1)
        assert tape.advance(0).reward == 1

    def test_vectors_are_compared_number_by_number(self) -> None:
        tape = Tape()
        segment = Segment(tape, True, 10)
        segment.begin(decide("s0", np.array([0.1, 0.2], np.float32)))
        segment.end(1.0, "s1", True, False)
        tape.first()
        with pytest.raises(ValueError, match="the record says"):
            tape.advance(np.array([0.1, 0.3], np.float32))
        tape.advance(np.array([0.1, 0.2], np.float32))

    def test_a_step_before_the_first_reset_is_refused(self) -> None:
        with pytest.raises(RuntimeError, match="reset"):
            Tape().advance(0)

    def test_a_second_reset_gives_the_same_observation(self) -> None:
        tape = Tape()
        record(tape, True, 2)
        assert tape.first() == tape.first() == "s0"
        assert play(tape)[-1] == ("s2", 2, True, False)

    def test_a_reset_in_the_middle_skips_the_rest(self) -> None:
        tape = Tape()
        record(tape, True, 5, name="a")
        record(tape, True, 2, name="b")
        tape.first()
        tape.advance(0)
        assert tape.first() == "b0"
        assert play(tape)[-1] == ("b2", 2, True, False)

    def test_the_learner_waits_for_what_is_not_recorded_yet(self) -> None:
        tape = Tape()
        first = in_thread(tape.first)
        record(tape, True, 1)
        assert first() == "s0"

    def test_a_learner_that_waits_for_more_gets_less_in_the_end(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(replay, "BATCH_SECONDS", 0.01)
        tape = Tape()
        tape.batch = 100
        first = in_thread(tape.first)
        record(tape, True, 1)
        assert first() == "s0"

    def test_closing_it_ends_the_wait(self) -> None:
        tape = Tape()
        first = in_thread(tape.first)
        tape.close()
        with pytest.raises(TapeClosed):
            first()

    def test_what_is_left_when_it_is_closed_is_not_learned_from(self) -> None:
        tape = Tape()
        record(tape, True, 3)
        tape.close()
        with pytest.raises(TapeClosed):
            tape.first()

    def test_paused_it_gives_nothing(self) -> None:
        tape = Tape()
        tape.pause(True)
        record(tape, True, 1)
        first = in_thread(tape.first)
        with pytest.raises(AssertionError, match="still waits"):
            first(0.05)
        tape.pause(False)
        assert first() == "s0"

    def test_paused_it_can_be_closed(self) -> None:
        tape = Tape()
        tape.pause(True)
        record(tape, True, 1)
        first = in_thread(tape.first)
        tape.close()
        with pytest.raises(TapeClosed):
            first()

    def test_every_item_that_is_taken_is_said(self) -> None:
        tape, taken = Tape(), []
        tape.on_taken = lambda: taken.append(tape.backlog)
        record(tape, True, 3)
        play(tape)
        assert taken == [3, 2, 1, 0]


class TestErrands:
    def test_an_errand_is_run_where_the_learner_waits(self) -> None:
        tape, ran = Tape(), threading.Event()
        first = in_thread(tape.first)
        tape.send_errand(ran.set)
        assert ran.wait(PATIENCE)
        record(tape, True, 1)
        assert first() == "s0"

    def test_an_errand_comes_before_what_is_recorded(self) -> None:
        tape, seen = Tape(), []
        record(tape, True, 1)
        tape.send_errand(lambda: seen.append(tape.backlog))
        tape.first()
        assert seen == [2]

    def test_an_errand_is_run_while_the_tape_is_paused(self) -> None:
        tape, ran = Tape(), threading.Event()
        tape.pause(True)
        in_thread(tape.first)
        tape.send_errand(ran.set)
        assert ran.wait(PATIENCE)
        tape.close()

    def test_the_actor_records_while_an_errand_runs(self) -> None:
        tape, running, gate = Tape(), threading.Event(), threading.Event()
        first = in_thread(tape.first)
        tape.send_errand(lambda: (running.set(), gate.wait(PATIENCE)))
        assert running.wait(PATIENCE)
        record(tape, True, 4)  # would wait for ever if the errand held the lock
        assert tape.backlog == 5
        gate.set()
        assert first() == "s0"

    def test_an_errand_that_fails_fails_the_learner(self) -> None:
        tape = Tape()
        tape.send_errand(lambda: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            tape.first()
        record(tape, True, 1)  # and leaves no lock behind


@pytest.mark.parametrize("stream", [True, False])
@pytest.mark.parametrize("piece", [2, 1000])
def test_the_bonus_of_a_decision_comes_with_its_own_reward(stream: bool, piece: int) -> None:
    tape = Tape()
    segment = Segment(tape, stream, piece)
    for number in range(4):
        decision = Decision(number, number, (), bonus=0.5 * number)
        if number == 0:
            segment.begin(decision)
        else:
            segment.follow(10.0 * number, number, decision)
    segment.end(40.0, 4, True, False)
    rewards = [outcome[1] for _ in range(2 if piece == 2 and not stream else 1) for outcome in play(tape)[1:]]
    assert rewards == [10.0, 20.5, 31.0, 41.5]
