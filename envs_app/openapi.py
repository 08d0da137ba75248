"""The descriptions of the endpoints, for the schema at /api/schema/ and the page at /api/docs/.

They stand apart from the views, which stay readable, and are applied as decorators: `@openapi.step`.
"""

from __future__ import annotations

from typing import Any

from drf_spectacular.types import OpenApiTypes
from drf_spectacular.utils import OpenApiExample, OpenApiParameter, OpenApiResponse, extend_schema

from envs_app import errors
from envs_app.errors import ShepherdError
from envs_app.problems import describe
from envs_app.serializers import AgentSerializer, ReturnsPageSerializer, SessionSerializer

Schema = dict[str, Any]

OBSERVATION: Schema = {
    "description": "As the agent's observation space says: a whole number, nested lists, or an object of those.",
    "anyOf": [{"type": "integer"}, {"type": "array", "items": {}}, {"type": "object", "additionalProperties": {}}],
}
ACTION: Schema = {
    "description": "A whole number, or nested lists of numbers; null after the end of an episode.",
    "anyOf": [{"type": "integer"}, {"type": "array", "items": {}}, {"type": "null"}],
}
SEQ: Schema = {
    "type": "integer",
    "minimum": 0,
    "maximum": 2**53,
    "description": "The number of the step in its session.",
}


def _object(required: list[str], properties: Schema, strict: bool = True) -> Schema:
    schema = {"type": "object", "required": required, "properties": properties}
    return schema | {"additionalProperties": False} if strict else schema


STEP_REQUEST = _object(
    ["obs", "reward", "terminated", "truncated"],
    {
        "obs": OBSERVATION,
        "reward": {"type": "number", "description": "For the last action; ignored at the start of an episode."},
        "terminated": {"type": "boolean", "description": "The episode is over, and nothing comes after this."},
        "truncated": {"type": "boolean", "description": "The episode is cut off here, though it could go on."},
        "info": {"type": ["object", "null"], "description": "Gymnasium's info."},
        "seq": {
            **SEQ,
            "type": ["integer", "null"],
            "description": "One more than the last one. A repeated number gets "
            "the stored answer, so a step may be sent again after a lost connection.",
        },
        "advice": {
            "description": "What somebody at the client would do here, in place of a peer's advice: how good each "
            "action is, as a list, or {mean, std} for continuous actions."
        },
        "action_mask": {
            "type": ["array", "null"],
            "items": {"type": "boolean"},
            "description": "Which actions are allowed, for agents that take masks.",
        },
    },
)
STEP_REPLY = _object(
    ["action", "seq"],
    {
        "action": ACTION,
        "seq": SEQ,
        "episode_return": {"type": ["number", "null"], "description": "Sum of the rewards."},
    },
)
PROBLEM = _object(
    ["type", "title", "status", "detail", "code"],
    {
        "type": {"type": "string"},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "detail": {"type": "string", "description": "What to do, for people."},
        "code": {"type": "string", "description": "Stable, for programs."},
        "retry_after": {"type": "number", "description": "Seconds to wait; only with 429 and 503."},
    },
)
LEGACY_ERROR = _object(["ok", "error"], {"ok": {"const": False}, "error": {"type": "string"}})
LEGACY_STEP = _object(
    ["session_key", "obs"],
    {
        "session_key": {"type": "string"},
        "obs": {"anyOf": [*OBSERVATION["anyOf"], {"type": "null"}], "description": "null closes the session."},
        "reward": {"type": ["number", "null"]},
        "done": {"type": "boolean"},
        "info": {"type": ["object", "null"]},
    },
    strict=False,
)
EMPTY = _object([], {})
STATUS = _object(["status"], {"status": {"type": "string"}})

COMPONENTS = {
    "securitySchemes": {
        "apiKey": {
            "type": "http",
            "scheme": "bearer",
            "description": "An API key (sk_..., pk_...), made in the admin.",
        },
        "sessionKey": {"type": "http", "scheme": "bearer", "description": "A session key, from POST /api/v1/sessions."},
    },
    "schemas": {"Problem": PROBLEM, "Step": STEP_REQUEST, "Reply": STEP_REPLY, "LegacyError": LEGACY_ERROR},
}


def add_components(result: Schema, **kwargs: Any) -> Schema:
    """A hook of drf-spectacular: the parts that the descriptions refer to."""
    for kind, parts in COMPONENTS.items():
        result["components"].setdefault(kind, {}).update(parts)
    return result


def _ref(name: str) -> Schema:
    return {"$ref": f"#/components/schemas/{name}"}


ALWAYS = (errors.MethodNotAllowed(), errors.Unavailable(), errors.InternalError())
BODY = (errors.InvalidRequest("The request lacks terminated; its keys are ..."), errors.RequestTooLarge())
API_KEY = (errors.InvalidApiKey(), errors.Throttled(retry_after=42.5))
SESSION_KEY = (errors.UnknownSession(),)
ORIGIN = errors.Forbidden("This publishable key was used from a page of https://example.org; it works only in ...")
START = (errors.QuotaExceeded(retry_after=1.25), errors.NoCapacity(retry_after=2.0))
STEP = (
    ORIGIN,
    errors.Throttled(retry_after=3.5),
    errors.InvalidObservation("obs[3] is nan; a finite number is expected."),
    errors.InvalidReward("reward is null; a finite number is expected."),
    errors.StepPending(),
    errors.SequenceGap(),
    errors.ExecutionLost(retry_after=0.5),
)


def _refusals(*some: ShepherdError, legacy: bool = False) -> dict[Any, OpenApiResponse]:
    """The replies to what goes wrong, by status, each error with its example."""
    media_type = "application/json" if legacy else "application/problem+json"
    by_status: dict[int, list[ShepherdError]] = {}
    for error in (*some, *ALWAYS):
        by_status.setdefault(error.status, []).append(error)
    return {(status, media_type): _refusal(kinds, legacy) for status, kinds in sorted(by_status.items())}


def _refusal(kinds: list[ShepherdError], legacy: bool) -> OpenApiResponse:
    examples = [
        OpenApiExample(error.code, {"ok": False, "error": error.detail} if legacy else describe(error))
        for error in kinds
    ]
    description = " ".join(f"`{error.code}`: {error.title}." for error in kinds)
    return OpenApiResponse(_ref("LegacyError" if legacy else "Problem"), description, examples)


def _example(name: str, value: Any) -> OpenApiExample:
    return OpenApiExample(name, value, request_only=True)


BY_API_KEY: Any = [{"apiKey": []}]
BY_SESSION_KEY: Any = [{"sessionKey": []}]
RUN = OpenApiParameter("run", int, description="The number of a run; without it the one that learns now.")
SESSION_REPLY = {
    "session_key": "ss_...",
    "agent": {"name": "lander", "algorithm": "PPO", "action_space": 4, "observation_space": [[8], -10, 10]},
}

step = extend_schema(
    operation_id="step",
    tags=["session"],
    auth=BY_SESSION_KEY,
    request={"application/json": _ref("Step")},
    responses={
        200: OpenApiResponse(
            _ref("Reply"),
            "The next action; null after the end of an episode.",
            [
                OpenApiExample("A discrete action", {"action": 2, "seq": 17}),
                OpenApiExample("A continuous action", {"action": [0.25, -1.0], "seq": 17}),
                OpenApiExample("After the end", {"action": None, "seq": 18, "episode_return": -123.5}),
            ],
        ),
        **_refusals(*BODY, *SESSION_KEY, *STEP, *START),
    },
    examples=[
        _example(
            "A vector",
            {"obs": [0.1, -0.5, 0.0], "reward": 1.0, "terminated": False, "truncated": False, "info": {}, "seq": 17},
        ),
        _example("A state", {"obs": 3, "reward": 0, "terminated": False, "truncated": False}),
        _example(
            "Several sensors",
            {"obs": {"place": 3, "speed": [0.5]}, "reward": -1, "terminated": True, "truncated": False},
        ),
    ],
)
open_session = extend_schema(
    operation_id="open_session",
    tags=["session"],
    auth=BY_API_KEY,
    request={"application/json": EMPTY},
    responses={
        201: OpenApiResponse(
            SessionSerializer, "The session; its key is shown only here.", [OpenApiExample("A session", SESSION_REPLY)]
        ),
        **_refusals(*BODY, *API_KEY, ORIGIN),
    },
)
close_session = extend_schema(
    operation_id="close_session",
    tags=["session"],
    auth=BY_SESSION_KEY,
    responses={204: OpenApiResponse(None, "Closed."), **_refusals(*SESSION_KEY)},
)
describe_agent = extend_schema(
    operation_id="describe_agent",
    tags=["agent"],
    auth=BY_API_KEY,
    responses={200: AgentSerializer, **_refusals(*API_KEY, errors.Forbidden())},
)
list_returns = extend_schema(
    operation_id="list_returns",
    tags=["agent"],
    auth=BY_API_KEY,
    parameters=[
        RUN,
        OpenApiParameter("format", enum=["json", "csv"], description="csv: all returns of the run at once."),
        OpenApiParameter("limit", int, description="Episodes in a page, up to 10,000; 1,000 without it."),
        OpenApiParameter("cursor", str, description="Of a page; follow `next` instead of making one."),
    ],
    responses={
        (200, "application/json"): ReturnsPageSerializer,
        (200, "text/csv"): OpenApiResponse(OpenApiTypes.STR, "The same columns, with a header."),
        **_refusals(errors.InvalidRequest(), *API_KEY, errors.Forbidden(), errors.NotFound()),
    },
)
download_model = extend_schema(
    operation_id="download_model",
    tags=["agent"],
    auth=BY_API_KEY,
    parameters=[RUN],
    responses={
        (200, "application/zip"): OpenApiResponse(
            OpenApiTypes.BINARY, "Load it with stable_baselines3.PPO.load, or its class."
        ),
        **_refusals(errors.InvalidRequest(), *API_KEY, errors.Forbidden(), errors.NotFound()),
    },
)
legacy_login = extend_schema(
    operation_id="legacy_login",
    tags=["original protocol"],
    auth=[],
    request={"application/json": _object(["apikey"], {"apikey": {"type": "string"}}, strict=False)},
    responses={
        200: _object(["ok", "session_key"], {"ok": {"const": True}, "session_key": {"type": "string"}}),
        **_refusals(*BODY, *API_KEY, ORIGIN, legacy=True),
    },
    examples=[_example("Log in", {"apikey": "sk_..."})],
)
legacy_step = extend_schema(
    operation_id="legacy_step",
    tags=["original protocol"],
    auth=[],
    request={"application/json": LEGACY_STEP},
    responses={
        200: _object(["action"], {"action": ACTION}),
        **_refusals(*BODY, *SESSION_KEY, *STEP, *START, legacy=True),
    },
    examples=[
        _example("A step", {"session_key": "ss_...", "obs": [0.1, 0.2], "reward": 1.0, "done": False, "info": {}}),
        _example("Close", {"session_key": "ss_...", "obs": None, "reward": 0, "done": False, "info": {}}),
    ],
)
health = extend_schema(operation_id="health", tags=["operations"], auth=[], responses={200: STATUS, **_refusals()})
ready = extend_schema(operation_id="ready", tags=["operations"], auth=[], responses={200: STATUS, **_refusals()})
metrics = extend_schema(
    operation_id="metrics",
    tags=["operations"],
    auth=[],
    responses={
        (200, "text/plain"): OpenApiResponse(OpenApiTypes.STR, "Prometheus' text format."),
        **_refusals(errors.InvalidApiKey()),
    },
)
