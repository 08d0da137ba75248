"""The algorithms that Shepherd offers, one row each. Classes are dotted strings, imported on first use, so that the web
process can list algorithms without loading torch.

`family` names the module beside this one that teaches executions to act with the algorithm and to replay its records.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

ACTOR_CRITIC = ("MlpPolicy", "CnnPolicy", "MultiInputPolicy")
RECURRENT = ("MlpLstmPolicy", "CnnLstmPolicy", "MultiInputLstmPolicy")
LINEAR = ("LinearPolicy", "MlpPolicy")
FLAT = ("MlpPolicy", "MultiInputPolicy")
OURS = "agents_app.algorithms"


@dataclass(frozen=True)
class Row:
    """One algorithm: where its class is, how it acts, on what it can act."""

    name: str
    path: str  # module:class
    family: str  # on_policy, recurrent, maskable, off_policy, direct
    discrete: bool
    continuous: bool
    advice: bool = False
    policies: tuple[str, ...] = ACTOR_CRITIC

    @property
    def corrects(self) -> bool:
        """Whether its learning rule can know of the advice. The others off the policy need not (actor_advisor.md section 2)."""
        return self.advice and (self.family == "on_policy" or self.name == "BDPI")

    @property
    def averages(self) -> bool:
        """Whether its executions can average what they learn: it updates after a rollout, not at each step."""
        return self.family in ("on_policy", "recurrent", "maskable")

    @property
    def masks(self) -> bool:
        """Whether an agent can have some of n actions forbidden at a step."""
        return self.discrete and self.family in ("on_policy", "off_policy", "maskable")

    @property
    def scores(self) -> bool:
        """Whether it can score actions by their features: its networks end in a layer per action. Those of BDPI are stacked."""
        return self.masks and self.name != "BDPI"

    @property
    def normalises(self) -> bool:
        """Whether its observations can be normalised. CrossQ does so itself; BDPI, ARS and RecurrentPPO have other networks."""
        return self.family in ("on_policy", "maskable", "off_policy") and self.name not in ("CrossQ", "BDPI")

    def load(self) -> type[Any]:
        """The algorithm's own class."""
        module, name = self.path.split(":")
        return getattr(import_module(module), name)


ROWS = (
    Row("PPO", "stable_baselines3:PPO", "on_policy", discrete=True, continuous=True, advice=True),
    Row("A2C", "stable_baselines3:A2C", "on_policy", discrete=True, continuous=True, advice=True),
    Row("DQN", "stable_baselines3:DQN", "off_policy", discrete=True, continuous=False, advice=True),
    Row("DDPG", "stable_baselines3:DDPG", "off_policy", discrete=False, continuous=True, advice=True),
    Row("TD3", "stable_baselines3:TD3", "off_policy", discrete=False, continuous=True, advice=True),
    Row("SAC", "stable_baselines3:SAC", "off_policy", discrete=False, continuous=True, advice=True),
    Row("TRPO", "sb3_contrib:TRPO", "on_policy", discrete=True, continuous=True, advice=True),
    Row("QR-DQN", "sb3_contrib:QRDQN", "off_policy", discrete=True, continuous=False, advice=True),
    Row("TQC", "sb3_contrib:TQC", "off_policy", discrete=False, continuous=True, advice=True),
    Row("CrossQ", "sb3_contrib:CrossQ", "off_policy", discrete=False, continuous=True, policies=("MlpPolicy",)),
    Row("ARS", "sb3_contrib:ARS", "direct", discrete=True, continuous=True, policies=LINEAR),
    Row("RecurrentPPO", "sb3_contrib:RecurrentPPO", "recurrent", discrete=True, continuous=True, policies=RECURRENT),
    Row("MaskablePPO", "sb3_contrib:MaskablePPO", "maskable", discrete=True, continuous=False),
    Row("BDPI", f"{OURS}.bdpi:BDPI", "off_policy", discrete=True, continuous=False, advice=True, policies=FLAT),
    Row(
        "PolicyGradient",
        f"{OURS}.policy_gradient:PolicyGradient",
        "on_policy",
        discrete=True,
        continuous=True,
        advice=True,
    ),
)
BY_NAME = {row.name: row for row in ROWS}


def get_row(name: str) -> Row:
    """The row of an algorithm. Raises KeyError when there is none."""
    return BY_NAME[name]
