# Sourced by the other scripts here: brings a Debian machine to the point where the program is built
# and the Python harness installed. Every step is skipped when there is nothing to do, so that a
# second run needs neither root nor a network.
# shellcheck shell=bash
# shellcheck disable=SC2034  # its variables are used by the scripts that source it

set -o pipefail

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
build_dir=$root/build
# The analyser goes into sources that another includes where this name is in the path of that one. Told
# to go into all that is included, it would go into foreign headers, too.
lint_dir=$root/build-lint/UnifiedSource
sanitize_dir=$root/build-sanitize
threads_dir=$root/build-threads
arm64_dir=$root/build-arm64
arm64_sysroot=$root/build-arm64-sysroot
venv=$root/.venv
setup_log=$root/out/setup.log

# What the program and its tests are built with. PCL is needed for its headers and as an oracle of
# the tests; the program itself links nothing of it but pcl_common.
build_packages=(
  build-essential cmake ninja-build
  libpcl-dev liblz4-dev libeigen3-dev libceres-dev libyaml-cpp-dev libcli11-dev
  nlohmann-json3-dev libgtest-dev libbenchmark-dev
  pybind11-dev python3-dev python3-venv
)
check_packages=(
  clang-format clang-tidy shellcheck valgrind chromium chromium-driver
  mosquitto mosquitto-clients
  bash-completion lintian
)
# llvm has what names the functions of a stack trace.
sanitize_packages=(clang libclang-rt-dev llvm)
bench_packages=(time)
package_packages=(dpkg-dev file help2man)  # CPack tells programs from other files by `file`
arm64_packages=(g++-aarch64-linux-gnu qemu-user-static)
# What the program and its tests are built with, of arm64: some with all that they depend on, some
# alone, as VTK and compilers hang on those.
arm64_sysroot_packages=(
  libc6-dev libpcl-common1.13 liblz4-dev libeigen3-dev libceres-dev libyaml-cpp-dev libcli11-dev
  nlohmann-json3-dev libgtest-dev python3.11 libpython3.11-dev
)
arm64_lone_packages=(
  libpcl-dev libflann-dev libboost1.74-dev pybind11-dev
  libboost-{date-time,filesystem,iostreams,serialization,system}1.74{-dev,.0}
)

# Of Python, for the tests: one that asks for older packages than the harness does, and needs none of
# them for what is used of it. tools/lock.sh has the release.
lone_python_package='ouster-sdk>=1.0'

say() {
  printf '\n==> %s\n' "$*"
}

fail() {
  printf '%s: %s\n' "${0##*/}" "$*" >&2
  exit 1
}

# followed SHOW REASON COMMAND...: the command's output goes to the log and to SHOW, which tells of it;
# when it fails, its last lines are shown and the script ends with REASON.
followed() {
  local show=$1 reason=$2
  shift 2
  if ! "$@" 2>&1 </dev/null | tee -- "$setup_log" | "$show"; then
    grep -vE '^(dl|pm)status:' -- "$setup_log" | tail -n 10 >&2
    fail "$reason (whole output: $setup_log)"
  fi
}

# quietly REASON COMMAND...: shown only when it fails.
quietly() {
  followed swallow "$@"
}

swallow() {
  cat >/dev/null
}

# apt_progress: how much apt-get is going to do, and each tenth of it that it has done.
apt_progress() {
  local line kind percent now last=
  while IFS= read -r line; do
    case $line in
      *' newly installed'* | 'Need to get '* | 'After this operation'*) printf '    %s\n' "$line" ;;
      dlstatus:* | pmstatus:*)
        IFS=: read -r kind _ percent _ <<<"$line"
        percent=${percent%.*}
        now="${kind/pmstatus/installed}: $((percent / 10 * 10)) %"
        now=${now/dlstatus/downloaded}
        [[ $now == "$last" ]] || printf '    %s\n' "$now"
        last=$now
        ;;
    esac
  done
}

# pip_progress: the packages that pip fetches, ten at a time, and that it installs them.
pip_progress() {
  local line count=0
  while IFS= read -r line; do
    case $line in
      'Collecting '* | 'Processing '*) ((++count % 10)) || printf '    downloaded: %d packages\n' "$count" ;;
      'Installing collected packages'*) printf '    installing: %d packages\n' "$count" ;;
    esac
  done
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
  as_root+=(env DEBIAN_FRONTEND=noninteractive LC_ALL=C)
  say "Installing ${missing[*]} (once)"
  # An unreachable foreign source must not stop what the others can deliver: the install decides.
  # Its progress has a descriptor of its own, opened behind sudo, which closes all but three: scripts
  # of packages find the one that apt reports on closed, and libxml-sax-perl's fails without its output.
  "${as_root[@]}" apt-get -qq -o DPkg::Lock::Timeout=300 update >/dev/null 2>&1 </dev/null || true
  followed apt_progress "apt-get could not install ${missing[*]}; is there a network?" \
    "${as_root[@]}" sh -c 'exec apt-get "$@" 3>&1' apt-get -q -y -o DPkg::Lock::Timeout=300 \
    -o Dpkg::Use-Pty=0 -o APT::Status-Fd=3 install --no-install-recommends "${missing[@]}"
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
  # The Python of .venv: its module is for no other.
  quietly "CMake could not configure the build" \
    cmake -S "$root" -B "$folder" -G Ninja -DPython_EXECUTABLE="$(find_python)" "$@"
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

# build TARGET...: what users get, in build/, compiled as fast as it can be from nothing.
build() {
  build_in "$build_dir" "$@" -- -DCMAKE_BUILD_TYPE=Release -DUNLIDAR_UNITY=ON -DUNLIDAR_JOINED_TESTS=ON
}

# build_sanitized TARGET...: with assertions, the sanitizers for memory and undefined behaviour, counts
# of executed lines, and the fuzzers, in build-sanitize/. Not among them: division by zero of floating
# numbers, which is defined and meant.
build_sanitized() {
  build_in "$sanitize_dir" "$@" -- -DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++ \
    -DCMAKE_BUILD_TYPE=Debug '-DCMAKE_CXX_FLAGS_DEBUG=-O2 -gline-tables-only' \
    -DUNLIDAR_UNITY=ON -DUNLIDAR_JOINED_TESTS=ON -DUNLIDAR_SANITIZE=address,undefined \
    -DUNLIDAR_COVERAGE=ON -DUNLIDAR_BUILD_FUZZERS=ON \
    -DUNLIDAR_BUILD_BENCHMARKS=OFF -DUNLIDAR_BUILD_PYTHON=OFF
}

# build_for_threads TARGET...: with the sanitizer for data races, in build-threads/. The library is
# built file by file: elsewhere it would not show that one lacks an include.
build_for_threads() {
  build_in "$threads_dir" "$@" -- -DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++ \
    -DCMAKE_BUILD_TYPE=Debug '-DCMAKE_CXX_FLAGS_DEBUG=-O2 -gline-tables-only' \
    -DUNLIDAR_SANITIZE=thread \
    -DUNLIDAR_BUILD_BENCHMARKS=OFF -DUNLIDAR_BUILD_PYTHON=OFF
}

# build_for_arm64 TARGET...: against the packages in build-arm64-sysroot/, in build-arm64/; the engine for
# Python in python/ there.
build_for_arm64() {
  build_in "$arm64_dir" "$@" -- -DCMAKE_TOOLCHAIN_FILE="$root/cmake/arm64.cmake" \
    -DCMAKE_SYSROOT="$arm64_sysroot" -DCMAKE_BUILD_TYPE=Release -DUNLIDAR_UNITY=ON \
    -DUNLIDAR_ORACLES=OFF -DUNLIDAR_BUILD_BENCHMARKS=OFF \
    -DPython_INCLUDE_DIR="$arm64_sysroot/usr/include/python3.11" -DUNLIDAR_PYTHON_DIR="$arm64_dir/python"
}

# make_arm64_sysroot: build-arm64-sysroot/, with the packages of arm64 unpacked. apt works in a folder
# of its own there, as that of an arm64 machine on which nothing is installed.
make_arm64_sysroot() {
  local package part=$arm64_sysroot.part
  local packages="${arm64_sysroot_packages[*]} ${arm64_lone_packages[*]}"
  local libraries=$part/usr/lib/aarch64-linux-gnu
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
  # What installing does: the alternative that gives the library its name.
  for package in blas lapack; do
    ln -s "atlas/lib$package.so" "atlas/lib$package.so.3" "$libraries"
  done
  # Ceres names these libraries where they would be installed.
  sed -i 's|;/usr/lib/|;${_IMPORT_PREFIX}/lib/|g' "$libraries/cmake/Ceres/CeresTargets.cmake"
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

# make_venv EXTRA: .venv with unlidar, installed in place, and what it and its EXTRA need ('' for
# the plain package, or test), in the releases of requirements*.txt and no others. A stamp keeps what was
# installed; it also names the folder and the Python, because environments survive neither a move nor
# another Python. A package that is needed no more must not stay: other releases make all of it anew.
# What tests need stays for tests.
make_venv() {
  local extra=$1 python place project stamp_file=$venv/unlidar.stamp
  local pip=("$venv/bin/python" -u -m pip install --disable-pip-version-check --no-deps)
  python=$(find_python) ||
    fail "Python 3.11 or newer with venv is needed, found $(python3 --version 2>&1 || true)"
  place="$root with $python, $("$python" --version), $(
    cat -- "$root"/tools/requirements{,-test}.txt | sha256sum
  )"
  project="pyproject.toml:$(sha256sum <"$root/pyproject.toml")"
  ! grep -qxF extra:test "$stamp_file" 2>/dev/null || extra='test'
  if ! "$venv/bin/python" -c '' 2>/dev/null || ! grep -qxF "$place" "$stamp_file" 2>/dev/null; then
    rm -rf -- "$venv"
  elif grep -qxF "$project" "$stamp_file" && grep -qxF "extra:$extra" "$stamp_file"; then
    return 0
  fi
  say "Installing the Python harness in $venv"
  [[ -e $venv ]] || quietly "$python could not make a virtual environment" "$python" -m venv "$venv"
  # Nothing but wheels: what builds others would come in any release.
  followed pip_progress "pip could not install what the harness needs; is there a network?" \
    "${pip[@]}" --require-hashes --only-binary :all: \
    --requirement "$root/tools/requirements${extra:+-$extra}.txt"
  quietly "pip could not install the harness" \
    "${pip[@]}" --no-build-isolation --editable "$root"
  # The plain install is part of every one with an extra.
  printf '%s\n' "$place" "$project" extra: "extra:$extra" >"$stamp_file"
}
