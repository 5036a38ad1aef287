# SPDX-License-Identifier: BSD-3-Clause
# The whole: a robot drives through a building whose rooms and corridors are alike but for what their walls reflect.
# Drivers, reflectivities, SLAM, loops of laser, camera and lidar, pose graph, corrected maps.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
source "$(dirname "${BASH_SOURCE[0]}")/building_drive.sh"
here=$out/building
mkdir -p "$here"
rm -f "$here"/*

echo "Simulating the drive: a Hokuyo's scans, images, and the clouds of a lidar with 16 beams"
building_drive "$here"

echo "Driving: emulated Hokuyo -> driver -> reflectivities -> SLAM, 3D map, loops, places, pose graph"
port=$(free_port)
screen
launch robot.launch ip_address:=127.0.0.1 ip_port:="$port" odom_frame:=odom slam_config:="$here/slam.yaml" \
  calibration:="$workspace/laser_intensity_calib/config/reflectivity_hokuyo_utm30lx.yaml" \
  mapping:=true mapping_config:="$here/mapping.yaml" cloud:=velodyne_points resolution:=0.1 loop_closure:=true \
  place_recognition:=true pose_graph:=true session_file:="$here/building.session"
robot=$launched
until_logged 'process\[pose_graph-.*started' "$robot"
kill -0 "$robot" 2>/dev/null || { tail -5 "$log" >&2; fail "roslaunch ended, see $log"; }
rosrun hokuyo_sick_drivers hokuyo_emulator --tcp "$port" --topic /simulated_scan >"$here/emulator.log" 2>&1 &
background+=("$!")
# The whole floor, without what is above it.
sed -e 's/Scale: 60/Scale: 27/' -e 's/^      X: 0/      X: 11/' -e 's/^      Y: 0/      Y: 4/' \
  -e '/Name: 3D map/{n;s/true/false/}' mapping_bringup/config/robot.rviz >"$here/robot.rviz"
rosrun rviz rviz -d "$here/robot.rviz" >"$here/rviz.log" 2>&1 &
background+=("$!")
rosrun mapping_simulation play_live "$here/drive.bag" --wait-for camera/image_rect --stand-still scan:=simulated_scan >"$here/play.log" 2>&1 &
play=$!
background+=("$play")
(log=$here/play.log; until_logged 'stands still' "$play"; logged 'stands still') || fail "the drive ended early, see $here/play.log"
still_picture "$here/rviz.png"
stop "$robot"
logged 'process has died' && { grep -a 'process has died' "$log" >&2; fail "a process died, see $log"; }

echo "What the session holds, and what comes of it"
session() { rosrun pose_graph pose_graph "$1" "$here/building.session" "${@:2}"; }
session info | tee "$here/session.txt"
for file in graph.g2o trajectory.tum after.pgm; do session export "$here/$file"; done >/dev/null
session export "$here/cloud.map" --resolution 0.1 >/dev/null
for file in before.tum before.pgm; do session export "$here/$file" --without-loops; done >/dev/null
shift=$(sed -n 's/^stamps are later by \(.*\) s$/\1/p' "$here/play.log")
awk -v by="$shift" '!/^#/ { $1 = sprintf("%.6f", $1 + by); print }' "$here/truth.tum" >"$here/truth_live.tum"
error() {
  rosrun rosbag_tests trajectory_error --reference "$here/truth_live.tum" --estimate "$here/$1" --max-gap 0.1 >"$here/error.txt"
  sed '1,/^absolute/d' "$here/error.txt" | awk -v name="$2" '/^translation, absolute/ {t = $4; most = $NF} /^rotation, absolute/ {r = $4}
    END {printf "%s,%.3f,%.3f,%.2f\n", name, t, most, r}'
}
{ echo 'way,mean error (m),greatest (m),mean error (deg)'; error before.tum 'without loops'; error trajectory.tum 'with loops'; } |
  tee "$here/accuracy.csv"
picture_of() {
  rosrun pose_graph plot_graph.py "$here/graph.g2o" "$here/$1.png" --title "$3" --map "$here/$2.yaml" "${@:4}"
}
picture_of graph after 'The graph over the corrected map' --truth "$here/truth_live.tum" --trajectory "$here/trajectory.tum"
for map in before after; do convert "$here/$map.pgm" "$here/$map.png"; done
