"""GET /api/v1/agent."""

from agents_app.models import APIKey
from tests.agents.makers import make_agent
from tests.api.conftest import assert_problem


def test_it_describes_the_agent_of_the_key(api, agent, manage_key):
    make_agent("another")
    described = api.get("/api/v1/agent", manage_key).json()
    assert described["id"] == str(agent.pk)
    assert (described["name"], described["algorithm"], described["policy"]) == ("lander", "PPO", agent.policy)
    assert (described["action_space"], described["observation_space"]) == (4, [[8], -10, 10])
    assert described["run"] == 1
    assert described["enable_learning"] is True
    assert described["averaging"] is True
    assert described["advice"] == {
        **{
            "method": "intersection",
            "advisors": "random",
            "peers_advise": True,
            "advisor": None,
            "advisor_save": "latest",
        },
        **{"form": "soft", "rho": 1.0, "continuous": "mean"},
        **{
            "samples": 64,
            "last_word": "learner",
            "weight": 1.0,
            "psi": 0.5,
            "shaping_scale": 1.0,
            "learning_correction": True,
        },
    }


def test_it_tells_the_parameters_with_their_defaults(api, db):
    agent = make_agent("tuned", parameters={"n_steps": 64, "gamma": 0.9})
    described = api.get("/api/v1/agent", APIKey.issue(agent)[1]).json()
    parameters = described["parameters"]
    assert (parameters["n_steps"], parameters["gamma"], parameters["gae_lambda"]) == (64, 0.9, 0.95)


def test_it_wants_the_scope_manage(api, step_key):
    assert_problem(api.get("/api/v1/agent", step_key), 403, "forbidden", "use one with the scope 'manage'")


def test_it_rejects_a_wrong_key(api, db):
    assert_problem(api.get("/api/v1/agent", "sk_wrong"), 401, "invalid_api_key")


def test_it_tells_no_key(api, manage_key):
    assert manage_key[:9].encode() not in api.get("/api/v1/agent", manage_key).content
