# SPDX-License-Identifier: BSD-3-Clause
# A bag is replayed by rosbag through the mapping nodelet under roslaunch: a picture from RViz, the map, the comparison
# with OctoMap.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
rm -f "$out"/street.map "$out"/map.png
if [ -z "$bag" ]; then
  bag=$out/street.bag cloud=velodyne_points
  echo "Simulating a drive along a street"
  rosrun mapping_simulation simulate --world config/worlds/street.yaml --sensor config/simulator/velodyne_hdl64e.yaml \
    --duration $((quick ? 5 : 15)) --seed 1 --out "$bag"
elif [ -z "$cloud" ]; then
  cloud=$(rosbag info -y -k topics "$bag" | awk '/topic:/ {t = $3} /sensor_msgs\/PointCloud2/ {print t; exit}')
  [ -n "$cloud" ] || fail "$bag has no sensor_msgs/PointCloud2 topic"
fi

echo "Mapping $bag, topic $cloud: rosbag -> roslaunch -> nodelet -> RViz"
screen
launch mapping_bag.launch bag:="$bag" cloud:="$cloud" frame_id:="$frame" rviz:=true exit_at_end:=false
until_logged 'process\[bag-.*started' "$launched"
duration=$(rosbag info -y -k duration "$bag")
printf 'Replaying %.0f s\n' "$duration"
until_logged '\[bag-.*process has' "$launched"
logged '\[bag-.*finished cleanly' || { tail -20 "$log" >&2; fail "the replay failed, see $log"; }
still_picture "$out/map.png"
saved=$(rosservice call /mapping/save_map "path: '$out/street.map'" 2>&1) || true
[[ $saved == *'success: True'* ]] || fail "the map was not saved: $saved; see $log"
stop "$launched"

echo "The same scans in OctoMap and in the R-tree map"
rosrun rosbag_tests compare_octomap --bag "$bag" --cloud "$cloud" --fixed-frame "$frame" --fusion equal thesis \
  --json "$out/comparison.json" | tee "$out/comparison.txt"
