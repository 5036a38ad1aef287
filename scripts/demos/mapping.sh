# SPDX-License-Identifier: BSD-3-Clause
# A bag is replayed by rosbag through the mapping nodelet under roslaunch: a picture from RViz, the map, the comparison
# with OctoMap.
rm -f "$out"/street.map "$out"/map.png
if [ -z "$bag" ]; then
  bag=$out/street.bag cloud=velodyne_points
  say "Simulating a drive along a street"
  rosrun rosbag_tests simulate --world config/worlds/street.yaml --sensor config/simulator/velodyne_hdl64e.yaml \
    --duration 15 --seed 1 --out "$bag"
elif [ -z "$cloud" ]; then
  cloud=$(rosbag info -y -k topics "$bag" | awk '/topic:/ {t = $3} /sensor_msgs\/PointCloud2/ {print t; exit}')
  [ -n "$cloud" ] || { echo "demo: $bag has no sensor_msgs/PointCloud2 topic" >&2; exit 2; }
fi

say "Mapping $bag, topic $cloud: rosbag -> roslaunch -> nodelet -> RViz"
launch mapping_bag.launch bag:="$bag" cloud:="$cloud" frame_id:="$frame" rviz:=true exit_at_end:=false
until logged 'process\[bag-.*started' || ! kill -0 $launched 2>/dev/null; do sleep 0.5; done
duration=$(rosbag info -y -k duration "$bag") start=$SECONDS
until logged '\[bag-.*process has' || ! kill -0 $launched 2>/dev/null; do
  printf '\rreplaying, %d s of %.0f s ' $((SECONDS - start)) "$duration" >&2
  sleep 1
done
printf '\n' >&2
logged '\[bag-.*finished cleanly' || { tail -20 "$log" >&2; echo "demo: the replay failed, see $log" >&2; exit 1; }
sleep 8  # the last scans, and RViz drawing them
picture "$out/map.png"
rosservice call /mapping/save_map "path: '$out/street.map'" | grep -q 'success: True' ||
  { echo "demo: the map was not saved, see $log" >&2; exit 1; }
stop $launched

say "The same scans in OctoMap and in the R-tree map"
rosrun rosbag_tests compare_octomap --bag "$bag" --cloud "$cloud" --fixed-frame "$frame" --fusion equal thesis \
  --json "$out/comparison.json" | tee "$out/comparison.txt"
