"""What a relay reads of its file's past: less, and it knows the same."""

from __future__ import annotations

import asyncio
import itertools
import json
import random
import time
from pathlib import Path

import pytest
from station_events import (
    BEGIN_NS,
    end,
    now,
    returns,
    row,
    sensor,
    square,
    state,
    track,
    write_site,
)
from unlidar.events.lines import Line
from unlidar.events.site import Site, load_site, load_zones
from unlidar.events.source import open_source
from unlidar.events.station import Station
from unlidar.relay.sapient.picture import Picture

SECONDS = 300


def history(rng: random.Random) -> list[str]:
    """Of an engine that is killed now and then, and begins its numbers anew."""
    lines, flying, numbers = [], {}, itertools.count()
    for step in range(SECONDS * 2):
        at = step / 2
        if step == 0 or rng.random() < 0.003:
            lines.append(state("warming_up", at))
            flying, numbers = {}, itertools.count()
        if rng.random() < 0.02:
            lines.append(sensor("avia", rng.choice(("ok", "blinded", "silent")), at))
        if not flying or (rng.random() < 0.1 and len(flying) < 5):
            number = next(numbers)
            flying[number] = at + rng.uniform(1.0, 100.0)
            lines.append(track(number, at, drone=round(rng.random(), 3)))
        lines.append(returns("avia", at, [[1.0, 2.0, 3.0]]))
        for number, until in list(flying.items()):
            if at > until:
                lines.append(end(number, at))
                del flying[number]
            else:
                place = (rng.uniform(-60.0, 60.0), 0.0, 20.0)
                lines += [now(number, at, place), row(number, at - 0.9, place)]
    return lines


async def read(path: Path, whole: bool) -> list[Line]:
    """The file's lines of before."""
    found = []
    async for line in open_source(str(path), whole=whole).lines():
        if not line.old:
            return found
        found.append(line)
    raise AssertionError("a file is followed for ever")


def known(lines: list[Line], site: Site) -> tuple:
    """All that a node would tell next."""
    station, picture = Station(site, load_zones(site)), Picture("node", lambda: 0.0)
    for line in lines:
        for message in station.take(line.data):
            picture.learn(message)
    picture.learned()
    ids = {number: (t.object_id, t.drone) for number, t in picture._tracks.items()}
    alerts = {(a.alert_id, a.object_id, a.is_active) for a in picture.take_alerts()}
    return ids, alerts, {t.object_id for t in picture.take_lost()}, picture.health()


@pytest.mark.parametrize("seed", range(3))
def test_the_same_is_known_from_a_fraction_of_the_lines(seed, tmp_path, monkeypatch) -> None:
    site = load_site(write_site(tmp_path, [square(50, "apron")]))
    lines = history(random.Random(seed))
    if seed % 2:  # as other programs write JSON
        lines = [json.dumps(json.loads(line)) for line in lines]
    path = tmp_path / "events.jsonl"
    path.write_text("".join(line + "\n" for line in lines) + '{"event":"row","at"')
    monkeypatch.setattr(time, "time", lambda: BEGIN_NS * 1e-9 + SECONDS)
    whole, less = (asyncio.run(read(path, whole)) for whole in (True, False))
    assert len(whole) == len(lines)
    expected = known(whole, site)
    assert known(less, site) == expected
    assert all(expected[:2])  # tracks and alerts
    assert len(less) < len(lines) * 2 / 3


def test_what_comes_later_is_read_whole(tmp_path) -> None:
    path = tmp_path / "events.jsonl"
    seen = [now(7, 0.0), row(7, 0.0), returns("avia", 0.0, [[1, 2, 3]])]
    past = [track(7, 0.0), *seen, end(7, 1.0), track(8, 99.0)]
    later = [*seen, end(7, 101.0)]
    path.write_text("".join(line + "\n" for line in past))

    async def go() -> list[Line]:
        found = []
        async for line in open_source(str(path), whole=False).lines():
            found.append(line)
            if line.data == past[-1].encode():
                with path.open("a") as file:
                    file.write("".join(text + "\n" for text in later))
            if line.data == later[-1].encode():
                break
        return found

    found = asyncio.run(go())
    assert [line.data.decode() for line in found if line.old] == [past[0], *past[-2:]]
    assert [line.data.decode() for line in found if not line.old and line.data] == later
