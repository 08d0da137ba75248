"""shepherd-client: train a Shepherd agent on a Gymnasium environment from the command line."""

from __future__ import annotations

import argparse
import json
import logging
import os
import signal
import sys
from typing import TYPE_CHECKING

from shepherd_client.client import DEFAULT_URL, Client
from shepherd_client.errors import ShepherdError
from shepherd_client.spaces import spaces_of
from shepherd_client.training import RECENT, train

if TYPE_CHECKING:
    import gymnasium

OK, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130  # exit codes


def main(arguments: list[str] | None = None) -> int:
    """The command. Returns its exit code."""
    options = _parser().parse_args(arguments)
    logging.basicConfig(format="%(message)s", level=logging.WARNING)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # close the session then, too
    try:
        env = _make(options.env)
        return _describe(env) if options.describe else _train(env, options)
    except (ShepherdError, ValueError, ImportError) as error:
        return _complain(str(error), FAILED)
    except KeyboardInterrupt:
        return INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="shepherd-client",
        description="Train an agent of Shepherd on a Gymnasium environment.",
        epilog="Exit codes: 0 done, 1 failed, 2 wrong usage, 130 interrupted (the session is closed).",
    )
    parser.add_argument("--env", required=True, help="e.g. CartPole-v1, or module:Name-v0 to import a module first")
    parser.add_argument("--describe", action="store_true", help="print the spaces as create_agent wants them, and end")
    parser.add_argument("--episodes", type=_count, help="stop after so many episodes")
    parser.add_argument("--steps", type=_count, help="stop after so many steps; with neither, train until Ctrl-C")
    parser.add_argument("--url", default=os.environ.get("SHEPHERD_URL", DEFAULT_URL), help="default: %(default)s")
    parser.add_argument("--key", help="the agent's API key; better in the variable SHEPHERD_API_KEY")
    parser.add_argument("--seed", type=int, help="of the environment")
    return parser


def _count(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("write 1 or more")
    return number


def _make(name: str) -> gymnasium.Env:
    try:
        import gymnasium
    except ImportError:
        raise ValueError("Gymnasium is not installed: pip install gymnasium tqdm")
    try:
        return gymnasium.make(name)
    except (gymnasium.error.Error, ImportError) as error:
        raise ValueError(f"There is no environment {name!r}: {error}")


def _describe(env: gymnasium.Env) -> int:
    notes = spaces_of(env)
    print(f"--action-space '{json.dumps(notes.action_space)}'")
    print(f"--observation-space '{json.dumps(notes.observation_space)}'")
    return OK


def _train(env: gymnasium.Env, options: argparse.Namespace) -> int:
    key = options.key or os.environ.get("SHEPHERD_API_KEY")
    if not key:
        return _complain("No API key: give --key, or set the variable SHEPHERD_API_KEY.", USAGE)
    returns: list[float] = []
    with Client(key, url=options.url) as client:
        try:
            train(env, client.session(), returns, episodes=options.episodes, steps=options.steps, seed=options.seed)
        finally:
            _summarise(returns)
    return OK


def _summarise(returns: list[float]) -> None:
    if returns:
        recent = returns[-RECENT:]
        mean = sum(recent) / len(recent)
        print(f"{len(returns)} episodes; mean return of the last {len(recent)}: {mean:.1f}")


def _complain(message: str, code: int) -> int:
    print(f"shepherd-client: {message}", file=sys.stderr)
    return code
