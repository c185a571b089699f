#!/usr/bin/env bash
# From a bare machine to a tracked drone in one command.
set -euo pipefail

usage() {
  cat <<'TEXT'
Usage: tools/demo.sh [RECORDING]

Installs what is missing, builds the program, simulates a flight, tracks its drone, prints RMSE and
coverage and draws a figure. With RECORDING (a folder of frames or any recording that
`unlidar convert` reads) it does the same for that one:

    tools/demo.sh
    tools/demo.sh ../shared/data/mmaud/val/seq0001

Results are written to out/run/ in the project's folder. Works from any folder. The first run takes a
network, 3.5 GB of disk, nearly all of it for packages, and 3 to 6 minutes on a bare machine with two
processors; later ones take half a minute and no network.
TEXT
}

# shellcheck source=tools/setup.sh
source "$(dirname -- "${BASH_SOURCE[0]}")/setup.sh"

case ${1:-} in
  -h | --help) usage; exit 0 ;;
  -*) usage >&2; fail "unknown option '$1'" ;;
esac
(($# <= 1)) || { usage >&2; fail "expected at most one recording, got $#"; }
if (($# == 1)); then
  [[ -e $1 ]] || fail "no such recording: '$1' (in $PWD)"
fi

check_root_is_writable
install_packages "${build_packages[@]}"
build unlidar_track unlidar_python
make_venv ''

unlidar=$venv/bin/unlidar
export UNLIDAR_TRACK=$build_dir/unlidar_track
if (($# == 1)); then
  recording=$(realpath -- "$1")
else
  recording=$root/out/demo
  say "Simulating a flight"
  "$unlidar" simulate demo "$recording" --force
fi
say "Tracking"
"$unlidar" run "$recording" --out "$root/out/run/$(basename -- "$recording")"
