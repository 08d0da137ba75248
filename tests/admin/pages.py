"""The page of an agent, as a browser asks for it and sends it."""

from django.urls import reverse

from agents_app.admin.agents import ADVICE


def url(agent, name="change", *arguments):
    return reverse(f"admin:agents_app_agent_{name}", args=[agent.pk, *arguments])


def act(client, agent, name):
    return client.post(url(agent, "action_view", name), follow=True)


def fields_of(agent, **changes):
    """What the form of an agent sends."""
    names = ["name", "policy", "max_percent_cpu", "max_executions", "sessions_per_execution"]
    ticks = ("enable_learning", "learning_correction", "peers_advise", "averaging")
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
