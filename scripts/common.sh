# SPDX-License-Identifier: BSD-3-Clause
# Sourced by the scripts beside it: installs what is missing (Debian 11, 12 or 13 and their own ROS packages) and builds.
# shellcheck disable=SC2034

set -euo pipefail
workspace=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$workspace"
export PATH=/usr/sbin:/usr/bin:/sbin:/bin  # Debian's python3, which has the ROS modules, before any other
export LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive

# What the script that sources this says of itself at its head.
usage() { sed -n '3,/^[^#]/s/^# \{0,1\}//p' "$workspace/scripts/${0##*/}"; }
wrong_usage() { printf '%s: %s\n\n%s\n' "${0##*/}" "$*" "$(usage)" >&2; exit 2; }
case "${1:-}" in -h | --help) usage; exit ;; esac

# Compilers at a time: each needs up to a gigabyte.
jobs=$(awk -v cores="$(nproc)" '/^MemAvailable/ {n = int($2 / 1e6); print n < 1 ? 1 : n < cores ? n : cores}' /proc/meminfo)

# To build and run the drivers, and what else one types on a robot: rostopic echo needs the messages' Python modules.
packages_drivers=(
  build-essential catkin cmake
  ros-core-dev libdiagnostic-updater-dev libdynamic-reconfigure-config-init-mutex-dev libnodelet-dev libnodeletlib-dev
  libtf2-eigen-dev libtf2-msgs-dev libtf2-ros-dev pluginlib-dev
  libboost-program-options-dev libeigen3-dev libsqlite3-dev libtinyxml2-dev libyaml-cpp-dev
  libzstd-dev
  libnodeletlib-tools rosbash tf2-tools
  python3-dynamic-reconfigure python3-rosbag python3-roslaunch python3-rosmsg python3-rosnode python3-rosparam
  python3-rosservice python3-rostopic
  python3-diagnostic-msgs python3-geometry-msgs python3-map-msgs python3-nav-msgs python3-sensor-msgs python3-std-msgs
  python3-tf2-msgs python3-visualization-msgs
)
# To build all, and its tests. PCL is by far the largest.
packages_build=(
  "${packages_drivers[@]}"
  libcv-bridge-dev libimage-transport-dev libmap-msgs-dev
  libboost-iostreams-dev libceres-dev libflann-dev libgtest-dev liblz4-dev liblzma-dev liboctomap-dev libopencv-dev
  libpcl-dev libqhull-dev
  pybind11-dev python3-dev python3-numpy python3-rostest xz-utils zlib1g-dev
)
packages_pictures=(rviz xvfb imagemagick)
packages_plots=(python3-matplotlib python3-yaml)
packages_fuzz=(clang libeigen3-dev libtinyxml2-dev make)
# Clang's sanitizers, which Debian 11 has in clang itself.
grep -q '^VERSION_ID="11"' /etc/os-release || packages_fuzz+=(libclang-rt-dev)
packages_format=(clang-format-14)
packages_tidy=(clang-tidy-14)

say() { printf '\n== %s\n' "$*" >&2; }
# took START: how long it took since $SECONDS was START
took() { printf '   took %d:%02d min\n' $(((SECONDS - $1) / 60)) $(((SECONDS - $1) % 60)) >&2; }

free_port() { python3 -c 'import socket; s = socket.socket(); s.bind(("", 0)); print(s.getsockname()[1])'; }

# follow LOG: copies what make or apt-get says to LOG and shows how far it is, on one changing line of a terminal, else at
# each tenth.
follow() {
  local line percent what last=-10
  while IFS= read -r line; do
    if [[ $line =~ ^(dl|pm)status:.*:([0-9]+)\.[0-9]+:(.*)$ ]]; then  # apt-get: downloads, packages
      percent=${BASH_REMATCH[2]} what=${BASH_REMATCH[3]}
    else
      printf '%s\n' "$line" >&3
      [[ $line =~ ^\[\ *([0-9]+)%\]\ (Building\ |Linking\ |Built\ target\ )?(CXX\ )?(object\ )?(.*)$ ]] || continue
      percent=${BASH_REMATCH[1]} what=${BASH_REMATCH[5]/CMakeFiles\/*.dir\//}
    fi
    if [ -t 2 ]; then
      printf '\r\033[K%3d %% %.90s' "$percent" "$what" >&2
    elif [ "$percent" -ge $((last + 10)) ] || [ "$percent" -lt "$last" ]; then
      printf '%3d %% %.90s\n' "$percent" "$what" >&2
      last=$((percent / 10 * 10))
    fi
  done 3>"$1"
  [ ! -t 2 ] || printf '\r\033[K' >&2
}

# The packages' C++ files.
cpp_files() {
  local files=(*/package.xml)
  find "${files[@]%/package.xml}" -name '*.cpp' -o -name '*.h' | sort
}

# install_missing PACKAGE...
install_missing() {
  local missing=() package sudo=() start=$SECONDS
  for package in "$@"; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  if ! grep -q '^ID=debian' /etc/os-release || ! grep -qE '^VERSION_ID="1[123]"' /etc/os-release; then
    echo "These scripts install packages on Debian 11, 12 and 13 alone; missing here: ${missing[*]}" >&2
    echo "For Ubuntu 20.04 with ROS Noetic see the README." >&2
    exit 1
  fi
  [ "$(id -u)" = 0 ] || sudo=(sudo)
  say "Installing ${#missing[@]} packages and what they need: compiler, ROS, libraries; some minutes the first time"
  if ! "${sudo[@]}" apt-get update -qq >install.log 2>&1; then
    cat install.log >&2
    exit 1
  fi
  LC_ALL=C apt-get install --assume-no --no-install-recommends "${missing[@]}" 2>/dev/null |
    sed -nE 's/^Need to get (.*) of archives.*/   \1 to download/p; s/^After this operation, (.*) of add.*/   \1 on the disk/p' >&2 || true
  # shellcheck disable=SC2016
  "${sudo[@]}" sh -c 'exec apt-get install -y --no-install-recommends -o APT::Status-Fd=3 -o DPkg::Lock::Timeout=300 "$@" 3>&1 >>install.log 2>&1' sh \
    "${missing[@]}" | follow /dev/null ||
    { grep -E -B2 '^(E|W|Err|dpkg):? ' install.log | head -40 >&2; echo "Installing failed: see install.log" >&2; exit 1; }
  took "$start"
}

# The catkin source space of this clone: src/PACKAGE -> ../PACKAGE. Where the clone is in another workspace's source space,
# catkin would find each package twice.
link_packages() {
  local dir=$workspace package
  while [ "$dir" != / ]; do
    dir=$(dirname "$dir")
    if [ -L "$dir/CMakeLists.txt" ] && [[ $(readlink "$dir/CMakeLists.txt") == */catkin/cmake/toplevel.cmake ]]; then
      dir=$(dirname "$dir")
    elif [[ $workspace/ != $dir/src/* ]] || { [ ! -e "$dir/.catkin_workspace" ] && [ ! -e "$dir/.catkin_tools" ]; }; then
      continue
    fi
    echo "This clone is in the source space of the catkin workspace $dir: build there, with" >&2
    echo "  scripts/build --packages; cd $dir; catkin_make -DCMAKE_BUILD_TYPE=Release" >&2
    echo "or clone to another place for scripts/${0##*/}." >&2
    exit 1
  done
  find src -xtype l -delete
  for package in */package.xml; do ln -sfn "../${package%/*}" "src/${package%/*}"; done
}

# prepare PACKAGE...: makes this clone a workspace, for which Debian's PACKAGEs are needed
prepare() {
  link_packages
  install_missing "$@"
}

space=$workspace  # where build/, devel/ and logs are
build_options=(-DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_FLAGS=-Werror)
all_packages=(-DCATKIN_WHITELIST_PACKAGES= -DCATKIN_ENABLE_TESTING=ON)

# make_in_catkin OPTION...: catkin_make, its progress shown
make_in_catkin() {
  local options=(-DPYTHON_EXECUTABLE=/usr/bin/python3 -DCMAKE_EXPORT_COMPILE_COMMANDS=ON)
  if command -v ccache >/dev/null; then options+=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache); fi
  # With this one, Debian 11's catkin finds no gtest when it is configured a second time; without, it builds gtest.
  if [ -e /usr/share/cmake/GMock ]; then options+=(-DCMAKE_DISABLE_FIND_PACKAGE_GMock=ON); fi
  following catkin_make "$@" "${build_options[@]}" "${options[@]}"
}

# following COMMAND...: a build, its progress shown; the script ends where it fails
following() {
  "$@" 2>&1 | follow "$space/build.log" || {
    grep -E -A5 '(error|Error|undefined reference)' "$space/build.log" | head -40 >&2
    echo "The build failed: see $space/build.log" >&2
    exit 1
  }
}

# build_in FOLDER FLAGS: lets all below build in another folder of the workspace, with these flags of the compiler alone
build_in() {
  space=$workspace/$1
  build_options=(--build "$space/build" -DCATKIN_DEVEL_PREFIX="$space/devel" -DCMAKE_BUILD_TYPE=None "-DCMAKE_CXX_FLAGS=$2")
  mkdir -p "$space"
}

# build [--only PACKAGE] [TARGET...]: --only leaves out what PACKAGE doesn't depend on, and tests
build() {
  local start=$SECONDS what="all packages" minutes=20 options=("${all_packages[@]}")
  if [ "${1:-}" = --only ]; then
    what=$2 minutes=4 options=(--only-pkg-with-deps "$2" -DCATKIN_ENABLE_TESTING=OFF)
    shift 2
  fi
  [[ " $* " != *' tests '* ]] || { what+=" and their tests" minutes=40; }
  say "Building $what, $jobs files at a time: about $((minutes / jobs + 1)) minutes the first time"
  make_in_catkin "$@" -j"$jobs" "${options[@]}"
  took "$start"
}

# configure: what tests there are is known then
configure() {
  say "Configuring"
  make_in_catkin cmake_check_build_system "${all_packages[@]}"
}

# check_tests [PACKAGE | TEST]...: whether there may be such
check_tests() {
  local name
  for name; do
    grep -qsE 'mapping_(gtest|rostest)\(' "./${name%_test_*}/CMakeLists.txt" || wrong_usage "there are no tests $name"
  done
}

# tests [PACKAGE | TEST]...: of the tests in C++ of these packages, or of all: the target that builds it, such as
# rtree_occupancy_map_test_rtree, which TEST is, and the one that runs it, which builds nothing.
tests() {
  local package kind name test wanted
  while read -r package kind name; do
    test=$name
    [ "$kind" = gtest ] || { test=${package}_${name#test_}; test=${test%.test}; }
    for wanted in "${@:-$package}"; do
      [ "$wanted" != "$package" ] && [ "$wanted" != "$test" ] || echo "$test _run_tests_${package}_${kind}_$name/fast"
    done
  done < <(sed -nE 's/^_run_tests_(\w+)_(gtest|rostest)_([^/ :]+):.*/\1 \2 \3/p' "$space/build/Makefile" | sort -u)
}

run_with=()  # what runs the tests, such as a command that changes their limits

# count COUNT PATTERN: after each line that the pattern matches, COUNT in all, adds one with the percentage and what the
# pattern's first group matched; leaves out make's own percentages
count() {
  local line ended=0
  while IFS= read -r line; do
    [[ $line =~ ^\[.*%\] ]] || printf '%s\n' "$line"
    [[ $line =~ $2 ]] || continue
    ended=$((ended + 1))
    printf '[%3d%%] %s\n' $((100 * ended / $1)) "${BASH_REMATCH[1]}"
  done
}

# build_tests TEST...: these alone, with what they need, which takes make one pass
build_tests() {
  local start=$SECONDS targets=() test
  for test; do targets+=("${test%_test_*}/CMakeFiles/$test.dir/all"); done
  say "Building $# tests"
  following make_counting "${targets[@]}"
  took "$start"
}
make_counting() {
  make -C "$space/build" -f CMakeFiles/Makefile2 -j"$jobs" "$@" 2>&1 | count $# 'Built target (\w+_test_\w+)'
}

# run_tests COUNT TARGET...: runs COUNT tests, one after the other
run_tests() {
  local total=$1
  shift
  rm -rf "$space/build/test_results"
  { "${run_with[@]}" make -C "$space/build" -k -j1 "$@" 2>&1 || true; } |
    count "$total" 'run_tests.py: verify result.*/([^/]*)\.xml' | follow "$space/test.log"
}

# The workspace's environment, which isn't written for "set -u".
use_workspace() {
  set +u
  # shellcheck disable=SC1091
  source "$space/devel/setup.bash"
  set -u
}
