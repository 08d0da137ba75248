"""Advice must suit the agent's algorithm and actions, and reaches its executions; the refusal says what to write."""

import pytest
from django.core.exceptions import ValidationError

from agents_app import services
from agents_app.models import Agent, Algorithm, User
from tests.agents.makers import make_agent, make_user
from tests.agents.unsaved import REAL, VECTOR, agent, refusal

pytestmark = pytest.mark.django_db


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "TRPO", "PolicyGradient", "DQN", "QR-DQN", "BDPI"])
@pytest.mark.parametrize("method", Agent.AdviceMethod.values)
def test_every_method_is_taken_for_one_of_n_actions(algorithm, method):
    agent(algorithm, advice_method=method, advice_form="deterministic", peers_advise=False).full_clean()


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "TRPO", "PolicyGradient"])
def test_orders_at_each_step_would_leave_nothing_to_learn(algorithm):
    orders = {"algorithm": algorithm, "advice_method": "intersection", "advice_form": "deterministic"}
    assert "write soft" in refusal("advice_form", **orders)
    agent(**orders, learning_correction=False).full_clean()
    agent(**orders | {"action_space": REAL}).full_clean()
    agent(**orders | {"advice_method": "reuse"}).full_clean()


@pytest.mark.parametrize("algorithm", ["DQN", "BDPI"])
def test_off_the_policy_orders_are_learned_from(algorithm):
    agent(algorithm, advice_method="intersection", advice_form="deterministic").full_clean()


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "TRPO", "PolicyGradient", "SAC", "TQC", "TD3", "DDPG"])
@pytest.mark.parametrize("method", Agent.AdviceMethod.values)
def test_every_method_but_union_is_taken_for_vectors(algorithm, method):
    if method == "union":
        refused = refusal("advice_method", algorithm=algorithm, action_space=REAL, advice_method=method)
        assert "write intersection or reuse" in refused
    else:
        agent(algorithm, REAL, advice_method=method).full_clean()


@pytest.mark.parametrize("algorithm", ["DQN", "BDPI", "ARS"])
def test_an_algorithm_that_learns_at_each_step_averages_nothing_and_says_so(algorithm):
    plain = agent(algorithm)
    plain.full_clean()
    assert not plain.averaging
    plain.save()
    plain.averaging = True
    with pytest.raises(ValidationError, match=f"{algorithm} learns at every step, not after many: write no."):
        plain.full_clean()


@pytest.mark.parametrize("algorithm", ["ARS", "RecurrentPPO", "MaskablePPO"])
def test_an_algorithm_that_takes_no_advice_begins_with_none_and_refuses_any(algorithm):
    plain = agent(algorithm)
    plain.full_clean()
    assert plain.advice_method == "none"
    assert refusal("advice_method", algorithm=algorithm, advice_method="reuse") == (
        f"{algorithm} takes no advice: write none, or choose another algorithm."
    )
    plain.save()
    plain.advice_method = "intersection"
    with pytest.raises(ValidationError, match="takes no advice"):
        plain.full_clean()


def test_asked_for_by_name_the_default_is_refused_too():
    fields = {"name": "ars", "algorithm": Algorithm.objects.get(name="ARS"), "action_space": 4}
    fields |= {"observation_space": VECTOR, "advice_method": "intersection"}
    with pytest.raises(ValidationError, match="ARS takes no advice: write none"):
        services.create_agent(User.objects.create_user("owner"), fields, {})


def test_to_imitate_is_not_to_learn():
    only = {"advice_method": "reuse", "psi": 1}
    assert "write less" in refusal("psi", **only)
    agent(**only, learning_correction=False).full_clean()
    agent(**only, peers_advise=False).full_clean()
    agent("DQN", **only).full_clean()
    assert "write soft" in refusal("advice_form", advice_method="geometric", advice_form="deterministic")
    agent(advice_method="geometric", advice_form="deterministic", advice_weight=0).full_clean()


def test_the_density_of_an_order_is_no_reward():
    fields = {"action_space": REAL, "advice_method": "shaping", "advice_form": "deterministic"}
    assert "write soft" in refusal("advice_form", **fields)


def test_an_advisor_is_another_agent_of_the_owner_that_sees_and_does_the_same():
    young, said = make_agent("young"), []
    foreign = make_agent("foreign", "somebody")
    blind, slow = make_agent("blind", observation_space=2), make_agent("slow", action_space=3)
    for advisor in (young, make_agent("searching", algorithm="ARS"), blind, slow, foreign):
        young.advisor = advisor
        with pytest.raises(ValidationError) as caught:
            young.full_clean()
        said.append(caught.value.message_dict["advisor"][0])
    sentences = ["its own advisor", "gives no probabilities", "other actions", "other actions", "somebody else"]
    assert all(part in sentence for part, sentence in zip(sentences, said, strict=True))
    young.advisor = make_agent("old", algorithm="DQN", parameters={"net_arch": "9"})
    young.full_clean()


def test_the_execution_knows_the_advisor_and_where_its_saves_are():
    from envs_app.executions import advisor_spec

    old, young = make_agent("old", parameters={"net_arch": "9"}), make_agent("young")
    assert advisor_spec(young) is None
    young.advisor, young.advisor_save = old, "best"
    spec = advisor_spec(young)
    assert (spec["name"], spec["rule"], spec["saves"]) == ("old", "best", f"{old.pk}/{old.current_run().pk}")
    assert spec["agent"]["parameters"]["net_arch"] == "9"
    old.owner = make_user("somebody")
    assert advisor_spec(young) is None, "it was given away"
    old.owner, young.advice_method = young.owner, "none"
    assert advisor_spec(young) is None


def test_the_settings_of_advice_reach_the_execution():
    from agents_app.algorithms.mixing import Mixing
    from envs_app.executions import agent_spec

    settings = {"advice_method": "reuse", "psi": 0.2, "continuous_advice": "sampling", "advice_samples": 9}
    settings |= {
        "last_word": "advisor",
        "advice_form": "deterministic",
        "shaping_scale": 3.0,
        "rho": 0.7,
        "advice_weight": 0.3,
    }
    settings |= {"advisors": "all", "learning_correction": False}
    spec = agent_spec(agent(**settings), {})
    assert {name: getattr(spec, name) for name in settings} == settings
    assert spec.mixing() == Mixing("reuse", False, 0.2, "sampling", 9, "advisor", 0.3)


def test_reward_shaping_needs_no_correction():
    from envs_app.executions import agent_spec

    assert not agent_spec(agent(advice_method="shaping", learning_correction=True), {}).mixing().correction
