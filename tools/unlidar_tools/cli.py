"""The command line of `unlidar`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from unlidar_tools import (
    benchmark_command,
    completion_command,
    convert_command,
    evaluate_command,
    export_command,
    history_command,
    play_command,
    relay_command,
    report_command,
    run_command,
    sensor_command,
    telling,
    watch_command,
)
from unlidar_tools.arguments import whole
from unlidar_tools.configs import scenario_names
from unlidar_tools.errors import UsageError, report_errors
from unlidar_tools.printable import printable


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} (see {self.prog} --help)")


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from unlidar_tools import __version__  # reads the metadata of the package

        print(f"unlidar {__version__}")
        parser.exit()


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    return report_errors(lambda: _act(arguments))


def _act(arguments: Sequence[str] | None) -> None:
    words = sys.argv[1:] if arguments is None else arguments
    parser = _parser()
    chosen = parser.parse_args(words or ["--help"])
    telling.show(chosen.verbose)
    chosen.act(chosen)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="unlidar",
        description="Converts, simulates, tracks and measures LiDAR recordings of drones.",
        epilog="example: unlidar simulate demo out/demo && unlidar run out/demo",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    _add_convert(commands)
    _add_simulate(commands)
    _add_run(commands)
    _add_play(commands)
    _add_relay(commands)
    _add_watch(commands)
    _add_history(commands)
    text = "finds Livox LiDARs and makes them send their packets to unlidar_track --livox"
    sensor_command.define(_add(commands, "sensor", text, sensor_command.EXAMPLE))
    _add_evaluate(commands)
    _add_export(commands)
    _add_report(commands)
    _add_benchmark(commands)
    text = "what a shell needs to complete the command line"
    completion_command.define(
        _add(commands, "completion", text, completion_command.EXAMPLE), parser
    )
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


def _add_convert(commands: argparse._SubParsersAction) -> None:
    text = "recording -> frame directories and ground_truth.csv"
    p = _add(commands, "convert", text, convert_command.EXAMPLE)
    convert_command.define(p)
    _add_sensors(p, "default: all LiDARs; radars only if named")


def _add_simulate(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "simulate",
        "synthetic flight with exact truth -> frame directories",
        "unlidar simulate demo out/demo --seed 7",
    )
    known = ", ".join(scenario_names())
    p.add_argument("scenario", metavar="SCENARIO", help=f"a .yaml file, or one of {known}")
    p.add_argument("out", metavar="OUT", type=Path, help="folder to be written")
    p.add_argument("--seed", type=whole, default=1, help="same seed, same bytes (default: 1)")
    p.add_argument("--force", action="store_true", help="replace OUT if it was simulated before")
    p.add_argument(
        "--packets", metavar="FILE", type=Path,
        help="also write a capture of the packets that its Mid-360 and Avia would send",
    )  # fmt: skip
    p.set_defaults(act=_simulate)


def _add_run(commands: argparse._SubParsersAction) -> None:
    text = "converts if need be, tracks, evaluates, draws; one recording or many"
    p = _add(commands, "run", text, run_command.EXAMPLE)
    run_command.define(p)
    _add_sensors(p, "default: all found")


def _add_play(commands: argparse._SubParsersAction) -> None:
    text = "a recording as a live source: to a command, a stream or followed folders"
    p = _add(commands, "play", text, play_command.EXAMPLE)
    play_command.define(p)
    _add_sensors(p, "default: all found")


def _add_relay(commands: argparse._SubParsersAction) -> None:
    text = "events of a running station -> TAK, MQTT, WebSocket; alarms by zones"
    relay_command.define(_add(commands, "relay", text, relay_command.EXAMPLE))


def _add_watch(commands: argparse._SubParsersAction) -> None:
    text = "a page that shows a running station, its alarms and its last hours"
    watch_command.define(_add(commands, "watch", text, watch_command.EXAMPLE))


def _add_history(commands: argparse._SubParsersAction) -> None:
    text = "what a station has seen -> a list, CSV, GeoJSON, KML, mcap"
    history_command.define(_add(commands, "history", text, history_command.EXAMPLE))


def _add_evaluate(commands: argparse._SubParsersAction) -> None:
    text = "trajectory against truth: RMSE, per axis, coverage, false rows; one or many sequences"
    evaluate_command.define(_add(commands, "evaluate", text, evaluate_command.EXAMPLE))


def _add_export(commands: argparse._SubParsersAction) -> None:
    text = "trajectory to TUM, CSV, KML, GeoJSON, ROS 1 and 2 recordings, the UG2+ challenge's CSV"
    export_command.define(_add(commands, "export", text, export_command.EXAMPLE))


def _add_report(commands: argparse._SubParsersAction) -> None:
    text = "results of run -> one HTML page, figures for papers, a recording for rerun"
    report_command.define(_add(commands, "report", text, report_command.EXAMPLE))


def _add_benchmark(commands: argparse._SubParsersAction) -> None:
    text = "scenes x seeds x methods -> one table, with the published figures beside it"
    benchmark_command.define(_add(commands, "benchmark", text, benchmark_command.EXAMPLE))


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


# The sub-commands import what they need themselves: --help need not wait for matplotlib.


def _simulate(a: argparse.Namespace) -> None:
    from unlidar_tools.simulate import Simulation, load_scenario, packets, simulate

    scenario = load_scenario(a.scenario)
    sent_from = {} if a.packets is None else packets.addresses(scenario)
    report = simulate(scenario, a.out, a.seed, a.force)
    drones = len(report["scenario"]["drones"])
    print(printable(f"{a.out}: {_counts(report)}, {drones} drone(s)"))
    if a.packets is not None:
        packets.write_packets(Simulation(scenario, a.seed), a.packets)
        told = ", ".join(f"{sensor} at {address}" for sensor, address in sent_from.items())
        print(printable(f"{a.packets}: {told}"))


def _counts(report: dict) -> str:
    return ", ".join(
        f"{name} {frames} frames with {report['returns'][name]} returns"
        for name, frames in report["frames"].items()
    )
