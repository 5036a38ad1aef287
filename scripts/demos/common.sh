# SPDX-License-Identifier: BSD-3-Clause
# Sourced by the parts of the demo beside it, which scripts/demo runs: a screen, roslaunch and pictures.
source "$(dirname "${BASH_SOURCE[0]}")/../common.sh"
use_workspace
# shellcheck disable=SC2034
out=$workspace/out quick=${quick:-} bag=${bag:-} cloud=${cloud:-} frame=${frame:-map}

fail() { echo "demo: $*" >&2; exit 1; }

ROS_MASTER_URI=http://localhost:$(free_port)
export ROS_MASTER_URI ROS_HOSTNAME=localhost
export PYTHONUNBUFFERED=1  # roslaunch's log is followed
export LIBGL_ALWAYS_SOFTWARE=1 QT_QPA_PLATFORM=xcb XDG_RUNTIME_DIR=${XDG_RUNTIME_DIR:-/tmp}
background=()
trap 'kill "${background[@]}" 2>/dev/null || true; wait || true' EXIT

# launch FILE ARGUMENTS...: roslaunch in the background, its log in $log. Sets $launched.
launch() {
  log=$out/${1%.launch}.log
  : >"$log"  # what an earlier run logged isn't waited for
  roslaunch --port "${ROS_MASTER_URI##*:}" "launch/$1" "${@:2}" >"$log" 2>&1 &
  launched=$!
  background+=("$launched")
}
stop() { kill -INT "$1" 2>/dev/null || true; wait "$1" || true; }
logged() { grep -a -q "$1" "$log"; }
# until_logged TEXT PROCESS: waits for TEXT in $log, or for the end of PROCESS
until_logged() { until logged "$1" || ! kill -0 "$2" 2>/dev/null; do sleep 0.5; done; }

# screen: an X server for RViz
screen() {
  local number=$out/.screen
  rm -f "$number"
  Xvfb -displayfd 1 -screen 0 1200x800x24 -nolisten tcp >"$number" 2>/dev/null &
  background+=("$!")
  until [ -s "$number" ]; do kill -0 "$!" 2>/dev/null || fail "Xvfb doesn't start"; sleep 0.2; done
  DISPLAY=:$(cat "$number")
  export DISPLAY
}
# still_picture FILE: of the whole screen once RViz has drawn all, which takes long without a graphics card
still_picture() {
  local end=$((SECONDS + 90))
  picture "$1"
  until sleep 10; mv "$1" "$1.before"; picture "$1"
        [ $SECONDS -gt $end ] || compare -metric AE -crop 1200x750+0+0 "$1.before" "$1" null: 2>/dev/null; do :; done
  rm "$1.before"
}
# picture FILE: of the whole screen
picture() {
  import -window root "$1" || fail "no picture could be taken"
  [ "$(identify -format %k "$1")" -gt 16 ] || fail "$1 is blank, see $log"
}
