"""Tracks of several stations that are one drone: which belong together, and where it is.

Everything is in one frame and of one kind of time; nothing here knows where events come from. Two
tracks are compared by the Mahalanobis distance of their positions at one instant. How their errors
hang together is not known (the same wind, the same survey), so positions are joined by covariance
intersection (Julier and Uhlmann, 1997), which is never too sure whatever the correlation.
"""

import itertools
import math
from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize_scalar

Key = tuple[str, int]  # station, number of its track

_GATE = 11.345  # of chi-square with 3 degrees of freedom, 99 %
_APART = 4.0  # a pair is parted at so many times the gate: none flickers
_SMOOTHING_S = 1.0
_JOIN_S = 1.0  # two courses are alike for so long at least
_NEAR_S = 0.5  # estimates further apart in time are not compared
_HISTORY_S = 10.0  # by so much a station may be heard later than another
_PATIENCE_S = 2.0  # a new track waits so long for stations that are behind
_ACCELERATION_MPS2 = 3.0  # 1-sigma, of a drone between two rows
_FORGET_S = 120.0  # of what is known of clocks
_LEAST_SPREAD_MPS = 1.0  # of velocities, for clocks to be told from places


@dataclass(frozen=True)
class Estimate:
    """Where a track is at an instant."""

    stamp_ns: int
    xyz_m: np.ndarray  # (3,)
    velocity_mps: np.ndarray  # (3,)
    covariance_m2: np.ndarray  # (3, 3) of the position


@dataclass(frozen=True)
class Fused:
    """One drone: its identity never changes while any of its tracks goes on."""

    identity: int
    members: tuple[Key, ...]
    estimate: Estimate


@dataclass
class _Pair:
    """How alike two courses are."""

    distance: float  # smoothed squared Mahalanobis distance
    begin_ns: int
    newest_ns: int
    joined: bool = False


@dataclass
class _Clock:
    """Sums of a regression: difference of positions = offset of places + time * velocity."""

    newest_ns: int = 0
    weight: float = 0.0
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    difference: np.ndarray = field(default_factory=lambda: np.zeros(3))
    squares: float = 0.0
    products: float = 0.0

    def take(self, stamp_ns: int, velocity: np.ndarray, difference: np.ndarray) -> None:
        passed_s = max(0, stamp_ns - self.newest_ns) * 1e-9 if self.weight else 0.0
        kept = math.exp(-passed_s / _FORGET_S)
        self.newest_ns = max(self.newest_ns, stamp_ns)
        self.weight = kept * self.weight + 1
        self.velocity = kept * self.velocity + velocity
        self.difference = kept * self.difference + difference
        self.squares = kept * self.squares + float(velocity @ velocity)
        self.products = kept * self.products + float(velocity @ difference)

    def offset_s(self) -> float | None:
        if self.weight == 0:
            return None
        spread = self.squares - float(self.velocity @ self.velocity) / self.weight
        if spread < self.weight * _LEAST_SPREAD_MPS**2:
            return None
        return (self.products - float(self.velocity @ self.difference) / self.weight) / spread


class Fusion:
    """Takes the rows of all stations in, in any order of stations."""

    def __init__(self, survey_sigma_m: float) -> None:
        """`survey_sigma_m`: how well the stations' places are known, for each axis."""
        self._survey_m2 = survey_sigma_m**2 * np.eye(3)
        self._heard: dict[Key, list[Estimate]] = {}  # the last _HISTORY_S of each track
        self._identity: dict[Key, int] = {}
        self._pairs: dict[frozenset[Key], _Pair] = {}
        self._clocks: dict[tuple[str, str], _Clock] = {}
        self._numbers = itertools.count(1)

    def take(self, key: Key, estimate: Estimate) -> int:
        """The drone's identity, as of now."""
        heard = self._heard.setdefault(key, [])
        if heard and estimate.stamp_ns <= heard[-1].stamp_ns:
            return self._identity[key]
        heard.append(estimate)
        del heard[: _index(heard, estimate.stamp_ns - _HISTORY_S * 1e9)]
        self._identity.setdefault(key, 0)
        for other, theirs in self._heard.items():
            nearest = _nearest(theirs, estimate.stamp_ns)
            apart_s = abs(estimate.stamp_ns - nearest.stamp_ns) * 1e-9
            if other[0] != key[0] and apart_s <= _NEAR_S:
                self._compare(key, estimate, other, nearest)
        self._regroup()
        return self._identity[key]

    def end(self, key: Key) -> None:
        """The track has ended; the drone lives on in the others of it."""
        self._heard.pop(key, None)
        self._identity.pop(key, None)
        self._pairs = {pair: value for pair, value in self._pairs.items() if key not in pair}

    def identities(self) -> set[int]:
        """Of all drones that there are."""
        return set(self._identity.values())

    def is_settled(self, identity: int) -> bool:
        """False of a new drone that looks like an older one, until that is decided."""
        members = [key for key, number in self._identity.items() if number == identity]
        stations = {station for station, _ in members}
        older = [
            key
            for key, number in self._identity.items()
            if number < identity and key[0] not in stations
        ]
        return not any(self._may_join(own, other) for own in members for other in older)

    def _may_join(self, own: Key, other: Key) -> bool:
        """Whether it is still open if a new track is the drone of an older one."""
        pair = self._pairs.get(frozenset((own, other)))
        if pair is not None:
            return pair.distance <= _GATE and (pair.newest_ns - pair.begin_ns) * 1e-9 < _JOIN_S
        heard = self._heard[own]
        is_behind = self._heard[other][-1].stamp_ns < heard[0].stamp_ns
        return is_behind and (heard[-1].stamp_ns - heard[0].stamp_ns) * 1e-9 < _PATIENCE_S

    def drone(self, identity: int) -> Fused:
        """One drone at the newest instant of its tracks. KeyError where there is none."""
        members = tuple(sorted(k for k, number in self._identity.items() if number == identity))
        if not members:
            raise KeyError(identity)
        return Fused(identity, members, _together(self._heard[key][-1] for key in members))

    def fused(self) -> list[Fused]:
        """Every drone, by identity."""
        return [self.drone(identity) for identity in sorted(self.identities())]

    def clock_offset_s(self, station: str, other: str) -> float | None:
        """By how much the stamps of `station` are ahead of the other's, as far as flights tell.

        None where no joint flight has changed its velocity enough: then a wrong clock and a wrong
        place are alike.
        """
        first, second = sorted((station, other))
        clock = self._clocks.get((first, second))
        offset_s = None if clock is None else clock.offset_s()
        return offset_s if offset_s is None or station == first else -offset_s

    def _compare(self, key: Key, mine: Estimate, other: Key, theirs: Estimate) -> None:
        stamp_ns = max(mine.stamp_ns, theirs.stamp_ns)
        mine, theirs = at(mine, stamp_ns), at(theirs, stamp_ns)
        difference = mine.xyz_m - theirs.xyz_m
        total = mine.covariance_m2 + theirs.covariance_m2 + 2 * self._survey_m2
        squared = float(difference @ np.linalg.solve(total, difference))
        pair = self._pairs.setdefault(frozenset((key, other)), _Pair(squared, stamp_ns, stamp_ns))
        passed_s = max(0, stamp_ns - pair.newest_ns) * 1e-9  # none where a station is heard later
        share = 1 - math.exp(-passed_s / _SMOOTHING_S)
        pair.distance += share * (squared - pair.distance)
        pair.newest_ns = max(pair.newest_ns, stamp_ns)
        if pair.joined:
            pair.joined = pair.distance <= _APART * _GATE
        else:
            lasted_s = (pair.newest_ns - pair.begin_ns) * 1e-9
            pair.joined = lasted_s >= _JOIN_S and pair.distance <= _GATE
        if pair.joined:
            # The same path, stamped later: what is ahead by dt seems to be v * dt behind.
            ahead, behind = (mine, theirs) if key[0] < other[0] else (theirs, mine)
            velocity = (ahead.velocity_mps + behind.velocity_mps) / 2
            clock = self._clocks.setdefault(
                (min(key[0], other[0]), max(key[0], other[0])), _Clock()
            )
            clock.take(stamp_ns, velocity, behind.xyz_m - ahead.xyz_m)

    def _regroup(self) -> None:
        """Groups with at most one track of each station, the most alike pairs first.

        Whom a track is with already goes before somebody new.
        """
        group: dict[Key, set[Key]] = {key: {key} for key in self._heard}
        joined = [(pair, tuple(keys)) for keys, pair in self._pairs.items() if pair.joined]

        def order(entry: tuple[_Pair, tuple[Key, ...]]) -> tuple:
            one, two = entry[1]
            together = self._identity[one] == self._identity[two] != 0
            return not together, entry[0].distance, sorted(entry[1])

        for _, (one, two) in sorted(joined, key=order):
            first, second = group[one], group[two]
            stations = [key[0] for key in first | second]
            if first is not second and len(set(stations)) == len(stations):
                first |= second
                for key in second:
                    group[key] = first
        self._name({id(members): members for members in group.values()}.values())

    def _name(self, groups: Iterable[set[Key]]) -> None:
        """The oldest identity of a group is its own; it is given once, to the largest group."""
        given: set[int] = set()
        for members in sorted(groups, key=lambda keys: (-len(keys), sorted(keys))):
            known = {self._identity[key] for key in members} - {0} - given
            identity = min(known) if known else next(self._numbers)
            given.add(identity)
            for key in members:
                self._identity[key] = identity


def _index(heard: list[Estimate], stamp_ns: float) -> int:
    """Of the first that is not older."""
    return bisect_left(heard, stamp_ns, key=lambda estimate: estimate.stamp_ns)


def _nearest(heard: list[Estimate], stamp_ns: int) -> Estimate:
    after = _index(heard, stamp_ns)
    return min(heard[max(0, after - 1) : after + 1], key=lambda e: abs(e.stamp_ns - stamp_ns))


def at(estimate: Estimate, stamp_ns: int) -> Estimate:
    """Carried on at its velocity; less sure by what the drone may have accelerated."""
    passed_s = (stamp_ns - estimate.stamp_ns) * 1e-9
    sigma_m = 0.5 * _ACCELERATION_MPS2 * passed_s**2
    return Estimate(
        stamp_ns,
        estimate.xyz_m + passed_s * estimate.velocity_mps,
        estimate.velocity_mps,
        estimate.covariance_m2 + sigma_m**2 * np.eye(3),
    )


def covariance_intersection(
    one_m: np.ndarray, one_m2: np.ndarray, two_m: np.ndarray, two_m2: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Position, covariance and the share of the first, which makes the determinant least.

    P^-1 = w P1^-1 + (1 - w) P2^-1, P^-1 x = w P1^-1 x1 + (1 - w) P2^-1 x2.
    """
    first, second = np.linalg.inv(one_m2), np.linalg.inv(two_m2)

    def log_volume(share: float) -> float:
        return -float(np.linalg.slogdet(share * first + (1 - share) * second)[1])

    found = minimize_scalar(log_volume, bounds=(0, 1), method="bounded", options={"xatol": 1e-4})
    # The ends are not tried by a bounded search, and often the best.
    share = min((0.0, 1.0, float(found.x)), key=log_volume)
    covariance = np.linalg.inv(share * first + (1 - share) * second)
    position = covariance @ (share * first @ one_m + (1 - share) * second @ two_m)
    return position, covariance, share


def _together(estimates: Iterable[Estimate]) -> Estimate:
    known = list(estimates)
    stamp_ns = max(estimate.stamp_ns for estimate in known)
    result, *others = (at(estimate, stamp_ns) for estimate in known)
    for other in others:
        position, covariance, share = covariance_intersection(
            result.xyz_m, result.covariance_m2, other.xyz_m, other.covariance_m2
        )
        velocity = share * result.velocity_mps + (1 - share) * other.velocity_mps
        result = Estimate(stamp_ns, position, velocity, covariance)
    return result
