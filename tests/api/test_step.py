"""POST /api/v1/step: what the web layer makes of a request before and after envs_app.sessions."""

import pytest
from django.db import OperationalError

from envs_app import errors
from envs_app.steps import Reply
from envs_app.transports.base import Away
from tests.api.conftest import assert_problem

STEP = {"obs": [0.5] * 8, "reward": 1.5, "terminated": False, "truncated": False}


def post(api, body=None, **changes):
    return api.post("/api/v1/step", STEP | changes if body is None else body, key="ss_1")


def without(key):
    return {name: value for name, value in STEP.items() if name != key}


def test_it_answers_with_an_action(api, core):
    response = post(api, seq=17)
    assert response.status_code == 200
    assert response["Content-Type"] == "application/json"
    assert response["Content-Length"] == str(len(response.content))
    assert response.json() == {"action": 2, "seq": 17}


def test_it_answers_the_end_of_an_episode_with_its_return(api, core):
    core.answer = lambda key, step: Reply(None, 18, -123.5)
    assert post(api, terminated=True).json() == {"action": None, "seq": 18, "episode_return": -123.5}


def test_it_hands_on_everything_that_a_client_may_say(api, core):
    post(api, truncated=True, info={"a": 1}, seq=3, advice=[0.1, 0.9], action_mask=[True, False])
    ((key, step),) = core.steps
    assert key == "ss_1"
    assert (step.obs, step.reward, step.terminated, step.truncated) == ([0.5] * 8, 1.5, False, True)
    assert (step.info, step.seq, step.advice, step.action_mask) == ({"a": 1}, 3, [0.1, 0.9], [True, False])


def test_null_is_as_good_as_leaving_out_what_may_be_left_out(api, core):
    post(api, info=None, seq=None, advice=None, action_mask=None)
    post(api)
    assert core.steps[0] == core.steps[1]


def test_it_does_not_touch_the_database(api, core):
    assert post(api).status_code == 200  # pytest-django refuses every query of a test without the mark


@pytest.mark.parametrize("header", ["", "Bearer", "Bearer ", "Basic abc", "ss_1"])
def test_it_wants_a_session_key(api, core, header):
    response = api.post("/api/v1/step", STEP, Authorization=header)
    assert_problem(response, 401, "unknown_session", "Authorization: Bearer <session key>")
    assert response["WWW-Authenticate"] == 'Bearer realm="Shepherd"'
    assert core.steps == []


def test_the_scheme_may_be_written_in_any_case(api, core):
    assert api.post("/api/v1/step", STEP, Authorization="bearer ss_1").status_code == 200


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"terminated": 0}, "invalid_request", "terminated and truncated are true or false"),
        ({"truncated": "false"}, "invalid_request", "terminated and truncated are true or false"),
        ({"truncated": None}, "invalid_request", "terminated and truncated are true or false"),
        ({"info": []}, "invalid_request", "info is an object"),
        ({"info": "x"}, "invalid_request", "info is an object"),
        ({"seq": -1}, "invalid_request", "seq is a whole number"),
        ({"seq": 1.0}, "invalid_request", "seq is a whole number"),
        ({"seq": True}, "invalid_request", "seq is a whole number"),
        ({"seq": "1"}, "invalid_request", "seq is a whole number"),
        ({"seq": 2**63}, "invalid_request", "seq is a whole number"),
        ({"action_mask": {}}, "invalid_request", "action_mask is a list"),
        ({"done": False}, "invalid_request", "has an unknown 'done'; its keys are"),
        ({"reward": None}, "invalid_reward", "reward is null; a finite number is expected"),
        ({"reward": True}, "invalid_reward", "reward is true"),
        ({"reward": "1"}, "invalid_reward", "reward is the text '1'"),
        ({"reward": float("nan")}, "invalid_reward", "reward is nan"),
        ({"reward": float("inf")}, "invalid_reward", "reward is inf"),
    ],
)
def test_it_refuses_what_is_of_the_wrong_type_and_says_what_to_write(api, core, changes, code, words):
    assert_problem(post(api, **changes), 422, code, words)
    assert core.steps == []


@pytest.mark.parametrize("key", STEP)
def test_it_refuses_a_missing_key(api, core, key):
    assert_problem(post(api, without(key)), 422, "invalid_request", f"The request lacks {key}")
    assert core.steps == []


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"", "The body is empty: send a JSON object."),
        (b"{", "not valid JSON"),
        (b"obs=1", "not valid JSON"),
        (b'{"obs": NaN', "not valid JSON"),
        (b'{"obs": "\\ud800", "reward": NaN}', "not valid JSON"),
        (b"\xff\xfe", "not valid JSON"),
        (b"[" * 100_000, "not valid JSON"),
        (b'{"reward": NaN, "obs": ' + b"[" * 100_000, "not valid JSON"),
        (b"[1, 2]", "must be a JSON object"),
        (b"null", "must be a JSON object"),
        (b"NaN", "must be a JSON object"),
    ],
)
def test_it_refuses_a_body_that_is_no_json_object(api, core, body, words):
    assert_problem(post(api, body), 422, "invalid_request", words)
    assert core.steps == []


def test_a_nan_in_the_observation_reaches_the_check_that_says_where_it_is(api, core):
    post(api, obs=[float("nan"), float("inf")])
    assert str(core.steps[0][1].obs) == "[nan, inf]"


@pytest.mark.parametrize("content_type", ["text/plain", "", "application/x-www-form-urlencoded", "multipart/form-data"])
def test_it_reads_json_whatever_the_content_type(api, core, content_type):
    body = b'{"obs": 1, "reward": 0, "terminated": false, "truncated": false}'
    response = api.client.post("/api/v1/step", body, content_type, headers={"Authorization": "Bearer ss_1"})
    assert response.status_code == 200


def test_it_refuses_a_body_that_is_too_large(api, core, settings):
    settings.MAX_BODY_BYTES = settings.DATA_UPLOAD_MAX_MEMORY_SIZE = 2048
    assert_problem(post(api, obs=[1.0] * 1000), 413, "request_too_large", "larger than 2048 bytes")
    assert post(api).status_code == 200


@pytest.mark.parametrize("kind", errors.ShepherdError.__subclasses__())
def test_every_error_becomes_a_problem(api, core, kind):
    core.answer = kind("Do something else.")
    problem = assert_problem(post(api), kind.status, kind.code, "Do something else.")
    assert ("retry_after" in problem) == (kind.status in (429, 503))


@pytest.mark.parametrize(
    ("wait", "header", "exact"),
    [(0.2, "1", 0.2), (1.0, "1", 1.0), (41.0004, "42", 41.001), (None, "1", 1.0), (-3, "1", 0.0)],
)
def test_it_says_how_long_to_wait_in_whole_seconds_and_exactly(api, core, wait, header, exact):
    core.answer = errors.QuotaExceeded(retry_after=wait)
    response = post(api)
    assert response["Retry-After"] == header
    assert response.json()["retry_after"] == exact


def test_a_database_that_is_locked_is_a_503(api, core):
    core.answer = OperationalError("database is locked")
    response = post(api)
    assert_problem(response, 503, "unavailable", "The database cannot be reached now")
    assert response["Retry-After"] == "1"


def test_executions_that_cannot_be_reached_are_a_503(api, core):
    core.answer = ConnectionRefusedError(111, "Connection refused")
    assert_problem(post(api), 503, "unavailable", "The executions, or what they saved, cannot be reached now")


def test_while_what_carries_the_steps_is_away_it_is_asked_again_soon(api, core):
    """Most often it is being started again; the header has whole seconds only."""
    core.answer = Away("Redis does not answer")
    response = post(api)
    assert_problem(response, 503, "unavailable", "The executions, or what they saved, cannot be reached now")
    assert response["Retry-After"] == "1"
    assert response.json()["retry_after"] == 0.25


def test_a_fault_is_logged_with_its_traceback_and_tells_the_client_nothing(api, core, capsys, caplog):
    core.answer = RuntimeError("the password is swordfish")
    response = post(api)
    assert_problem(response, 500, "internal_error", "in the server's log")
    assert b"swordfish" not in response.content
    (record,) = [record for record in caplog.records if record.levelname == "ERROR"]
    assert "swordfish" in str(record.exc_info or record.msg)


def test_other_methods_are_refused(api, core):
    response = api.get("/api/v1/step")
    assert_problem(response, 405, "method_not_allowed", "GET")
    assert response["Allow"] == "POST"
