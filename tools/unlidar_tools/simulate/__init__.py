"""Synthetic flights with exact truth: rays are cast into a scene, nothing is drawn from data."""

from unlidar_tools.simulate.recording import Simulation, simulate
from unlidar_tools.simulate.scenario import Scenario, load_scenario

__all__ = ["Scenario", "Simulation", "load_scenario", "simulate"]
