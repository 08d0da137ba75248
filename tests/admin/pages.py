"""The page of an agent, as a browser asks for it and sends it."""

from html.parser import HTMLParser

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


class Shown(HTMLParser):
    """The form of a page, and what a browser sends of it when nobody touches it."""

    def __init__(self, page):
        super().__init__()
        self.fields, self._inside, self._select, self._area = {}, False, "", ""
        self.feed(page.content.decode())

    def handle_starttag(self, tag, attrs):
        of = dict(attrs)
        if tag == "form":
            self._inside = of.get("id") == "agent_form"
        elif not self._inside or "disabled" in of:
            return
        elif tag == "input" and of.get("type") not in ("submit", "button", "file", "image", "reset"):
            if of.get("type") not in ("checkbox", "radio") or "checked" in of:
                self.fields[of.get("name", "")] = of.get("value", "on" if of.get("type") == "checkbox" else "")
        elif tag == "select":
            self._select = of["name"]
        elif tag == "option" and ("selected" in of or self._select not in self.fields):
            self.fields[self._select] = of.get("value", "")
        elif tag == "textarea":
            self._area = of["name"]
            self.fields[self._area] = ""

    def handle_data(self, data):
        if self._area:
            self.fields[self._area] += data

    def handle_endtag(self, tag):
        if tag == "form":
            self._inside = False
        if tag == "textarea":
            self._area = ""


def save_as_shown(client, agent, **changes):
    """As an owner does it who opens the page, changes some fields, and saves."""
    fields = {
        name: value for name, value in Shown(client.get(url(agent))).fields.items() if name and not name.startswith("_")
    }
    return client.post(url(agent), fields | changes, follow=True)


def errors(response):
    return response.context["adminform"].form.errors
