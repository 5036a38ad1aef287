# SPDX-License-Identifier: BSD-3-Clause
# Calibrates the intensities of a simulated Hokuyo that drives along a white wall.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
rosrun mapping_simulation simulate --world config/worlds/calibration_wall.yaml --sensor config/simulator/hokuyo_utm30lx.yaml \
  --seed 1 --out "$out/wall.bag"
rosrun laser_intensity_calib calibrate --bag "$out/wall.bag" --topic scan --frame map --box=-0.2,-29,0,0.2,29,3 --step 2 \
  --scanner "a simulated Hokuyo UTM-30LX" --reference "white wall" --out "$out/hokuyo.yaml" --report "$out/calibration"
