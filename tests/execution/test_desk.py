"""What an execution answers: in turn and out of turn, once and again, whoever held the session before."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.execution.station import Station


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    """A PPO that learns from rollouts of 32 steps; its actor may lead by 8."""
    with Station(tmp_path) as one:
        yield one


def run_ahead(station: Station, session: int = 1) -> str:
    """Step until the learner, which is held, is too far behind; returns the request that is parked."""
    for _ in range(100):
        request = station.post(session, reward=1.0)
        if request not in station.answers:
            return request
    raise AssertionError("nothing is parked")


class TestEpisodes:
    def test_every_observation_gets_an_action_and_the_last_one_the_return(self, station: Station) -> None:
        for _ in range(3):
            answer = station.step(reward=0.5)
            assert answer["action"] in range(3)
            assert not answer["ended"]
        end = station.step(reward=2.0, terminated=True)
        assert end["ended"]
        assert end["action"] is None
        assert end["episode"] == {
            "number": 1, "return": 3.0, "length": 3, "learning": True, "run": 1, "execution": "first"
        }  # fmt: skip

    def test_the_reward_of_the_first_observation_is_ignored(self, station: Station) -> None:
        station.step(reward=1000.0)
        assert station.step(reward=1.0, truncated=True)["episode"]["return"] == 1.0

    def test_an_episode_that_ends_with_its_first_message_leaves_no_trace(self, station: Station) -> None:
        answer = station.step(reward=5.0, terminated=True)
        assert (answer["ended"], answer["episode"]) == (True, None)
        assert station.worker.counters.episodes == 0
        station.step()
        assert station.step(reward=1.0, terminated=True)["episode"]["number"] == 1

    def test_of_an_episode_of_one_step_the_action_is_told_and_when_it_was_chosen(self, station: Station) -> None:
        before = time.time()
        action = station.step()["action"]
        between = time.time()
        episode = station.step(reward=1.0, terminated=True)["episode"]
        assert episode["action"] == action
        assert before <= episode["chosen_at"] <= between

    def test_the_next_episode_begins_anew(self, station: Station) -> None:
        station.play(9, length=3)
        assert [answer["episode"] for answer in station.answers.values() if answer["ended"]] == [
            {"number": number, "return": 3.0, "length": 3, "learning": True, "run": 1, "execution": "first"}
            for number in (1, 2, 3)
        ]

    def test_a_client_without_numbers_that_ends_an_episode_twice_hears_of_the_same_one(self, station: Station) -> None:
        """It was told 503, say: the return was made, and could not be kept."""
        ended = station.play(3, length=3)[-1]
        assert ended["episode"]["return"] == 3.0
        assert station.step(terminated=True)["episode"] == ended["episode"]
        assert station.worker.counters.episodes == 1

    def test_the_parent_is_told_who_has_a_place(self, station: Station) -> None:
        station.step(session=7)
        assert station.told("took") == [{"k": "took", "session": 7}]
        station.step(session=7, terminated=True)
        assert station.told("released") == [{"k": "released", "session": 7}]


class TestTurns:
    def test_a_repeated_number_gets_the_stored_answer(self, station: Station) -> None:
        station.step(seq=1)
        answer = station.step(seq=2, reward=1.0)
        assert station.step(seq=2, reward=1.0) == answer
        assert station.step(seq=3, reward=1.0, terminated=True)["episode"]["return"] == 2.0

    def test_a_repeated_end_gets_the_same_return(self, station: Station) -> None:
        station.step(seq=1)
        assert station.step(seq=2, terminated=True) == station.step(seq=2, terminated=True)
        assert station.worker.counters.episodes == 1

    def test_a_request_that_the_web_process_repeats_is_stepped_once(self, station: Station) -> None:
        station.step()
        answer = station.step(reward=1.0, request="the same")
        assert station.step(reward=1.0, request="the same") == answer
        assert station.step(terminated=True)["episode"]["return"] == 1.0

    def test_a_gap_is_refused_and_changes_nothing(self, station: Station) -> None:
        station.step(seq=1)
        refusal = station.step(seq=3)
        assert (refusal["k"], refusal["code"]) == ("error", "sequence_gap")
        assert "2" in refusal["detail"]
        assert station.step(seq=2)["k"] == "answer"

    def test_any_first_number_is_taken(self, station: Station) -> None:
        assert station.step(seq=41)["seq"] == 41
        assert station.step(seq=42)["seq"] == 42

    def test_without_numbers_every_message_is_a_new_step(self, station: Station) -> None:
        assert [station.step(reward=1.0)["seq"] for _ in range(3)] == [0, 1, 2]


class TestLead:
    def test_acting_goes_on_while_the_learner_is_busy(self, station: Station) -> None:
        station.hold_learner()
        for _ in range(station.worker.allowed_lead):
            assert station.post() in station.answers

    def test_a_step_past_the_lead_waits_for_the_learner(self, station: Station) -> None:
        let_go = station.hold_learner()
        parked = run_ahead(station)
        station.desk.wake()
        assert parked not in station.answers
        let_go()
        assert station.wait_for_answer(parked)["k"] == "answer"

    def test_a_step_while_one_is_pending_is_refused(self, station: Station) -> None:
        let_go = station.hold_learner()
        parked = run_ahead(station)
        assert station.step()["code"] == "step_pending"
        let_go()
        assert station.wait_for_answer(parked)["k"] == "answer"

    def test_a_pending_step_that_is_asked_again_answers_the_last_asker(self, station: Station) -> None:
        let_go = station.hold_learner()
        parked = run_ahead(station)
        station.post(request=parked, to="another connection")
        let_go()
        assert station.wait_for_answer("another connection")["k"] == "answer"
        assert station.answers[parked]["code"] == "step_pending"  # nobody waits in vain

    def test_a_pending_step_is_asked_again_by_its_number(self, station: Station) -> None:
        let_go = station.hold_learner()
        numbers = iter(range(1, 100))
        parked = next(
            n for n in numbers if station.post(seq=n, to=f"number {n}") and f"number {n}" not in station.answers
        )
        station.post(seq=parked, to="another connection")
        let_go()
        assert station.wait_for_answer("another connection")["seq"] == parked

    def test_evaluation_waits_for_no_learner(self, station: Station) -> None:
        station.hold_learner()
        run_ahead(station)
        station.worker.set_learning(False)
        station.desk.wake()
        assert all(station.post() in station.answers for _ in range(50))


class TestQuota:
    def test_a_throttled_agent_is_told_how_long_to_wait(self, station: Station) -> None:
        station.step(seq=1)
        station.desk.throttled_until = time.monotonic() + 5
        refusal = station.step(seq=2)
        assert refusal["code"] == "quota_exceeded"
        assert 4 < refusal["retry_after"] <= 5

    def test_what_was_answered_is_repeated_all_the_same(self, station: Station) -> None:
        answer = station.step(seq=1)
        station.desk.throttled_until = time.monotonic() + 5
        assert station.step(seq=1) == answer

    def test_the_refused_step_goes_on_later(self, station: Station) -> None:
        station.step(seq=1)
        station.desk.throttled_until = time.monotonic() + 60
        station.step(seq=2)
        station.desk.throttled_until = time.monotonic()
        assert station.step(seq=2, reward=1.0, terminated=True)["episode"]["return"] == 1.0


class TestPlaces:
    def test_a_second_session_is_sent_elsewhere(self, station: Station) -> None:
        station.step(session=1)
        assert station.step(session=2)["code"] == "busy"

    def test_the_place_is_free_between_episodes(self, station: Station) -> None:
        station.step(session=1)
        station.step(session=1, terminated=True)
        assert station.step(session=2)["k"] == "answer"
        assert station.step(session=1)["code"] == "busy"

    def test_a_parked_session_has_its_place(self, station: Station) -> None:
        let_go = station.hold_learner()
        run_ahead(station, session=1)
        station.desk.parked.clear()
        station.desk.release(1)  # its next message begins an episode, and must wait for the learner
        parked = station.post(session=1)
        assert parked not in station.answers
        assert station.step(session=2)["code"] == "busy"
        let_go()
        assert station.wait_for_answer(parked)["k"] == "answer"

    def test_a_silent_session_loses_its_place(self, tmp_path: Path) -> None:
        with Station(tmp_path, reclaim_seconds=0.02) as station:
            station.step(session=1)
            time.sleep(0.03)
            assert station.step(session=2)["k"] == "answer"
            assert {"k": "released", "session": 1} in station.reports
            assert station.step(session=1)["code"] == "busy"

    def test_a_silent_session_keeps_its_place_until_then(self, tmp_path: Path) -> None:
        with Station(tmp_path, reclaim_seconds=60) as station:
            station.step(session=1)
            assert station.step(session=2)["code"] == "busy"

    def test_a_session_whose_step_is_pending_is_not_silent(self, tmp_path: Path) -> None:
        with Station(tmp_path, reclaim_seconds=0.0) as station:
            station.hold_learner()
            run_ahead(station, session=1)
            assert station.step(session=2)["code"] == "busy"

    def test_the_refused_session_finds_its_episode_again(self, tmp_path: Path) -> None:
        with Station(tmp_path, reclaim_seconds=0.0) as station:
            station.step(session=1)
            station.step(session=1, reward=1.0)
            station.step(session=2)
            station.step(session=1, reward=1.0)  # takes its place back
            assert station.step(session=1, reward=1.0, terminated=True)["episode"]["return"] == 3.0

    def test_a_closed_session_leaves_its_place(self, station: Station) -> None:
        station.step(session=1)
        station.desk.release(1)
        assert station.step(session=2)["k"] == "answer"

    def test_closing_a_session_answers_its_pending_step(self, station: Station) -> None:
        station.hold_learner()
        parked = run_ahead(station)
        station.desk.release(1)
        assert station.answers[parked]["code"] == "execution_lost"


class TestOwners:
    @pytest.fixture
    def other(self, tmp_path: Path) -> Iterator[Station]:
        """Another execution of the run."""
        with Station(tmp_path, uid="second", number=2) as one:
            yield one

    def test_a_session_of_another_execution_is_refused_unless_it_is_claimed(
        self, station: Station, other: Station
    ) -> None:
        station.step()
        assert other.step(claim=False)["code"] == "not_mine"
        assert other.step(claim=True)["k"] == "answer"
        assert station.step(claim=False)["code"] == "not_mine"

    def test_a_new_session_must_be_claimed(self, station: Station) -> None:
        assert station.step(claim=False)["code"] == "not_mine"

    def test_the_episode_goes_on_where_it_was(self, station: Station, other: Station) -> None:
        station.step(seq=1)
        station.step(seq=2, reward=1.0)
        other.step(seq=3, reward=1.0)
        end = other.step(seq=4, reward=1.0, terminated=True)
        assert (end["episode"]["return"], end["episode"]["length"]) == (3.0, 3)
        assert end["episode"]["execution"] == "second"

    def test_the_last_answer_of_the_other_is_repeated(self, station: Station, other: Station) -> None:
        station.step(seq=1)
        answer = station.step(seq=2)
        assert other.step(seq=2) == answer

    def test_the_newcomer_says_that_it_has_the_session(self, station: Station, other: Station) -> None:
        station.step()
        other.step()
        assert other.told("took") == [{"k": "took", "session": 1}]

    def test_a_session_may_go_back_and_forth(self, station: Station, other: Station) -> None:
        for number in range(1, 21):
            answer = (other if number // 3 % 2 else station).step(seq=number, reward=1.0)
            assert answer["seq"] == number
        end = station.step(seq=21, reward=1.0, terminated=True)
        assert (end["episode"]["return"], end["episode"]["length"]) == (20.0, 20)

    def test_numbers_of_episodes_that_are_recorded_are_not_used_again(self, station: Station) -> None:
        message = {"k": "step", "session": 1, "request": "a", "seq": None, "claim": True, "episodes": 12, "mask": None}
        obs = station.somewhere().tobytes()
        station.desk.step({**message, "obs": obs, "reward": 0.0, "terminated": False, "truncated": False}, "a")
        assert station.step(terminated=True)["episode"]["number"] == 13


class TestEnd:
    def test_pending_steps_are_told_to_ask_again(self, station: Station) -> None:
        station.hold_learner()
        parked = run_ahead(station)
        station.desk.abandon()
        assert station.answers[parked]["code"] == "execution_lost"
        assert station.answers[parked]["retry_after"] > 0

    def test_what_is_known_of_a_running_episode_is_learned_from(self, station: Station) -> None:
        for _ in range(6):
            station.step()
        station.desk.abandon()
        station.wait_until(lambda: station.learned_from == 4)  # 5 outcomes; the last one ends the tape
