"""Scenes x seeds x methods -> one table, with the published figures beside it."""

from unlidar.benchmark.job import Job, Result
from unlidar.benchmark.report import write_report
from unlidar.benchmark.run import run_jobs
from unlidar.benchmark.scenes import SceneSeed, find_scenes, simulated_scenes
from unlidar.benchmark.summary import summarise
from unlidar.benchmark.variants import Variant, ablation, methods, variant

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
