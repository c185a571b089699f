#!/usr/bin/env bash
# Measures the program beside others and writes docs/performance.md.
set -euo pipefail

usage() {
  cat <<'TEXT'
Usage: tools/bench.sh [--quick] [--hour] [PART...]

Builds the program and what it is compared with, measures each PART (without one, all) by turns in
one run, so that ratios hold on a machine that others use too, and writes the tables of
docs/performance.md anew; its text stays.

    tools/bench.sh
    tools/bench.sh clustering pcd

  --quick  little of everything in three minutes, for out/bench/quick only: the page stays as it is
  --hour   a recording of an hour too

Parts: clustering, pcd, spline, whole, duration, live, moving (beside DUFOMap, a detector of all that
moves), swarm (1, 10 and 50 drones at once). All of them take about 40 minutes. Recordings are
simulated once and kept in out/bench/, beside every number as JSON. Works from any folder.
TEXT
}

# shellcheck source=tools/setup.sh
source "$(dirname -- "${BASH_SOURCE[0]}")/setup.sh"

known=(clustering pcd spline whole duration live moving swarm)
parts=()
page=(--page "$root/docs/performance.md")
options=()
while (($#)); do
  case $1 in
    -h | --help) usage; exit 0 ;;
    --quick) page=() options+=(--quick) ;;
    --hour) options+=(--hour) ;;
    -*) usage >&2; fail "unknown option '$1'" ;;
    *)
      [[ " ${known[*]} " == *" $1 "* ]] || fail "no part '$1', expected some of: ${known[*]}"
      parts+=("$1")
      ;;
  esac
  shift
done

check_root_is_writable
install_packages "${build_packages[@]}" "${bench_packages[@]}"
build unlidar_track clustering_bench pcd_bench trajectory_bench pcl_pipeline
make_venv test # with scikit-learn and DUFOMap
say "Measuring ${parts[*]:-everything}"
"$venv/bin/python" -m unlidar_bench --build "$build_dir" --work "$root/out/bench" \
  "${page[@]}" "${options[@]}" "${parts[@]}"
