"""Figure 2.2: one action of a hundred that is not its own stops Policy Gradient from learning Lunar Lander."""

from experiments.curves import LANDER, POLICY_GRADIENT, disturbed
from experiments.figure import Claim, Figure, Panel

PANEL = "Lunar Lander"
FIGURE = Figure(
    number="2.2",
    title="Policy Gradient, disturbed",
    thesis="1 % arbitrary actions stop Policy Gradient from learning Lunar Lander, which it learns in about 2000 episodes.",
    panels=(Panel(PANEL, disturbed(LANDER[0], 2000, POLICY_GRADIENT), window=100),),
    claims=(Claim(PANEL, "own actions", "1% arbitrary actions", first=1000),),
    remark=(
        "The learner is slowed, not stopped: over the last fifth the disturbed one has 144 where the other has "
        "190, and until about episode 900 it is not behind. The thesis says nothing of its optimiser, its "
        "baseline or its batches; ours are in curves.py, and stand more."
    ),
)
