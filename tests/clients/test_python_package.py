"""The Python package by itself."""

from __future__ import annotations

import os
import subprocess
import sys

import gymnasium
import numpy as np
import shepherd_client
from shepherd_client import ShepherdError, TransientError, errors

import envs_app.errors
from tests.clients.driving import PYTHON_PATH
from tests.servers import Server

BARE = """
import sys
for name in ("numpy", "gymnasium", "tqdm", "orjson"):
    sys.modules[name] = None
import shepherd_client
print(shepherd_client.Client("sk_").resume("key", 3).seq)
"""


def test_it_needs_nothing_but_python() -> None:
    done = subprocess.run(
        [sys.executable, "-c", BARE], env=os.environ | {"PYTHONPATH": PYTHON_PATH}, capture_output=True, text=True
    )
    assert done.stdout == "3\n", done.stderr


def test_every_error_of_the_server_has_a_class_of_its_own() -> None:
    for code, theirs in envs_app.errors.BY_CODE.items():
        ours = errors.BY_CODE[code]
        assert ours.__name__ == theirs.__name__
        waits = theirs.status in (429, 503) or code == "step_pending"
        assert issubclass(ours, TransientError) == waits, code


def test_every_error_can_be_imported_from_the_package() -> None:
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, ShepherdError)]
    assert all(getattr(shepherd_client, kind.__name__) is kind for kind in kinds)


def test_run_returns_what_the_server_counted(server: Server) -> None:
    _, key = server.create_agent(name="clients: run")
    returns = shepherd_client.run(
        gymnasium.make("CartPole-v1"), key, episodes=4, url=server.url, progress=False, seed=1
    )
    assert len(returns) == 4
    assert all(value >= 8 for value in returns)  # Cart Pole gives 1 per step


def test_run_plays_environments_with_images_dictionaries_and_box_actions(server: Server) -> None:
    sensors = gymnasium.spaces.Dict(
        {
            "camera": gymnasium.spaces.Box(0, 255, (36, 36, 3), np.uint8),
            "speed": gymnasium.spaces.Box(-1, 1, (2,)),
            "room": gymnasium.spaces.Discrete(3, start=1),
        }
    )

    class Street(gymnasium.Env):
        observation_space, action_space = sensors, gymnasium.spaces.Box(-1, 1, (2,))

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            self.left = 3
            return self.observation_space.sample(), {}

        def step(self, action):
            assert self.action_space.contains(action)
            self.left -= 1
            return self.observation_space.sample(), float(self.left), False, self.left == 0, {}

    notes = shepherd_client.spaces_of(Street())
    _, key = server.create_agent(name="clients: street", **notes._asdict())
    assert shepherd_client.run(Street(), key, episodes=2, url=server.url, progress=False) == [3.0, 3.0]
