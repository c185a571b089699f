#!/usr/bin/env bash
# Renews the exact versions and hashes of the Python packages that the other scripts install.
set -euo pipefail

usage() {
  cat <<'TEXT'
Usage: tools/lock.sh

Asks the package index for the newest releases that fit pyproject.toml and one another, and writes

  tools/requirements.txt        the plain harness, and the setuptools that installs it
  tools/requirements-test.txt   on top of those, the extra `test` and a package that stands alone

with the hashes of every file of each release, for any kind of machine. The other scripts install from
these files alone; tools/test.sh then tells whether the new releases do. pyproject.toml keeps the oldest
releases that a user may have.

Needs a network and takes about seven minutes. Works from any folder.
TEXT
}

# shellcheck source=tools/setup.sh
source "$(dirname -- "${BASH_SOURCE[0]}")/setup.sh"

case ${1:-} in
  '') ;;
  -h | --help) usage; exit 0 ;;
  *) usage >&2; fail "unexpected argument '$1'" ;;
esac

pip_tools='pip-tools==7.6.2'
work=$root/out/lock

check_root_is_writable
# Of the Python of Debian 12, whatever there is in PATH: another one needs other packages.
python=/usr/bin/python3
"$python" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null ||
  fail "$python with venv, of version 3.11, is needed"
rm -rf -- "$work"
mkdir -p -- "$work"
say "Installing $pip_tools in $work"
quietly "pip-tools could not be installed; is there a network?" "$python" -m venv "$work/venv"
quietly "pip-tools could not be installed; is there a network?" \
  "$work/venv/bin/python" -m pip install --disable-pip-version-check "$pip_tools"

# compile OUTPUT ARGUMENT...: exact versions of what is asked for and of all that it needs. The index is
# the public one, whatever this machine has beside it.
compile() {
  local output=$1
  shift
  say "Choosing releases for ${output##*/}"
  quietly "releases that fit could not be found; is there a network?" \
    env PIP_CONFIG_FILE=/dev/null PIP_FIND_LINKS= PIP_EXTRA_INDEX_URL= "$work/venv/bin/pip-compile" \
    --generate-hashes --allow-unsafe --strip-extras --no-annotate --no-header --no-emit-options \
    --no-emit-index-url --no-emit-find-links --no-emit-trusted-host --output-file "$output" "$@"
}

# entries_of FILE: its packages with their hashes, one a line, sorted.
entries_of() {
  sed -e ':join' -e '/\\$/{N; s/ *\\\n */ /; b join}' -- "$1" |
    grep '==' | LC_ALL=C sort
}

# write_lock FILE: what comes, with a hash a line.
write_lock() {
  { echo '# Made by tools/lock.sh, do not edit.'; sed 's/ --hash/ \\\n    --hash/g'; } >"$work/lock"
  mv -- "$work/lock" "$root/tools/$1"
}

project=$root/pyproject.toml
compile "$work/all.txt" --build-deps-for editable --extra test "$project"
compile "$work/plain.txt" --build-deps-for editable --constraint "$work/all.txt" "$project"
printf '%s\n' "$lone_python_package" >"$work/lone.in"
compile "$work/lone.txt" "$work/lone.in"

entries_of "$work/plain.txt" | write_lock requirements.txt
{
  echo '-r requirements.txt'
  LC_ALL=C comm -13 <(entries_of "$work/plain.txt") <(entries_of "$work/all.txt")
  entries_of "$work/lone.txt" | grep "^${lone_python_package%%[<>=]*}=="
} | write_lock requirements-test.txt
say "Wrote tools/requirements.txt and tools/requirements-test.txt"
