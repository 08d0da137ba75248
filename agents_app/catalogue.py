"""The catalogue of algorithms and parameters, read from the algorithms' own signatures, annotations and docstrings.

`fill` is idempotent and runs after each migration. Only here does Django meet torch, and only when `fill` is called.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from django.db import transaction

from agents_app import catalogue_texts as texts
from agents_app.algorithms.registry import ROWS, Row
from agents_app.catalogue_cache import cached
from agents_app.models import Algorithm, Parameter, ParameterType

# Parameters of simple types that are the server's business, not the owner's. optimize_memory_usage is refused by SB3
# itself beside its default handling of truncated episodes.
LEFT_OUT = {"tensorboard_log", "verbose", "stats_window_size", "_init_setup_model", "optimize_memory_usage"}
# Observations, by default: docs/adr/0013.
# Of total_timesteps; sb3-contrib's 0.005 is meant for millions of them, and would be over after 500 of our 100,000.
DEFAULTS = {("QR-DQN", "exploration_fraction"): 0.1}
NORMALISING = {"PPO", "A2C", "TRPO", "PolicyGradient", "MaskablePPO", "SAC", "TQC", "TD3", "DDPG"}
TYPES = {
    str: ParameterType.STR,
    float: ParameterType.FLOAT,
    int: ParameterType.INT,
    bool: ParameterType.BOOL,
}  # widest first


@dataclass(frozen=True)
class Entry:
    """One parameter as a signature tells it."""

    name: str
    type: ParameterType
    default: Any = None
    help_text: str = ""
    minimum: float | None = None
    maximum: float | None = None
    pattern: str = ""
    choices: list[str] = field(default_factory=list)


@cache
def read_entries() -> dict[str, list[Entry]]:
    """The parameters of each algorithm of the registry. Imports the algorithms, and so torch, unless they are known."""
    return {name: [_from_json(entry) for entry in entries] for name, entries in cached(_read).items()}


def _read() -> dict[str, list[dict[str, Any]]]:
    return {row.name: [asdict(entry) for entry in entries_of(row)] for row in ROWS}


def _from_json(entry: dict[str, Any]) -> Entry:
    return Entry(**{**entry, "type": ParameterType(entry["type"])})


def entries_of(row: Row) -> Iterator[Entry]:
    """The parameters of one algorithm: its own that are numbers, truths or texts, then Shepherd's."""
    cls = row.load()
    signature, docs = inspect.signature(cls.__init__, eval_str=True).parameters, docstring_parameters(cls)
    replays = "buffer_size" in signature
    plain = texts.PARAMETERS | (texts.REPLAYING if replays else {}) | texts.OWN.get(row.name, {})
    for name, parameter in signature.items():
        kind = type_of(parameter.annotation)
        if kind is not None and name not in LEFT_OUT:
            default = DEFAULTS.get((row.name, name), parameter.default)
            yield _entry(name, kind, default, plain.get(name) or docs.get(name, ""), replays)
        if name == "learning_rate":
            yield _entry("learning_rate_end", ParameterType.FLOAT, None, texts.LEARNING_RATE_END)
    yield _net_arch(row)
    if row.normalises:
        by_default = row.name in NORMALISING
        yield _entry("normalize_observations", ParameterType.BOOL, by_default, texts.NORMALIZE_OBSERVATIONS)
    if "action_noise" in signature:
        default = "normal 0.1" if row.name in ("TD3", "DDPG") else ""  # these two explore in no other way
        yield _entry("action_noise", ParameterType.STR, default, texts.ACTION_NOISE)
    yield _entry("total_timesteps", ParameterType.INT, 100_000, texts.TOTAL_TIMESTEPS)


def _net_arch(row: Row) -> Entry:
    """The hidden layers; algorithms that score actions can do without."""
    entry = _entry("net_arch", ParameterType.STR, None, texts.NET_ARCH)
    return (
        replace(entry, help_text=texts.NET_ARCH_OR_NONE, pattern=rf"{entry.pattern}|\s*0\s*") if row.scores else entry
    )


def _entry(name: str, kind: ParameterType, default: Any, help_text: str, replays: bool = False) -> Entry:
    if kind == ParameterType.STR:
        return Entry(name, kind, default, help_text, pattern=texts.PATTERNS.get(name, ""))
    minimum, maximum = texts.BOUNDS.get(name, (None, None))
    if replays and name in ("n_steps", "batch_size"):
        minimum = 1
    if kind == ParameterType.FLOAT and default is not None:
        default = float(default)
    return Entry(name, kind, default, help_text, minimum, maximum)


def type_of(annotation: Any) -> ParameterType | None:
    """The type of a value that fits the annotation; None when it takes an object that nobody can type into a form."""
    members = set(get_args(annotation)) if get_origin(annotation) in (Union, UnionType) else {annotation}
    simple = members & set(TYPES)
    others = {get_origin(member) or member for member in members - simple - {NoneType}}
    if others - {Callable, tuple}:  # a constant stands in for a schedule, a number for a number with its unit
        return None
    return next((kind for python, kind in TYPES.items() if python in simple), None)


def docstring_parameters(cls: type) -> dict[str, str]:
    """The texts of `:param name: text` in the docstring of a class, on one line each."""
    fields = re.split(r"^\s*:param\s+", inspect.getdoc(cls) or "", flags=re.MULTILINE)[1:]
    pairs = (text.partition(":")[::2] for text in fields)
    return {name.strip(): " ".join(text.replace("``", "").split()) for name, text in pairs}


def fill(using: str = "default") -> None:
    """Make the tables say what the code says. What vanished stays, unlisted, as long as agents need it."""
    entries = read_entries()
    with transaction.atomic(using=using):
        algorithms = {row.name: _fill_algorithm(row, using) for row in ROWS}
        Algorithm.objects.using(using).exclude(name__in=algorithms).update(listed=False)
        for name, algorithm in algorithms.items():
            _fill_parameters(algorithm, entries[name], using)


def _fill_algorithm(row: Row, using: str) -> Algorithm:
    facts: dict[str, Any] = {
        "discrete": row.discrete,
        "continuous": row.continuous,
        "advice": row.advice,
        "listed": True,
    }
    description = f"{texts.ALGORITHMS[row.name]} {texts.TAKES_ADVICE if row.advice else texts.TAKES_NONE}"
    facts |= {"policies": list(row.policies), "description": description}
    return Algorithm.objects.using(using).update_or_create(name=row.name, defaults=facts)[0]


def _fill_parameters(algorithm: Algorithm, entries: list[Entry], using: str) -> None:
    """Update in place. A parameter that is gone, or of another type, takes its values along: nothing accepts them."""
    known = Parameter.objects.using(using).filter(algorithm=algorithm)
    known.exclude(name__in=[entry.name for entry in entries]).delete()
    types = dict(known.values_list("name", "type"))
    changed = [entry.name for entry in entries if types.get(entry.name, entry.type) != entry.type]
    if changed:
        known.filter(name__in=changed).delete()
    Parameter.objects.using(using).bulk_create(
        [Parameter(algorithm=algorithm, position=position, **vars(entry)) for position, entry in enumerate(entries)],
        update_conflicts=True,
        unique_fields=["algorithm", "name"],
        update_fields=["position", *(name for name in Entry.__dataclass_fields__ if name != "name")],
    )
