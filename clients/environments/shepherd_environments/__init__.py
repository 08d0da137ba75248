"""Gymnasium environments to train Shepherd's agents on. Importing this package registers them."""

from gymnasium import register

from shepherd_environments.acrobot import ContinuousAcrobot
from shepherd_environments.five_rooms import SIZES, FiveRooms
from shepherd_environments.thermostat import Person, SimulatedPerson, Thermostat

__all__ = ["ContinuousAcrobot", "FiveRooms", "Person", "SimulatedPerson", "Thermostat"]

register("Thermostat-v0", entry_point="shepherd_environments.thermostat:Thermostat", max_episode_steps=288)
register("ContinuousAcrobot-v0", entry_point="shepherd_environments.acrobot:ContinuousAcrobot", max_episode_steps=500)
for name, rewards in (("FiveRooms", "dear"), ("FiveRoomsCheap", "cheap")):
    for size in SIZES:
        register(
            f"{name}-{size}-v0",
            entry_point="shepherd_environments.five_rooms:FiveRooms",
            max_episode_steps=500,
            kwargs={"size": size, "rewards": rewards},
        )
