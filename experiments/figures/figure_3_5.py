"""Figure 3.5: Policy Intersection and Policy Union. (The thesis does not say on which task; Lunar Lander is its usual one.)"""

from experiments.curves import ALONE, LANDER, POLICY_GRADIENT, advised
from experiments.figure import Claim, Figure, Panel
from experiments.in_process import InProcess

PANEL, INTERSECTION, UNION = "Lunar Lander", "Policy Intersection", "Policy Union"
FIGURE = Figure(
    number="3.5",
    title="Policy Gradient, advised by intersection and by union",
    thesis="with either the learning correction; intersection is better, since union explores too much.",
    panels=(
        Panel(
            PANEL,
            {
                ALONE: InProcess(LANDER[0], 500, **POLICY_GRADIENT),
                UNION: advised(LANDER, 500, POLICY_GRADIENT, advice_method="union"),
                INTERSECTION: advised(LANDER, 500, POLICY_GRADIENT, advice_method="intersection"),
            },
            goal=200,
        ),
    ),
    claims=(Claim(PANEL, INTERSECTION, UNION),),
)
