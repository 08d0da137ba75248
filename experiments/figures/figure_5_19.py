"""Figure 5.19, the platform's own: executions that advise each other, through the real server with real clients."""

from typing import Any

from experiments.figure import Claim, Figure, Panel
from experiments.over_http import OverHTTP

PANEL, NAMES = "Lunar Lander", {1: "1 execution", 2: "2 executions", 4: "4 executions"}
THESIS: dict[str, Any] = {
    "advice": "intersection",
    "advisors": "random",
}  # its own method; the correction is on by default
FIGURE = Figure(
    number="5.19",
    title="PPO, executions that advise each other, through the server",
    thesis="four executions stay on top of two, and two of one; the gain is largest between episodes 200 and 400.",
    panels=(
        Panel(
            PANEL,
            {name: OverHTTP("LunarLander-v3", 800, clients, agent=THESIS) for clients, name in NAMES.items()},
            goal=200,
        ),
    ),
    claims=(
        Claim(PANEL, NAMES[4], NAMES[1], 200, 400),
        Claim(PANEL, NAMES[4], NAMES[2], 200, 400),
        Claim(PANEL, NAMES[2], NAMES[1], 200, 400),
        Claim(PANEL, NAMES[4], NAMES[1], 400, 800),
    ),
    runs=8,
)
