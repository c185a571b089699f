#!/usr/bin/env bash
# Makes what others install: Debian packages, a wheel and a source distribution.
set -euo pipefail

usage() {
  cat <<'TEXT'
Usage: tools/package.sh [--arm64]

Installs what is missing, builds, and writes to out/packages/:

  unlidar-track_VERSION_ARCH.deb              the program, its manual page and its service
  libunlidar-dev_VERSION_ARCH.deb             the C++ API: headers, static library, CMake configuration
  unlidar_track-VERSION-PYTHON-PLATFORM.whl   for Python: engine, harness, program, all that they link
  unlidar_track-VERSION.tar.gz                the sources of that wheel, which pip builds where CMake,
                                              a compiler and the libraries are installed

  --arm64  only the wheel, for arm64, by Debian's cross compiler as in tools/arm64.sh, to
           out/packages-arm64/; runs its program and its engine in emulation

The version is that of CMakeLists.txt. Works from any folder.
TEXT
}

# shellcheck source=tools/setup.sh
source "$(dirname -- "${BASH_SOURCE[0]}")/setup.sh"

arm64=
case ${1:-} in
  '') ;;
  --arm64) arm64=yes ;;
  -h | --help) usage; exit 0 ;;
  *) usage >&2; fail "unexpected argument '$1'" ;;
esac
(($# <= 1)) || { usage >&2; fail "expected one option, got $#"; }

packages=$root/out/packages${arm64:+-arm64}
# Libraries that are compiled into program and engine, by Debian's names. Not Boost: what is compiled of
# it need not say so. auditwheel adds shared ones.
compiled_in=(libceres-dev libcli11-dev libeigen3-dev libflann-dev nlohmann-json3-dev pybind11-dev)

work=$root/out/wheel${arm64:+-arm64}
# make_wheel FOLDER [OPTION...]: of what CMake has built in FOLDER. Libraries that not every Linux has go
# into it, with their licences; its name then says how old a C library will do. The options are auditwheel's.
make_wheel() {
  local build=$1 multiarch wheel library file package
  shift
  multiarch=$(dpkg-architecture --query DEB_HOST_MULTIARCH)
  rm -rf -- "$work" "$root/build-wheel"
  mkdir -p -- "$work/licences" "$packages"
  quietly "pip could not make the wheel" env UNLIDAR_BUILD_DIR="$build" \
    "$venv/bin/python" -m pip wheel --disable-pip-version-check --no-deps --no-build-isolation \
    --wheel-dir "$work/built" "$root"
  quietly "auditwheel could not complete the wheel" env PATH="$venv/bin:$PATH" \
    "$venv/bin/python" -m auditwheel repair --strip "$@" --wheel-dir "$work" "$work"/built/*.whl
  wheel=$(printf '%s\n' "$work"/*.whl)
  for package in "${compiled_in[@]}"; do
    cp -L -- "/usr/share/doc/$package/copyright" "$work/licences/${package%-dev}.txt"
  done
  while IFS= read -r library; do
    # libglog-034500bc.so.0.6.0 was libglog.so.0.6.0.
    file=$(sed -E 's|.*/(.*)-[0-9a-f]{8}(\.so.*)|\1\2|' <<<"$library")
    package=$(dpkg-query --search "*/$multiarch/$file" | cut -d : -f 1)
    cp -L -- "/usr/share/doc/$package/copyright" "$work/licences/$package.txt"
  done < <("$venv/bin/python" -m zipfile --list "$wheel" | grep -o '^unlidar_track\.libs/[^ ]*\.so[^ ]*')
  quietly "licences could not be added to the wheel" \
    "$venv/bin/python" "$root/tools/wheel_licences.py" "$wheel" "$work/licences"
  mv -- "$wheel" "$packages"
}

# check_arm64_wheel: what an arm64 machine does with the wheel, in emulation, with what the engine imports.
check_arm64_wheel() {
  local site=$work/site emulated=(qemu-aarch64-static -L "$arm64_sysroot") platform
  local -a install=("$venv/bin/python" -m pip install --disable-pip-version-check --no-deps
    --only-binary :all: --target "$site")
  for platform in manylinux_2_{17,27,28,35}_aarch64 manylinux2014_aarch64; do
    install+=(--platform "$platform")
  done
  sed -nE '/^(annotated-types|numpy|pydantic(-core)?|ruamel-yaml|typing-[a-z]+)==/,/[^\\]$/p' \
    "$root/tools/requirements.txt" >"$work/requirements.txt"
  quietly "pip could not install packages of arm64; is there a network?" \
    "${install[@]}" --require-hashes --requirement "$work/requirements.txt"
  quietly "pip could not install the wheel" "${install[@]}" --no-index "$packages"/*.whl
  "${emulated[@]}" "$site/unlidar/bin/unlidar_track" --version
  PYTHONPATH=$site "${emulated[@]}" "$arm64_sysroot/usr/bin/python3.11" -c \
    'import platform, unlidar; unlidar.Engine().close(); print("import unlidar:", platform.machine())'
}

check_root_is_writable
exec {lock}>"$root/out/package.lock"
flock "$lock" # two of these would write to the same folders
# The same sources give the same packages, whoever may read what lies in the tree.
umask 022
SOURCE_DATE_EPOCH=$(git -C "$root" log -1 --format=%ct 2>/dev/null || stat -c %Y -- "$root/CHANGELOG.md")
export SOURCE_DATE_EPOCH
install_packages "${build_packages[@]}" "${package_packages[@]}"
make_venv test

rm -rf -- "$packages"
if [[ $arm64 ]]; then
  install_packages "${arm64_packages[@]}"
  make_arm64_sysroot
  build_for_arm64 unlidar_track unlidar_python
  say "Packing"
  # With the `strip` of arm64 first in PATH.
  PATH=/usr/aarch64-linux-gnu/bin:$PATH _PYTHON_HOST_PLATFORM=linux-aarch64 \
    make_wheel "$arm64_dir" --ldpaths "$arm64_sysroot/usr/lib/aarch64-linux-gnu"
  ls -- "$packages"
  check_arm64_wheel
  exit
fi

mkdir -p -- "$packages"
build unlidar_track unlidar_python package_files
say "Packing"
quietly "CPack could not make the packages" \
  cpack --config "$build_dir/CPackConfig.cmake" -B "$packages"
rm -rf -- "$packages/_CPack_Packages"
make_wheel "$build_dir"
(cd -- "$root" && quietly "the source distribution could not be made" "$venv/bin/python" -c \
  'import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])' "$packages")
ls -- "$packages"
