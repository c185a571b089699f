"""`unlidar play`: options and messages."""

import argparse
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from unlidar.capture import is_capture
from unlidar.cli.arguments import count
from unlidar.errors import InputError, ProgramError, UsageError, listed, reason

if TYPE_CHECKING:
    from unlidar.play import Played

EXAMPLE = """unlidar simulate demo out/demo --force
  unlidar play out/demo --rate 10 --into out/station
  unlidar play out/demo --rate inf > out/demo.stream
  unlidar play out/demo --to 'unlidar_track --stdin --out traj.csv'"""


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments but --sensors."""
    p.add_argument(
        "recording",
        metavar="RECORDING",
        type=Path,
        help="a folder of frame directories, converted or simulated; or a capture (.pcap, .pcapng) "
        "of the packets of Livox LiDARs, or a folder of a series of them",
    )
    p.add_argument(
        "--rate",
        metavar="X",
        type=_rate,
        default=1.0,
        help="so many times as fast as it was recorded; inf: as fast as it is taken (default: 1)",
    )
    p.add_argument(
        "--repeat",
        metavar="N",
        type=count,
        default=1,
        help="so many times one after the other, with stamps that go on (default: 1); times of "
        "points must be offsets from the stamp then",
    )
    to = p.add_mutually_exclusive_group()
    to.add_argument(
        "--into",
        metavar="DIR",
        type=Path,
        help="write each frame as a file DIR/SENSOR/STAMP.pcd that appears in one piece, for "
        "unlidar_track --follow",
    )
    to.add_argument(
        "--to",
        metavar="COMMAND",
        type=shlex.split,
        help="a command whose stdin takes the frames as unlidar_track --stdin reads them; its exit "
        "code is handed on (default: stdout); of a capture: HOST:PORT to send its packets to",
    )
    p.add_argument(
        "--anywhere",
        action="store_true",
        help="a capture may go to a HOST that is not this computer",
    )
    p.set_defaults(act=_play)


def _play(a: argparse.Namespace) -> None:
    if is_capture(a.recording):
        _play_capture(a)
    else:
        _play_frames(a)


def _play_frames(a: argparse.Namespace) -> None:
    from unlidar.frames_io import find_sensors
    from unlidar.play import FolderSink, MessageSink, frames_in_order, play

    if a.anywhere:
        raise UsageError(f"--anywhere: is for captures of packets, {a.recording} is none")
    if not a.recording.is_dir():
        raise InputError(f"{a.recording}: is no folder of frame directories")
    sensors = find_sensors(a.recording)
    if not sensors:
        raise InputError(
            f"{a.recording}: holds no frames, expected *.pcd in it or in its folders; "
            "'unlidar convert' makes them"
        )
    for name in a.sensors or ():
        if name not in sensors:
            raise UsageError(f"{a.recording}: has no sensor '{name}', it holds {listed(sensors)}")
    if a.sensors:
        sensors = {name: sensors[name] for name in a.sensors}
    frames = frames_in_order(sensors, a.repeat)
    if a.into is not None:
        _refuse_own_source(a.into, sensors)
        played = play(frames, FolderSink(a.into), a.rate)
    elif a.to:
        with _stdin_of(a.to) as stream:
            played = play(frames, MessageSink(stream), a.rate)
    elif sys.stdout.isatty():
        raise UsageError("stdout is a terminal, expected --into, --to, a pipe or a file")
    else:
        played = play(frames, MessageSink(sys.stdout.buffer), a.rate)
    _tell(played, "frames")


def _play_capture(a: argparse.Namespace) -> None:
    from unlidar.play_packets import play_packets

    for option, given in (("--into", a.into), ("--repeat", a.repeat > 1), ("--sensors", a.sensors)):
        if given:
            raise UsageError(f"{option}: is for frames, {a.recording} is a capture of packets")
    words = a.to or []
    host, colon, port = " ".join(words).rpartition(":")
    if not (colon and port.isdecimal() and 0 < int(port) < 65536):
        raise UsageError(
            f"--to '{' '.join(words)}': expected HOST:PORT for a capture, as in 127.0.0.1:56301"
        )
    _tell(play_packets(a.recording, host, int(port), a.rate, a.anywhere), "packets")


def _tell(played: "Played", what: str) -> None:
    behind = f", up to {played.most_behind_s:.1f} s behind" if played.most_behind_s > 0.5 else ""
    print(f"played {played.frames} {what} in {played.wall_s:.1f} s{behind}", file=sys.stderr)


def _refuse_own_source(into: Path, sensors: dict[str, Path]) -> None:
    for name, directory in sensors.items():
        if (into / name).resolve() == directory.resolve():
            raise UsageError(f"--into {into}: would write into the recording itself, {directory}")


@contextmanager
def _stdin_of(command: list[str]) -> Iterator[BinaryIO]:
    """Runs a command; at the end waits for it, and throws ProgramError if it has failed."""
    try:
        process = subprocess.Popen(command, stdin=subprocess.PIPE)
    except OSError as error:
        raise UsageError(f"{command[0]}: cannot be run: {reason(error)}") from error
    assert process.stdin is not None
    try:
        yield process.stdin
        process.stdin.close()
    except BrokenPipeError:  # the command exited; its exit code decides
        pass
    except BaseException:
        process.send_signal(signal.SIGTERM)
        process.wait()
        raise
    code = process.wait()
    if code != 0:
        ended = f"by signal {-code}" if code < 0 else f"with code {code}"
        raise ProgramError(f"{shlex.join(command)}: ended {ended}", code if code > 0 else 1)


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not rate > 0:
        raise argparse.ArgumentTypeError(f"'{text}', expected a number above 0, or inf")
    return rate
