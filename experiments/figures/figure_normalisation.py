"""What `normalize_observations` costs where observations have a good scale, and brings where they have none (docs/adr/0013).

Each task is played as it is, and told in units a thousandth as large with a zero far away, as a client's may be: x * 1000 + 3000.
"""

from typing import Any

from benchmarks.histories import DQN, SAC
from experiments.curves import SWINGING_PPO
from experiments.figure import Claim, Figure, Panel
from experiments.in_process import InProcess

OFF, ON, OFF_FAR, ON_FAR = "off", "on", "off, x1000 + 3000", "on, x1000 + 3000"
TD3 = SAC | {"action_noise": "normal 0.1"}  # the noise of the catalogue
FAR = {"scale": 1000.0, "shift": 3000.0}
CART_POLE, ACROBOT, PENDULUM, LANDER = "CartPole-v1", "Acrobot-v1", "Pendulum-v1", "LunarLander-v3"


def panel(
    algorithm: str, environment: str, episodes: int, parameters: dict[str, Any] | None = None, runs: int = 4
) -> Panel:
    """On and off, in both units. No parameters: the defaults of the catalogue."""

    def curve(on: bool, **units: float) -> InProcess:
        given = (parameters or {}) | ({"normalize_observations": True} if on else {})
        return InProcess(environment, episodes, algorithm, given, **units)  # type: ignore[arg-type]

    curves = {OFF: curve(False), ON: curve(True), OFF_FAR: curve(False, **FAR), ON_FAR: curve(True, **FAR)}
    return Panel(f"{algorithm}, {environment}", curves, window=20, runs=runs)


PANELS = (
    panel("PPO", CART_POLE, 300),
    panel("PPO", ACROBOT, 150),
    panel("PPO", PENDULUM, 150, SWINGING_PPO["parameters"]),
    panel("PPO", LANDER, 300),
    panel("A2C", CART_POLE, 300),
    panel("A2C", ACROBOT, 100),
    panel("PolicyGradient", CART_POLE, 150),
    panel("PolicyGradient", ACROBOT, 60),
    panel("DQN", CART_POLE, 250, DQN, runs=12),
    panel("DQN", ACROBOT, 60, DQN),
    panel("SAC", PENDULUM, 40, SAC, runs=2),
    panel("TD3", PENDULUM, 40, TD3, runs=2),
)
FIGURE = Figure(
    number="normalisation",
    title="Observations of a good scale and of none, normalised or not",
    said_by="ADR 0008",
    thesis="with observations of any scale, Policy Gradient and PPO need it; what it costs elsewhere was not measured.",
    panels=PANELS,
    claims=(
        *(Claim(panel.title, ON, OFF, same=True) for panel in PANELS),
        *(Claim(panel.title, ON_FAR, OFF_FAR) for panel in PANELS),
    ),
)
