"""Synthetic flights with exact truth: rays are cast into a scene, nothing is drawn from data."""

from unlidar.simulate.recording import Simulation, simulate, write_recording
from unlidar.simulate.scenario import Scenario, load_scenario

__all__ = ["Scenario", "Simulation", "load_scenario", "simulate", "write_recording"]
