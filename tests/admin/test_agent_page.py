"""What owners do on the page of an agent."""

import csv
import io
import re
from datetime import timedelta

import pytest
from django.test import Client
from django.urls import reverse
from django.utils import timezone

from agents_app.admin.agents import ADVICE, AgentAdmin, advice_fields
from agents_app.models import Agent, Algorithm, APIKey, EpisodeReturn, Parameter, hash_key
from tests.agents.makers import make_agent


def url(agent, name="change", *arguments):
    return reverse(f"admin:agents_app_agent_{name}", args=[agent.pk, *arguments])


@pytest.fixture
def fresh(ann):
    """An agent of Ann's that has not learned yet."""
    return make_agent("puppy", ann)


def act(client, agent, name):
    return client.post(url(agent, "action_view", name), follow=True)


def fields_of(agent, **changes):
    """What the form of an agent sends."""
    names = ["name", "policy", "max_percent_cpu", "max_executions", "sessions_per_execution"]
    ticks = ("enable_learning", "learning_correction", "peers_advise")
    names += [name for name in ADVICE if name not in (*ticks, "advisor")]
    fields = {
        name: getattr(agent, name)
        for name in [*names, "start_from", "save_interval", "answer_within", "unanswered_reward"]
    }
    fields |= {name: "on" for name in ticks if getattr(agent, name)} | {"advisor": agent.advisor_id or ""}
    fields |= {"action_space": "4", "observation_space": "[[8], -10, 10]"}
    return {name: value for name, value in (fields | changes).items() if value is not None}


def save(client, agent, **changes):
    return client.post(url(agent), fields_of(agent, **changes), follow=True)


def errors(response):
    return response.context["adminform"].form.errors


# --- advice ---


def shown(agent):
    return set(advice_fields(agent)["fields"])


def test_only_the_settings_of_advice_that_mean_anything_are_shown(ann):
    continuous = {"continuous_advice", "advice_samples"}
    vector = make_agent("vector", ann, action_space=[[2], -1, 1])
    assert shown(make_agent("discrete", ann)) == set(ADVICE) - continuous
    assert shown(vector) == set(ADVICE) - {"rho"}
    assert shown(make_agent("off", ann, algorithm="DQN")) == set(ADVICE) - continuous - {"learning_correction"}
    assert shown(make_agent("bdpi", ann, algorithm="BDPI")) == set(ADVICE) - continuous
    assert shown(make_agent("none", ann, algorithm="ARS")) == {"advice_method"}


def test_each_setting_is_hidden_by_a_condition_on_one_that_is_shown():
    assert set(AgentAdmin.conditional_fields) == set(ADVICE) - {"advice_method"}
    known = {value for choices in (Agent.AdviceMethod, Agent.ContinuousAdvice) for value in choices.values}
    for condition in AgentAdmin.conditional_fields.values():
        assert re.findall("(\\w+) [!=]= ", condition)[0] == "advice_method"
        assert set(re.findall("'(.*?)'", condition)) <= known


def test_another_agent_of_the_owner_may_advise(client, ann, fresh, foreign):
    learned = make_agent("old dog", ann, algorithm="DQN")
    make_agent("other eyes", ann, observation_space=3)
    make_agent("without probabilities", ann, algorithm="ARS")
    field = client.get(url(fresh)).context["adminform"].form.fields["advisor"]
    assert list(field.queryset) == [learned]
    save(client, fresh, advisor=str(learned.pk), advisor_save="best", peers_advise=None)
    fresh.refresh_from_db()
    assert (fresh.advisor, fresh.advisor_save, fresh.peers_advise) == (learned, "best", False)
    for stranger in (foreign, fresh):
        page = save(client, fresh, advisor=str(stranger.pk))
        assert "advisor" in errors(page)
    learned.delete()
    fresh.refresh_from_db()
    assert fresh.advisor is None


def test_an_algorithm_without_advice_says_so(client, ann):
    agent = make_agent("ars", ann, algorithm="ARS")
    assert agent.advice_method == "none"
    assert "ARS takes no advice." in client.get(url(agent)).content.decode()
    page = save(client, agent, advice_method="reuse")
    assert errors(page) == {"advice_method": ["ARS takes no advice: write none, or choose another algorithm."]}


def test_advice_is_set(client, fresh):
    changes = {"advice_method": "reuse", "psi": "0.25", "advisors": "best", "advice_form": "deterministic"}
    save(client, fresh, **changes)
    fresh.refresh_from_db()
    assert (fresh.advice_method, fresh.psi, fresh.advisors, fresh.advice_form) == (
        "reuse",
        0.25,
        "best",
        "deterministic",
    )


@pytest.mark.parametrize(("name", "value"), [("psi", "1.1"), ("rho", "-1"), ("shaping_scale", "-1"), ("psi", "nan")])
def test_shares_and_scales_have_bounds(client, fresh, name, value):
    assert set(errors(save(client, fresh, **{name: value}))) == {name}


# --- making one ---


def test_an_agent_is_made_with_the_basics_and_belongs_to_who_made_it(client):
    data = {"name": "new", "algorithm": Algorithm.objects.get(name="SAC").pk}
    data |= {"action_space": "[[2], -1, 1]", "observation_space": "[[3], -1, 1]"}
    page = client.post(reverse("admin:agents_app_agent_add"), data, follow=True)
    agent = Agent.objects.get()
    assert (agent.owner.name, agent.action_space, agent.policy) == ("ann", [[2], -1, 1], "auto")
    assert agent.runs.count() == 1
    assert page.redirect_chain[-1][0] == url(agent)


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("action_space", "[[2], -1", "This cannot be read: write e.g. 4"),
        ("action_space", "{}", "required"),
        ("action_space", "[[2], -1, 1]", "write a whole number n"),
        ("observation_space", "[[8], -Infinity, 1]", "must be finite"),
        ("observation_space", "[[8]]", "this one has 1"),
        ("name", "sheepdog", "already exists"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_is_made(client, agent, field, value, sentence):
    data = {"name": "new", "algorithm": Algorithm.objects.get(name="DQN").pk, "action_space": "2"}
    data |= {"observation_space": "[[8], -1, 1]", field: value}
    page = client.post(reverse("admin:agents_app_agent_add"), data)
    assert page.status_code == 200
    assert sentence in str(errors(page))
    assert Agent.objects.count() == 1


# --- parameters ---


def test_the_page_has_a_field_for_each_parameter_of_the_algorithm_alone(client, agent):
    form = client.get(url(agent)).context["adminform"].form
    shown = {name.removeprefix("parameter_") for name in form.fields if name.startswith("parameter_")}
    assert shown == set(Parameter.objects.filter(algorithm__name="PPO").values_list("name", flat=True))
    gamma = form.fields["parameter_gamma"]
    assert gamma.widget.attrs["placeholder"] == "default: 0.99"
    assert "future" in gamma.help_text


def test_values_are_kept_by_type_and_an_empty_field_is_the_default(client, fresh):
    agent = fresh
    changes = {"parameter_gamma": "0.9", "parameter_n_steps": "64", "parameter_normalize_advantage": "false"}
    save(client, agent, **changes, parameter_net_arch="32,32")
    assert agent.own_parameters() == {"gamma": 0.9, "n_steps": 64, "normalize_advantage": False, "net_arch": "32,32"}
    form = client.get(url(agent)).context["adminform"].form
    assert form["parameter_gamma"].value() == 0.9
    save(client, agent, parameter_n_steps="64")
    assert agent.own_parameters() == {"n_steps": 64}


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("gamma", "1.5", "write 1 or less"),
        ("gamma", "much", "Enter a number"),
        ("n_steps", "2.5", "Enter a whole number"),
        ("net_arch", "64 or so", "Sizes of the hidden layers"),
        ("use_sde", "true", "vectors of numbers"),
        ("gamma", "nan", "Enter a number"),
    ],
)
def test_values_that_do_not_fit_are_refused_at_their_field(client, fresh, name, value, sentence):
    page = save(client, fresh, **{f"parameter_{name}": value})
    assert list(errors(page)) == [f"parameter_{name}"]
    assert sentence in str(errors(page))
    assert fresh.own_parameters() == {}


def test_what_the_weights_depend_on_is_fixed_while_the_run_goes_on(client, agent):
    assert "reset its learning first" in str(errors(save(client, agent, action_space="5")))
    assert "reset its learning first" in str(errors(save(client, agent, parameter_net_arch="32")))
    act(client, agent, "reset")
    save(client, agent, action_space="5", parameter_net_arch="32")
    agent.refresh_from_db()
    assert (agent.action_space, agent.own_parameters()) == (5, {"net_arch": "32"})


def test_the_algorithm_cannot_be_changed(client, agent):
    save(client, agent, algorithm=Algorithm.objects.get(name="A2C").pk)
    agent.refresh_from_db()
    assert agent.algorithm.name == "PPO"


# --- telling the executions ---


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"enable_learning": None}, "set_learning"),
        ({"max_percent_cpu": 50}, "configure"),
        ({"sessions_per_execution": 5}, "configure"),
        ({"name": "other"}, None),
    ],
)
def test_live_executions_hear_of_what_changes_at_once(
    client, agent, fleet, django_capture_on_commit_callbacks, changes, told
):
    with django_capture_on_commit_callbacks(execute=True):
        save(client, agent, **changes)
    assert [call[0] for call in fleet.calls] == ([told] if told else [])


@pytest.mark.django_db(transaction=True)
def test_an_unreachable_fleet_does_not_lose_what_was_saved(client, agent, fleet):
    fleet.unreachable = True
    page = save(client, agent, max_percent_cpu=50, rho=0.5)
    assert b"could not be told" in page.content
    assert b"take the change when they are restarted" in page.content
    agent.refresh_from_db()
    assert (agent.max_percent_cpu, agent.rho) == (50, 0.5)


# --- actions ---


def test_evaluating_stops_the_learning_and_learning_goes_on(client, agent, fleet):
    assert b"learns nothing" in act(client, agent, "evaluate").content
    agent.refresh_from_db()
    assert not agent.enable_learning
    act(client, agent, "learn")
    assert [call[2] for call in fleet.calls if call[0] == "set_learning"] == [False, True]


def test_restarting_ends_the_executions(client, agent, fleet):
    assert b"2 executions saved and ended" in act(client, agent, "restart").content
    assert ("restart", str(agent.pk)) in fleet.calls


def test_resetting_begins_the_next_run_and_keeps_the_old_one(client, agent, fleet):
    act(client, agent, "reset")
    assert list(agent.runs.values_list("number", "ended_at")[1:]) == [(2, None)]
    assert agent.runs.get(number=1).ended_at
    assert agent.runs.get(number=1).returns.count() == 1
    assert ("restart", str(agent.pk)) in fleet.calls
    assert client.get(url(agent, "curve_view")).json()["lines"][0]["x"] == []
    assert client.get(url(agent, "curve_view") + "?run=1").json()["lines"][0]["value"] == [7.5]


def test_deleting_saves_and_curve_is_for_the_chosen_run(client, agent, fleet):
    act(client, agent, "reset")
    first = agent.runs.get(number=1)
    client.post(url(agent, "action_view", "delete_saves") + "?run=1")
    client.post(url(agent, "action_view", "delete_curve"))
    assert ("delete_saves", first) in fleet.calls
    assert EpisodeReturn.objects.count() == 1
    client.post(url(agent, "action_view", "delete_curve") + "?run=1")
    assert EpisodeReturn.objects.count() == 0


@pytest.mark.parametrize("name", ["reset", "delete_saves", "delete_curve"])
def test_what_destroys_asks_first(client, agent, fleet, name):
    page = client.get(url(agent, "action_view", name))
    assert b"No, go back" in page.content
    assert agent.runs.count() == EpisodeReturn.objects.count() == 1
    assert fleet.calls == []


@pytest.mark.parametrize("name", ["evaluate", "learn", "restart"])
def test_nothing_is_done_by_get(client, agent, fleet, name):
    assert client.get(url(agent, "action_view", name)).status_code == 405
    assert client.get(url(agent, "make_key_view")).status_code == 405
    assert fleet.calls == []


def test_nothing_is_done_without_a_csrf_token(ann, agent, fleet):
    browser = Client(enforce_csrf_checks=True)
    browser.force_login(ann)
    key = agent.api_keys.get()
    for name in ("restart", "reset", "evaluate", "delete_curve"):
        assert browser.post(url(agent, "action_view", name)).status_code == 403
    assert browser.post(url(agent, "make_key_view")).status_code == 403
    assert browser.post(url(agent, "revoke_key_view", key.pk)).status_code == 403
    assert fleet.calls == []


@pytest.mark.parametrize("name", ["restart", "delete_saves", "evaluate"])
def test_an_unreachable_fleet_is_said(client, agent, fleet, name):
    fleet.unreachable = True
    assert b"cannot be reached" in act(client, agent, name).content


def test_unknown_actions_and_runs_are_not_found(client, agent):
    assert client.post(url(agent, "action_view", "explode")).status_code == 404
    for number in ("7", "x", "-1", "²"):
        assert client.get(url(agent, "curve_view") + f"?run={number}").status_code == 404


def test_a_deleted_agent_takes_everything_along(client, agent, fleet):
    assert b"sheepdog, with everything" in client.get(url(agent, "delete")).content
    client.post(url(agent, "delete"), {"post": "yes"})
    assert not Agent.objects.exists()
    assert [call[0] for call in fleet.calls] == ["restart", "delete_saves"]


def test_an_agent_whose_executions_cannot_be_ended_stays(client, agent, fleet):
    fleet.unreachable = True
    page = client.post(url(agent, "delete"), {"post": "yes"}, follow=True)
    assert b"Not deleted" in page.content
    assert Agent.objects.exists()


# --- keys ---


def test_a_key_is_shown_once(client, agent):
    page = client.post(url(agent, "make_key_view"), {"name": "lab", "scope": "step"})
    secret = page.context["secret"]
    assert secret in page.content.decode()
    assert "no-store" in page["Cache-Control"]
    key = APIKey.objects.get(hash=hash_key(secret))
    assert (key.agent, key.name, key.scope) == (agent, "lab", "step")
    for address in (url(agent), url(agent, "history"), reverse("admin:agents_app_apikey_changelist")):
        assert secret not in client.get(address).content.decode()


def test_a_publishable_key_stays_readable(client, agent):
    made = client.post(
        url(agent, "make_key_view"), {"scope": "publishable", "origins": "https://a.example, http://b.example/"}
    )
    key = APIKey.objects.get(hash=hash_key(made.context["secret"]))
    assert (key.scope, key.origins) == ("step", ["https://a.example", "http://b.example"])
    assert b"https://a.example" in made.content
    for address in (url(agent), reverse("admin:agents_app_apikey_change", args=[key.pk])):
        page = client.get(address).content.decode()
        assert key.published in page
        assert "publishable https://a.example http://b.example" in page


def test_a_key_is_renewed_and_both_open_the_agent_for_a_while(client, agent, foreign):
    key = agent.api_keys.get()
    APIKey.objects.filter(pk=key.pk).update(scope="step", steps_per_minute=60)
    assert b"goes on for" in client.get(url(agent, "renew_key_view", key.pk)).content
    secret = client.post(url(agent, "renew_key_view", key.pk), {"days": "7"}).context["secret"]
    key.refresh_from_db()
    new = APIKey.objects.get(hash=hash_key(secret))
    assert (new.agent, new.name, new.scope, new.steps_per_minute, new.expires_at) == (agent, key.name, "step", 60, None)
    assert key.successor == new
    assert key.is_valid()
    assert timedelta(days=6, hours=23) < key.expires_at - timezone.now() < timedelta(days=7)
    assert b"renewed as" in client.get(url(agent, "history")).content
    again = client.post(url(agent, "renew_key_view", key.pk), {"days": "7"}, follow=True)
    assert b"has a successor already" in again.content
    assert agent.api_keys.count() == 2
    assert client.post(url(agent, "renew_key_view", foreign.api_keys.get().pk), {"days": "7"}).status_code == 404


def test_renewing_never_gives_a_key_more_time(client, agent):
    soon = timezone.now() + timedelta(days=1)
    agent.api_keys.update(expires_at=soon)
    client.post(url(agent, "renew_key_view", agent.api_keys.get().pk), {"days": "7"})
    assert agent.api_keys.get(successor__isnull=False).expires_at == soon


@pytest.mark.parametrize("days", ["", "-1", "366", "x"])
def test_a_key_is_renewed_only_for_a_number_of_days(client, agent, days):
    client.post(url(agent, "renew_key_view", agent.api_keys.get().pk), {"days": days})
    assert agent.api_keys.count() == 1


def test_a_key_may_expire(client, agent):
    client.post(url(agent, "make_key_view"), {"name": "for a course", "scope": "step", "days": "7"})
    left = APIKey.objects.get(name="for a course").expires_at - timezone.now()
    assert timedelta(days=6, hours=23) < left < timedelta(days=7)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ({"scope": "publishable", "origins": "example.org"}, "is no origin"),
        ({"scope": "manage", "origins": "https://example.org"}, "Only publishable keys"),
        ({"scope": "all"}, "not one of the available choices"),
        ({"scope": "step", "days": "0"}, "greater than or equal to 1"),
    ],
)
def test_a_key_that_makes_no_sense_is_not_made(client, agent, data, sentence):
    page = client.post(url(agent, "make_key_view"), data, follow=True).content.decode()
    assert "No key was made" in page
    assert sentence in page
    assert agent.api_keys.count() == 1


def test_a_revoked_key_closes_its_sessions(client, agent):
    key = agent.api_keys.get()
    assert b"No, go back" in client.get(url(agent, "revoke_key_view", key.pk)).content
    client.post(url(agent, "revoke_key_view", key.pk))
    key.refresh_from_db()
    assert not key.is_valid()
    assert key.sessions.get().closed_at


def test_keys_are_revoked_from_their_list_and_never_edited(client, agent):
    key = agent.api_keys.get()
    page = reverse("admin:agents_app_apikey_change", args=[key.pk])
    assert client.post(page, {"name": "other"}).status_code == 403
    assert client.get(reverse("admin:agents_app_apikey_add")).status_code == 403
    client.post(reverse("admin:agents_app_apikey_changelist"), {"action": "revoke", "_selected_action": [key.pk]})
    key.refresh_from_db()
    assert key.revoked_at


# --- downloads and live data ---


def test_returns_are_downloaded_as_csv(client, agent):
    response = client.get(url(agent, "csv_view"))
    rows = list(csv.DictReader(io.StringIO(b"".join(response.streaming_content).decode())))
    assert response["Content-Disposition"] == 'attachment; filename="sheepdog-run-1.csv"'
    assert [(row["run"], row["execution"], row["return"], row["length"]) for row in rows] == [("1", "1", "7.5", "10")]


def test_the_model_is_downloaded_as_it_is(client, agent, fleet):
    content = b"PK the model"
    fleet.zip = io.BytesIO(content)
    response = client.get(url(agent, "model_view"))
    assert b"".join(response.streaming_content) == content
    assert response["Content-Disposition"] == 'attachment; filename="sheepdog-run-1.zip"'


def test_that_there_is_no_model_yet_is_said(client, agent):
    assert b"There is no model yet" in client.get(url(agent, "model_view"), follow=True).content


def test_executions_and_errors_are_live(client, agent, fleet):
    fleet.statuses = [{"number": 1, "state": "acting", "steps": 5, "advisors": [2]}]
    live = client.get(url(agent, "live_view")).json()
    assert live["executions"] == fleet.statuses
    assert (live["errors"][0]["summary"], live["errors"][0]["traceback"]) == ("error of sheepdog", "trace of sheepdog")
    fleet.unreachable = True
    assert "cannot be reached" in client.get(url(agent, "live_view")).json()["notice"]


def test_a_reader_who_has_the_whole_curve_gets_nothing(client, agent):
    curve = client.get(url(agent, "curve_view")).json()
    assert curve["lines"][0]["value"] == [7.5]
    assert client.get(url(agent, "curve_view"), {"version": curve["version"]}).json() == {"unchanged": True}


def test_the_page_counts_no_returns(client, agent, django_assert_max_num_queries):
    client.get(url(agent))
    with django_assert_max_num_queries(25) as captured:
        client.get(url(agent))
    assert not any("episodereturn" in query["sql"] for query in captured.captured_queries)


def test_a_second_agent_with_the_same_name_belongs_to_another_owner(client, agent):
    make_agent("sheepdog", "carla")
    assert Agent.objects.filter(name="sheepdog").count() == 2
