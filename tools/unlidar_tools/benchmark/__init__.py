"""Scenes x seeds x methods -> one table, with the published figures beside it."""

from unlidar_tools.benchmark.job import Job, Result
from unlidar_tools.benchmark.report import write_report
from unlidar_tools.benchmark.run import run_jobs
from unlidar_tools.benchmark.scenes import SceneSeed, find_scenes, simulated_scenes
from unlidar_tools.benchmark.summary import summarise
from unlidar_tools.benchmark.variants import Variant, ablation, methods, variant

__all__ = [
    "Job",
    "Result",
    "SceneSeed",
    "Variant",
    "ablation",
    "find_scenes",
    "methods",
    "run_jobs",
    "simulated_scenes",
    "summarise",
    "variant",
    "write_report",
]
