"""Track-to-track fusion: association of several stations' tracks, and the fused position.

Positions are in one common frame and stamps of one time base. Two tracks are compared by the
Mahalanobis distance of their positions at one instant.
"""

import itertools
import math
from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from unlidar.events.estimates import Estimate, at, jumps, together
from unlidar.events.neighbours import Key, Neighbours

_GATE = 11.345  # of chi-square with 3 degrees of freedom, 99 %
_APART = 4.0  # a pair separates at this multiple of the gate (hysteresis)
_SMOOTHING_S = 1.0
_JOIN_S = 1.0  # two tracks must agree for at least so long
_LEAST_APART_NS = 40_000_000  # shortest interval between remembered estimates of a track
_NEAR_S = 0.5  # estimates further apart in time are not compared
_HISTORY_S = 10.0  # largest latency difference of stations
_PATIENCE_S = 2.0  # a new track waits so long for delayed stations
_FORGET_S = 120.0  # time constant of the clock regression
_LEAST_SPREAD_MPS = 1.0  # velocity spread needed to separate clock from survey errors
_REACH_M = 100.0  # gating radius, whatever the uncertainties
_STEP_S = 3.0  # largest time gap between tracks of a drone, and rows of a track


@dataclass(frozen=True)
class Fused:
    """One drone. Its identity is constant while any of its tracks lasts."""

    identity: int
    members: tuple[Key, ...]
    estimate: Estimate


@dataclass
class _Pair:
    """Similarity of two tracks."""

    distance: float  # smoothed squared Mahalanobis distance
    begin_ns: int
    newest_ns: int
    joined: bool = False


@dataclass
class _Clock:
    """Sums of the regression: position difference = survey offset + clock offset * velocity."""

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
    """Accepts rows of all stations, interleaved in any order.

    The cost of a row depends on the tracks near it, not on the number of all tracks.
    """

    def __init__(self, survey_sigma_m: float) -> None:
        """`survey_sigma_m`: 1-sigma of the stations' positions, per axis."""
        self._survey_m2 = survey_sigma_m**2 * np.eye(3)
        self._heard: dict[Key, list[Estimate]] = {}  # the last _HISTORY_S of each track
        self._identity: dict[Key, int] = {}  # 0: undecided
        self._members: dict[int, set[Key]] = {}  # tracks by identity
        self._pairs: dict[Key, dict[Key, _Pair]] = {}  # symmetric: stored under both tracks
        self._cuts: dict[Key, int] = {}
        self._near = Neighbours(_REACH_M)
        self._clocks: dict[tuple[str, str], _Clock] = {}
        self._numbers = itertools.count(1)

    def take(self, key: Key, estimate: Estimate) -> int:
        """Adds a row's estimate; returns the current identity of its drone."""
        heard = self._heard.setdefault(key, [])
        is_cut = bool(heard) and self._is_cut(heard[-1], estimate)
        self._cuts[key] = self._cuts.get(key, 0) + 1 if is_cut else 0
        if is_cut:
            self._part(key)
            heard.clear()
        if heard and estimate.stamp_ns <= heard[-1].stamp_ns:
            return self._identity[key]
        if len(heard) > 1 and heard[-1].stamp_ns - heard[-2].stamp_ns < _LEAST_APART_NS:
            heard.pop()  # bounds the memory at any row rate
        heard.append(estimate)
        del heard[: _index(heard, estimate.stamp_ns - _HISTORY_S * 1e9)]
        self._identity.setdefault(key, 0)
        self._near.put(key, tuple(estimate.xyz_m.tolist()))
        pairs = self._pairs.setdefault(key, {})
        near = self._near.around(key)
        for other in {*pairs, *near}:
            nearest = _nearest(self._heard[other], estimate.stamp_ns)
            if _apart_s(estimate, nearest) <= _NEAR_S:
                self._compare(key, estimate, other, nearest)
            elif other in pairs and _apart_s(estimate, self._heard[other][-1]) > _STEP_S:
                pairs[other].joined = False
        own = self._members.get(self._identity[key], set())
        for other in set(pairs).difference(near):
            if not (pairs[other].joined and other in own):
                self._unpair(key, other)
        self._regroup(key)
        return self._identity[key]

    def end(self, key: Key) -> None:
        """Removes an ended track; the drone continues with its other tracks."""
        if key not in self._heard:
            return
        self._part(key)
        self._rename(key, 0)
        self._near.remove(key)
        del self._heard[key], self._identity[key], self._pairs[key], self._cuts[key]

    def cuts(self, key: Key) -> int:
        """The number of consecutive last rows that jumped, that is, fit no single drone."""
        return self._cuts.get(key, 0)

    def forget(self, station: str) -> None:
        """Removes a station that has left, with its tracks."""
        self._clocks = {pair: c for pair, c in self._clocks.items() if station not in pair}

    def identities(self) -> set[int]:
        """The identities of all drones."""
        return set(self._members)

    def is_settled(self, identity: int) -> bool:
        """False while a new drone may still be merged with an older one."""
        members = self._members[identity]
        stations = {station for station, _ in members}
        return not any(
            self._may_join(own, other)
            for own in members
            for other in {*self._pairs[own], *self._near.around(own)}
            if self._identity[other] < identity and other[0] not in stations
        )

    def _may_join(self, own: Key, other: Key) -> bool:
        """True while a new track may still join the drone of an older one."""
        heard = self._heard[own]
        known_s = (heard[-1].stamp_ns - heard[0].stamp_ns) * 1e-9
        if known_s >= _PATIENCE_S + 1.5 * _JOIN_S:
            return False  # bounded, so that repeated approaches cannot hide a drone
        pair = self._pairs[own].get(other)
        if pair is not None:
            return pair.distance <= _GATE and (pair.newest_ns - pair.begin_ns) * 1e-9 < _JOIN_S
        behind_s = (heard[0].stamp_ns - self._heard[other][-1].stamp_ns) * 1e-9
        return 0 < behind_s <= _HISTORY_S and known_s < _PATIENCE_S

    def drone(self, identity: int) -> Fused:
        """One drone at the newest instant of its tracks. KeyError where there is none."""
        members = tuple(sorted(self._members[identity]))
        return Fused(identity, members, together(self._heard[key][-1] for key in members))

    def fused(self) -> list[Fused]:
        """Every drone, by identity."""
        return [self.drone(identity) for identity in sorted(self._members)]

    def clock_offset_s(self, station: str, other: str) -> float | None:
        """The lead in s of `station`'s stamps over the other's, as estimated from joint flights.

        None if no joint flight changed its velocity enough: a clock and a survey error are then
        indistinguishable.
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
        pair = self._pairs[key].get(other)
        if pair is None:
            pair = self._pairs[key][other] = _Pair(squared, stamp_ns, stamp_ns)
            self._pairs[other][key] = pair
        passed_s = max(0, stamp_ns - pair.newest_ns) * 1e-9  # 0 for a delayed station
        share = 1 - math.exp(-passed_s / _SMOOTHING_S)
        pair.distance += share * (squared - pair.distance)
        pair.newest_ns = max(pair.newest_ns, stamp_ns)
        if pair.joined:
            pair.joined = pair.distance <= _APART * _GATE
        else:
            lasted_s = (pair.newest_ns - pair.begin_ns) * 1e-9
            pair.joined = lasted_s >= _JOIN_S and pair.distance <= _GATE
        if pair.joined:
            # The same path with stamps ahead by dt appears v * dt behind.
            ahead, behind = (mine, theirs) if key[0] < other[0] else (theirs, mine)
            velocity = (ahead.velocity_mps + behind.velocity_mps) / 2
            clock = self._clocks.setdefault(
                (min(key[0], other[0]), max(key[0], other[0])), _Clock()
            )
            clock.take(stamp_ns, velocity, behind.xyz_m - ahead.xyz_m)

    def _is_cut(self, before: Estimate, now: Estimate) -> bool:
        """True if a track jumped in position or time."""
        passed_s = (now.stamp_ns - before.stamp_ns) * 1e-9
        return not -_HISTORY_S <= passed_s <= _STEP_S or jumps(before, now)

    def _part(self, key: Key) -> None:
        """Separates a track from its group, which keeps its identity."""
        for other in list(self._pairs[key]):
            self._unpair(key, other)
        if len(self._members[self._identity[key]]) > 1:
            self._rename(key, 0)

    def _unpair(self, key: Key, other: Key) -> None:
        del self._pairs[key][other], self._pairs[other][key]

    def _regroup(self, key: Key) -> None:
        """The new group of a track: at most one track of each station.

        Existing partners precede new ones, then the most similar come first.
        """
        rest = set(self._members.get(self._identity[key], ()))
        group = self._connected(key, rest)
        rest -= group
        joined = ((pair.distance, other) for other, pair in self._pairs[key].items() if pair.joined)
        for _, other in sorted(joined):
            theirs = self._members[self._identity[other]] - rest
            if not {station for station, _ in group} & {station for station, _ in theirs}:
                group |= theirs
        groups = [group]
        while rest:
            groups.append(self._connected(min(rest), rest))
            rest -= groups[-1]
        self._name(groups, key)

    def _connected(self, key: Key, among: set[Key]) -> set[Key]:
        """The connected component of a track."""
        reached, open_keys = {key}, [key]
        while open_keys:
            pairs = self._pairs[open_keys.pop()]
            new = {two for two in among - reached if two in pairs and pairs[two].joined}
            reached |= new
            open_keys += new
        return reached

    def _name(self, groups: Iterable[set[Key]], heard: Key) -> None:
        """Assigns identities: a group gets the oldest of its tracks, each identity once.

        The largest group chooses first, then the one of the track `heard` now.
        """
        given: set[int] = set()
        for members in sorted(groups, key=lambda keys: (-len(keys), heard not in keys, min(keys))):
            known = {self._identity[key] for key in members} - {0} - given
            identity = min(known) if known else next(self._numbers)
            given.add(identity)
            for key in members:
                self._rename(key, identity)

    def _rename(self, key: Key, identity: int) -> None:
        """Sets the identity of a track; 0: none."""
        before = self._identity.get(key, 0)
        if before == identity:
            return
        self._identity[key] = identity
        if before:
            self._members[before].discard(key)
            if not self._members[before]:
                del self._members[before]
        if identity:
            self._members.setdefault(identity, set()).add(key)


def _apart_s(one: Estimate, two: Estimate) -> float:
    return abs(one.stamp_ns - two.stamp_ns) * 1e-9


def _index(heard: list[Estimate], stamp_ns: float) -> int:
    """Index of the first estimate that is not older."""
    return bisect_left(heard, stamp_ns, key=lambda estimate: estimate.stamp_ns)


def _nearest(heard: list[Estimate], stamp_ns: int) -> Estimate:
    after = _index(heard, stamp_ns)
    return min(heard[max(0, after - 1) : after + 1], key=lambda e: abs(e.stamp_ns - stamp_ns))
