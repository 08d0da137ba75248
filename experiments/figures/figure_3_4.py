"""Figure 3.4: PPO and the learning correction, discrete actions."""

from experiments.curves import CART_POLE, LANDER, LARGE_ROOMS, PPO, WITH, WITHOUT, with_and_without_correction
from experiments.figure import Claim, Figure, Panel

FIGURE = Figure(
    number="3.4",
    title="PPO, advised, with and without the learning correction",
    thesis="better with it on Five Rooms, which is hard to explore; worse on Lunar Lander and Cart Pole.",
    panels=(
        Panel("Lunar Lander", with_and_without_correction(LANDER, 600, PPO), goal=200),
        Panel("Cart Pole", with_and_without_correction(CART_POLE, 400, PPO), 20, goal=195),
        Panel("Five Rooms 23x21", with_and_without_correction(LARGE_ROOMS, 400, PPO), 20, goal=50),
    ),
    claims=(
        Claim("Lunar Lander", WITHOUT, WITH),
        Claim("Cart Pole", WITHOUT, WITH),
        Claim("Five Rooms 23x21", WITH, WITHOUT),
    ),
    remark=(
        "On Lunar Lander ours is the reverse of the thesis: without the correction the learner, whose ratio is of "
        "probabilities that it did not act by, has -88 over the last fifth, with it 136. On Cart Pole both have "
        "200 from the first episode on, the most that there is, so that nothing can be told. Of its PPO the "
        "thesis gives no settings; ours are Stable-Baselines3's defaults, on version 3 of Lunar Lander."
    ),
)
