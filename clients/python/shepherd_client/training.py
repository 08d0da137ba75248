"""Whole Gymnasium environments. Needs gymnasium, numpy and tqdm (the extra `gym`)."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import count
from typing import TYPE_CHECKING, Any

from shepherd_client.client import DEFAULT_URL, Client, Session
from shepherd_client.spaces import check_spaces, from_wire, to_wire

if TYPE_CHECKING:
    import gymnasium

RECENT = 100  # episodes in the mean


def run(
    env: gymnasium.Env,
    api_key: str,
    *,
    episodes: int | None = None,
    steps: int | None = None,
    progress: bool = True,
    url: str = DEFAULT_URL,
    seed: int | None = None,
) -> list[float]:
    """Train the agent of `api_key` on an environment, for a number of episodes or steps, whichever ends first.

    Without either it goes on until it is interrupted. Returns the sum of the rewards of each whole episode.
    """
    returns: list[float] = []
    with Client(api_key, url=url) as client:
        train(env, client.session(), returns, episodes=episodes, steps=steps, progress=progress, seed=seed)
    return returns


def train(
    env: gymnasium.Env,
    session: Session,
    returns: list[float],
    *,
    episodes: int | None = None,
    steps: int | None = None,
    progress: bool = True,
    seed: int | None = None,
) -> None:
    """As `run`, in a session of the caller's; the returns are added to a list that survives an interruption."""
    check_spaces(env, session.agent)
    with _Progress(episodes, steps, progress) as shown:
        for step, total in zip(count(1), play(env, session, seed), strict=False):
            if total is not None:
                returns.append(total)
            shown.update(returns, ended=total is not None)
            if step == steps or len(returns) == episodes:
                return


def play(env: gymnasium.Env, session: Session, seed: int | None = None) -> Iterator[float | None]:
    """Play episode after episode; yields after each step, None or at an episode's end its return."""
    masked = session.agent.get("action_masks", False)
    while True:
        obs, info = env.reset(seed=seed)
        seed, total = None, None
        while total is None:
            mask = _mask(info) if masked else None
            action = session.act(to_wire(env.observation_space, obs), action_mask=mask)
            obs, reward, terminated, truncated, info = env.step(from_wire(env.action_space, action))
            total = session.observe(to_wire(env.observation_space, obs), float(reward), terminated, truncated)
            yield total


def _mask(info: dict[str, Any]) -> list[bool] | None:
    """Which actions are allowed, where the environment says so (Gymnasium's Taxi does)."""
    mask = info.get("action_mask")
    return None if mask is None else [bool(allowed) for allowed in mask]


class _Progress:
    """A progress bar over episodes or steps, with the last return and the mean of the recent ones."""

    def __init__(self, episodes: int | None, steps: int | None, shown: bool) -> None:
        self._by_step = episodes is None
        self._bar = _bar(episodes, steps) if shown else None

    def update(self, returns: list[float], ended: bool) -> None:
        """One step was made, and perhaps an episode ended."""
        if self._bar is None:
            return
        if ended:
            recent = returns[-RECENT:]
            mean = sum(recent) / len(recent)
            self._bar.set_postfix_str(
                f"episode {len(returns)}, return {returns[-1]:.1f}, mean {mean:.1f}", refresh=False
            )
        if self._by_step or ended:
            self._bar.update()

    def __enter__(self) -> _Progress:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.close()


def _bar(episodes: int | None, steps: int | None) -> Any:
    """The bar; where nobody watches a terminal, a line now and then."""
    from tqdm import tqdm

    unit, total = (" steps", steps) if episodes is None else (" episodes", episodes)
    return tqdm(total=total, unit=unit, mininterval=0.2 if sys.stderr.isatty() else 10.0, dynamic_ncols=True)
