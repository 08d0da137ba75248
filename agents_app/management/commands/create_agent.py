"""`manage.py create_agent`: an agent and its API key, for scripts."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from typing import Any

from django.core.exceptions import NON_FIELD_ERRORS, ValidationError
from django.core.management.base import BaseCommand, CommandError
from django.db import transaction
from django.db.models import BooleanField, JSONField

from agents_app import services
from agents_app.models import Agent, Algorithm, APIKey, User
from agents_app.origins import read_origins

SETTABLE = {field.name: field for field in Agent._meta.fields if field.editable and not field.is_relation}


class Command(BaseCommand):
    """Make an agent, and its owner if there is none of that name; print its id and new API keys as JSON."""

    help = 'Make an agent and print {"id", "name", "api_key"} (the key is shown this once) and any "publishable_key".'

    def add_arguments(self, parser: ArgumentParser) -> None:
        """The agent's fields; --set and --parameter for the rarer ones."""
        parser.add_argument("--owner", required=True, help="name of the owner; made if unknown")
        parser.add_argument("--name", required=True, help="name of the agent")
        parser.add_argument("--algorithm", required=True, help="e.g. PPO")
        parser.add_argument("--action-space", required=True, help="e.g. 4, or [[2], -1, 1]")
        parser.add_argument("--observation-space", required=True, help="e.g. [[8], -10, 10]")
        parser.add_argument("--policy", default="auto", help="kind of network (default: auto)")
        parser.add_argument("--parameter", action="append", default=[], metavar="NAME=VALUE", help="e.g. gamma=0.999")
        default = "(default: intersection, or none where the algorithm takes none)"
        parser.add_argument("--advice", choices=Agent.AdviceMethod.values, help=f"advice method {default}")
        parser.add_argument("--no-learning-correction", action="store_true", help="learn as if there were no advice")
        parser.add_argument("--advisor", metavar="NAME", help="another agent of the owner, whose latest save advises")
        parser.add_argument("--rho", type=float, help="influence of the advice, 0 to 1 (default: 1)")
        parser.add_argument("--publishable", action="store_true", help="also make a key for web pages of this server")
        parser.add_argument("--origin", action="append", default=[], help="and of this origin: https://example.org")
        parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", help="any other agent field")

    def handle(self, **options: Any) -> None:
        """Check everything first; nothing is made of what is wrong."""
        try:
            made = make(options)
        except ValidationError as error:
            raise CommandError("\n".join(sentences(error))) from None
        self.stdout.write(json.dumps(made))


@transaction.atomic
def make(options: dict[str, Any]) -> dict[str, str]:
    """The agent and its keys, as they are printed. Raises ValidationError."""
    algorithm = Algorithm.objects.filter(name=options["algorithm"], listed=True).first()
    if algorithm is None:
        names = ", ".join(Algorithm.objects.filter(listed=True).values_list("name", flat=True))
        raise ValidationError({"algorithm": f"There is no {options['algorithm']!r}: write one of {names}."})
    known = {parameter.name: parameter for parameter in algorithm.parameters.all()}
    texts = dict(pair(text) for text in options["parameter"])
    values = {name: services.parse_value(known[name], text) if name in known else text for name, text in texts.items()}
    owner = User.objects.filter(name=options["owner"]).first() or User.objects.create_user(options["owner"])
    options["advisor"] = options["advisor"] and advisor_of(owner, options["advisor"])
    agent = services.create_agent(owner, fields_of(options) | {"algorithm": algorithm}, values)
    made = {"id": str(agent.pk), "name": agent.name, "api_key": APIKey.issue(agent, name="create_agent")[1]}
    if options["publishable"] or options["origin"]:
        origins = read_origins(options["origin"])
        made["publishable_key"] = APIKey.issue(agent, name="create_agent", publishable=True, origins=origins)[1]
    return made


def fields_of(options: dict[str, Any]) -> dict[str, Any]:
    """The agent's fields as the options say."""
    fields = {"name": options["name"], "policy": options["policy"]}
    for name in ("action_space", "observation_space"):
        fields[name] = from_json(name, options[name], "4, or [[8], -10, 10]")
    if options["advice"]:
        fields["advice_method"] = options["advice"]
    fields |= {name: options[name] for name in ("rho", "advisor") if options[name] is not None}
    if options["no_learning_correction"]:
        fields["learning_correction"] = False
    return fields | dict(field(text) for text in options["set"])


def advisor_of(owner: User, name: str) -> Agent:
    """An agent of the owner. Raises ValidationError."""
    advisor = owner.agents.filter(name=name).first()
    if advisor is None:
        raise ValidationError({"advisor": f"{owner.name} has no agent {name!r}."})
    return advisor


def from_json(name: str, text: str, example: str) -> Any:
    """A field's value. Raises ValidationError."""
    try:
        return json.loads(text)
    except ValueError:
        raise ValidationError({name: f"{text!r} is no JSON: write e.g. {example}."}) from None


def field(text: str) -> tuple[str, Any]:
    """A field of an agent and its value, from FIELD=VALUE."""
    name, value = pair(text)
    if name not in SETTABLE:
        raise ValidationError(f"{name} is no field of an agent: write one of {', '.join(sorted(SETTABLE))}.")
    if isinstance(SETTABLE[name], JSONField):
        return name, from_json(name, value, "[[1, 0], [0.5, 1]]")
    if isinstance(SETTABLE[name], BooleanField):
        return name, truth(name, value)
    try:
        return name, SETTABLE[name].to_python(value)
    except ValidationError as error:
        raise ValidationError({name: error.messages}) from None


def truth(name: str, text: str) -> bool:
    """Yes or no. Raises ValidationError."""
    try:
        return services.parse_truth(text)
    except KeyError:
        raise ValidationError({name: f"{text!r} is neither: write yes or no."}) from None


def pair(text: str) -> tuple[str, str]:
    """NAME=VALUE, split."""
    name, equals, value = text.partition("=")
    if not equals:
        raise ValidationError(f"{text!r}: write NAME=VALUE.")
    return name.strip(), value


def sentences(error: ValidationError) -> list[str]:
    """What is wrong, a line per field."""
    if hasattr(error, "error_dict"):
        fields = error.message_dict.items()
        return [
            " ".join(messages) if name == NON_FIELD_ERRORS else f"{name}: {' '.join(messages)}"
            for name, messages in fields
        ]
    return error.messages
