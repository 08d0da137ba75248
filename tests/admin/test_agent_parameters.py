"""Owners set the parameters of an agent; live executions are told."""

import pytest

from agents_app.models import Algorithm, Parameter
from agents_app.services import set_parameters
from tests.admin.pages import act, errors, save, save_as_shown, url


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


@pytest.mark.parametrize("value", [True, False])
def test_what_nobody_touches_stays_as_it_is(client, fresh, value):
    changes = {
        "gamma": 0.9,
        "n_steps": 64,
        "normalize_advantage": value,
        "normalize_observations": value,
        "net_arch": "32,32",
    }
    set_parameters(fresh, changes)
    page = save_as_shown(client, fresh, max_executions="7")
    assert not page.context.get("errors")
    fresh.refresh_from_db()
    assert (fresh.max_executions, fresh.own_parameters()) == (7, changes)


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
