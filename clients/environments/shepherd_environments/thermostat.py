"""A room, its heater, and a person who lives there.

The thermal model is the usual one of a single capacity behind a single resistance, as in Newton's law of cooling; the
constants are those of a small living room with ordinary insulation. Written for Shepherd.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium import spaces

STEP = 300.0  # s
DAY = 86_400.0  # s
CAPACITY = 2.0e6  # J/K, of the room and what is in it
LOSS = 100.0  # W/K, through walls and windows
POWERS = (0.0, 2000.0, 4000.0)  # W, by action
MEAN_OUTSIDE, SWING_OUTSIDE = 5.0, 5.0  # °C; coldest at 3 o'clock, warmest at 15 o'clock
PRICE = 0.1  # reward of a step at full power, negative
ORIGIN, SCALE = 20.0, 10.0  # °C; observed temperatures are (T - ORIGIN) / SCALE


class Person(Protocol):
    """Whoever judges the room."""

    def thumb(self, temperature: float) -> float:
        """1 for a thumb up since the last call, -1 for a thumb down, 0 for none; several may be added."""
        ...


class SimulatedPerson:
    """Likes 20 to 22 °C, and cares to say so at 3 steps of 10."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def thumb(self, temperature: float) -> float:
        """The simulated thumb at a temperature."""
        if self._rng.random() >= 0.3:
            return 0.0
        return 1.0 if 20.0 <= temperature <= 22.0 else -1.0


class Thermostat(gym.Env[np.ndarray, np.int64]):
    """Keep a person comfortable, and spend little.

    - Actions: Discrete(3). 0 off, 1 half power (2 kW), 2 full power (4 kW), for 5 minutes.
    - Observations: Box(-5, 5, (4,), float32). Temperature of the room and outside, in tens of kelvin from 20 °C; sine
      and cosine of the time of day.
    - Rewards: the person's thumbs (+1 up, -1 down) since the last step, and -0.1 x the share of full power.
    - Start: the room between 14 and 26 °C, at any time of day.
    - End: never terminated; truncated by the registered time limit after 288 steps, a day.

    `person` is whoever judges; without one, a SimulatedPerson.
    """

    metadata = {"render_modes": []}

    def __init__(self, person: Person | None = None) -> None:
        self.action_space = spaces.Discrete(len(POWERS))
        self.observation_space = spaces.Box(-5.0, 5.0, (4,), np.float32)
        self._person = person
        self.temperature = ORIGIN  # °C
        self.time = 0.0  # s since midnight

    @property
    def outside(self) -> float:
        """The temperature outside, in °C."""
        return MEAN_OUTSIDE - SWING_OUTSIDE * math.cos(2 * math.pi * (self.time / DAY - 3 / 24))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a day."""
        super().reset(seed=seed)
        self.temperature = self.np_random.uniform(14.0, 26.0)
        self.time = self.np_random.uniform(0.0, DAY)
        return self._observe(), self._info()

    def step(self, action: np.int64 | int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Heat for five minutes."""
        power = POWERS[action]
        flow = power - LOSS * (self.temperature - self.outside)  # W, into the room
        self.temperature += STEP * flow / CAPACITY
        self.time = (self.time + STEP) % DAY
        reward = self._thumb() - PRICE * power / POWERS[-1]
        return self._observe(), reward, False, False, self._info()

    def _thumb(self) -> float:
        person = self._person or SimulatedPerson(self.np_random)
        return person.thumb(self.temperature)

    def _observe(self) -> np.ndarray:
        angle = 2 * math.pi * self.time / DAY
        inside, outside = ((degrees - ORIGIN) / SCALE for degrees in (self.temperature, self.outside))
        return np.array([inside, outside, math.sin(angle), math.cos(angle)], dtype=np.float32)

    def _info(self) -> dict[str, Any]:
        return {"temperature": self.temperature, "outside": self.outside}
