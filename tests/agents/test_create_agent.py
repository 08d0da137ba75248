"""`manage.py create_agent` and `manage.py demo_data`."""

import io
import json

import numpy as np
import pytest
from django.core.management import CommandError, call_command
from shepherd_environments.bored import Place, Point, features

from agents_app.demos import PLACES
from agents_app.models import Agent, APIKey, User, hash_key

pytestmark = pytest.mark.django_db


def run(*arguments, **options):
    out = io.StringIO()
    base = {
        "owner": "ann",
        "name": "lander",
        "algorithm": "PPO",
        "action_space": "4",
        "observation_space": "[[8], -10, 10]",
    }
    call_command("create_agent", *arguments, **(base | options), stdout=out)
    return json.loads(out.getvalue())


def test_it_prints_the_agent_and_a_key_that_opens_it():
    printed = run()
    agent = Agent.objects.get(pk=printed["id"])
    assert (agent.name, agent.owner.name, agent.action_space) == ("lander", "ann", 4)
    assert APIKey.objects.get(hash=hash_key(printed["api_key"])).agent == agent
    assert not agent.owner.has_usable_password()


def test_it_makes_a_publishable_key_when_it_is_asked_to():
    assert "publishable_key" not in run()
    own = run("--publishable", name="own pages")
    assert APIKey.objects.get(published=own["publishable_key"]).origins == []
    other = run("--origin=https://example.org", "--origin=http://localhost:5000/", name="other pages")
    key = APIKey.objects.get(published=other["publishable_key"])
    assert (str(key.agent_id), key.origins) == (other["id"], ["https://example.org", "http://localhost:5000"])


def test_it_sets_parameters_advice_and_other_fields():
    printed = run(
        "--parameter=gamma=0.9",
        "--parameter=normalize_advantage=no",
        "--set=max_executions=3",
        "--set=public=true",
        "--advice=none",
        "--no-learning-correction",
        "--rho=0.5",
    )
    agent = Agent.objects.get(pk=printed["id"])
    assert agent.own_parameters() == {"gamma": 0.9, "normalize_advantage": False}
    assert (agent.max_executions, agent.public, agent.advice_method) == (3, True, "none")
    assert (agent.learning_correction, agent.rho) == (False, 0.5)


def test_another_agent_of_the_owner_advises():
    old = run("--advice=none", name="old dog", algorithm="A2C")
    young = Agent.objects.get(pk=run("--advisor=old dog", "--set=advisor_save=best", "--set=peers_advise=false")["id"])
    assert (str(young.advisor_id), young.advisor_save, young.peers_advise) == (old["id"], "best", False)


def test_yes_and_no_are_read_as_in_the_administration():
    for text, value in (("no", False), ("yes", True), ("False", False), ("1", True)):
        assert Agent.objects.get(pk=run(f"--set=averaging={text}", name=text)["id"]).averaging is value


def test_actions_can_have_features():
    table = [[1, 0], [0.5, 1], [0, 0], [0, 1]]
    printed = run(f"--set=action_features={json.dumps(table)}")
    assert Agent.objects.get(pk=printed["id"]).action_features == table


@pytest.mark.parametrize("method", Agent.AdviceMethod.values)
def test_every_advice_method_can_be_chosen(method):
    agent = Agent.objects.get(pk=run(f"--advice={method}", "--set=advisors=best", "--set=psi=0.2")["id"])
    assert (agent.advice_method, agent.advisors, agent.psi) == (method, "best", 0.2)


@pytest.mark.parametrize(
    ("arguments", "options", "sentence"),
    [
        (["--advice=intersection"], {"algorithm": "ARS"}, "ARS takes no advice: write none"),
        (["--advice=union"], {"action_space": "[[2], -1, 1]"}, "write intersection or reuse"),
        (["--advisor=nobody"], {}, "has no agent 'nobody'"),
        (["--set=advisors=worst"], {}, "advisors: Value 'worst' is not a valid choice"),
        ([], {"algorithm": "XPO"}, "write one of A2C"),
        ([], {"observation_space": "vector"}, "is no JSON"),
        ([], {"observation_space": "[[8], -10]"}, "this one has 2"),
        ([], {"policy": "CnnPolicy"}, "write auto or MlpPolicy"),
        (["--parameter=gama=1"], {}, "PPO has no gama"),
        (["--parameter=gamma=much"], {}, "write a number"),
        (["--parameter=gamma=2"], {}, "write 1 or less"),
        (["--parameter=gamma"], {}, "write NAME=VALUE"),
        (["--set=colour=red"], {}, "is no field"),
        (["--set=averaging=often"], {}, "averaging: 'often' is neither: write yes or no"),
        (
            ["--set=averaging=yes"],
            {"algorithm": "DQN"},
            "averaging: DQN learns at every step, not after many: write no",
        ),
        (["--set=action_features=many"], {}, "action_features: 'many' is no JSON"),
        (["--set=action_features=[[1]]"], {}, "action_features: Write 4 rows"),
        (["--origin=example.org"], {}, "is no origin"),
        (["--set=rho=2"], {}, "less than or equal to 1"),
        (["--set=max_executions=many"], {}, "must be an integer"),
    ],
)
def test_it_refuses_in_words_and_makes_nothing(arguments, options, sentence):
    with pytest.raises(CommandError, match=sentence):
        run(*arguments, **options)
    assert not Agent.objects.exists()
    assert not User.objects.exists()


def test_it_refuses_a_second_agent_of_that_name():
    run()
    with pytest.raises(CommandError, match="already exists"):
        run()


def test_demo_data_is_made_once():
    out = io.StringIO()
    call_command("demo_data", stdout=out)
    made = json.loads(out.getvalue())
    assert User.objects.get(name="admin").check_password(made["admin"]["password"])
    assert [agent["name"] for agent in made["agents"]] == ["CartPole demo", "Lunar Lander demo", "Bored in the city"]
    again = io.StringIO()
    call_command("demo_data", stdout=again)
    assert again.getvalue() == ""
    assert Agent.objects.count() == 3


def test_demo_data_makes_nothing_where_somebody_has_deleted_it():
    call_command("demo_data", if_new=True, stdout=io.StringIO())
    assert Agent.objects.count() == 3
    Agent.objects.all().delete()
    call_command("demo_data", if_new=True, stdout=io.StringIO())
    assert not Agent.objects.exists()


def test_the_page_bored_in_the_city_finds_its_agent(client):
    assert client.get("/bored/config.json").json()["key"] is None
    call_command("demo_data", stdout=io.StringIO())
    key = APIKey.objects.get(published=client.get("/bored/config.json").json()["key"])
    assert (key.agent.name, key.scope) == ("Bored in the city", "step")
    assert key.agent.observation_space == [[29], -1, 1]
    places = [Place(place["type"], Point(place["lat"], place["lon"])) for place in PLACES]
    np.testing.assert_allclose(key.agent.action_features, features(places), atol=1e-12)
