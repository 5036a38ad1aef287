# SPDX-License-Identifier: BSD-3-Clause
# An emulated Hokuyo in a small room, the driver, and RViz.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
screen
port=$(free_port)
launch hokuyo_emulator.launch tcp:="$port"
emulator=$launched
until_logged 'process\[hokuyo_emulator-.*started' "$emulator"
rosrun tf2_ros static_transform_publisher 0 0 0.3 0 0 0 base_link laser >/dev/null &  # as a robot has; RViz warns without
background+=("$!")
launch hokuyo.launch ip_address:=127.0.0.1 ip_port:="$port" rviz:=true
frame=$(timeout 20 rostopic echo -n 1 /scan/header/frame_id 2>&1) || fail "no scan came within 20 s: ${frame:+$frame; }see $log"
sleep 8  # RViz drawing it
picture "$out/scan.png"
stop "$launched"
stop "$emulator"
