"""The catalogue says what the algorithms' signatures say."""

import inspect
import io

import pytest
from django.core.exceptions import ValidationError
from django.core.management import call_command

from agents_app import catalogue
from agents_app.algorithms.registry import ROWS, get_row
from agents_app.models import Algorithm, Parameter, ParameterType
from agents_app.models.catalogue import check_value

pytestmark = pytest.mark.django_db
OWN = {"learning_rate_end", "net_arch", "normalize_observations", "action_noise", "total_timesteps"}


def parameter(algorithm, name):
    return Parameter.objects.get(algorithm__name=algorithm, name=name)


def test_migrate_lists_every_algorithm_of_the_registry():
    listed = Algorithm.objects.filter(listed=True).values_list("name", "discrete", "continuous", "policies")
    assert {row[0]: row[1:] for row in listed} == {
        row.name: (row.discrete, row.continuous, list(row.policies)) for row in ROWS
    }


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_the_defaults_are_those_of_the_signature(row):
    signature = inspect.signature(row.load().__init__).parameters
    found = Parameter.objects.filter(algorithm__name=row.name).exclude(name__in=OWN)
    assert found.filter(name="learning_rate", type=ParameterType.FLOAT).exists()
    for each in found:
        default = catalogue.DEFAULTS.get((row.name, each.name), signature[each.name].default)
        assert each.default == default, each.name


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_every_default_is_within_its_own_bounds_and_explained(row):
    for each in Parameter.objects.filter(algorithm__name=row.name):
        assert len(each.help_text) > 15, each.name
        if each.default is not None:
            check_value(each, each.default)


def test_every_algorithm_says_whether_it_takes_advice():
    for algorithm in Algorithm.objects.filter(listed=True):
        said = "advise each other" if algorithm.advice else "Takes no advice"
        assert said in algorithm.description and len(algorithm.description) > 60


def test_a_parameter_means_what_it_means_in_its_algorithm():
    assert "learning starts" in parameter("BDPI", "learning_starts").help_text
    assert "random" in parameter("DQN", "learning_starts").help_text
    assert "random" not in parameter("BDPI", "learning_starts").help_text
    assert "episode" in parameter("PolicyGradient", "n_steps").help_text
    assert "episode" not in parameter("PPO", "n_steps").help_text


def test_objects_and_the_servers_business_are_left_out():
    names = set(Parameter.objects.values_list("name", flat=True))
    left_out = {"env", "policy", "device", "tensorboard_log", "verbose", "_init_setup_model", "replay_buffer_class"}
    assert not names & (left_out | {"policy_kwargs", "stats_window_size", "rollout_buffer_kwargs", "self"})


def test_types_follow_the_annotations():
    assert parameter("PPO", "n_steps").type == ParameterType.INT
    assert parameter("PPO", "clip_range").type == ParameterType.FLOAT
    assert parameter("PPO", "normalize_advantage").type == ParameterType.BOOL
    assert parameter("PPO", "ent_coef").type == ParameterType.FLOAT
    assert parameter("SAC", "ent_coef").type == ParameterType.STR
    assert parameter("DQN", "train_freq").type == ParameterType.INT
    assert parameter("TRPO", "target_kl").default == 0.01
    assert parameter("PPO", "target_kl").default is None


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_every_learning_rate_can_fall(row):
    names = list(Parameter.objects.filter(algorithm__name=row.name).order_by("position").values_list("name", flat=True))
    assert names[names.index("learning_rate") + 1] == "learning_rate_end"
    assert parameter(row.name, "learning_rate_end").default is None
    assert parameter(row.name, "total_timesteps").default == 100_000


def test_a_docstring_explains_what_has_no_plain_words():
    texts = catalogue.docstring_parameters(get_row("PPO").load())
    assert texts["gamma"] == "Discount factor"
    assert texts["clip_range_vf"].startswith("Clipping parameter for the value function, it can be")


def test_noise_explores_where_nothing_else_does():
    defaults = dict(Parameter.objects.filter(name="action_noise").values_list("algorithm__name", "default"))
    assert defaults == {"TD3": "normal 0.1", "DDPG": "normal 0.1", "SAC": "", "TQC": "", "CrossQ": ""}


def test_filling_again_changes_nothing():
    before = list(Algorithm.objects.values()), list(Parameter.objects.values())
    call_command("fill_catalogue", stdout=io.StringIO())
    assert (list(Algorithm.objects.values()), list(Parameter.objects.values())) == before


def test_filling_mends_what_was_changed_and_unlists_what_vanished():
    Algorithm.objects.create(name="Sarsa", discrete=True)
    Parameter.objects.filter(name="gamma").update(default=0.5)
    Parameter.objects.create(algorithm=Algorithm.objects.get(name="PPO"), name="gone", type=ParameterType.INT)
    catalogue.fill()
    assert not Algorithm.objects.get(name="Sarsa").listed
    assert parameter("PPO", "gamma").default == 0.99
    assert not Parameter.objects.filter(name="gone").exists()


@pytest.mark.parametrize(
    ("algorithm", "name", "value"),
    [
        ("PPO", "gamma", 1.1),
        ("PPO", "gamma", -0.1),
        ("PPO", "learning_rate", 0.0),
        ("PPO", "learning_rate_end", -1e-4),
        ("PPO", "gamma", float("nan")),
        ("PPO", "n_steps", 0),
        ("PPO", "net_arch", "64;64"),
        ("PPO", "net_arch", "0,4"),
        ("SAC", "ent_coef", "a lot"),
        ("TD3", "action_noise", "normal"),
        ("TD3", "action_noise", "pink 0.1"),
        ("PPO", "gamma", None),
        ("PolicyGradient", "n_episodes", 0),
        ("BDPI", "n_critics", 65),
        ("BDPI", "alpha", 0.0),
        ("BDPI", "alpha", 1.1),
        ("BDPI", "delta", 0.0),
    ],
)
def test_values_out_of_bounds_are_refused_in_words(algorithm, name, value):
    with pytest.raises(ValidationError, match=name):
        check_value(parameter(algorithm, name), value)


@pytest.mark.parametrize(
    ("algorithm", "name", "value"),
    [
        ("PPO", "net_arch", "64, 64"),
        ("PPO", "net_arch", "256"),
        ("SAC", "ent_coef", "auto"),
        ("SAC", "ent_coef", "auto_0.1"),
        ("SAC", "ent_coef", "0.2"),
        ("SAC", "target_entropy", "-2.5"),
        ("TD3", "action_noise", "ou 0.2"),
        ("TD3", "action_noise", "normal 0"),
        ("TD3", "action_noise", ""),
        ("BDPI", "alpha", 1.0),
        ("BDPI", "learning_rate_end", 0.0),
    ],
)
def test_texts_that_can_be_read_are_taken(algorithm, name, value):
    check_value(parameter(algorithm, name), value)
