"""POST /shepherd/env/: the original protocol."""

import pytest

from envs_app import errors
from envs_app.steps import Reply, Step

STEP = {"session_key": "ss_1", "obs": [0.5] * 8, "reward": 1.5, "done": False, "info": {}}


def post(api, body=None, path="/shepherd/env/", **changes):
    return api.post(path, STEP | changes if body is None else body)


@pytest.mark.parametrize("path", ["/shepherd/env/", "/shepherd/env"])
def test_it_answers_with_nothing_but_an_action(api, core, path):
    response = post(api, path=path)
    assert (response.status_code, response.json()) == (200, {"action": 2})
    assert core.steps == [("ss_1", Step([0.5] * 8, 1.5, info={}))]


def test_done_is_terminated_and_answered_with_null(api, core):
    core.answer = lambda key, step: Reply(None, 5, 10.0)
    assert post(api, done=True).json() == {"action": None}
    assert (core.steps[0][1].terminated, core.steps[0][1].truncated, core.steps[0][1].seq) == (True, False, None)


def test_an_obs_of_null_closes_the_session(api, core, monkeypatch):
    closed = []
    monkeypatch.setattr("envs_app.views.legacy.close_session", closed.append)
    assert post(api, obs=None).json() == {"action": None}
    assert (closed, core.steps) == (["ss_1"], [])


def test_what_clients_in_the_field_leave_out_or_add_is_forgiven(api, core):
    post(api, {"session_key": "ss_1", "obs": 3})
    post(api, {"session_key": "ss_1", "obs": 3, "reward": None, "done": 0, "info": None, "more": 1})
    assert [step for _, step in core.steps] == [Step(3), Step(3)]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"session_key": None}, "needs session_key"),
        ({"reward": float("nan")}, "reward is nan"),
        ({"reward": "1"}, "reward is the text"),
        ({"done": "yes"}, "done is true or false"),
        ({"done": 2}, "done is true or false"),
        ({"info": []}, "info is an object"),
    ],
)
def test_it_says_what_is_wrong_in_its_own_words(api, core, changes, words):
    response = post(api, **changes)
    assert response.status_code == 422
    assert response.json().keys() == {"ok", "error"}
    assert words in response.json()["error"]
    assert core.steps == []


def test_it_refuses_a_step_without_an_observation(api, core):
    response = post(api, {"session_key": "ss_1"})
    assert (response.status_code, response.json()) == (422, {"ok": False, "error": "The request has no obs."})


@pytest.mark.parametrize("kind", errors.ShepherdError.__subclasses__())
def test_every_error_is_told_in_its_own_words(api, core, kind):
    core.answer = kind("Do something else.", 7)
    response = post(api)
    assert (response.status_code, response.json()) == (kind.status, {"ok": False, "error": "Do something else."})
    assert response.get("Retry-After") == ("7" if kind.status in (429, 503) else None)


def test_a_fault_tells_the_client_nothing(api, core):
    core.answer = RuntimeError("swordfish")
    response = post(api)
    assert response.status_code == 500
    assert response.json()["ok"] is False
    assert b"swordfish" not in response.content


def test_it_needs_no_csrf_token(api, core):
    api.client.handler.enforce_csrf_checks = True
    assert post(api).json() == {"action": 2}
