"""ShepherdEnv-v0 is a Gymnasium environment like any other: whoever learns on those learns on this one."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from stable_baselines3 import DQN, PPO

import envs_app.shepherd_env  # noqa: F401  (registers it)
from agents_app.algorithms.direct import LiveFeed
from agents_app.algorithms.replay import Outcome, TapeClosed

PATIENCE = 20.0


class Client(threading.Thread):
    """A client of the identity game: whoever does at `obs` what `obs` says is rewarded. Episodes have `length` steps."""

    def __init__(self, states: Iterator[Any], length: int) -> None:
        super().__init__(daemon=True)
        self.states, self.length = states, length
        self.feed = LiveFeed()
        self._asked, self._over = threading.Event(), False
        self.feed.on_action = self._asked.set

    def run(self) -> None:
        while not self._over:
            here = next(self.states)
            self.feed.begin(here)
            for number in range(1, self.length + 1):
                action = self._wait_for_action()
                if self._over:
                    return
                there, ends = next(self.states), number == self.length
                self.feed.follow(Outcome(float(np.array_equal(action, here)), there, ends, False, None))
                here = there

    def stop(self) -> None:
        self._over = True
        self._asked.set()
        self.feed.close()
        self.join(PATIENCE)

    def _wait_for_action(self) -> Any:
        while not self._over:
            self._asked.wait(PATIENCE)
            self._asked.clear()
            if (action := self.feed.take_action()) is not None:
                return action
        return None


Play = Callable[..., gym.Env]


@pytest.fixture
def play() -> Iterator[Play]:
    """Makes a ShepherdEnv with a client behind it."""
    clients: list[Client] = []

    def make(observations: spaces.Space, actions: spaces.Space, length: int = 1) -> gym.Env:
        client = Client(at_random(observations), length)
        clients.append(client)
        client.start()
        facts = {"observation_space": observations, "action_space": actions, "feed": client.feed}
        return gym.make("ShepherdEnv-v0", **facts)

    yield make
    for client in clients:
        client.stop()


def at_random(space: spaces.Space) -> Iterator[Any]:
    """A world in which every observation is equally probable."""
    space.seed(1)
    while True:
        yield space.sample()


SPACES = {
    "discrete": spaces.Discrete(4),
    "vector": spaces.Box(-1, 1, (3,), np.float32),
    "image": spaces.Box(0, 255, (3, 36, 36), np.uint8),
    "dict": spaces.Dict({"camera": spaces.Box(0, 255, (3, 36, 36), np.uint8), "room": spaces.Discrete(3)}),
}


@pytest.mark.parametrize("actions", [spaces.Discrete(4), spaces.Box(-1, 1, (2,), np.float32)], ids=["n", "vector"])
@pytest.mark.parametrize("kind", SPACES)
@pytest.mark.filterwarnings("error")
def test_the_checker_of_gymnasium_finds_nothing(play: Play, kind: str, actions: spaces.Space) -> None:
    env = play(SPACES[kind], actions)
    check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    ("algorithm", "parameters"),
    [
        (PPO, {"n_steps": 32, "batch_size": 32, "n_epochs": 4}),
        (DQN, {"learning_starts": 50, "exploration_fraction": 0.5}),
    ],
    ids=["PPO", "DQN"],
)
def test_stock_algorithms_learn_on_it(play: Play, algorithm: Any, parameters: dict[str, Any]) -> None:
    env = play(spaces.Discrete(3), spaces.Discrete(3), length=8)
    facts = {"learning_rate": 0.01, "gamma": 0.0, "seed": 1, "device": "cpu"} | parameters
    model = algorithm("MlpPolicy", env, **facts).learn(1000)
    assert [int(model.predict(np.int64(state), deterministic=True)[0]) for state in range(3)] == [0, 1, 2]


def test_a_tiny_q_learner_of_a_stranger_learns_on_it(play: Play) -> None:
    env = play(spaces.Discrete(4), spaces.Discrete(4), length=10)
    values: dict[int, np.ndarray] = defaultdict(lambda: np.ones(4))
    obs, _ = env.reset()
    for _ in range(200):
        action = int(values[int(obs)].argmax())
        following, reward, terminated, truncated, _ = env.step(action)
        values[int(obs)][action] += 0.5 * (float(reward) - values[int(obs)][action])
        obs = env.reset()[0] if terminated or truncated else following
    assert [int(values[state].argmax()) for state in range(4)] == [0, 1, 2, 3]


class TestLiveFeed:
    """Two threads: here the algorithm's calls run in a thread, and the test is the client."""

    @pytest.fixture
    def feed(self) -> Iterator[LiveFeed]:
        feed = LiveFeed()
        yield feed
        feed.close()

    @staticmethod
    def later(call: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
        """Call in another thread; returns what waits for the result."""
        results: list[Any] = []

        def run() -> None:
            try:
                results.append(call(*arguments))
            except TapeClosed as closed:
                results.append(closed)

        thread = threading.Thread(target=run, daemon=True)
        thread.start()

        def wait() -> Any:
            thread.join(PATIENCE)
            assert results, "it still waits"
            return results[0]

        return wait

    @staticmethod
    def action(feed: LiveFeed) -> Any:
        """The action that the client is given."""
        chosen = threading.Event()
        feed.on_action = chosen.set
        while (action := feed.take_action()) is None:
            assert chosen.wait(PATIENCE)
            chosen.clear()
        return action

    def test_an_action_is_given_once(self, feed: LiveFeed) -> None:
        feed.begin("start")
        assert feed.first() == "start"
        done = self.later(feed.advance, 3)
        assert self.action(feed) == 3
        assert feed.take_action() is None
        outcome = Outcome(1.0, "there", False, False, None)
        feed.follow(outcome)
        assert done() is outcome

    def test_an_episode_that_breaks_off_ends_by_truncation_where_it_stood(self, feed: LiveFeed) -> None:
        feed.begin("start")
        feed.first()
        done = self.later(feed.advance, 3)
        assert self.action(feed) == 3
        feed.begin("another start")
        outcome = done()
        assert (outcome.obs, outcome.reward) == ("start", 0.0)
        assert (outcome.terminated, outcome.truncated) == (False, True)
        assert feed.first() == "another start"

    def test_an_action_for_an_episode_that_broke_off_is_not_given_to_the_next(self, feed: LiveFeed) -> None:
        feed.begin("start")
        feed.first()
        feed.begin("another start")  # while the algorithm thinks
        outcome = feed.advance(3)
        assert outcome.truncated
        assert feed.take_action() is None
        assert feed.first() == "another start"
        done = self.later(feed.advance, 4)
        assert self.action(feed) == 4
        feed.follow(Outcome(1.0, "end", True, False, None))
        assert done().obs == "end"

    def test_an_episode_that_the_algorithm_gives_up_goes_on(self, feed: LiveFeed) -> None:
        feed.begin("start")
        assert feed.first() == feed.first() == "start"

    def test_an_errand_is_run_while_the_algorithm_waits(self, feed: LiveFeed) -> None:
        started = self.later(feed.first)
        ran = threading.Event()
        feed.send_errand(ran.set)
        assert ran.wait(PATIENCE)
        feed.begin("start")
        assert started() == "start"

    def test_closing_it_ends_the_wait(self, feed: LiveFeed) -> None:
        started = self.later(feed.first)
        feed.close()
        assert isinstance(started(), TapeClosed)
