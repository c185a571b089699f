"""Tracks of several stations that are one drone: laws of joining and of naming."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from unlidar.events.estimates import Estimate, covariance_intersection
from unlidar.events.fusion import Fusion

PERIOD_S = 0.1
SIGMA = np.array([0.1, 0.15, 0.3])


def circle(t: float, centre=(0.0, 0.0, 30.0), radius=20.0, turn=0.25, phase=0.0):
    """Position and velocity."""
    a = turn * t + phase
    position = np.array(centre) + radius * np.array([np.cos(a), np.sin(a), 0.0])
    return position, radius * turn * np.array([-np.sin(a), np.cos(a), 0.0])


class Station:
    """Sees drones with its own noise, a wrong survey and a wrong clock."""

    def __init__(self, name: str, seed: int, bias=(0.0, 0.0, 0.0), ahead_s=0.0, late_s=0.0):
        self.name, self.bias, self.ahead_s, self.late_s = name, np.array(bias), ahead_s, late_s
        self._random = np.random.default_rng(seed)

    def sees(self, t: float, **course) -> Estimate:
        position, velocity = circle(t + self.late_s, **course)
        noise = self._random.normal(size=3) * SIGMA
        stamp_ns = round((t + self.late_s + self.ahead_s) * 1e9)
        return Estimate(stamp_ns, position + self.bias + noise, velocity, np.diag(SIGMA**2))


def fly(fusion: Fusion, begin_s: float, end_s: float, seen: list) -> list[dict]:
    """(station, number, course) each at every period; identities by key after each of them."""
    told = []
    for step in range(round(begin_s / PERIOD_S), round(end_s / PERIOD_S)):
        now = {}
        for station, number, course in seen:
            key = (station.name, number)
            now[key] = fusion.take(key, station.sees(step * PERIOD_S, **course))
        told.append(now)
    return told


def trio() -> list[Station]:
    biases = ((0.2, -0.1, 0.1), (-0.2, 0.2, 0.0), (0.0, 0.1, -0.2))
    return [
        Station(name, i, bias, late_s=0.03 * i)
        for i, (name, bias) in enumerate(zip("abc", biases, strict=True))
    ]


def test_one_drone_of_three_stations_is_one_and_better_known_than_by_each() -> None:
    fusion, stations = Fusion(0.3), trio()
    fly(fusion, 0, 10, [(s, 1 + i, {}) for i, s in enumerate(stations)])
    (drone,) = fusion.fused()
    assert drone.members == (("a", 1), ("b", 2), ("c", 3))
    volume = np.linalg.det(drone.estimate.covariance_m2)
    assert volume <= np.prod(SIGMA**2) * 1.0001
    truth, velocity = circle(drone.estimate.stamp_ns * 1e-9)
    assert np.linalg.norm(drone.estimate.xyz_m - truth) < 1
    assert np.allclose(drone.estimate.velocity_mps, velocity, atol=0.2)


def test_it_stays_one_when_stations_drop_out_and_come_back() -> None:
    fusion, (a, b, c) = Fusion(0.3), trio()
    fly(fusion, 0, 5, [(a, 1, {}), (b, 1, {})])
    (drone,) = fusion.fused()
    fly(fusion, 5, 8, [(a, 1, {}), (b, 1, {}), (c, 4, {})])
    fusion.end(("a", 1))  # the station that had it first is killed
    fly(fusion, 8, 12, [(b, 1, {}), (c, 4, {})])
    assert [f.identity for f in fusion.fused()] == [drone.identity]
    fusion.end(("b", 1))
    fly(fusion, 12, 16, [(c, 4, {}), (a, 2, {})])  # the first is back, with a new number
    (last,) = fusion.fused()
    assert last.identity == drone.identity
    assert last.members == (("a", 2), ("c", 4))


@pytest.mark.parametrize("behind_s", [0.3, 1.5])
def test_a_station_heard_later_than_another_sees_the_same_drone(behind_s) -> None:
    """Their delays differ, or a network holds rows up; `b` was there first."""
    fusion, (a, b, _) = Fusion(0.3), trio()
    steps, behind = round(20 / PERIOD_S), round(behind_s / PERIOD_S)
    shown = set()
    for step in range(steps):
        rows = [(b, step)] + [(a, step + behind)] * (step > steps // 4)
        for station, at_step in rows:
            identity = fusion.take((station.name, 1), station.sees(at_step * PERIOD_S))
            if fusion.is_settled(identity):
                shown.add(identity)
    (drone,) = fusion.fused()
    assert len(drone.members) == 2
    assert shown == {drone.identity}


def test_two_drones_stay_two_however_the_rows_come() -> None:
    near = {"centre": (0.0, 0.0, 30.0)}, {"centre": (0.0, 0.0, 34.0)}
    for order in (1, -1):
        fusion, (a, b, _) = Fusion(0.3), trio()
        seen = [(a, 1, near[0]), (b, 7, near[0]), (a, 2, near[1]), (b, 5, near[1])][::order]
        fly(fusion, 0, 10, seen)
        assert sorted(f.members for f in fusion.fused()) == [
            (("a", 1), ("b", 7)),
            (("a", 2), ("b", 5)),
        ]


def test_drones_that_meet_keep_their_names() -> None:
    """They pass each other within a metre, in opposite directions."""
    fusion, (a, b, _) = Fusion(0.3), trio()
    courses = {"turn": 0.25}, {"turn": -0.25, "centre": (0.0, 0.0, 31.0), "phase": 2.5}
    seen = [(s, n + 1, course) for n, course in enumerate(courses) for s in (a, b)]
    told = fly(fusion, 0, 25, seen)
    settled = told[20]
    assert settled["a", 1] == settled["b", 1] != settled["a", 2] == settled["b", 2]
    assert all(now == settled for now in told[20:])


def test_drones_that_fly_side_by_side_for_long_keep_their_names() -> None:
    """So near that by their distances alone either could be either, after they were told apart."""
    fusion, (a, b, _) = Fusion(0.3), trio()

    def pair(gap_m: float) -> list:
        courses = {}, {"centre": (0.0, 0.0, 30.0 + gap_m)}
        return [(s, n + 1, course) for n, course in enumerate(courses) for s in (a, b)]

    settled = fly(fusion, 0, 5, pair(8.0))[-1]
    told = fly(fusion, 5, 30, pair(0.05))
    assert len(set(settled.values())) == 2
    assert all(now == settled for now in told)


def test_tracks_of_one_station_are_never_one() -> None:
    fusion, (a, b, _) = Fusion(0.3), trio()
    fly(fusion, 0, 5, [(a, 1, {}), (a, 2, {}), (b, 1, {})])
    for drone in fusion.fused():
        stations = [station for station, _ in drone.members]
        assert len(set(stations)) == len(stations)
    assert len(fusion.fused()) == 2


def test_a_pair_that_parts_becomes_two_and_the_old_name_goes_on() -> None:
    fusion, (a, b, _) = Fusion(0.3), trio()
    fly(fusion, 0, 5, [(a, 1, {}), (b, 1, {})])
    (drone,) = fusion.fused()
    fly(fusion, 5, 10, [(a, 1, {}), (b, 1, {"centre": (15.0, 0.0, 30.0)})])
    assert len(fusion.fused()) == 2
    assert drone.identity in [f.identity for f in fusion.fused()]


@pytest.mark.parametrize("ahead_s", [-0.2, -0.05, 0.0, 0.1])
def test_clocks_are_compared_apart_from_places(ahead_s) -> None:
    """A clock that is ahead by so much, and a survey that is wrong by half a metre."""
    fusion = Fusion(1.0)
    a = Station("a", 1, bias=(0.5, 0.0, 0.0))
    b = Station("b", 2, ahead_s=ahead_s)
    assert fusion.clock_offset_s("a", "b") is None
    fly(fusion, 0, 60, [(a, 1, {}), (b, 1, {})])
    assert fusion.clock_offset_s("b", "a") == pytest.approx(ahead_s, abs=0.01)
    assert fusion.clock_offset_s("a", "b") == pytest.approx(-ahead_s, abs=0.01)


def test_what_flies_straight_carries_no_information_on_clocks() -> None:
    fusion = Fusion(1.0)
    for step in range(100):
        for name in "ab":
            t = step * PERIOD_S
            xyz = np.array([5.0 * t, 0.0, 30.0])
            velocity = np.array([5.0, 0.0, 0.0])
            fusion.take((name, 1), Estimate(round(t * 1e9), xyz, velocity, 0.01 * np.eye(3)))
    assert len(fusion.fused()) == 1
    assert fusion.clock_offset_s("a", "b") is None


def test_rows_that_come_twice_or_late_change_nothing() -> None:
    fusion, (a, b, _) = Fusion(0.3), trio()
    fly(fusion, 0, 5, [(a, 1, {}), (b, 1, {})])
    before = fusion.fused()
    fusion.take(("a", 1), a.sees(2.0))
    after = fusion.fused()
    assert [f.members for f in after] == [f.members for f in before]
    assert np.array_equal(after[0].estimate.xyz_m, before[0].estimate.xyz_m)


def spd(seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(3, 3))
    return root @ root.T + 0.05 * np.eye(3)


@given(st.integers(0, 10**6), st.floats(-0.99, 0.99))
def test_covariance_intersection_is_never_too_sure(seed, correlation) -> None:
    """The claimed covariance bounds the true one for any correlation of the two errors."""
    one, two = spd(seed), spd(seed + 1)
    position, claimed, share = covariance_intersection(np.zeros(3), one, np.ones(3), two)
    assert 0 <= share <= 1
    first = claimed @ (share * np.linalg.inv(one))
    second = claimed @ ((1 - share) * np.linalg.inv(two))
    assert np.allclose(first + second, np.eye(3), atol=1e-8)
    assert np.allclose(position, second @ np.ones(3))
    cross = correlation * np.linalg.cholesky(one) @ np.linalg.cholesky(two).T
    true = first @ one @ first.T + second @ two @ second.T
    true += first @ cross @ second.T + second @ cross.T @ first.T
    assert np.linalg.eigvalsh(claimed - true).min() > -1e-8
    # And no worse than the better of the two.
    volume = np.linalg.det(claimed)
    assert volume <= min(np.linalg.det(one), np.linalg.det(two)) * (1 + 1e-9)


def test_covariance_intersection_takes_each_where_it_is_good() -> None:
    one, two = np.diag([0.01, 1.0, 1.0]), np.diag([1.0, 0.01, 1.0])
    _, both, share = covariance_intersection(np.zeros(3), one, np.zeros(3), two)
    assert share == pytest.approx(0.5, abs=1e-3)
    assert both[0, 0] < 0.05
    assert both[1, 1] < 0.05
    assert both[2, 2] == pytest.approx(1.0)
