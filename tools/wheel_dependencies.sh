#!/usr/bin/env bash
# Builds the libraries of a wheel where no distribution has them, as in the containers that cibuildwheel uses.
set -euo pipefail

usage() {
  cat <<'TEXT'
Usage: tools/wheel_dependencies.sh FOLDER

Fetches the sources of all C++ libraries that program and engine need but PCL, builds them, installs them in
FOLDER for CMAKE_PREFIX_PATH, and puts their licences in FOLDER/licences, for tools/wheel_licences.py. All are
static or headers, so that the wheel brings no shared library. Needs git, CMake and a compiler.
TEXT
}

case ${1:-} in
  -h | --help) usage; exit 0 ;;
  '' | -*) usage >&2; exit 2 ;;
esac
prefix=$1
work=$(mktemp -d)
trap 'rm -rf -- "$work"' EXIT
mkdir -p -- "$prefix/licences"

# library NAME URL TAG LICENCE [OPTION...]: LICENCE is its file, the options are CMake's.
library() {
  local name=$1 url=$2 tag=$3 licence=$4
  shift 4
  git -c advice.detachedHead=false clone --quiet --depth 1 --branch "$tag" "$url" "$work/$name"
  cmake -S "$work/$name" -B "$work/$name-build" -DCMAKE_BUILD_TYPE=Release \
    -DCMAKE_INSTALL_PREFIX="$prefix" -DCMAKE_INSTALL_LIBDIR=lib -DCMAKE_PREFIX_PATH="$prefix" \
    -DCMAKE_POSITION_INDEPENDENT_CODE=ON -DCMAKE_CXX_VISIBILITY_PRESET=hidden \
    -DBUILD_SHARED_LIBS=OFF -DBUILD_TESTING=OFF "$@"
  cmake --build "$work/$name-build" --parallel "$(nproc)" --target install
  cp -- "$work/$name/$licence" "$prefix/licences/$name.txt"
}

library eigen https://gitlab.com/libeigen/eigen.git 3.4.0 COPYING.MPL2 -DEIGEN_BUILD_DOC=OFF
# Its logger prints every detail unless told otherwise: warnings are enough.
library ceres-solver https://github.com/ceres-solver/ceres-solver.git 2.2.0 LICENSE \
  -DMINIGLOG=ON -DMINIGLOG_MAX_LOG_LEVEL=-1 -DGFLAGS=OFF -DSUITESPARSE=OFF -DLAPACK=OFF \
  -DEIGENMETIS=OFF -DUSE_CUDA=OFF -DSCHUR_SPECIALIZATIONS=OFF -DBUILD_EXAMPLES=OFF -DBUILD_BENCHMARKS=OFF
library yaml-cpp https://github.com/jbeder/yaml-cpp.git yaml-cpp-0.9.0 LICENSE \
  -DYAML_CPP_BUILD_TOOLS=OFF -DYAML_CPP_BUILD_TESTS=OFF
library CLI11 https://github.com/CLIUtils/CLI11.git v2.7.2 LICENSE \
  -DCLI11_BUILD_TESTS=OFF -DCLI11_BUILD_EXAMPLES=OFF -DCLI11_BUILD_DOCS=OFF
library nlohmann-json https://github.com/nlohmann/json.git v3.11.3 LICENSE.MIT -DJSON_BuildTests=OFF
library pybind11 https://github.com/pybind/pybind11.git v3.1.0 LICENSE -DPYBIND11_TEST=OFF
