"""The engine in this process among threads, closed, not built; what editors see of it."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import unlidar
from synthetic import PROJECT, make_flight

STAMPS = make_flight().stamps_ns


@pytest.fixture(scope="module", autouse=True)
def _built() -> None:
    pytest.importorskip("unlidar._engine", reason="the engine for Python is not built")


def frames_of(seed: int) -> list[unlidar.Frame]:
    flight = make_flight(seed)
    stamped = zip(flight.stamps_ns, flight.clouds, strict=True)
    return [unlidar.Frame("lidar", stamp_ns, cloud) for stamp_ns, cloud in stamped]


def streamed(frames: list[unlidar.Frame]) -> list[unlidar.Event]:
    engine = unlidar.Engine()
    return [event for frame in frames for event in engine.add(*frame)] + engine.close()


def in_threads(*work) -> None:
    threads = [threading.Thread(target=one) for one in work]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def test_two_engines_in_two_threads_give_what_each_gives_alone() -> None:
    flights = [frames_of(1), frames_of(2)]
    alone = [streamed(frames) for frames in flights]
    assert alone[0] != alone[1]
    together: dict[int, list[unlidar.Event]] = {}
    in_threads(
        *(lambda i=i: together.update({i: streamed(flights[i])}) for i in range(len(flights)))
    )
    assert [together[0], together[1]] == alone


def test_frames_may_be_a_sequence_without_an_iterator() -> None:
    class Frames:
        def __getitem__(self, number: int) -> unlidar.Frame:
            return frames_of(1)[number]

    def rows(frames: object) -> list[bytes]:
        return [track.rows.tobytes() for track in unlidar.track(frames)]

    assert rows(Frames()) == rows(frames_of(1)) != []
    with pytest.raises(unlidar.UsageError, match="frames: 5, expected an iterable of Frame"):
        unlidar.track(5)


def test_an_engine_of_several_threads_takes_one_frame_after_the_other() -> None:
    frames = frames_of(1)
    engine = unlidar.Engine(settings={"live.reorder_s": 60, "live.delay_s": 61})
    in_threads(*(lambda k=k: [engine.add(*frame) for frame in frames[k::3]] for k in range(3)))
    *_, last = engine.close()
    assert (last.frames, last.dropped) == (len(frames), 0)


def test_python_goes_on_while_the_engine_works() -> None:
    """Each of these calls takes long: without the lock nothing would be counted during it."""
    frames = frames_of(1)
    settings = {"live.delay_s": float("inf"), "live.window_s": float("inf")}
    engine = unlidar.Engine(settings=settings, rate_hz=10_000)
    for frame in frames:
        engine.add(*frame)
    counted, done = [0], threading.Event()

    def count() -> None:
        while not done.is_set():
            counted[0] += 1
            time.sleep(0)

    counter = threading.Thread(target=count)
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        counter.start()
        native = engine._stream
        before = counted[0]
        native.close()
        assert counted[0] - before > 100
    finally:
        sys.setswitchinterval(interval_s)
        done.set()
        counter.join()


def test_a_closed_engine_takes_nothing_and_says_so() -> None:
    frames = frames_of(1)
    engine = unlidar.Engine()
    engine.add(*frames[0])
    assert engine.close()
    assert engine.close() == []
    for call in (lambda: engine.add(*frames[1]), lambda: engine.advance(frames[1].stamp_ns)):
        with pytest.raises(unlidar.UsageError, match="is closed, expected a new one"):
            call()


def test_nothing_in_gives_nothing_out() -> None:
    assert unlidar.Engine().close() == []
    assert unlidar.Engine().advance(STAMPS[0]) == []
    assert unlidar.track([]) == []
    nothing = np.empty((0, 3))
    empty = [("lidar", stamp_ns, nothing, np.empty(0, np.int64)) for stamp_ns in STAMPS]
    assert unlidar.track(empty) == []
    events = streamed([unlidar.Frame(*frame) for frame in empty])
    assert not [event for event in events if isinstance(event, unlidar.Row)]
    assert (events[-1].frames, events[-1].dropped) == (len(empty), 0)


def test_without_the_module_the_rest_works_and_an_engine_says_what_to_build() -> None:
    code = (
        "import sys; sys.modules['unlidar._engine'] = None\n"
        "import unlidar\n"
        "print(unlidar.convert.__name__, unlidar.run.__name__, unlidar.evaluate.__name__)\n"
        "for make in (unlidar.Engine, lambda: unlidar.track([])):\n"
        "    try: make()\n"
        "    except unlidar.UnlidarError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    first, *errors = done.stdout.splitlines()
    assert first == "convert run evaluate"
    assert len(errors) == 2
    for error in errors:
        assert "cmake --build build --target unlidar_python" in error


def test_stubs_tell_of_all_that_the_module_has() -> None:
    from unlidar import _engine

    tree = ast.parse((PROJECT / "tools/unlidar/_engine.pyi").read_text())
    stubs = {
        node.name: {member.name for member in node.body if isinstance(member, ast.FunctionDef)}
        for node in tree.body
        if isinstance(node, ast.ClassDef)
    }
    classes = inspect.getmembers(_engine, inspect.isclass)
    found = {
        name: {m for m in vars(kind) if not m.startswith("_")} | {"__init__"}
        for name, kind in classes
    }
    assert stubs == found
    for name, kind in classes:
        (stub,) = (n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == name)
        assert ast.get_docstring(stub) == inspect.getdoc(kind)


def test_everything_public_has_a_docstring_and_shows_in_dir() -> None:
    assert set(unlidar.__all__) <= set(dir(unlidar))
    public = [getattr(unlidar, name) for name in unlidar.__all__ if name not in ("__version__",)]
    public += [unlidar.Engine.add, unlidar.Engine.advance, unlidar.Engine.close]
    undocumented = [it for it in public if it is not unlidar.Event and not inspect.getdoc(it)]
    assert undocumented == []
    for word in ("(n, 3)", "nanoseconds", "metres", "InputError"):
        assert word in unlidar.Engine.add.__doc__
    assert {"add", "advance", "close"} <= set(dir(unlidar.Engine))
