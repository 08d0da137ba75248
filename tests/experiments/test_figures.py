"""Each figure can be played, as a very small one; its advice reaches the learner."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents_app.algorithms.builder import build
from experiments import __main__ as command
from experiments import advisors, in_process
from experiments.advisors import ADVISORS, UNIFORM
from experiments.figure import Figure, figure, numbers
from experiments.in_process import Advised, InProcess, Scaled, spec_of, try_out
from experiments.results import RESULTS, advisor_return, read_curve
from experiments.runner import missing


def test_the_figures_are_those_of_the_issue() -> None:
    assert numbers() == ["2.2", "2.3", "3.3", "3.4", "3.5", "3.7", "5.19", "known", "normalisation"]


@pytest.mark.parametrize("number", numbers())
def test_a_figure_is_consistent(number: str, tmp_path: Path) -> None:
    whole = figure(number)
    assert whole.number == number
    assert whole.runs >= (8 if number == "5.19" else 4)
    assert whole.claims or whole.levels
    for claim in whole.claims:
        curves = whole.panel(claim.panel).curves
        assert {claim.better, claim.worse} <= curves.keys()
        assert all(claim.first < (claim.last or task.episodes) <= task.episodes for task in curves.values())
    for level in whole.levels:
        episodes = whole.panel(level.panel).curves[level.curve].episodes
        assert level.over <= (level.by or episodes) <= episodes
    for task in (task for panel in whole.panels for task in panel.curves.values()):
        assert all(ADVISORS[name].environment == task.environment for name in task.advisors)
    paths = [job.path for job in missing([whole], tmp_path)]
    assert len(set(paths)) == len(paths) == sum(whole.runs_of(panel) * len(panel.curves) for panel in whole.panels)


def last_panels(number: str) -> Figure:
    """The last two with two curves each, which have every kind of task that a figure has; 5.19 would start four servers more."""
    whole = figure(number)
    panels = tuple(replace(panel, curves=dict(list(panel.curves.items())[:2])) for panel in whole.panels[-2:])
    names = {panel.title: set(panel.curves) for panel in panels}
    claims = tuple(claim for claim in whole.claims if {claim.better, claim.worse} <= names.get(claim.panel, set()))
    return replace(whole, panels=panels, claims=claims)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", ["2.3", "3.5", "5.19"])  # continuous, advised, over HTTP
def test_a_tiny_version_plays_end_to_end(
    number: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "figure", last_panels)
    options = ["--episodes", "2", "--runs", "1", "--jobs", "2", "--advisor-steps", "1", "--results", str(tmp_path)]
    assert command.main([number, *options]) == 0
    tiny = last_panels(number).shortened(2, 1)
    for panel in tiny.panels:
        for name in panel.curves:
            assert read_curve(tmp_path, tiny, panel, name).shape == (1, 2)
    assert (tmp_path / number / "figure.png").exists()
    assert "1 of 1 runs per curve so far" in capsys.readouterr().out
    assert missing([tiny], tmp_path) == []


def test_a_quick_look_does_not_touch_the_results(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command.main(["3.4", "--episodes", "2"])
    assert "--results" in capsys.readouterr().err
    assert RESULTS.parent.name == "experiments"


# --- advice ---
@pytest.mark.parametrize("name", ["cart-pole", "pendulum", "five-rooms-14x12"])
def test_an_advisor_is_kept_and_advises_always_the_same(name: str, tmp_path: Path) -> None:
    assert advisor_return(tmp_path, name) is None
    advisors.train(name, tmp_path, steps=1)
    assert advisor_return(tmp_path, name) is not None
    env = gym.make(ADVISORS[name].environment)
    obs, _ = env.reset(seed=1)
    advice = advisors.load(name, tmp_path)(obs)
    np.testing.assert_array_equal(advice, advisors.load(name, tmp_path)(obs))
    if isinstance(env.action_space, gym.spaces.Discrete):
        assert advice.shape == (env.action_space.n,)
        assert advice.sum() == pytest.approx(1)
    else:
        assert advice.shape == (2,) and advice[1] > 0


@pytest.mark.parametrize("broken", [b"", b"PK", b"{}"])
def test_a_broken_advisor_counts_as_none(broken: bytes, tmp_path: Path) -> None:
    (tmp_path / "cart-pole.npz").write_bytes(broken)
    assert advisor_return(tmp_path, "cart-pole") is None


def test_five_rooms_advisors_begin_anywhere_and_the_learner_does_not(tmp_path: Path) -> None:
    env = advisors.AnyCell(gym.make("shepherd_environments:FiveRooms-14x12-v0"))
    cells = {int(env.reset(seed=seed)[0]) for seed in range(30)}
    assert len(cells) > 15
    learner = gym.make("shepherd_environments:FiveRooms-14x12-v0")
    assert {int(learner.reset(seed=seed)[0]) for seed in range(5)} == {0}


def test_advice_rides_beside_the_observation() -> None:
    env = Advised(gym.make("CartPole-v1"), advisors.uniform(gym.spaces.Discrete(2)))
    obs, _ = env.reset(seed=1)
    assert obs["advice"].tolist() == [0.5, 0.5]
    assert obs in env.observation_space
    assert env.step(0)[0] in env.observation_space


def test_an_advisor_rewards_and_the_returns_are_those_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    monkeypatch.setattr(in_process, "build", lambda *args: made.append(build(*args)) or made[-1])  # type: ignore[func-returns-value]
    parameters = {"n_steps": 8, "batch_size": 8}
    task = InProcess("CartPole-v1", 4, parameters=parameters, agent={"advice_method": "shaping"}, advisor=UNIFORM)
    (episodes,) = task.learn(1, Path(), lambda: None)
    ends = [0, *(step for step, _ in episodes)]
    assert [total for _, total in episodes] == [last - first for first, last in pairwise(ends)]
    assert set(made[0].rollout_buffer.rewards.ravel().tolist()) <= {0.0, 1.5}  # 1 of Cart Pole, one half of the advisor


def test_other_units_are_the_same_environment() -> None:
    plain, told = gym.make("CartPole-v1"), Scaled(gym.make("CartPole-v1"), 1000.0, 3000.0)
    obs, far = plain.reset(seed=1)[0], told.reset(seed=1)[0]
    np.testing.assert_allclose(far, obs * 1000.0 + 3000.0, atol=1e-3)
    assert far.dtype == np.float32 and far in told.observation_space


def test_a_learner_sees_the_units_of_its_task() -> None:
    runs = [InProcess("CartPole-v1", 20, scale=scale).learn(1, Path(), lambda: None) for scale in (1.0, 1e6)]
    assert runs[0] != runs[1]


def test_the_uniform_advisor_of_continuous_actions_spans_their_range() -> None:
    space = gym.spaces.Box(np.float32([-2, 0]), np.float32([2, 1]))
    assert advisors.uniform(space)(None).tolist() == [0, 0.5, 2, 0.5]


def test_the_same_seed_learns_the_same() -> None:
    task = InProcess(
        "CartPole-v1", 5, parameters={"n_steps": 32}, agent={"advice_method": "intersection"}, advisor=UNIFORM
    )
    runs = [task.learn(seed, Path(), lambda: None) for seed in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]
    assert [len(episodes) for episodes in runs[0]] == [5]


def test_each_episode_is_told() -> None:
    told: list[int] = []
    InProcess("CartPole-v1", 4).learn(1, Path(), lambda: told.append(1))
    assert len(told) == 4


def test_the_last_episodes_may_try_out_what_was_learned() -> None:
    told: list[int] = []
    (learned,) = InProcess("CartPole-v1", 5).learn(1, Path(), lambda: None)
    (both,) = InProcess("CartPole-v1", 9, tried=4).learn(1, Path(), lambda: told.append(1))
    assert both[:5] == learned
    assert len(both) == len(told) == 9


def test_what_is_tried_out_is_the_best_action_and_nothing_is_learned() -> None:
    env = Acted(gym.make("CartPole-v1"))
    algorithm = build(spec_of(env, "PPO", {}), env, 0)
    try_out(algorithm, env)
    assert env.actions == [algorithm.predict(obs, deterministic=True)[0] for obs in env.seen[:-1]]
    assert algorithm.num_timesteps == 0


class Acted(gym.Wrapper):
    """Remembers what was seen and done."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        self.seen: list[np.ndarray] = []
        self.actions: list[int] = []

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        obs, info = self.env.reset(**kwargs)
        self.seen, self.actions = [obs], []
        return obs, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        step = self.env.step(action)
        self.seen.append(step[0])
        self.actions.append(action)
        return step
