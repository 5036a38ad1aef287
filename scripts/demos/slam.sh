# SPDX-License-Identifier: BSD-3-Clause
# A room seen by a Hokuyo with a narrow field of view (Fig. 3.6): what each cost makes of it, and the same live, from raw
# intensities over reflectivities to the map in RViz.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
echo "SLAM in a room, with each cost, and as Hector SLAM without asking what a scan tells of the pose"
rosrun rosbag_tests evaluate_slam config/slam_evaluation/room.yaml --first-seed 8 --seeds 1 --duration $((quick ? 15 : 40)) \
  --min-observability 0 --guess last_pose --out "$out/slam" | tee "$out/slam.txt"
rosrun rosbag_tests plot_evaluation.py "$out/slam"
cp "$out/slam/room-maps.png" "$out/slam_costs.png"

echo "SLAM live: rosbag -> reflectivities -> map -> RViz"
rosrun mapping_simulation simulate --world config/worlds/laboratory.yaml --sensor config/simulator/hokuyo_utm30lx.yaml \
  --no-map-tf --duration $((quick ? 10 : 20)) --seed 1 --out "$out/laboratory.bag"
screen
launch slam_bag.launch bag:="$out/laboratory.bag" scan:=scan_reflectivity exit_at_end:=false rviz:=true
slam=$launched slam_log=$log
until_logged 'process\[bag-.*started' "$slam"
launch reflectivity.launch
reflectivity=$launched log=$slam_log
until_logged '\[bag-.*process has' "$slam"
logged '\[bag-.*finished cleanly' || { tail -20 "$log" >&2; fail "the replay failed, see $log"; }
still_picture "$out/slam.png"
stop "$reflectivity"
stop "$slam"
