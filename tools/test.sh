#!/usr/bin/env bash
# Installs what is missing, builds, and runs every check and test of the project.
set -euo pipefail

usage() {
  cat <<'TEXT'
Usage: tools/test.sh [--quick | --sanitize]

Checks the format and lints C++, Python and shell, runs the C++ and the Python tests, then those of
the program once more with the sanitizers for memory and undefined behaviour, which also measures
line coverage, those of what runs on several threads with that for data races, and each fuzzer for 20
seconds. Exit code 0 if all of them pass.

  --quick     without sanitizers, coverage and fuzzers: while working on something
  --sanitize  only the tests with sanitizers and the line coverage

Works from any folder; tests that need ../shared skip without it. Everything takes 35 to 60 minutes on
a bare machine with two processors, a part seconds or minutes where nothing that it depends on changed.
TEXT
}

# shellcheck source=tools/setup.sh
source "$(dirname -- "${BASH_SOURCE[0]}")/setup.sh"

least_coverage=95 # per cent of the lines of the program
threaded_tests=(parallel_test frames_test tracker_test livox_receiver_test) # of all that runs on several threads

case ${1:-} in
  '') parts=(quick sanitize fuzz) ;;
  --quick) parts=(quick) ;;
  --sanitize) parts=(sanitize) ;;
  -h | --help) usage; exit 0 ;;
  *) usage >&2; fail "unexpected argument '$1'" ;;
esac
(($# <= 1)) || { usage >&2; fail "expected one option, got $#"; }
# does PART: whether it was asked for.
does() {
  [[ " ${parts[*]} " == *" $1 "* ]]
}

check_root_is_writable
install_packages "${build_packages[@]}" "${check_packages[@]}" "${package_packages[@]}" \
  "${sanitize_packages[@]}" "${arm64_packages[@]}"
make_venv test

cd -- "$root"
jobs=$(nproc)
# A file's tests share what takes long to make. They wait for clocks, servers and browsers for a third of
# their time: half as many again as there are processors keep those busy.
pytest=("$venv/bin/python" -m pytest --numprocesses "$(((jobs * 3 + 1) / 2))" --dist loadfile
  --no-loadscope-reorder --durations 20)
# First, so that none of them is the last to end.
longest=(python_tests/test_{arm64,run_many,watch_browser,report_browser,docs,watch_soak}.py)
failed=()
durations=()
# took SECONDS NAME: for the table at the end.
took() {
  durations+=("$(printf '%5d s  %s' "$1" "$2")")
}
# timed NAME COMMAND...: notes how long the command takes; its exit code is the command's.
timed() {
  local name=$1 start=$SECONDS code=0
  shift
  "$@" || code=$?
  took "$((SECONDS - start))" "$name"
  return "$code"
}
# check NAME COMMAND...: all checks run, even after one has failed.
check() {
  say "$1"
  timed "$@" </dev/null || failed+=("$1")
}

took "$SECONDS" "Set-up"

mapfile -d '' -t cpp_headers < <(find include src -name '*.hpp' -print0 | sort -z)
mapfile -d '' -t cpp_units < <(find src -name '*.cpp' -print0 | sort -z)
mapfile -d '' -t cpp_rules < <(find .clang-tidy src -name .clang-tidy -print0 | sort -z)

# tidy: lints each folder of the library, and some tests at a time, as one file that includes its sources,
# as most of the time goes into foreign headers, and every other .cpp alone; where it has changed since
# it last passed, or all when a header, a compiler option or a rule has.
tidy() {
  local passed=$lint_dir/passed common unit key
  local -a folders units=() pending=()
  configure_in "$lint_dir" -DUNLIDAR_UNITY=ON -DUNLIDAR_JOINED_TESTS=ON
  mkdir -p -- "$passed"
  mapfile -t folders < <(grep -o '"file": ".*_cxx\.cxx' "$lint_dir/compile_commands.json" | cut -d '"' -f 4)
  units=("${folders[@]}") # first, as they take longest
  for unit in "${cpp_units[@]}"; do
    grep -qF "/$unit\"" "${folders[@]}" || units+=("$unit")
  done
  common=$(cat -- "${cpp_rules[@]}" "${cpp_headers[@]}" "$lint_dir/compile_commands.json" | sha256sum)
  for unit in "${units[@]}"; do
    key=$({ printf '%s\n' "$common" "$unit" && cat -- "$unit" &&
      sed -n 's/^#include "\(.*\.cpp\)"$/\1/p' "$unit" | xargs cat; } </dev/null | sha256sum)
    [[ -e $passed/${key%% *} ]] || pending+=("$unit" "$passed/${key%% *}")
  done
  echo "$((${#pending[@]} / 2)) of ${#units[@]} to look at"
  ((${#pending[@]})) || return 0
  # The count of suppressed warnings in foreign headers is noise.
  # shellcheck disable=SC2016  # the inner shell is the one to expand them
  printf '%s\0' "${pending[@]}" |
    xargs -0 -n 2 -P "$jobs" bash -c '
      case $1 in
        */all_tests.dir/*.cxx) options=(--config-file=src/tests/.clang-tidy) ;;
        *) options=() ;;
      esac
      clang-tidy --quiet -p "$0" "${options[@]}" "$1" && touch -- "$2"' \
      "$lint_dir" 2> >(grep -v -E '^[0-9]+ warnings? generated\.$' >&2)
}

# covered: shows how many lines of the program the tests with sanitizers have run, file by file, keeps
# a page with each line in out/coverage, and fails where it is less than least_coverage.
covered() {
  local profile=$sanitize_dir/profile table=$root/out/coverage/table.txt
  local -a programs options
  mkdir -p -- "$(dirname -- "$table")"
  mapfile -t programs < <(find "$sanitize_dir/src/tests" -maxdepth 1 -type f -name '*_test*' -perm -u+x | sort)
  options=(-instr-profile="$profile/all.profdata" "$sanitize_dir/unlidar_track"
    "${programs[@]/#/-object=}" "$root/src" "$root/include"
    -ignore-filename-regex='/src/(tests|fuzz|bench)/')
  # A program that is killed while it ends, as some are here, leaves a file that cannot be read.
  llvm-profdata merge -failure-mode=all -o "$profile/all.profdata" "$profile"/*.profraw || return
  # Functions that one of the programs uses and another has for nothing are said not to match.
  {
    llvm-cov show -format=html -output-dir="$root/out/coverage" "${options[@]}" &&
      llvm-cov report -show-region-summary=0 -show-branch-summary=0 "${options[@]}"
  } 2> >(grep -v 'functions have mismatched data' >&2) | tee -- "$table" || return
  awk -v least="$least_coverage" \
    '$1 == "TOTAL" { total = $NF + 0 } END { exit !(total >= least) }' "$table" || {
    echo "less than $least_coverage % of the lines"
    return 1
  }
}

if does quick; then
  timed "Build" build all
  check "Format of C++" clang-format --dry-run -Werror "${cpp_headers[@]}" "${cpp_units[@]}"
  check "Lint of C++" tidy
  check "Lint of shell" shellcheck -x tools/*.sh .ci/run
  check "Lint of Python" "$venv/bin/ruff" check setup.py tools python_tests docs
  check "Format of Python" "$venv/bin/ruff" format --check setup.py tools python_tests docs
  check "C++ tests" ctest --test-dir "$build_dir" --output-on-failure --parallel "$jobs"
  check "Python tests" env UNLIDAR_TRACK="$build_dir/unlidar_track" \
    "${pytest[@]}" "${longest[@]}" python_tests/test_*.py
fi
if does sanitize; then
  timed "Build with sanitizers" build_sanitized all
  rm -rf -- "$sanitize_dir/profile"
  export LLVM_PROFILE_FILE=$sanitize_dir/profile/%4m.profraw # four files a program, which all its runs share
  # An oracle that goes through all paths takes minutes there.
  check "C++ tests with sanitizers" env GTEST_FILTER='-*Enumeration*' \
    ctest --test-dir "$sanitize_dir" --output-on-failure --parallel "$jobs"
  # A limit of memory leaves the sanitizers none; whole scenes take them minutes; the same bytes for any
  # number of threads are nothing that they look for. These few files differ too much to go one by one.
  check "Command line with sanitizers" env UNLIDAR_TRACK="$sanitize_dir/unlidar_track" \
    "${pytest[@]}" --dist worksteal python_tests/test_{bad_input,cli_contract,outputs,live_stdin,live_follow,livox}.py \
    -k 'not bounded_memory and not every_malformed_file and not keeps_its_memory and not scenes and not thread_count'
  check "Line coverage" covered
  export TSAN_OPTIONS=suppressions=$root/tools/threads.supp
  timed "Build for several threads" build_for_threads "${threaded_tests[@]}"
  check "C++ tests with several threads" env GTEST_FILTER='-*Enumeration*' \
    ctest --test-dir "$threads_dir" --output-on-failure --parallel "$jobs" \
    -R "^($(IFS='|'; printf '%s' "${threaded_tests[*]}"))\$"
fi
if does fuzz; then
  check "Fuzzers" tools/fuzz.sh 20s
fi

say "What took how long"
printf '%s\n' "${durations[@]}"

((${#failed[@]} == 0)) || fail "failed: $(IFS=,; printf '%s' "${failed[*]}")"
