#!/usr/bin/env bash
# Feeds the parsers and the whole pipeline what nobody would write, and watches.
set -euo pipefail

usage() {
  cat <<'TEXT'
Usage: tools/fuzz.sh [--runs N] TIME [TARGET...]

Builds the fuzzers of src/fuzz/ with clang and its address and undefined behaviour sanitizers, and
runs each TARGET (without one, all) for a TIME in minutes, or with an s behind it in seconds, as many
at a time as there are processors:

    tools/fuzz.sh 10
    tools/fuzz.sh 30s
    tools/fuzz.sh --runs 10000000 600 pcd

  --runs N   ends a target after N executions, if that is sooner

Inputs that reach new code are kept in build-sanitize/corpus/TARGET: the next run goes on from there.
A find ends its target, is kept in out/fuzz/TARGET/ and makes the exit code 1. A single input is run
again with: build-sanitize/src/fuzz/TARGET_fuzz FILE. Works from any folder.
TEXT
}

# shellcheck source=tools/setup.sh
source "$(dirname -- "${BASH_SOURCE[0]}")/setup.sh"

# fuzz TARGET: one line about the run; 1 and the end of the log if there was a find.
fuzz() {
  local target=$1 status=0
  local seeds=$root/src/fuzz/corpus/$target kept=$sanitize_dir/corpus/$target
  local finds=$root/out/fuzz/$target log=$root/out/fuzz/$target.log
  mkdir -p -- "$kept" "$finds"
  # Less time and memory than these is promised for any input of this size.
  "$sanitize_dir/src/fuzz/${target}_fuzz" -max_total_time="$seconds" -runs="$runs" \
    -max_len=1024 -timeout=60 -rss_limit_mb=1024 -print_final_stats=1 \
    -artifact_prefix="$finds/" "$kept" "$seeds" >"$log" 2>&1 </dev/null || status=1
  if ((status)); then
    grep -E -A 12 'BROKEN LAW|ERROR:|runtime error|terminate called' "$log" || tail -n 20 -- "$log"
  fi
  printf '%s: %s executions, %s\n' "$target" \
    "$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")" \
    "$( ((status)) && echo "A FIND, see $log and $finds" || echo 'no find')"
  return "$status"
}

runs=-1
targets=()
while (($#)); do
  case $1 in
    -h | --help) usage; exit 0 ;;
    --runs) runs=${2:-}; shift ;;
    -*) usage >&2; fail "unknown option '$1'" ;;
    *) targets+=("$1") ;;
  esac
  shift || fail "--runs: expected a number of executions behind it"
done
[[ $runs =~ ^(-1|[1-9][0-9]*)$ ]] || fail "--runs '$runs': expected a whole number above 0"
((${#targets[@]})) || { usage >&2; fail "expected a number of minutes or seconds"; }
duration=${targets[0]}
targets=("${targets[@]:1}")
[[ $duration =~ ^([1-9][0-9]{0,5})(s?)$ ]] ||
  fail "'$duration': expected a whole number of minutes above 0, or of seconds, as in 30s"
seconds=$((BASH_REMATCH[1] * (${#BASH_REMATCH[2]} ? 1 : 60)))

mapfile -t known < <(cd -- "$root/src/fuzz" && printf '%s\n' *_fuzz.cpp | sed 's/_fuzz\.cpp$//')
((${#targets[@]})) || targets=("${known[@]}")
for target in "${targets[@]}"; do
  [[ " ${known[*]} " == *" $target "* ]] || fail "no target '$target', expected some of: ${known[*]}"
done

check_root_is_writable
install_packages "${build_packages[@]}" "${sanitize_packages[@]}"
build_sanitized "${targets[@]/%/_fuzz}"
say "Fuzzing ${targets[*]}, $seconds s each"

export root sanitize_dir seconds runs
export -f fuzz
# shellcheck disable=SC2016  # the inner shell is the one to expand it
printf '%s\0' "${targets[@]}" |
  xargs -0 -n 1 -P "$(nproc)" bash -c 'fuzz "$0"' || fail "something was found, see above"
