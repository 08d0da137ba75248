"""Figures that are known of some algorithms, and ours: in process, a run per seed, exploring as they learn."""

from typing import Any

from benchmarks.histories import SAC
from experiments.advisors import LANDER, OURS
from experiments.figure import Figure, Level, Panel
from experiments.in_process import InProcess

POLE, SWING = "Cart Pole", "Pendulum"
MOON, CONTINUOUS, BDPI_MOON, ROOMS = (
    "Lunar Lander",
    "Lunar Lander, continuous",
    "Lunar Lander, BDPI",
    "Five Rooms 29x27",
)
PPO, SAC_, BDPI = "PPO", "SAC", "BDPI"
ZOO = "rl-baselines3-zoo: {} by a trained {}, not exploring"
AUTHORS = "its authors"
BDPI_LANDER: dict[str, Any] = {"n_critics": 16, "net_arch": "32", "fit_steps": 20, "train_freq": 8}
BDPI_ROOMS: dict[str, Any] = {"net_arch": "64", "train_freq": 4}


def panel(title: str, name: str, task: InProcess, runs: int = 4, window: int = 100) -> Panel:
    """A task and its only learner."""
    return Panel(title, {name: task}, window, runs=runs)


FIGURE = Figure(
    number="known",
    title="Known figures",
    said_by="Known",
    thesis="Cart Pole 475 (its environment's own mark) to 500, Lunar Lander over 200 (its mark), Pendulum about -150; of BDPI, "
    "from its authors, Lunar Lander about 150 by 200 episodes and 200 by 1000, Five Rooms about 45 of 47 by 200.",
    panels=(
        panel(POLE, PPO, InProcess("CartPole-v1", 600, "PPO")),
        panel(SWING, SAC_, InProcess("Pendulum-v1", 40, "SAC", SAC), runs=2, window=10),
        panel(MOON, PPO, InProcess("LunarLander-v3", 1500, "PPO", LANDER), runs=2),
        panel(CONTINUOUS, PPO, InProcess("LunarLanderContinuous-v3", 1500, "PPO", LANDER), runs=2),
        panel(BDPI_MOON, BDPI, InProcess("LunarLander-v3", 1000, "BDPI", BDPI_LANDER), runs=2),
        panel(ROOMS, BDPI, InProcess(f"{OURS}FiveRooms-29x27-v0", 200, "BDPI", BDPI_ROOMS), runs=2, window=20),
    ),
    claims=(),
    levels=(
        Level(POLE, PPO, 475, "Gymnasium's mark of a solved task"),
        Level(SWING, SAC_, -157, ZOO.format("-157", "SAC"), over=10),
        Level(MOON, PPO, 200, "Gymnasium's mark of a solved task"),
        Level(CONTINUOUS, PPO, 200, "Gymnasium's mark of a solved task"),
        Level(BDPI_MOON, BDPI, 150, AUTHORS, by=200, over=50),
        Level(BDPI_MOON, BDPI, 200, AUTHORS),
        Level(ROOMS, BDPI, 45, AUTHORS, over=50),
    ),
)
