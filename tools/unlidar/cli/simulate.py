"""`unlidar simulate`: options and output."""

import argparse
from pathlib import Path

from unlidar.cli.arguments import whole
from unlidar.cli.convert import counts_of
from unlidar.configs import scenario_names
from unlidar.sanitize import printable

EXAMPLE = "unlidar simulate demo out/demo --seed 7"


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    known = ", ".join(scenario_names())
    p.add_argument("scenario", metavar="SCENARIO", help=f"a .yaml file, or one of {known}")
    p.add_argument("out", metavar="OUT", type=Path, help="folder to be written")
    p.add_argument("--seed", type=whole, default=1, help="same seed, same bytes (default: 1)")
    p.add_argument("--force", action="store_true", help="replace OUT if it was simulated before")
    p.add_argument(
        "--packets",
        metavar="FILE",
        type=Path,
        help="also write a capture of the packets that its Mid-360 and Avia would send",
    )
    p.set_defaults(act=_simulate)


def _simulate(a: argparse.Namespace) -> None:
    from unlidar.simulate import Simulation, load_scenario, packets, simulate

    scenario = load_scenario(a.scenario)
    sent_from = {} if a.packets is None else packets.addresses(scenario)
    report = simulate(scenario, a.out, a.seed, a.force)
    drones = len(report["scenario"]["drones"])
    print(printable(f"{a.out}: {counts_of(report)}, {drones} drone(s)"))
    if a.packets is not None:
        packets.write_packets(Simulation(scenario, a.seed), a.packets)
        told = ", ".join(f"{sensor} at {address}" for sensor, address in sent_from.items())
        print(printable(f"{a.packets}: {told}"))
