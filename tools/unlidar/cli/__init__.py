"""The command line of `unlidar`."""

import argparse
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import NoReturn

from unlidar import reporting
from unlidar.cli import (
    benchmark,
    compare,
    completion,
    convert,
    evaluate,
    explain,
    export,
    history,
    play,
    relay,
    report,
    run,
    sensor,
    simulate,
    view,
    watch,
)
from unlidar.errors import UsageError, report_errors

# Commands with their help and, where they have --sensors, its default. Imports are deferred to
# the command's action, so that --help need not load matplotlib.
_COMMANDS: dict[str, tuple[ModuleType, str, str | None]] = {
    "convert": (
        convert,
        "recording -> frame directories and ground_truth.csv",
        "default: all LiDARs; radars only if named",
    ),
    "simulate": (simulate, "synthetic flight with exact truth -> frame directories", None),
    "run": (
        run,
        "converts if need be, tracks, evaluates, draws; one recording or many",
        "default: all found",
    ),
    "play": (
        play,
        "a recording as a live source: to a command, a stream or followed folders",
        "default: all found",
    ),
    "relay": (
        relay,
        "events of a running station -> TAK, SAPIENT, MQTT, WebSocket; alarms by zones",
        None,
    ),
    "watch": (watch, "a page that shows a running station, its alarms and its last hours", None),
    "history": (history, "what a station has seen -> a list, CSV, GeoJSON, KML, mcap", None),
    "sensor": (
        sensor,
        "finds Livox LiDARs and makes them send their packets to unlidar_track --livox",
        None,
    ),
    "evaluate": (
        evaluate,
        "trajectory against truth: RMSE, per axis, coverage, false rows; one or many sequences",
        None,
    ),
    "compare": (compare, "several results of one flight -> one table and one figure", None),
    "explain": (
        explain,
        "why a drone was not tracked: second by second, the first stage that lost it",
        None,
    ),
    "export": (
        export,
        "trajectory to TUM, CSV, KML, GeoJSON, COURAGEOUS, ROS 1 and 2, the UG2+ challenge's CSV",
        None,
    ),
    "report": (
        report,
        "results of run -> one HTML page, figures for papers, a recording for rerun",
        None,
    ),
    "view": (view, "results in 3-D over time: in rerun where installed, else in the browser", None),
    "benchmark": (
        benchmark,
        "scenes x seeds x methods -> one table, with the published figures beside it",
        None,
    ),
}


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} (see {self.prog} --help)")


class _Command(_Parser):
    """A sub-command whose lists of positional arguments may be split by options."""

    _is_parsing = False

    def parse_known_args(self, args=None, namespace=None):
        if self._is_parsing:
            return super().parse_known_args(args, namespace)
        # argparse takes all positional arguments before the first option for the whole list.
        is_mixing = any(a.nargs in ("+", "*") for a in self._actions)
        parse = self.parse_known_intermixed_args if is_mixing else self.parse_known_args
        self._is_parsing = True
        try:
            known, unknown = parse(args, namespace)
        finally:
            self._is_parsing = False
        if unknown:  # argparse leaves them to the parser of all commands, with its help
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return known, unknown


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from unlidar import __version__  # reads the metadata of the package

        print(f"unlidar {__version__}")
        parser.exit()


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    return report_errors(lambda: _act(arguments))


def _act(arguments: Sequence[str] | None) -> None:
    words = sys.argv[1:] if arguments is None else arguments
    parser = _parser()
    chosen = parser.parse_args(words or ["--help"])
    reporting.show_on_stderr(chosen.verbose)
    chosen.act(chosen)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="unlidar",
        description="Converts, simulates, tracks and measures LiDAR recordings of drones.",
        epilog="example: unlidar simulate demo out/demo && unlidar run out/demo",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Command)
    for name, (command, text, sensors) in _COMMANDS.items():
        p = _add(commands, name, text, command.EXAMPLE)
        command.define(p)
        if sensors is not None:
            _add_sensors(p, sensors)
    text = "what a shell needs to complete the command line"
    completion.define(_add(commands, "completion", text, completion.EXAMPLE), parser)
    return parser


def _add(commands: argparse._SubParsersAction, name: str, text: str, example: str) -> _Parser:
    parser = commands.add_parser(
        name,
        help=text,
        description=f"{text[0].upper()}{text[1:]}.",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--verbose", action="store_true", help="tell of every command that is run and every stage"
    )
    return parser


def _add_sensors(p: argparse.ArgumentParser, default: str) -> None:
    p.add_argument(
        "--sensors",
        metavar="NAME[,NAME...]",
        type=_names,
        help=f"which sensors, the first gives the output times ({default})",
    )


def _names(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names or len(set(names)) != len(names):
        raise argparse.ArgumentTypeError(f"'{text}', expected different names")
    return names
