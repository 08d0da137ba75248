"""The tables of Shepherd (thesis section 5.5.1, figure 5.16), one file per subject."""

from agents_app.models.agent import Agent
from agents_app.models.catalogue import Algorithm, Parameter, ParameterType, ParameterValue
from agents_app.models.history import ActionTally, CurveBlock, EpisodeReturn, Execution, ExecutionError, Run, Save
from agents_app.models.keys import APIKey, Session, hash_key, make_key
from agents_app.models.user import User

__all__ = [
    "APIKey",
    "ActionTally",
    "Agent",
    "Algorithm",
    "CurveBlock",
    "EpisodeReturn",
    "Execution",
    "ExecutionError",
    "Parameter",
    "ParameterType",
    "ParameterValue",
    "Run",
    "Save",
    "Session",
    "User",
    "hash_key",
    "make_key",
]
