"""Trajectories fitted to the same measurements of the same flights, whose truth is known."""

import time
from collections.abc import Callable

import numpy as np
from scipy.interpolate import UnivariateSpline, make_smoothing_spline
from unlidar.simulate import Simulation, load_scenario

from unlidar_bench.paired import by_turns, median, ratio
from unlidar_bench.processes import cpu_ms, google_benchmark
from unlidar_bench.setting import Setting
from unlidar_bench.tables import Column, digits, metres, times, whole

COLUMNS = (
    Column("measurements", "measurements", whole),
    Column("outliers", "outliers"),
    Column("by", "by"),
    Column("ms", "ms", digits),
    Column("times ours", "times", times),
    Column("RMSE, m", "rmse", metres),
)
_OUTLIERS = 0.1
_OUTLIER_M = 3.0
_SIGMA_M = 0.1
_OURS, _GIVEN = "ours", "ours, agility given"

Flight = np.ndarray  # (N, 5) t x y z sigma
Fit = Callable[[np.ndarray], np.ndarray]


def measure(setting: Setting) -> list[dict]:
    """Flights of many and few measurements, with and without outliers."""
    simulation = Simulation(load_scenario("mid"), 1)
    folder = setting.work / "flights"
    folder.mkdir(parents=True, exist_ok=True)
    flights = {}
    for count in setting.measurements:
        for outliers in (0.0, _OUTLIERS):
            path = folder / f"{count}_{outliers:g}"
            flights[path] = _flight(simulation, count, outliers)
            np.savetxt(path, flights[path], fmt="%.9f")
    program = setting.bench("trajectory_bench")

    def ours() -> dict:
        found = google_benchmark(program, list(flights), setting.least_s)
        return {name: cpu_ms(one) for name, one in found.items()}

    def scipys() -> dict:
        return {
            f"{path}/{name}": _timed(fit, flight)
            for path, flight in flights.items()
            for name, fit in _SCIPY.items()
        }

    turns = by_turns(setting.rounds, {"ours": ours, "scipy": scipys})
    rows = []
    for path, flight in flights.items():
        reference = [one[f"{path}/fit"] for one in turns["ours"]]
        fitted = np.loadtxt(f"{path}.fitted")
        truth = simulation.drones[0].centres(fitted[:, 0])
        found = {
            _OURS: (reference, fitted[:, 1:]),
            _GIVEN: ([one[f"{path}/refit"] for one in turns["ours"]], None),
        }
        for name, fit in _SCIPY.items():
            found[name] = ([o[f"{path}/{name}"] for o in turns["scipy"]], fit(flight)(fitted[:, 0]))
        rows += [
            {
                "measurements": len(flight),
                "outliers": "10 %" if path.name.endswith("_0.1") else "none",
                "by": name,
                "ms": median(spent),
                "times": ratio(spent, reference),
                "rmse": None if xyz_m is None else _rmse(xyz_m - truth),
            }
            for name, (spent, xyz_m) in found.items()
        ]
    return rows


def _flight(simulation: Simulation, count: int, outliers: float) -> Flight:
    rng = np.random.default_rng(1)
    time_s = np.sort(rng.uniform(0.0, simulation.scenario.duration_s, count))
    xyz_m = simulation.drones[0].centres(time_s) + rng.normal(0, _SIGMA_M, (count, 3))
    wrong = rng.random(count) < outliers
    xyz_m[wrong] += rng.normal(0, _OUTLIER_M, (int(wrong.sum()), 3))
    return np.column_stack([time_s, xyz_m, np.full(count, _SIGMA_M)])


def _smoothing_spline(flight: Flight) -> Fit:
    """Its smoothness by generalised cross-validation."""
    return make_smoothing_spline(flight[:, 0], flight[:, 1:4], w=flight[:, 4] ** -2)


def _univariate_spline(flight: Flight) -> Fit:
    """The smoothest whose residuals are as large as the sigmas say."""
    fits = [UnivariateSpline(flight[:, 0], x, w=1 / flight[:, 4]) for x in flight[:, 1:4].T]
    return lambda time_s: np.stack([fit(time_s) for fit in fits], axis=1)


_SCIPY: dict[str, Callable[[Flight], Fit]] = {
    "scipy, `make_smoothing_spline`": _smoothing_spline,
    "scipy, `UnivariateSpline`": _univariate_spline,
}


def _timed(fit: Callable[[Flight], Fit], flight: Flight) -> float:
    begin = time.process_time()
    fit(flight)
    return 1e3 * (time.process_time() - begin)


def _rmse(error_m: np.ndarray) -> float:
    return float(np.sqrt((error_m**2).sum(axis=1).mean()))
