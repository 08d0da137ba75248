"""Figure 2.3: PPO hardly notices such actions."""

from experiments.curves import CONTINUOUS_LANDER, LANDER, PPO, disturbed
from experiments.figure import Claim, Figure, Panel

FIGURE = Figure(
    number="2.3",
    title="PPO, disturbed",
    thesis="1 % arbitrary actions hardly matter to PPO; slightly, at the beginning, where actions are continuous.",
    panels=(
        Panel("Lunar Lander, continuous", disturbed(CONTINUOUS_LANDER[0], 600, PPO)),
        Panel("Lunar Lander", disturbed(LANDER[0], 600, PPO)),
    ),
    claims=(
        Claim("Lunar Lander, continuous", "own actions", "1% arbitrary actions", same=True),
        Claim("Lunar Lander", "own actions", "1% arbitrary actions", same=True),
    ),
    remark=(
        "Ours hardly bears out that PPO notices less than Policy Gradient does: on discrete Lunar Lander it loses "
        "65 over the last fifth (not significant with four runs), Policy Gradient 45 (figure 2.2)."
    ),
)
