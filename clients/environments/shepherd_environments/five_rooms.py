"""Five Rooms: a large grid, its walls, and four doors of one cell, in three sizes.

Environment of the thesis behind Shepherd (Plisnier, "Actor-Advisor", 3.1, 4.3.2 and 5.3.2), inspired by the Four Rooms of
Sutton, Precup and Singh (1999). The thesis gives sizes, rewards and optima, but its drawing is not at hand: walls and doors
here are ours, chosen so that the optima hold.

    S . . . | . . . .     three storeys of equal height, two horizontal walls with a door each;
    . . . . D . . . .     the upper two are divided by a vertical wall with a door.
    --------+---D----     S start, G goal, D doors.
    . . . . | . . . .
    . . . . D . . . .
    ------------D----
    . . . . . . . . G
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

MOVES = ((-1, 0), (1, 0), (0, -1), (0, 1))  # rows and columns, by action: up, down, left, right
GOAL = 100.0
Cell = tuple[int, int]  # row, column


@dataclass(frozen=True)
class Size:
    """A grid without a border, and where its horizontal walls have their doors."""

    rows: int
    columns: int
    doors: tuple[int, int]  # columns, from the top

    @property
    def storey(self) -> int:
        """The height of a storey, in cells."""
        return (self.rows - 2) // 3


# The doors of 29x27 lie on a shortest way between the corners; in the others the second one lies a step behind the first.
SIZES = {"29x27": Size(29, 27, (19, 22)), "23x21": Size(23, 21, (16, 15)), "14x12": Size(14, 12, (9, 8))}
# What a step brings, and the step onto the goal. The thesis counts an optimum of 100 - 54 x 0.1 in chapter 4, where the last
# step costs as the others do; its other optima are those of a last step that is free.
REWARDS = {"dear": (-1.0, GOAL), "cheap": (-0.1, GOAL - 0.1)}


class FiveRooms(gym.Env[np.int64, np.int64]):
    """Walk from the top left corner to the bottom right one.

    - Actions: Discrete(4). 0 up, 1 down, 2 left, 3 right; into a wall, nothing moves.
    - Observations: Discrete(rows x columns), the cell: row x columns + column. (The thesis speaks of a vector of 812 numbers for
      29x27, which has 783 cells.)
    - Rewards: -1 per step, 100 for the step onto the goal ("dear", thesis 3.1, 5.3.2); or -0.1 per step, 99.9 ("cheap", 4.3.2).
    - Start: the top left corner.
    - End: terminated on the goal; truncated by the registered time limit after 500 steps.
    - Optima: 54 steps in 29x27, a return of 47 or, cheap, 94.6; 44 steps and 57 in 23x21; 26 steps and 75 in 14x12.

    `doors`: the columns of the doors of the two horizontal walls, if other than usual; each may be at any column but that of
    the vertical walls, e.g. at 26 of 27 (thesis 5.3.2).
    """

    metadata = {"render_modes": ["ansi"], "render_fps": 10}

    def __init__(
        self,
        size: str = "29x27",
        rewards: str = "dear",
        doors: tuple[int, int] | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Raises KeyError for another size or reward, ValueError for a door where none can be."""
        self.size, self.render_mode = SIZES[size], render_mode
        self.step_reward, self.goal_reward = REWARDS[rewards]
        self.walls = _walls(self.size, doors or self.size.doors)  # (rows, columns) of bool
        self.action_space = spaces.Discrete(len(MOVES))
        self.observation_space = spaces.Discrete(self.walls.size)
        self.start, self.goal = (0, 0), (self.size.rows - 1, self.size.columns - 1)
        self.cell: Cell = self.start

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin in the corner, or at `options["cell"]`."""
        super().reset(seed=seed)
        self.cell = (options or {}).get("cell", self.start)
        return self._observe(), {}

    def step(self, action: np.int64 | int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move by one cell."""
        self.cell = self.neighbour(self.cell, int(action))
        arrived = self.cell == self.goal
        return self._observe(), self.goal_reward if arrived else self.step_reward, arrived, False, {}

    def neighbour(self, cell: Cell, action: int) -> Cell:
        """Where an action leads from a cell."""
        row, column = cell[0] + MOVES[action][0], cell[1] + MOVES[action][1]
        inside = 0 <= row < self.size.rows and 0 <= column < self.size.columns
        return (row, column) if inside and not self.walls[row, column] else cell

    def free_cells(self) -> list[Cell]:
        """All cells where one can stand."""
        return [(int(row), int(column)) for row, column in np.argwhere(~self.walls)]

    def render(self) -> str:
        """The map, a line per row."""
        signs = np.where(self.walls, "#", ".")
        signs[self.start], signs[self.goal], signs[self.cell] = "S", "G", "@"
        return "\n".join("".join(row) for row in signs)

    def _observe(self) -> np.int64:
        return np.int64(self.cell[0] * self.size.columns + self.cell[1])


def _walls(size: Size, doors: tuple[int, int]) -> np.ndarray:
    """Where walls are, (rows, columns) of bool."""
    walls = np.zeros((size.rows, size.columns), bool)
    middle, floors = size.columns // 2, (size.storey, 2 * size.storey + 1)
    walls[: floors[1], middle] = True
    for floor, door in zip(floors, doors, strict=True):
        if door == middle or not 0 <= door < size.columns:
            raise ValueError(
                f"There can be no door at column {door}: take one of 0 to {size.columns - 1} but {middle}."
            )
        walls[floor] = True
        walls[floor, door] = False
        walls[floor - 1 - size.storey // 2, middle] = False  # the door of the vertical wall above this floor
    return walls
