"""PyTorch without its compiler, until somebody compiles.

PyTorch's optimisers import torch._dynamo when the first of them is made, only to tell it that it shall not compile them.
Nobody compiles here, and the import takes as long as that of torch itself (1.5 s of CPU, 71 MB). So it sleeps: what the
optimisers say to it does nothing, and torch.compile, or whoever asks it for anything else, wakes it up.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from importlib.util import find_spec, module_from_spec
from types import ModuleType
from typing import Any

import torch

NAME = "torch._dynamo"


class Asleep(ModuleType):
    """A module that is executed when it is asked for something that it was not given beforehand."""

    def __getattr__(self, name: str) -> Any:
        wake()
        return getattr(self, name)


def sleep() -> None:
    """Let torch._dynamo sleep, unless it has been imported before."""
    if NAME in sys.modules or (spec := find_spec(NAME)) is None:
        return
    module = module_from_spec(spec)
    module.disable, module.graph_break = _as_it_is, _nothing  # type: ignore[attr-defined]  # what optimisers say
    module.__class__ = Asleep
    sys.modules[NAME] = torch._dynamo = module
    torch.compile = _waking(torch.compile)  # in the order in which it imports parts of it, all must be there


def wake() -> None:
    """Import torch._dynamo as it is."""
    module = sys.modules[NAME]
    if isinstance(module, Asleep):
        module.__class__ = ModuleType  # type: ignore[assignment]  # first: while it is executed it asks itself
        module.__spec__.loader.exec_module(module)  # type: ignore[union-attr]


def _waking(function: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(function)
    def awake(*arguments: Any, **options: Any) -> Any:
        wake()
        return function(*arguments, **options)

    return awake


def _as_it_is(function: Callable[..., Any], *arguments: Any, **options: Any) -> Callable[..., Any]:
    """In place of torch._dynamo.disable."""
    return function


def _nothing() -> None:
    """In place of torch._dynamo.graph_break."""
