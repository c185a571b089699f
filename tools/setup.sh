# Sourced by the other scripts here: brings a Debian machine to the point where the program is built
# and the Python harness installed. Every step is skipped when there is nothing to do, so that a
# second run needs neither root nor a network.
# shellcheck shell=bash
# shellcheck disable=SC2034  # its variables are used by the scripts that source it

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
build_dir=$root/build
lint_dir=$root/build-lint
sanitize_dir=$root/build-sanitize
threads_dir=$root/build-threads
arm64_dir=$root/build-arm64
arm64_sysroot=$root/build-arm64-sysroot
venv=$root/.venv
setup_log=$root/out/setup.log

# What the program and its tests are built with. PCL is needed for its headers and as an oracle of
# the tests, Ceres as one alone; the program itself links nothing of them but pcl_common.
build_packages=(
  build-essential cmake ninja-build
  libpcl-dev liblz4-dev libeigen3-dev libceres-dev libyaml-cpp-dev libcli11-dev
  nlohmann-json3-dev libgtest-dev libbenchmark-dev
  python3 python3-venv
)
check_packages=(
  clang-format clang-tidy shellcheck valgrind chromium chromium-driver
  mosquitto mosquitto-clients
  bash-completion lintian
)
# llvm has what names the functions of a stack trace.
sanitize_packages=(clang libclang-rt-dev llvm)
bench_packages=(time)
package_packages=(dpkg-dev help2man)
arm64_packages=(g++-aarch64-linux-gnu qemu-user-static)
# What the program and its tests are built with, of arm64: some with all that they depend on, some
# alone, as VTK and compilers hang on those.
arm64_sysroot_packages=(
  libc6-dev libpcl-common1.13 liblz4-dev libeigen3-dev libyaml-cpp-dev libcli11-dev
  nlohmann-json3-dev libgtest-dev
)
arm64_lone_packages=(
  libpcl-dev libflann-dev libboost1.74-dev
  libboost-{date-time,filesystem,iostreams,serialization,system}1.74{-dev,.0}
)

# Of Python, for the tests: one that asks for older packages than the harness does, and needs none of
# them for what is used of it.
lone_python_package='ouster-sdk>=1.0'

say() {
  printf '\n==> %s\n' "$*"
}

fail() {
  printf '%s: %s\n' "${0##*/}" "$*" >&2
  exit 1
}

# quietly REASON COMMAND...: the command's output goes to the log; when it fails, its last lines
# are shown and the script ends with REASON.
quietly() {
  local reason=$1
  shift
  if ! "$@" >"$setup_log" 2>&1 </dev/null; then
    tail -n 10 -- "$setup_log" >&2
    fail "$reason (whole output: $setup_log)"
  fi
}

check_root_is_writable() {
  local path
  mkdir -p -- "$root/out" 2>/dev/null || fail "cannot write in $root: run as its owner or as root"
  for path in "$root/out" "$build_dir" "$lint_dir" "$sanitize_dir" "$threads_dir" "$arm64_dir" \
    "$arm64_sysroot" "$venv" "$setup_log"; do
    [[ ! -e $path || -w $path ]] ||
      fail "cannot write $path: it belongs to $(stat -c %U -- "$path"), remove it or run as that user"
  done
}

# install_packages PACKAGE...: installs those that are missing, through sudo unless root.
install_packages() {
  local installed package as_root=()
  local -a missing=()
  { command -v dpkg-query && command -v apt-get; } >/dev/null ||
    fail "this is not Debian or Ubuntu (no apt-get): install the counterparts of $* by hand"
  installed=$(dpkg-query -W -f='${Package} ${db:Status-Status}\n' "$@" 2>/dev/null || true)
  for package in "$@"; do
    grep -qxF "$package installed" <<<"$installed" || missing+=("$package")
  done
  ((${#missing[@]})) || return 0

  if ((EUID != 0)); then
    command -v sudo >/dev/null ||
      fail "these packages are missing: ${missing[*]}; neither root nor sudo is at hand to install them"
    [[ -t 0 ]] || sudo -n true 2>/dev/null ||
      fail "these packages are missing: ${missing[*]}; sudo asks for a password and there is no terminal"
    as_root=(sudo)
    sudo -v || fail "these packages are missing: ${missing[*]}; sudo refused to install them"
  fi
  as_root+=(env DEBIAN_FRONTEND=noninteractive)
  say "Installing ${missing[*]} (once, some minutes)"
  # An unreachable foreign source must not stop what the others can deliver: the install decides.
  "${as_root[@]}" apt-get -qq -o DPkg::Lock::Timeout=300 update >/dev/null 2>&1 </dev/null || true
  quietly "apt-get could not install ${missing[*]}; is there a network?" \
    "${as_root[@]}" apt-get -qq -y -o DPkg::Lock::Timeout=300 -o Dpkg::Use-Pty=0 \
    install --no-install-recommends "${missing[@]}"
}

# configure_in FOLDER OPTION...: a build with these options of CMake.
configure_in() {
  local folder=$1
  shift
  # A build folder that came along when the project was copied or moved is of no use here.
  if [[ -e $folder/CMakeCache.txt ]] &&
    ! grep -qxF "CMAKE_HOME_DIRECTORY:INTERNAL=$root" "$folder/CMakeCache.txt"; then
    rm -rf -- "$folder"
  fi
  quietly "CMake could not configure the build" cmake -S "$root" -B "$folder" -G Ninja "$@"
}

# build_in FOLDER TARGET... -- OPTION...: builds the targets with these options of CMake.
build_in() {
  local folder=$1 targets=()
  shift
  while [[ $1 != -- ]]; do
    targets+=("$1")
    shift
  done
  shift
  say "Building in $folder"
  configure_in "$folder" "$@"
  cmake --build "$folder" --target "${targets[@]}" </dev/null || fail "the build failed, see above"
}

# build TARGET...: what users get, in build/.
build() {
  build_in "$build_dir" "$@" -- -DCMAKE_BUILD_TYPE=Release
}

# build_sanitized TARGET...: with assertions, the sanitizers for memory and undefined behaviour, counts
# of executed lines, and the fuzzers, in build-sanitize/. Not among them: division by zero of floating
# numbers, which is defined and meant.
build_sanitized() {
  build_in "$sanitize_dir" "$@" -- -DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++ \
    -DCMAKE_BUILD_TYPE=Debug '-DCMAKE_CXX_FLAGS_DEBUG=-O2 -gline-tables-only' \
    -DUNLIDAR_UNITY=ON -DUNLIDAR_SANITIZE=address,undefined -DUNLIDAR_COVERAGE=ON -DUNLIDAR_BUILD_FUZZERS=ON \
    -DUNLIDAR_BUILD_BENCHMARKS=OFF
}

# build_for_threads TARGET...: with the sanitizer for data races, in build-threads/. The library is
# built of the folders that the tests of what runs on several threads need.
build_for_threads() {
  build_in "$threads_dir" "$@" -- -DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++ \
    -DCMAKE_BUILD_TYPE=Debug '-DCMAKE_CXX_FLAGS_DEBUG=-O2 -gline-tables-only' \
    -DUNLIDAR_UNITY=ON -DUNLIDAR_SANITIZE=thread '-DUNLIDAR_CORE=base|io|robust/(plots|scene|tracking)' \
    -DUNLIDAR_BUILD_BENCHMARKS=OFF
}

# build_for_arm64 TARGET...: against the packages in build-arm64-sysroot/, in build-arm64/.
build_for_arm64() {
  build_in "$arm64_dir" "$@" -- -DCMAKE_TOOLCHAIN_FILE="$root/cmake/arm64.cmake" \
    -DCMAKE_SYSROOT="$arm64_sysroot" -DCMAKE_BUILD_TYPE=Release -DUNLIDAR_UNITY=ON \
    -DUNLIDAR_ORACLES=OFF -DUNLIDAR_BUILD_BENCHMARKS=OFF
}

# make_arm64_sysroot: build-arm64-sysroot/, with the packages of arm64 unpacked. apt works in a folder
# of its own there, as that of an arm64 machine on which nothing is installed.
make_arm64_sysroot() {
  local package part=$arm64_sysroot.part
  local packages="${arm64_sysroot_packages[*]} ${arm64_lone_packages[*]}"
  local apt=(apt-get -qq -y -o APT::Architecture=arm64 -o APT::Architectures=arm64
    -o Dir::State="$part/apt" -o Dir::State::status="$part/apt/status" -o Dir::Cache="$part/apt"
    -o APT::Sandbox::User="$(id -un)" -o APT::Install-Recommends=false)
  ! grep -qxF "$packages" "$arm64_sysroot/packages" 2>/dev/null || return 0
  say "Unpacking packages of arm64 in $arm64_sysroot"
  rm -rf -- "$arm64_sysroot" "$part"
  mkdir -p -- "$part/apt/archives" "$part/usr/lib"
  ln -s usr/lib "$part/lib"
  touch -- "$part/apt/status"
  "${apt[@]}" update >/dev/null 2>&1 </dev/null || true # as in install_packages
  quietly "apt-get could not fetch packages of arm64; is there a network?" \
    "${apt[@]}" --download-only install "${arm64_sysroot_packages[@]}"
  (cd -- "$part/apt/archives" &&
    quietly "apt-get could not fetch packages of arm64; is there a network?" \
      "${apt[@]}" download "${arm64_lone_packages[@]}")
  for package in "$part"/apt/archives/*.deb; do
    quietly "$package could not be unpacked" dpkg-deb --extract "$package" "$part"
  done
  rm -rf -- "$part/apt"
  printf '%s\n' "$packages" >"$part/packages"
  mv -- "$part" "$arm64_sysroot"
}

# The first Python that is new enough and can make a virtual environment. The system's goes first: a
# newer one in PATH would hide what breaks with the one that a fresh Debian has.
find_python() {
  local candidate
  for candidate in /usr/bin/python3 python3; do
    if "$candidate" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' \
      >/dev/null 2>&1; then
      command -v "$candidate"
      return
    fi
  done
  return 1
}

# make_venv EXTRA: .venv with unlidar_tools and what its EXTRA needs ('' for the plain package),
# installed in place. A stamp keeps what was installed from which pyproject.toml; it also names the
# folder and the Python, because environments survive neither a move nor another Python.
make_venv() {
  local extra=$1 python place project stamp_file=$venv/unlidar_tools.stamp
  python=$(find_python) ||
    fail "Python 3.11 or newer with venv is needed, found $(python3 --version 2>&1 || true)"
  place="$root with $python, $("$python" --version)"
  project="pyproject.toml:$(sha256sum <"$root/tools/pyproject.toml") $lone_python_package"
  if ! "$venv/bin/python" -c '' 2>/dev/null || ! grep -qxF "$place" "$stamp_file" 2>/dev/null; then
    rm -rf -- "$venv"
  elif grep -qxF "$project" "$stamp_file" && grep -qxF "extra:$extra" "$stamp_file"; then
    return 0
  fi
  say "Installing the Python harness in $venv"
  [[ -e $venv ]] || quietly "$python could not make a virtual environment" "$python" -m venv "$venv"
  quietly "pip could not install the harness; is there a network?" \
    "$venv/bin/python" -m pip install --disable-pip-version-check \
    --editable "$root/tools${extra:+[$extra]}"
  [[ $extra != test ]] || quietly "pip could not install $lone_python_package; is there a network?" \
    "$venv/bin/python" -m pip install --disable-pip-version-check --no-deps "$lone_python_package"
  # The plain install is part of every one with an extra.
  printf '%s\n' "$place" "$project" extra: "extra:$extra" >"$stamp_file"
}
