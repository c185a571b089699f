#!/usr/bin/env bash
# Makes what others install: Debian packages and a wheel.
set -euo pipefail

usage() {
  cat <<'TEXT'
Usage: tools/package.sh

Installs what is missing, builds, and writes to out/packages/:

  unlidar-track_VERSION_ARCH.deb              the program, its manual page and its service
  libunlidar-dev_VERSION_ARCH.deb             the C++ API: headers, static library, CMake configuration
  unlidar_track-VERSION-PYTHON-PLATFORM.whl   for Python: engine, harness, program, all that they link

The version is that of CMakeLists.txt. Works from any folder.
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
install_packages "${build_packages[@]}" "${package_packages[@]}"
make_venv test

# The same sources give the same packages, whoever may read what lies in the tree.
umask 022
packages=$root/out/packages
rm -rf -- "$packages" "$root/out/wheel" "$root/tools/build"
mkdir -p -- "$packages"
SOURCE_DATE_EPOCH=$(git -C "$root" log -1 --format=%ct 2>/dev/null || stat -c %Y -- "$root/CHANGELOG.md")
export SOURCE_DATE_EPOCH
build unlidar_python package_files
say "Packing"
quietly "CPack could not make the packages" \
  cpack --config "$build_dir/CPackConfig.cmake" -B "$packages"
rm -rf -- "$packages/_CPack_Packages"
quietly "pip could not make the wheel" \
  "$venv/bin/python" -m pip wheel --disable-pip-version-check --no-deps --no-build-isolation \
  --wheel-dir "$root/out/wheel" "$root/tools"
# Libraries that not every Linux has go into it; its name then says how old a C library will do.
quietly "auditwheel could not complete the wheel" env PATH="$venv/bin:$PATH" \
  "$venv/bin/python" -m auditwheel repair --strip --wheel-dir "$packages" "$root"/out/wheel/*.whl
ls -- "$packages"
