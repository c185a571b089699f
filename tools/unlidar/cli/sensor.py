"""`unlidar sensor`: options and action."""

import argparse
import ipaddress
import time

from unlidar.errors import InputError

EXAMPLE = "unlidar sensor livox --host 192.168.1.5 --lidar 192.168.1.12"

_PORT = 56301
_STARTS_WITHIN_S = 30.0  # the motor takes 10 s


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    p.add_argument(
        "maker",
        choices=("livox",),
        help="of Mid-360 and HAP; an Avia is started by its maker's software",
    )
    p.add_argument(
        "--host",
        metavar="IP",
        type=_address,
        required=True,
        help="address of this computer in the LiDAR's network, to which the packets shall go",
    )
    p.add_argument(
        "--lidar",
        metavar="IP",
        type=_address,
        help="address of the LiDAR (default: list those that answer, and change nothing)",
    )
    p.add_argument(
        "--port",
        metavar="PORT",
        type=_port,
        default=_PORT,
        help=f"at which unlidar_track --livox listens (default: {_PORT})",
    )
    p.add_argument(
        "--stop", action="store_true", help="ends the measuring instead: laser and motor off"
    )
    p.add_argument(
        "--discovery-port",
        metavar="PORT",
        type=_port,
        default=56000,
        help="at which LiDARs listen for who looks for them (default: 56000)",
    )
    p.set_defaults(act=_act)


def _act(a: argparse.Namespace) -> None:
    from unlidar.livox_control import IDLE, SAMPLING, control, discover

    if a.lidar is None:
        found = discover(a.host, port=a.discovery_port)
        if not found:
            raise InputError(f"no Livox LiDAR answers in the network of {a.host}")
        print("\n".join(map(str, found)))
        return
    found = discover(a.host, a.lidar, a.discovery_port)
    if not found:
        raise InputError(
            f"{a.lidar}: does not answer, expected a Livox LiDAR in the network of {a.host}; "
            "without --lidar all that answer are listed"
        )
    mode, name = (IDLE, "idle") if a.stop else (SAMPLING, "measuring")
    with control(a.host, found[0]) as lidar:
        if not a.stop:
            lidar.send_points_to(a.port)
        lidar.set_mode(mode)
        end = time.monotonic() + _STARTS_WITHIN_S
        while (state := lidar.state()).mode != mode:
            if time.monotonic() > end:
                raise InputError(f"{a.lidar}: is not {name} but in state {state.mode}")
            time.sleep(0.2)
    where = "" if a.stop else f", sends to {a.host}:{a.port}"
    print(f"{found[0]}, {name}, clock {state.clock}{where}")


def _address(text: str) -> str:
    try:
        return str(ipaddress.IPv4Address(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}', expected an IPv4 address") from None


def _port(text: str) -> int:
    if not (text.isdecimal() and 0 < int(text) < 65536):
        raise argparse.ArgumentTypeError(f"'{text}', expected a port, 1 to 65535")
    return int(text)
