"""`unlidar watch`: its options."""

import argparse
import asyncio
from pathlib import Path

from unlidar.cli.arguments import positive, whole
from unlidar.errors import UsageError
from unlidar.extras import need_station
from unlidar.history import DAYS, MEGABYTES

EXAMPLE = """unlidar watch events.jsonl --site site.yaml --store sky.db
  unlidar watch events.jsonl --returns /run/unlidar/returns.jsonl
  unlidar watch tcp://127.0.0.1:4000 --address 0.0.0.0 --token-file /etc/unlidar/token
  unlidar_track --stdin --out traj.csv --events - | unlidar watch -"""
_PORT = 8377
_LEAST_TOKEN = 16


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    p.add_argument(
        "events",
        metavar="EVENTS",
        help="of unlidar_track --events: a file, which is followed as it grows; - for stdin; "
        "tcp://HOST:PORT. Or mqtt[s]://[USER:PASSWORD@]HOST[:PORT]: a broker to which the relays "
        "of several stations publish",
    )
    p.add_argument(
        "--returns",
        metavar="FILE",
        type=Path,
        help="show what the LiDARs see: of unlidar_track --event-returns-file, where the events "
        "hold no returns themselves",
    )
    p.add_argument(
        "--site",
        metavar="FILE",
        type=Path,
        help="YAML with name and origin of the station and its rules for alarms",
    )
    p.add_argument(
        "--store",
        metavar="FILE",
        type=Path,
        help="keep what was seen in a SQLite file, for the time line and unlidar history "
        "(default: in memory)",
    )
    p.add_argument(
        "--days",
        metavar="N",
        type=positive,
        default=DAYS,
        help="keep so many days (default: %(default)g)",
    )
    p.add_argument(
        "--megabytes",
        metavar="N",
        type=positive,
        default=MEGABYTES,
        help="and so much at most, the oldest goes first (default: %(default)g)",
    )
    p.add_argument(
        "--address",
        metavar="HOST",
        default="127.0.0.1",
        help="where to serve the page; other machines need --token-file (default: %(default)s)",
    )
    p.add_argument(
        "--port",
        type=whole,
        default=_PORT,
        help="0: any that is free (default: %(default)s)",
    )
    p.add_argument(
        "--token-file",
        metavar="FILE",
        type=Path,
        help="file with a secret; who calls the page with ?token=SECRET is let in",
    )
    p.add_argument(
        "--certificate", metavar="PEM", type=Path, help="serve by TLS with this certificate"
    )
    p.add_argument("--key", metavar="PEM", type=Path, help="and this key")
    p.set_defaults(act=act)


def act(a: argparse.Namespace) -> None:
    """Serves until SIGINT, SIGTERM or SIGHUP, which are no errors."""
    need_station("watch", ("paho", "shapely", "starlette", "uvicorn"))
    from unlidar.events.site import Site, load_site
    from unlidar.events.source import follow_file, open_source
    from unlidar.watch.gate import LOCAL
    from unlidar.watch.run import Served, watch

    token = _token(a.token_file)
    if a.address not in LOCAL and token is None:
        raise UsageError(
            f"--address {a.address}: other machines may call it, expected --token-file FILE too"
        )
    if a.port > 65535:
        raise UsageError(f"--port {a.port}: expected at most 65535")
    if a.key is not None and a.certificate is None:
        raise UsageError("--key needs --certificate")
    site = load_site(a.site) if a.site is not None else Site()
    served = Served(
        a.address,
        a.port,
        a.token_file,
        token,
        None if a.certificate is None else str(a.certificate),
        None if a.key is None else str(a.key),
        a.store,
        a.days,
        a.megabytes,
    )
    source = open_source(a.events, site.tls)
    if a.returns is not None and source.many:
        raise UsageError("--returns is for the events of one station, not for a broker's")
    returns = None if a.returns is None else follow_file(a.returns)
    asyncio.run(watch(source, returns, site, served))


def _token(path: Path | None) -> str | None:
    from unlidar.errors import ConfigError, reason

    if path is None:
        return None
    try:
        token = path.read_text(encoding="ascii").strip()
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot be read: {reason(error)}") from error
    if len(token) < _LEAST_TOKEN or not token.isalnum():
        raise ConfigError(
            f"{path}: expected at least {_LEAST_TOKEN} letters and digits, "
            "as 'openssl rand -hex 16' gives them"
        )
    return token
