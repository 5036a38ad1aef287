# SPDX-License-Identifier: BSD-3-Clause
# An emulated Hokuyo that sees what a simulated robot sees, the driver, and RViz.
say "Emulated Hokuyo -> driver -> RViz"
rosrun rosbag_tests simulate --world config/worlds/laboratory.yaml --sensor config/simulator/hokuyo_utm30lx.yaml \
  --duration 10 --seed 1 --out "$out/laboratory_scans.bag"
launch hokuyo_emulator.launch bag:="$out/laboratory_scans.bag" topic:=scan tcp:=10949
emulator=$launched
until logged 'process\[hokuyo_emulator-.*started' || ! kill -0 $emulator 2>/dev/null; do sleep 0.5; done
launch hokuyo.launch ip_address:=127.0.0.1 ip_port:=10949 rviz:=true
sleep 12
picture "$out/scan.png"
timeout 20 rostopic echo -n 1 /scan/header/frame_id | grep -q laser ||
  { echo "demo: there are no scans, see $log" >&2; exit 1; }
stop $launched
stop $emulator
