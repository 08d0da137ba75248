"""The forms of requests and replies.

A step is read by hand (`read_step`), since a serializer of Django REST framework takes longer than everything else that
happens to a step; the serializers here write the slow replies and describe all of them in the API's schema.
"""

from __future__ import annotations

from typing import Any

import orjson
from rest_framework import serializers

from agents_app.models import Agent, EpisodeReturn
from envs_app.errors import InvalidRequest
from envs_app.observations import read_reward
from envs_app.steps import Reply, Step

REQUIRED = {"obs", "reward", "terminated", "truncated"}
KNOWN = REQUIRED | {"info", "seq", "advice", "action_mask"}
LARGEST_SEQ = 2**53  # the whole numbers that every language has
LARGEST_INFO = 2**16  # bytes of JSON


def read_step(body: dict[str, Any]) -> Step:
    """The step that a request of /api/v1/step asks for. Raises InvalidRequest or InvalidReward."""
    if not REQUIRED <= body.keys() <= KNOWN:
        raise InvalidRequest(_wrong_keys(body))
    step = Step(**body)
    step.reward = read_reward(step.reward)
    if type(step.terminated) is not bool or type(step.truncated) is not bool:
        raise InvalidRequest("terminated and truncated are true or false, nothing else.")
    _check_info(step.info)
    if step.seq is not None and (type(step.seq) is not int or not 0 <= step.seq <= LARGEST_SEQ):
        raise InvalidRequest("seq is a whole number from 0 on, one more than the last one, or left out.")
    if step.action_mask is not None and type(step.action_mask) is not list:
        raise InvalidRequest("action_mask is a list with true or false for each action, or left out.")
    return step


def write_reply(reply: Reply) -> dict[str, Any]:
    """What /api/v1/step answers."""
    if reply.action is None:
        return {"action": None, "seq": reply.seq, "episode_return": reply.episode_return}
    return {"action": reply.action, "seq": reply.seq}


def read_legacy_step(body: dict[str, Any]) -> Step:
    """The step that a request of the original protocol asks for; `done` is `terminated`. Raises InvalidRequest."""
    if "obs" not in body:
        raise InvalidRequest("The request has no obs.")
    done, info = body.get("done", False), body.get("info")
    if done not in (True, False):  # also 0 and 1, which clients in the field send
        raise InvalidRequest("done is true or false, nothing else.")
    _check_info(info)
    reward = body.get("reward")
    return Step(body["obs"], 0.0 if reward is None else read_reward(reward), terminated=bool(done), info=info)


def read_text(body: dict[str, Any], key: str) -> str:
    """A text of the body. Raises InvalidRequest."""
    value = body.get(key)
    if type(value) is not str:
        raise InvalidRequest(f"The request needs {key}, a text.")
    return value


def _check_info(info: Any) -> None:
    """Nobody knows what is in it, and it is kept as long as the step: many large ones would fill the memory."""
    if not info and (info is None or type(info) is dict):
        return
    if type(info) is not dict:
        raise InvalidRequest("info is an object, such as {}, or left out.")
    try:
        size = len(orjson.dumps(info))
    except orjson.JSONEncodeError:
        raise InvalidRequest("info is nested too deeply; make it flat, or leave it out.") from None
    if size > LARGEST_INFO:
        raise InvalidRequest(f"info has {size} bytes; at most {LARGEST_INFO} are taken.")


def _wrong_keys(body: dict[str, Any]) -> str:
    missing, unknown = sorted(REQUIRED - body.keys()), sorted(body.keys() - KNOWN)
    wrong = [f"lacks {key}" for key in missing] + [f"has an unknown {key[:20]!r}" for key in unknown[:3]]
    return f"The request {' and '.join(wrong)}; its keys are {', '.join(sorted(KNOWN))}."


class SessionAgentSerializer(serializers.ModelSerializer):
    """What a client must know of its agent."""

    algorithm = serializers.CharField(source="algorithm.name")
    action_masks = serializers.BooleanField(source="takes_masks", help_text="Whether steps may have an action_mask.")

    class Meta:
        model = Agent
        fields = ["name", "algorithm", "action_space", "observation_space", "action_masks"]


class SessionSerializer(serializers.Serializer):
    """A new session. The key is shown only here."""

    session_key = serializers.CharField()
    agent = SessionAgentSerializer()


class AdviceSerializer(serializers.ModelSerializer):
    """How the agent's executions advise each other."""

    method = serializers.CharField(source="advice_method")
    form = serializers.CharField(source="advice_form")
    continuous = serializers.CharField(source="continuous_advice")
    samples = serializers.IntegerField(source="advice_samples")
    advisor = serializers.CharField(source="advisor.name", allow_null=True, default=None, help_text="An agent's name.")
    advisor_save = serializers.CharField()
    weight = serializers.FloatField(source="advice_weight")

    class Meta:
        model = Agent
        fields = [
            "method",
            "advisors",
            "peers_advise",
            "advisor",
            "advisor_save",
            "form",
            "rho",
            "continuous",
            "samples",
        ]
        fields += ["last_word", "weight", "psi", "shaping_scale", "learning_correction"]


class AgentSerializer(SessionAgentSerializer):
    """An agent's whole configuration."""

    action_features = serializers.ListField(
        child=serializers.ListField(child=serializers.FloatField()),
        allow_null=True,
        help_text="What is known of each action: a row of numbers. null: each action is learned on its own.",
    )
    parameters = serializers.SerializerMethodField(help_text="By name, with defaults where the owner set nothing.")
    advice = AdviceSerializer(source="*")
    run = serializers.SerializerMethodField(help_text="The number of the run that learns now.")

    class Meta:
        model = Agent
        fields = [
            *("id", "name", "algorithm", "policy", "action_space", "observation_space", "action_masks"),
            *("action_features", "parameters", "advice", "averaging"),
            *("enable_learning", "max_percent_cpu", "max_executions", "sessions_per_execution"),
            *("answer_within", "unanswered_reward"),
            *("start_from", "save_interval", "public", "counted_in", "created_at", "last_activity_at", "run"),
        ]

    def get_parameters(self, agent: Agent) -> dict[str, Any]:
        """By name."""
        return agent.parameters()

    def get_run(self, agent: Agent) -> int:
        """From 1."""
        return agent.current_run().number


class EpisodeReturnSerializer(serializers.ModelSerializer):
    """One finished episode."""

    run = serializers.IntegerField(source="run.number")
    execution = serializers.IntegerField(source="execution.number")

    ended_at = serializers.DateTimeField(source="created_at")

    class Meta:
        model = EpisodeReturn
        fields = ["run", "execution", "session", "episode", "length", "learning", "ended_at"]

    def get_fields(self) -> dict[str, serializers.Field]:
        """With `return`, which is no name for an attribute in Python."""
        return super().get_fields() | {
            "return": serializers.FloatField(source="value", help_text="Sum of the rewards.")
        }


class ReturnsPageSerializer(serializers.Serializer):
    """A page of finished episodes, in the order in which they ended."""

    next = serializers.URLField(allow_null=True, help_text="The next page; null after the last one.")
    previous = serializers.URLField(allow_null=True)
    results = EpisodeReturnSerializer(many=True)
