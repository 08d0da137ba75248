"""Spaces, algorithm and policy of an agent must fit together; the refusal says what to write."""

import pytest
from django.core.exceptions import ValidationError

from agents_app import services
from agents_app.checks_agent import check_fixed
from agents_app.models import Agent, Algorithm, User
from tests.agents.makers import make_agent, make_user

pytestmark = pytest.mark.django_db
VECTOR, IMAGE, SMALL, DICTIONARY = (
    [[8], -10, 10],
    [[84, 84, 3], 0, 255],
    [[20, 20, 3], 0, 255],
    {"a": [[3], -1, 1], "b": 5},
)
REAL = [[2], -1, 1]


def agent(algorithm="PPO", action_space=4, observation_space=None, policy="auto", **advice):
    owner, _ = User.objects.get_or_create(name="owner")
    return Agent(
        owner=owner,
        name="agent",
        algorithm=Algorithm.objects.get(name=algorithm),
        action_space=action_space,
        observation_space=VECTOR if observation_space is None else observation_space,
        policy=policy,
        **advice,
    )


def refusal(field, **fields):
    with pytest.raises(ValidationError) as caught:
        agent(**fields).full_clean()
    assert set(caught.value.message_dict) == {field}
    return " ".join(caught.value.message_dict[field])


@pytest.mark.parametrize(
    ("algorithm", "action_space", "observation_space", "policy"),
    [
        ("PPO", 4, VECTOR, "auto"),
        ("PPO", REAL, IMAGE, "CnnPolicy"),
        ("PPO", 4, SMALL, "auto"),
        ("PPO", 4, IMAGE, "MlpPolicy"),
        ("A2C", 4, DICTIONARY, "MultiInputPolicy"),
        ("DQN", 2, 16, "auto"),
        ("SAC", REAL, DICTIONARY, "auto"),
        ("CrossQ", REAL, VECTOR, "auto"),
        ("ARS", 2, VECTOR, "LinearPolicy"),
        ("BDPI", 4, DICTIONARY, "auto"),
        ("PolicyGradient", REAL, IMAGE, "CnnPolicy"),
        ("RecurrentPPO", 2, IMAGE, "CnnLstmPolicy"),
    ],
)
def test_what_fits_is_taken(algorithm, action_space, observation_space, policy):
    agent(algorithm, action_space, observation_space, policy).full_clean()


@pytest.mark.parametrize(
    ("space", "sentence"),
    [
        ("four", "write a number of choices"),
        (True, "write a number of choices"),
        (0, "from 1 to"),
        ([[8], -10], "this one has 2"),
        ([[8], 10, -10], "less than its high"),
        ([[8], -1e999, 10], "must be finite"),
        ([[8], float("nan"), 10], "must be finite"),
        ([[8], 10**400, 10], "large"),
        ({"advice": 2}, "choose another"),
        ({"action_mask": [[3], 0, 1], "seen": 2}, "choose another"),
        ({"a": {"b": 2}}, "a key of its own"),
    ],
)
def test_it_refuses_what_is_no_space(space, sentence):
    assert sentence in refusal("observation_space", observation_space=space)


@pytest.mark.parametrize(
    ("algorithm", "space", "sentence"),
    [
        ("DQN", REAL, "write a whole number n"),
        ("BDPI", REAL, "write a whole number n"),
        ("SAC", 4, "write [shape, low, high]"),
        ("PPO", {"a": 2}, "cannot be a dictionary"),
        ("SAC", [[2], -1e300, 1e300], "write smaller ones"),
        ("SAC", [[2], 0, 255], "write 0.0 and 255.0"),
    ],
)
def test_it_refuses_actions_that_the_algorithm_cannot_choose(algorithm, space, sentence):
    assert sentence in refusal("action_space", algorithm=algorithm, action_space=space)


@pytest.mark.parametrize(
    ("algorithm", "space", "policy", "sentence"),
    [
        ("PPO", VECTOR, "CnnPolicy", "write auto or MlpPolicy"),
        ("PPO", SMALL, "CnnPolicy", "36 by 36"),
        ("PPO", DICTIONARY, "MlpPolicy", "write auto or MultiInputPolicy"),
        ("PPO", VECTOR, "MultiInputPolicy", "write auto or MlpPolicy"),
        ("PPO", VECTOR, "MlpLstmPolicy", "PPO has no MlpLstmPolicy"),
        ("ARS", VECTOR, "CnnPolicy", "write auto or LinearPolicy or MlpPolicy"),
    ],
)
def test_it_refuses_a_network_that_does_not_fit(algorithm, space, policy, sentence):
    assert sentence in refusal("policy", algorithm=algorithm, observation_space=space, policy=policy)


@pytest.mark.parametrize(
    ("algorithm", "action_space", "space"),
    [
        ("CrossQ", REAL, IMAGE),
        ("BDPI", 4, IMAGE),
        ("CrossQ", REAL, DICTIONARY),
        ("ARS", 2, IMAGE),
        ("PPO", 2, {"eye": SMALL}),
    ],
)
def test_it_refuses_observations_without_a_network(algorithm, action_space, space):
    assert "write" in refusal(
        "observation_space", algorithm=algorithm, action_space=action_space, observation_space=space
    )


def test_an_algorithm_that_is_no_longer_listed_takes_no_new_agents():
    Algorithm.objects.filter(name="PPO").update(listed=False)
    assert "choose another" in refusal("algorithm")


def test_the_algorithm_is_fixed():
    saved = agent()
    saved.save()
    saved.algorithm = Algorithm.objects.get(name="A2C")
    with pytest.raises(ValidationError, match="make a new agent"):
        saved.full_clean()


def test_spaces_are_fixed_once_it_has_learned():
    saved = agent()
    saved.save()
    saved.action_space = 5
    saved.full_clean()
    saved.current_run().executions.create(number=1)
    with pytest.raises(ValidationError, match="reset its learning"):
        saved.full_clean()


@pytest.mark.parametrize(
    ("fields", "values", "name"),
    [
        ({}, {"use_sde": True}, "use_sde"),
        ({"algorithm": "DQN", "observation_space": DICTIONARY}, {"n_steps": 3}, "n_steps"),
        ({"algorithm": "ARS"}, {"net_arch": "64"}, "net_arch"),
        ({"algorithm": "ARS"}, {"n_top": 9}, "n_top"),
        ({"algorithm": "MaskablePPO"}, {"n_steps": 65}, "batch_size"),  # a deviation over one step is no number
        ({"algorithm": "RecurrentPPO"}, {"batch_size": 1}, "batch_size"),
        ({"algorithm": "CrossQ", "action_space": REAL}, {"batch_size": 1}, "batch_size"),
        ({"algorithm": "TRPO"}, {"n_steps": 16, "sub_sampling_factor": 9}, "sub_sampling_factor"),
        ({"algorithm": "DQN"}, {"gradient_steps": 0}, "gradient_steps"),
        ({"algorithm": "DQN", "observation_space": [[210, 160, 3], 0, 255]}, {"gamma": 0.9}, "buffer_size"),
        ({"algorithm": "SAC", "action_space": REAL}, {"ent_coef": "auto_0"}, "ent_coef"),
        ({"algorithm": "SAC", "action_space": REAL}, {"ent_coef": "1e400"}, "ent_coef"),
        ({"algorithm": "SAC", "action_space": REAL}, {"target_entropy": "-1e39"}, "target_entropy"),
        ({"algorithm": "SAC", "action_space": REAL}, {"action_noise": "normal 1e39"}, "action_noise"),
    ],
)
def test_parameters_must_suit_the_spaces(fields, values, name):
    saved = agent(**fields)
    saved.save()
    with pytest.raises(ValidationError) as caught:
        services.set_parameters(saved, values)
    assert list(caught.value.message_dict) == [name]
    assert saved.own_parameters() == {}


@pytest.mark.parametrize(
    ("algorithm", "values"),
    [
        ("PPO", {"n_steps": 65}),  # it leaves one step as it is
        ("RecurrentPPO", {"n_steps": 65, "batch_size": 64, "normalize_advantage": False}),
        ("MaskablePPO", {"n_steps": 66}),
        ("TRPO", {"n_steps": 16, "sub_sampling_factor": 8}),
    ],
)
def test_of_two_steps_or_where_nothing_is_compared_updates_may_be_made(algorithm, values):
    saved = agent(algorithm, 3)
    saved.save()
    services.set_parameters(saved, values)
    assert saved.own_parameters() == values


def test_parameters_are_the_defaults_and_the_owners_values():
    saved = agent()
    saved.save()
    services.set_parameters(saved, {"gamma": 0.9, "net_arch": "32"})
    assert saved.parameters()["gamma"] == 0.9
    assert saved.parameters()["net_arch"] == "32"
    assert saved.parameters()["n_steps"] == 2048
    assert "target_kl" not in saved.parameters()
    services.set_parameters(saved, {"gamma": None})
    assert saved.parameters()["gamma"] == 0.99
    with pytest.raises(ValidationError, match="PPO has no tau"):
        services.set_parameters(saved, {"tau": 1.0})


# --- advice ---


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


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "TRPO", "PolicyGradient"])
@pytest.mark.parametrize("bounds", [(20, 30), (-9, -3), (0, 1000)])
def test_actions_that_would_not_be_found_are_refused_to_a_new_agent(algorithm, bounds):
    assert "have your client scale" in refusal("action_space", algorithm=algorithm, action_space=[[1], *bounds])
    agent("SAC", [[1], *bounds]).full_clean()
    agent(algorithm, [[2], [0, -1], [5, 1]]).full_clean()
    old = agent(algorithm, [[1], *bounds])
    old.save()
    old.full_clean()


@pytest.mark.parametrize("name", ["psi", "rho", "advice_weight", "shaping_scale", "unanswered_reward"])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_numbers_are_finite(name, value):
    refusal(name, **{name: value})


def test_an_algorithm_that_plays_itself_ends_no_episode_for_a_client():
    assert "write 0" in refusal("answer_within", algorithm="ARS", answer_within=9)


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


@pytest.mark.parametrize("algorithm", ["TD3", "DDPG"])
def test_advice_by_samples_needs_to_know_how_probable_actions_are(algorithm):
    by_samples = {"advice_method": "intersection", "continuous_advice": "sampling"}
    one = agent(algorithm, REAL, **by_samples)
    one.save()
    for none in ("", "normal 0", "ou 0.0", "normal 1e-50"):
        with pytest.raises(ValidationError) as caught:
            services.set_parameters(one, {"action_noise": none})
        assert "write e.g. normal 0.1" in caught.value.message_dict["action_noise"][0]
    services.set_parameters(one, {"action_noise": "normal 0.2"})
    for other in (agent(algorithm, REAL), agent("SAC", REAL, **by_samples)):
        other.name = other.algorithm.name
        other.save()
        services.set_parameters(other, {"action_noise": ""})


def test_a_learning_rate_falls_and_does_not_rise():
    one = agent("PPO")
    one.save()
    services.set_parameters(one, {"learning_rate_end": 0.0003})
    for changes in ({"learning_rate_end": 0.001}, {"learning_rate": 0.0001}):
        with pytest.raises(ValidationError) as caught:
            services.set_parameters(one, changes)
        assert "Write at most the learning_rate" in caught.value.message_dict["learning_rate_end"][0]
    services.set_parameters(one, {"learning_rate": 0.0001, "learning_rate_end": 0.0})


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


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"algorithm": "SAC", "action_space": REAL, "action_features": [[1.0]]}, "leave it empty"),
        ({"algorithm": "BDPI", "action_features": [[1.0]] * 4}, "choose e.g. DQN"),
        ({"action_features": [[1.0]] * 3}, "Write 4 rows"),
        ({"action_features": [[1.0], [1.0], [1.0], [1.0, 2.0]]}, "Write 4 rows"),
        ({"action_features": [[]] * 4}, "Write 4 rows"),
        ({"action_features": [[True]] * 4}, "Write 4 rows"),
        ({"action_features": [["red"]] * 4}, "Write 4 rows"),
        ({"action_features": [[1e39]] * 4}, "finite"),
        ({"action_features": {"0": [1.0]}}, "Write 4 rows"),
    ],
)
def test_it_refuses_features_of_actions_that_are_no_table(fields, sentence):
    assert sentence in refusal("action_features", **fields)


def test_it_takes_a_row_of_features_for_each_action():
    agent(algorithm="DQN", action_features=[[1, 0.5], [0, 1], [0, 0], [-1, 1]]).full_clean()


def test_features_of_actions_stay_once_the_agent_has_learned(monkeypatch):
    before, after = (agent(action_features=[[number]] * 4) for number in (0, 1))
    monkeypatch.setattr(after, "has_learned", lambda: True)
    with pytest.raises(ValidationError) as caught:
        check_fixed(before, after)
    assert set(caught.value.message_dict) == {"action_features"}
