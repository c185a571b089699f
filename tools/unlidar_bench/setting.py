"""How much is measured, and where the programs are."""

from dataclasses import dataclass
from pathlib import Path

from unlidar.errors import InputError


@dataclass(frozen=True)
class Setting:
    """Of one run of the bench."""

    build: Path  # has unlidar_track and src/bench/*
    work: Path  # for recordings and results
    rounds: int = 5
    least_s: float = 0.3  # that each micro-benchmark runs in a round
    superimposed_s: float = 0.5  # of a recording, for the clustering
    measurements: tuple[int, ...] = (30, 300, 3000)  # of the flights that splines are fitted to
    scenes: tuple[str, ...] = ("near", "mid", "hover", "fast", "two", "empty_sky")
    seeds: tuple[int, ...] = (1, 2, 3)
    minutes: tuple[float, ...] = (1, 2, 5, 10)  # of the recordings that are tracked as a whole
    turn_s: float = 60.0  # what is simulated of a long recording; it is played again and again
    live_minutes: float = 10.0  # with a Mid-360 and an Avia
    dense_minutes: float = 1.0
    dense_turn_s: float = 20.0
    live_rounds: int = 3
    flight_s: float = 10.0  # of the flights whose returns are judged
    swarms: tuple[int, ...] = (1, 10, 50)  # drones at once
    swarm_s: float = 20.0

    @property
    def program(self) -> Path:
        """Ours."""
        return self.tool("unlidar_track")

    def bench(self, name: str) -> Path:
        """A program of src/bench."""
        return self.tool(f"src/bench/{name}")

    def tool(self, name: str) -> Path:
        """Throws InputError unless it is built."""
        path = self.build / name
        if not path.is_file():
            raise InputError(f"{path}: is not built, tools/bench.sh builds it")
        return path


QUICK = {
    "rounds": 2,
    "least_s": 0.01,
    "superimposed_s": 0.2,
    "measurements": (30, 100),
    "scenes": ("near",),
    "seeds": (1,),
    "minutes": (0.1, 0.2),
    "turn_s": 6.0,
    "live_minutes": 0.2,
    "dense_minutes": 0.05,
    "dense_turn_s": 1.0,
    "live_rounds": 1,
    "flight_s": 1.0,
    "swarms": (1, 3),
    "swarm_s": 4.0,
}
