#!/usr/bin/env bash
# Builds the program for arm64 on another machine and compares it with that machine's.
set -euo pipefail

usage() {
  cat <<'TEXT'
Usage: tools/arm64.sh [--quick]

Builds the program for arm64 with Debian's cross compiler, against packages of arm64 that are unpacked
in build-arm64-sysroot/, and runs it in qemu's emulation: the C++ tests but those that need PCL's
reader, run other programs or measure time, and recordings as a whole and live. Live rows and events must be
those of the program that is built for this machine, byte for byte; rows of a recording as a whole, which
Ceres fits, the same to 1e-6 m. The recordings are simulated; ../shared has a real one. Then tells how large
the program and its libraries are.

  --quick  one recording, and those C++ tests only that are all arithmetic

Works from any folder. The first run takes about a quarter of an hour, with --quick some minutes.
TEXT
}

# shellcheck source=tools/setup.sh
source "$(dirname -- "${BASH_SOURCE[0]}")/setup.sh"

recordings=(near two people takeoff clocks)
tests=(all)
which_tests=.
case ${1:-} in
  '') ;;
  --quick)
    recordings=(near)
    tests=(unlidar_track spline_test track_model_test)
    which_tests='^(spline|track_model)_test\.'
    ;;
  -h | --help) usage; exit 0 ;;
  *) usage >&2; fail "unexpected argument '$1'" ;;
esac
(($# <= 1)) || { usage >&2; fail "expected one option, got $#"; }
[[ $(uname -m) != aarch64 ]] || fail "this machine is arm64: tools/test.sh tests the program on it"

check_root_is_writable
install_packages "${build_packages[@]}" "${arm64_packages[@]}"
build unlidar_track
make_arm64_sysroot
build_for_arm64 "${tests[@]}"
make_venv ''

# Not those that run the program or a compiler themselves: nobody would tell qemu. Nor those of time,
# of which the emulation takes as much as it likes.
say "C++ tests"
ctest --test-dir "$arm64_dir" --output-on-failure --parallel "$(nproc)" \
  --tests-regex "$which_tests" --exclude-regex '^(allocation_test|consumer|memory_test\.CostTest)\.' ||
  fail "C++ tests failed on arm64"

work=$root/out/arm64
mkdir -p -- "$work"
here=$build_dir/unlidar_track
there=(qemu-aarch64-static -L "$arm64_sysroot" "$arm64_dir/unlidar_track")

# track METHOD OUTPUT PROGRAM...: the recording in $frames and $stream, into OUTPUT.csv and OUTPUT.also.
track() {
  local method=$1 out=$2
  shift 2
  if [[ $method == live ]]; then
    "$@" --quiet --stdin --out "$out.csv" --events "$out.also" <"$stream"
  else
    "$@" --quiet --set "method=$method" "${frames[@]}" --out "$out.csv" --points "$out.also"
  fi || fail "'$*' failed"
}

# same_rows HERE THERE: but for a micrometre in positions, velocities and sigmas.
same_rows() {
  paste -d, -- "$1" "$2" | awk -F, '
    NF != 24 { exit 1 }
    {
      for (i = 1; i <= 12; ++i) {
        is_length = i > 2 && i < 12
        if (is_length && NR > 1 ? ($i - $(i + 12)) ^ 2 > 1.01e-12 : $i "" != $(i + 12) "") exit 1
      }
    }'
}

differing=()
# compare NAME RECORDING: tracks it here and there.
compare() {
  local name=$1 sensor method
  local frames=() stream=$work/$name.stream
  for sensor in "$2"/*/; do
    compgen -G "$sensor*.pcd" >/dev/null || continue
    frames+=(--frames "$(basename "$sensor")=$sensor")
  done
  "$venv/bin/unlidar" play "$2" --rate inf >"$stream" 2>"$setup_log" ||
    fail "$name could not be played (whole output: $setup_log)"
  for method in robust paper live; do
    rm -f -- "$work"/{here,there}.{csv,also}
    track "$method" "$work/here" "$here"
    track "$method" "$work/there" "${there[@]}"
    printf '%-10s %-7s %5d rows: ' "$name" "$method" "$(($(wc -l <"$work/here.csv") - 1))"
    if cmp -s "$work/here.csv" "$work/there.csv" && cmp -s "$work/here.also" "$work/there.also"; then
      echo the same bytes
    elif [[ $method != live ]] && same_rows "$work"/{here,there}.csv &&
      cmp -s "$work/here.also" "$work/there.also"; then
      echo the same to 1e-6 m
    else
      printf '%d others\n' "$(diff -- "$work"/{here,there}.csv | grep -c '^>' || true)"
      differing+=("$name $method")
    fi
  done
  rm -f -- "$stream"
}

say "Rows of arm64 and of $(uname -m)"
for name in "${recordings[@]}"; do
  [[ -d $work/$name ]] ||
    quietly "$name could not be simulated" "$venv/bin/unlidar" simulate "$name" "$work/$name"
  compare "$name" "$work/$name"
done
real=$root/../shared/data/mmaud/val/seq0001
if [[ ${1:-} != --quick && -d $real ]]; then
  [[ -d $work/seq0001 ]] ||
    quietly "$real could not be converted" "$venv/bin/unlidar" convert "$real" "$work/seq0001"
  compare seq0001 "$work/seq0001"
fi

say "Size"
aarch64-linux-gnu-strip -o "$work/unlidar_track" "$arm64_dir/unlidar_track"
mapfile -t libraries < <(qemu-aarch64-static -L "$arm64_sysroot" -E LD_TRACE_LOADED_OBJECTS=1 \
  "$arm64_dir/unlidar_track" | grep -o '/[^ ]*')
# megabytes FILE...: of them together.
megabytes() {
  stat --dereference --format=%s -- "$@" | awk '{ sum += $1 } END { printf "%.1f MB", sum / 1e6 }'
}
printf 'program, stripped: %s; its %d libraries, the C library among them: %s\n' \
  "$(megabytes "$work/unlidar_track")" "${#libraries[@]}" \
  "$(megabytes "${libraries[@]/#/$arm64_sysroot}")"

((${#differing[@]} == 0)) || fail "other rows on arm64: $(IFS=,; printf '%s' "${differing[*]}")"
