#!/usr/bin/env bash
# Installs what is missing, builds, and runs every check and test of the project.
set -euo pipefail

usage() {
  cat <<'TEXT'
Usage: tools/test.sh

Checks the format and lints C++, Python and shell, then runs the C++ and the Python tests.
Exit code 0 if all of them pass. Works from any folder; tests that need ../shared skip without it.
TEXT
}

# shellcheck source=tools/setup.sh
source "$(dirname -- "${BASH_SOURCE[0]}")/setup.sh"

case ${1:-} in
  '') ;;
  -h | --help) usage; exit 0 ;;
  *) usage >&2; fail "unexpected argument '$1'" ;;
esac

check_root_is_writable
install_packages "${build_packages[@]}" "${check_packages[@]}"
build all
make_venv test

cd -- "$root"
jobs=$(nproc)
failed=()
# check NAME COMMAND...: all checks run, even after one has failed.
check() {
  local name=$1
  shift
  say "$name"
  "$@" </dev/null || failed+=("$name")
}

mapfile -d '' -t cpp_headers < <(find include src -name '*.hpp' -print0 | sort -z)
mapfile -d '' -t cpp_units < <(find src -name '*.cpp' -print0 | sort -z)
mapfile -d '' -t cpp_rules < <(find .clang-tidy src -name .clang-tidy -print0 | sort -z)

# tidy: lints every .cpp that has changed since it last passed, or all when a header, a compiler
# option or a rule has: five minutes on two cores, and none when nothing has.
tidy() {
  local passed=$build_dir/tidy common unit key
  local -a pending=()
  mkdir -p -- "$passed"
  common=$(cat -- "${cpp_rules[@]}" "${cpp_headers[@]}" "$build_dir/compile_commands.json" | sha256sum)
  for unit in "${cpp_units[@]}"; do
    key=$({ printf '%s\n' "$common" "$unit" && cat -- "$unit"; } | sha256sum)
    [[ -e $passed/${key%% *} ]] || pending+=("$unit" "$passed/${key%% *}")
  done
  echo "$((${#pending[@]} / 2)) of ${#cpp_units[@]} files to look at"
  ((${#pending[@]})) || return 0
  # The count of suppressed warnings in foreign headers is noise.
  # shellcheck disable=SC2016  # the inner shell is the one to expand them
  printf '%s\0' "${pending[@]}" |
    xargs -0 -n 2 -P "$jobs" bash -c 'clang-tidy --quiet -p "$0" "$1" && touch -- "$2"' \
      "$build_dir" 2> >(grep -v -E '^[0-9]+ warnings? generated\.$' >&2)
}

check "Format of C++" clang-format --dry-run -Werror "${cpp_headers[@]}" "${cpp_units[@]}"
check "Lint of C++" tidy
check "Lint of shell" shellcheck -x tools/*.sh .ci/run
check "Lint of Python" "$venv/bin/ruff" check tools python_tests
check "Format of Python" "$venv/bin/ruff" format --check tools python_tests
check "C++ tests" ctest --test-dir "$build_dir" --output-on-failure --parallel "$jobs"
export UNLIDAR_TRACK=$build_dir/unlidar_track
check "Python tests" "$venv/bin/python" -m pytest python_tests

((${#failed[@]} == 0)) || fail "failed: $(IFS=,; printf '%s' "${failed[*]}")"
