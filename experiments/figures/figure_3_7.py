"""Figure 3.7: PPO and the learning correction, continuous actions, mixed by the mean (eq. 3.5)."""

from experiments.curves import (
    ACROBOT,
    CONTINUOUS_LANDER,
    PPO,
    SWING,
    SWINGING_PPO,
    WITH,
    WITHOUT,
    with_and_without_correction,
)
from experiments.figure import Claim, Figure, Panel

FIGURE = Figure(
    number="3.7",
    title="PPO with continuous actions, advised, with and without the learning correction",
    thesis="Pendulum and Lunar Lander are not learned without it; on Acrobot it costs sample-efficiency.",
    panels=(
        Panel("Pendulum", with_and_without_correction(SWING, 400, SWINGING_PPO), goal=-250),
        Panel("Lunar Lander, continuous", with_and_without_correction(CONTINUOUS_LANDER, 600, PPO), goal=200),
        Panel("Acrobot, continuous", with_and_without_correction(ACROBOT, 300, PPO), 20, goal=-100),
    ),
    claims=(
        Claim("Pendulum", WITH, WITHOUT),
        Claim("Lunar Lander, continuous", WITH, WITHOUT),
        Claim("Acrobot, continuous", WITHOUT, WITH),
    ),
)
