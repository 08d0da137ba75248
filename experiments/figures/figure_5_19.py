"""Figure 5.19, the platform's own: executions that advise each other, through the real server with real clients.

Beside it the same teams in one process (experiments/lockstep), which cost a tenth: there for longer, and with the other mixing.
"""

from dataclasses import replace
from typing import Any

from experiments.figure import Claim, Figure, Panel
from experiments.lockstep.task import InLockstep
from experiments.over_http import OverHTTP

LANDER = "LunarLander-v3"
EPISODES_SERVED, EPISODES = 400, 600
UNTIL_GOOD = {1: 2000, 4: 1200}  # episodes until the mean of 200
SERVER = "Lunar Lander, through the server, settings of the RL Zoo"
PROCESS = "Lunar Lander, in one process"
TUNED = "Lunar Lander, in one process, settings of the RL Zoo"
BEST = "Lunar Lander, in one process, ten epochs"
# rl-baselines3-zoo, hyperparams/ppo.yml, LunarLander-v3; there with 16 environments, here with one.
ZOO: dict[str, Any] = {"n_steps": 1024, "n_epochs": 4, "gamma": 0.999, "gae_lambda": 0.98, "ent_coef": 0.01}
TEN_EPOCHS = ZOO | {"n_epochs": 10}  # as in SB3's defaults: faster than four, alone as well
# Of ADR 0016: updates are frequent, and each goes far, for what four executions have learned is averaged after each.
QUICK = TEN_EPOCHS | {"n_steps": 512, "learning_rate": 0.001}
EPISODES_QUICK = {1: 1200, 2: 600, 4: 600}
EPISODES_QUICK_SERVED = {1: 800, 2: 400, 4: 400}
SERVER_QUICK = "Lunar Lander, through the server, quick updates"
AVERAGING = "Lunar Lander, in one process, quick updates"
EPISODES_BEST = {1: 1200, 4: 900}
ALONE, TWO, FOUR = "1 execution", "2 executions, intersection", "4 executions, intersection"
TWO_MEAN, FOUR_MEAN = "2 executions, geometric mean of all", "4 executions, geometric mean of all"
TWO_AVERAGING, FOUR_AVERAGING = (f"{n} executions, intersection and averaging" for n in (2, 4))
THESIS = ("intersection", "random")  # its own method; the learning correction is on by default
POOLED = ("geometric", "all")  # docs/adr/0006
CURVES: dict[str, tuple[int, tuple[str, str]]] = {
    ALONE: (1, THESIS),
    FOUR: (4, THESIS),
    TWO: (2, THESIS),
    FOUR_MEAN: (4, POOLED),
    TWO_MEAN: (2, POOLED),
}


def over_http(clients: int, how: tuple[str, str]) -> OverHTTP:
    """A client for each execution; the settings with which the gain lasts."""
    agent: dict[str, Any] = dict(zip(("advice", "advisors"), how, strict=True))
    return OverHTTP(LANDER, EPISODES_SERVED, clients, parameters=ZOO, agent=agent)


def in_lockstep(clients: int, how: tuple[str, str]) -> InLockstep:
    """The same without a server."""
    agent: dict[str, Any] = dict(zip(("advice_method", "advisors"), how, strict=True))
    return InLockstep(LANDER, EPISODES, clients, agent=agent)


def tuned(clients: int, how: tuple[str, str]) -> InLockstep:
    """With the settings of the RL Zoo, and for longer."""
    return replace(in_lockstep(clients, how), episodes=UNTIL_GOOD[clients], parameters=ZOO)


def best(clients: int, how: tuple[str, str]) -> InLockstep:
    """With better ones."""
    return replace(in_lockstep(clients, how), episodes=EPISODES_BEST[clients], parameters=TEN_EPOCHS)


def quick(clients: int, averaging: bool) -> InLockstep:
    """With quick updates; `averaging` what the executions learn."""
    agent = {"averaging": True} if averaging else {}
    task = replace(in_lockstep(clients, THESIS), episodes=EPISODES_QUICK[clients], parameters=QUICK)
    return replace(task, agent=task.agent | agent)


def quick_over_http(clients: int, averaging: bool) -> OverHTTP:
    """The same through the server."""
    task = replace(over_http(clients, THESIS), episodes=EPISODES_QUICK_SERVED[clients])
    return replace(task, parameters=QUICK, averaging=averaging)


REMARK = (
    "Through the server, each client has an execution of its own, which hears one peer at each step, drawn at random, "
    "whether there is one or there are three: with advice alone two gain as much as four, and half as many episodes "
    "to a mean of 200 are not reached: with the settings of the RL Zoo the mean of all eight runs (50 episodes each) "
    "is there at episode 1684 with one execution and at 1159 with four (0.69 times as many), with ten epochs at 971 "
    "and 694 (0.71). Other ways of mixing bring no more (docs/adr/0006): each of four executions learns from its own "
    "steps alone. When they average what they learn as well (docs/adr/0016), and update often and far, four are at "
    "100 at episode 225 and at 200 at episode 379, and 238 at last. One execution with the same settings is at 100 at "
    "545 (0.41), and does not come to 200 within 1200; with ten epochs, which suit it better, at 971 (0.39). Two are "
    "between: at 100 at 321, at 200 at 577; four stay above two, and two above one. Four with advice alone, and these "
    "settings, are at 100 at 272, and not at 200 within 600 (192 at last). Through the server four that average are "
    "at 100 at episode 224 and at 200 at 365, and have 218 over the last 50 of 400. One is at 100 at 422, and within "
    "its 800 episodes the mean of all eight runs is never at 200 (183 over its best 50). Of 2000 resamples of the "
    "runs 88 % have four at 200 in at most half of what one takes. Two are between, as in one process: over 200 to "
    "400 they are 76 below four (p < .001) and 46 above one (p = .06), at 100 at episode 326, and at 149 over the "
    "last 50 of 400. Single runs cross 200 earlier and fall back: six of eight of one, after 403 to 694 episodes; six "
    "of eight of four, after 336 to 391, and two are close at 400. These settings were chosen by some ten looks at "
    "two teams with other seeds. In one process all executions of a team update at once, and take the mean of their "
    "weights; through the server each updates when it has its steps, and takes over what the others have changed."
)
FIGURE = Figure(
    number="5.19",
    title="PPO, executions that advise each other",
    thesis="four executions stay on top of two, and two of one; the gain is largest between episodes 200 and 400.",
    panels=(
        Panel(SERVER, {name: over_http(*CURVES[name]) for name in (ALONE, FOUR, TWO)}, goal=200),
        Panel(PROCESS, {name: in_lockstep(*how) for name, how in CURVES.items()}, goal=200),
        Panel(TUNED, {name: tuned(*CURVES[name]) for name in (ALONE, FOUR)}, goal=200),
        Panel(BEST, {name: best(*CURVES[name]) for name in (ALONE, FOUR)}, goal=200),
        Panel(
            AVERAGING,
            {
                ALONE: quick(1, False),
                FOUR: quick(4, False),
                FOUR_AVERAGING: quick(4, True),
                TWO_AVERAGING: quick(2, True),
            },
            goal=200,
        ),
        Panel(
            SERVER_QUICK,
            {
                ALONE: quick_over_http(1, False),
                FOUR_AVERAGING: quick_over_http(4, True),
                TWO_AVERAGING: quick_over_http(2, True),
            },
            goal=200,
        ),
    ),
    claims=(
        *(Claim(panel, FOUR, ALONE, 200, 400) for panel in (SERVER, PROCESS)),
        *(Claim(panel, FOUR, TWO, 200, 400) for panel in (SERVER, PROCESS)),
        *(Claim(panel, TWO, ALONE, 200, 400) for panel in (SERVER, PROCESS)),
        Claim(PROCESS, FOUR, ALONE, 400, 600),
        Claim(PROCESS, FOUR_MEAN, ALONE, 200, 400),
        Claim(PROCESS, FOUR_MEAN, ALONE, 400, 600),
        Claim(PROCESS, FOUR_MEAN, FOUR, 200, 400),
        Claim(PROCESS, FOUR_MEAN, TWO_MEAN, 200, 400),
        Claim(PROCESS, TWO_MEAN, ALONE, 200, 400),
        *(Claim(TUNED, FOUR, ALONE, first, first + 200) for first in (200, 400, 600, 800, 1000)),
        *(Claim(BEST, FOUR, ALONE, first, first + 200) for first in (200, 400, 600)),
        Claim(BEST, FOUR, ALONE, 800, 900),
        *(Claim(AVERAGING, FOUR_AVERAGING, worse, 200, 400) for worse in (FOUR, TWO_AVERAGING, ALONE)),
        *(Claim(AVERAGING, FOUR_AVERAGING, worse, 400, 600) for worse in (FOUR, TWO_AVERAGING, ALONE)),
        *(Claim(AVERAGING, TWO_AVERAGING, ALONE, first, first + 200) for first in (200, 400)),
        *(Claim(SERVER_QUICK, FOUR_AVERAGING, worse, 200, 400) for worse in (TWO_AVERAGING, ALONE)),
        Claim(SERVER_QUICK, TWO_AVERAGING, ALONE, 200, 400),
    ),
    runs=8,
    remark=REMARK,
)
