# SPDX-License-Identifier: BSD-3-Clause
# The whole: a robot with a Hokuyo, a camera and a lidar drives through a building whose rooms are alike; drivers,
# reflectivities, SLAM, loop closures, pose graph, corrected maps.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
here=$out/building
mkdir -p "$here"
rm -f "$here"/*.png "$here"/*.csv "$here"/*.map "$here"/*.tum
[ -f "$out/hokuyo.yaml" ] || bash scripts/demos/calibration.sh >/dev/null

echo "Simulating the drive"
rosrun mapping_simulation simulate --world config/worlds/building.yaml --sensor config/simulator/hokuyo_utm30lx.yaml \
  --sensor config/simulator/camera_robot.yaml --sensor config/simulator/velodyne_vlp16_2hz.yaml --no-map-tf --clock-rate 0 \
  --translation-noise 0.02 --rotation-noise 0.01 --seed 1 --out "$here/drive.bag" --ground-truth "$here/truth.tum" \
  ${quick:+--duration 40}

echo "Driving: emulated Hokuyo -> driver -> reflectivities -> SLAM, 3D map, loop closures"
port=$(free_port)
screen
launch robot.launch ip_address:=127.0.0.1 ip_port:="$port" odom_frame:=odom calibration:="$out/hokuyo.yaml" mapping:=true \
  cloud:=velodyne_points resolution:=0.1 loop_closure:=true rviz:=true
robot=$launched
until_logged 'process\[slam-.*started' "$robot"
rosrun hokuyo_sick_drivers hokuyo_emulator --tcp "$port" --topic /simulated_scan >"$here/emulator.log" 2>&1 &
background+=("$!")
rosrun mapping_simulation play_live "$here/drive.bag" --wait-for camera/image_rect scan:=simulated_scan
still_picture "$here/rviz.png"
rosservice call /mapping/save_map "path: '$here/cloud.map'"
stop "$robot"
