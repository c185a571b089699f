"""Tracks of several stations that are one drone: which belong together, and where it is.

Everything is in one frame and of one kind of time; nothing here knows where events come from. Two
tracks are compared by the Mahalanobis distance of their positions at one instant.
"""

import itertools
import math
from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from unlidar_tools.events.estimates import Estimate, at, jumps, together
from unlidar_tools.events.neighbours import Key, Neighbours

_GATE = 11.345  # of chi-square with 3 degrees of freedom, 99 %
_APART = 4.0  # a pair is parted at so many times the gate: none flickers
_SMOOTHING_S = 1.0
_JOIN_S = 1.0  # two courses are alike for so long at least
_LEAST_APART_NS = 40_000_000  # of what is remembered of a track
_NEAR_S = 0.5  # estimates further apart in time are not compared
_HISTORY_S = 10.0  # by so much a station may be heard later than another
_PATIENCE_S = 2.0  # a new track waits so long for stations that are behind
_FORGET_S = 120.0  # of what is known of clocks
_LEAST_SPREAD_MPS = 1.0  # of velocities, for clocks to be told from places
_REACH_M = 100.0  # tracks further apart are not compared, however little is known of their places
_STEP_S = 3.0  # tracks of one drone are at most so far apart in time, and rows of one track


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
    """Takes the rows of all stations in, in any order of stations.

    Work for a row follows from the tracks near it, not from all that there are.
    """

    def __init__(self, survey_sigma_m: float) -> None:
        """`survey_sigma_m`: how well the stations' places are known, for each axis."""
        self._survey_m2 = survey_sigma_m**2 * np.eye(3)
        self._heard: dict[Key, list[Estimate]] = {}  # the last _HISTORY_S of each track
        self._identity: dict[Key, int] = {}  # 0: none yet
        self._members: dict[int, set[Key]] = {}  # of each identity
        self._pairs: dict[Key, dict[Key, _Pair]] = {}  # each under both of its tracks
        self._cuts: dict[Key, int] = {}
        self._near = Neighbours(_REACH_M)
        self._clocks: dict[tuple[str, str], _Clock] = {}
        self._numbers = itertools.count(1)

    def take(self, key: Key, estimate: Estimate) -> int:
        """The drone's identity, as of now."""
        heard = self._heard.setdefault(key, [])
        is_cut = bool(heard) and self._is_cut(heard[-1], estimate)
        self._cuts[key] = self._cuts.get(key, 0) + 1 if is_cut else 0
        if is_cut:
            self._part(key)
            heard.clear()
        if heard and estimate.stamp_ns <= heard[-1].stamp_ns:
            return self._identity[key]
        if len(heard) > 1 and heard[-1].stamp_ns - heard[-2].stamp_ns < _LEAST_APART_NS:
            heard.pop()  # however many rows a station tells, so much is remembered of them
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
        """The track has ended; the drone lives on in the others of it."""
        if key not in self._heard:
            return
        self._part(key)
        self._rename(key, 0)
        self._near.remove(key)
        del self._heard[key], self._identity[key], self._pairs[key], self._cuts[key]

    def cuts(self, key: Key) -> int:
        """So many of its last rows, one after the other, were no course of one drone."""
        return self._cuts.get(key, 0)

    def forget(self, station: str) -> None:
        """A station that is not there any more; its tracks have ended."""
        self._clocks = {pair: c for pair, c in self._clocks.items() if station not in pair}

    def identities(self) -> set[int]:
        """Of all drones that there are."""
        return set(self._members)

    def is_settled(self, identity: int) -> bool:
        """False of a new drone that looks like an older one, until that is decided."""
        members = self._members[identity]
        stations = {station for station, _ in members}
        return not any(
            self._may_join(own, other)
            for own in members
            for other in {*self._pairs[own], *self._near.around(own)}
            if self._identity[other] < identity and other[0] not in stations
        )

    def _may_join(self, own: Key, other: Key) -> bool:
        """Whether it is still open if a new track is the drone of an older one."""
        heard = self._heard[own]
        known_s = (heard[-1].stamp_ns - heard[0].stamp_ns) * 1e-9
        if known_s >= _PATIENCE_S + 1.5 * _JOIN_S:
            return False  # nobody hides a drone by coming near again and again
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
        pair = self._pairs[key].get(other)
        if pair is None:
            pair = self._pairs[key][other] = _Pair(squared, stamp_ns, stamp_ns)
            self._pairs[other][key] = pair
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

    def _is_cut(self, before: Estimate, now: Estimate) -> bool:
        """Whether a track is somewhere else, or of another time, than it can have come to."""
        passed_s = (now.stamp_ns - before.stamp_ns) * 1e-9
        return not -_HISTORY_S <= passed_s <= _STEP_S or jumps(before, now)

    def _part(self, key: Key) -> None:
        """A track is with nobody any more; whom it was with keep their name."""
        for other in list(self._pairs[key]):
            self._unpair(key, other)
        if len(self._members[self._identity[key]]) > 1:
            self._rename(key, 0)

    def _unpair(self, key: Key, other: Key) -> None:
        del self._pairs[key][other], self._pairs[other][key]

    def _regroup(self, key: Key) -> None:
        """The group of a track that was heard: at most one of each station.

        Whom it is with already goes before somebody new, then the most alike come first.
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
        """Who is joined with a track, or with one that is."""
        reached, open_keys = {key}, [key]
        while open_keys:
            pairs = self._pairs[open_keys.pop()]
            new = {two for two in among - reached if two in pairs and pairs[two].joined}
            reached |= new
            open_keys += new
        return reached

    def _name(self, groups: Iterable[set[Key]], heard: Key) -> None:
        """The oldest identity of a group is its own; it is given once.

        The largest group comes first, then the one that was `heard` just now.
        """
        given: set[int] = set()
        for members in sorted(groups, key=lambda keys: (-len(keys), heard not in keys, min(keys))):
            known = {self._identity[key] for key in members} - {0} - given
            identity = min(known) if known else next(self._numbers)
            given.add(identity)
            for key in members:
                self._rename(key, identity)

    def _rename(self, key: Key, identity: int) -> None:
        """0: it has none."""
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
    """Of the first that is not older."""
    return bisect_left(heard, stamp_ns, key=lambda estimate: estimate.stamp_ns)


def _nearest(heard: list[Estimate], stamp_ns: int) -> Estimate:
    after = _index(heard, stamp_ns)
    return min(heard[max(0, after - 1) : after + 1], key=lambda e: abs(e.stamp_ns - stamp_ns))
