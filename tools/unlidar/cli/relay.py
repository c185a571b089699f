"""`unlidar relay`: its options."""

import argparse
import asyncio
from dataclasses import replace
from pathlib import Path

from unlidar.errors import UsageError
from unlidar.extras import need_station

EXAMPLE = """unlidar relay events.jsonl --site site.yaml --to cot+udp://239.2.3.1:6969
  unlidar relay events.jsonl sapient+tcp://10.0.0.5:5020 --site site.yaml
  unlidar relay events.jsonl --to mqtt://broker.local --to ws://127.0.0.1:8765
  unlidar_track --stdin --out traj.csv --events - | unlidar relay - --site site.yaml"""


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    p.add_argument(
        "events",
        metavar="EVENTS",
        help="of unlidar_track --events: a file, which is followed as it grows; - for stdin; "
        "tcp://HOST:PORT",
    )
    p.add_argument(
        "urls",
        metavar="URL",
        nargs="*",
        help="cot+udp://, cot+tcp:// or cot+tls://HOST:PORT for TAK; sapient+tcp://HOST:PORT of a "
        "SAPIENT middleware; mqtt:// or mqtts://[USER:PASSWORD@]HOST[:PORT]; ws://HOST:PORT, where "
        "a server is opened. Added to the outputs of the site",
    )
    p.add_argument(
        "--to",
        metavar="URL",
        action="append",
        default=[],
        help="one more URL; may be given several times",
    )
    p.add_argument(
        "--site",
        metavar="FILE",
        type=Path,
        help="YAML with name and origin of the station, its outputs and its rules for alarms",
    )
    p.add_argument(
        "--all",
        action="store_true",
        help="send also what a file held before (default: what comes from now on)",
    )
    p.add_argument(
        "--store",
        metavar="FILE",
        type=Path,
        help="keep everything in a SQLite file too, for unlidar history and watch",
    )
    p.set_defaults(act=act)


def act(a: argparse.Namespace) -> None:
    """Runs until the source ends, or until SIGINT or SIGTERM, which are no errors."""
    need_station("relay", ("paho", "shapely", "websockets"))
    from unlidar.events.site import Output, Site, load_site
    from unlidar.events.source import open_source

    site = load_site(a.site) if a.site is not None else Site()
    site = replace(site, outputs=(*site.outputs, *(Output(to=url) for url in (*a.urls, *a.to))))
    if not site.outputs and a.store is None:
        raise UsageError("nobody to tell: give a URL, outputs in the file of --site, or --store")
    if a.events.startswith(("mqtt://", "mqtts://")):
        raise UsageError(f"'{a.events}', expected the events of one engine")
    source = open_source(a.events, whole=a.all or a.store is not None)

    async def run() -> None:
        from unlidar.history.keeper import keeping
        from unlidar.relay.run import make_way, relay

        ways = [make_way(o, site) for o in site.outputs]
        async with keeping(a.store, site) as keep:
            await relay(source, site, ways, a.all, keep)

    asyncio.run(run())
