# SPDX-License-Identifier: BSD-3-Clause
# Sourced by the scripts beside it: installs what is missing (Debian 12 and its own ROS packages) and builds.

set -euo pipefail
workspace=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$workspace"
export PATH=/usr/sbin:/usr/bin:/sbin:/bin  # Debian's python3, which has the ROS modules, before any other
export LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive

packages_build=(
  build-essential catkin cmake
  ros-core-dev libdiagnostic-updater-dev libdynamic-reconfigure-config-init-mutex-dev libmap-msgs-dev libnav-msgs-dev
  libcv-bridge-dev libimage-transport-dev libnodelet-dev libnodeletlib-dev pluginlib-dev librosbag-dev libtf2-dev
  libtf2-eigen-dev libtf2-msgs-dev libtf2-ros-dev
  libvisualization-msgs-dev python3-dynamic-reconfigure
  libboost-iostreams-dev libboost-program-options-dev libeigen3-dev libgtest-dev liblzma-dev liboctomap-dev libopencv-dev
  libpcl-dev libqhull-dev libtinyxml2-dev libyaml-cpp-dev
  python3-rostest
)
packages_run=(libnodeletlib-tools python3-rosbag python3-roslaunch python3-rosservice python3-rostopic rosbash xz-utils)
packages_pictures=(rviz xvfb imagemagick)
packages_plots=(python3-matplotlib python3-yaml)
packages_fuzz=(clang-14 libclang-rt-14-dev libeigen3-dev libtinyxml2-dev make)

say() { printf '\n== %s\n' "$*" >&2; }

install_missing() {
  local missing=() package
  for package in "$@"; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  if ! grep -q '^VERSION_ID="12"' /etc/os-release || ! grep -q '^ID=debian' /etc/os-release; then
    echo "These scripts install packages on Debian 12 alone; missing here: ${missing[*]}" >&2
    echo "For Ubuntu 20.04 with ROS Noetic see the README." >&2
    exit 1
  fi
  say "Installing ${missing[*]}"
  local sudo=()
  [ "$(id -u)" = 0 ] || sudo=(sudo)
  "${sudo[@]}" apt-get update -qq
  "${sudo[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}

# build [TARGET]
build() {
  say "Building${1:+ $1}"
  local package
  for package in */package.xml; do ln -sfn "../${package%/*}" "src/${package%/*}"; done
  catkin_make -j"$(nproc)" -DPYTHON_EXECUTABLE=/usr/bin/python3 -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_FLAGS=-Werror \
    "$@" >build.log 2>&1 || { grep -E -A5 '(error|Error)' build.log | head -40 >&2; echo "The build failed: see build.log" >&2; exit 1; }
}

# The workspace's environment, which isn't written for "set -u".
use_workspace() {
  set +u
  # shellcheck disable=SC1091
  source "$workspace/devel/setup.bash"
  set -u
}
