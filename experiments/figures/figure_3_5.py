"""Figure 3.5: Policy Intersection and Policy Union. And the same advisor as a reward.

The thesis does not say on which task; Lunar Lander is its usual one.
"""

from experiments.curves import ALONE, LANDER, POLICY_GRADIENT, advised
from experiments.figure import Claim, Figure, Panel
from experiments.in_process import InProcess

PANEL, INTERSECTION, UNION, SHAPED = "Lunar Lander", "Policy Intersection", "Policy Union", "reward shaping"
FIGURE = Figure(
    number="3.5",
    title="Policy Gradient, advised by intersection, by union, and by a reward",
    thesis="with either the learning correction; intersection is better, since union explores too much. (5.2.1: an advisor that "
    "rewards helps late, one that is followed at once.)",
    panels=(
        Panel(
            PANEL,
            {
                ALONE: InProcess(LANDER[0], 500, **POLICY_GRADIENT),
                UNION: advised(LANDER, 500, POLICY_GRADIENT, advice_method="union"),
                SHAPED: advised(LANDER, 500, POLICY_GRADIENT, advice_method="shaping"),
                INTERSECTION: advised(LANDER, 500, POLICY_GRADIENT, advice_method="intersection"),
            },
            goal=200,
        ),
    ),
    claims=(*(Claim(PANEL, INTERSECTION, other) for other in (UNION, SHAPED)), Claim(PANEL, SHAPED, ALONE)),
)
