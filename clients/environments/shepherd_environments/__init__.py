"""Gymnasium environments to train Shepherd's agents on. Importing this package registers them."""

from gymnasium import register

from shepherd_environments.thermostat import Person, SimulatedPerson, Thermostat

__all__ = ["Person", "SimulatedPerson", "Thermostat"]

register("Thermostat-v0", entry_point="shepherd_environments.thermostat:Thermostat", max_episode_steps=288)
