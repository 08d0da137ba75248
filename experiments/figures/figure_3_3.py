"""Figure 3.3: Policy Gradient needs the learning correction to use even a near-perfect advisor."""

from experiments.curves import (
    ALONE,
    CART_POLE,
    LANDER,
    POLICY_GRADIENT,
    SMALL_ROOMS,
    WITH,
    WITHOUT,
    with_and_without_correction,
)
from experiments.figure import Claim, Figure, Panel

FIGURE = Figure(
    number="3.3",
    title="Policy Gradient, advised, with and without the learning correction",
    thesis="with the correction it uses a good advisor on Lunar Lander and Five Rooms, without it collapses; on Cart Pole both "
    "curves overlap.",
    panels=(
        Panel("Lunar Lander", with_and_without_correction(LANDER, 600, POLICY_GRADIENT), goal=200),
        Panel("Five Rooms 14x12", with_and_without_correction(SMALL_ROOMS, 400, POLICY_GRADIENT), 20, goal=70),
        Panel("Cart Pole", with_and_without_correction(CART_POLE, 400, POLICY_GRADIENT), 20, goal=195),
    ),
    claims=(
        Claim("Lunar Lander", WITH, WITHOUT),
        Claim("Lunar Lander", WITH, ALONE),
        Claim("Five Rooms 14x12", WITH, WITHOUT),
        Claim("Cart Pole", WITH, WITHOUT, same=True),
    ),
    remark=(
        "On Lunar Lander with the correction the four runs have 235, 243, 198 and 209 over the last hundred, "
        "where the advisor has 232: in between a run may lose some forty, and in 2000 episodes it comes back "
        "(figure known). On Cart Pole both have 200 from the first episode on, the most that there is."
    ),
)
