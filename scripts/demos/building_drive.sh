# SPDX-License-Identifier: BSD-3-Clause
# Sourced by who sends the robot through the simulated building.

# building_drive FOLDER [HZ]: simulates the drive, with HZ images a second: drive.bag and truth.tum; slam.yaml and
# mapping.yaml are the parameters for it
building_drive() {
  cp config/slam.yaml "$1/slam.yaml"
  sed -i 's/^laser_max_dist: .*/laser_max_dist: 5.0/' "$1/slam.yaml"  # a cheaper scanner: the way drifts
  sed 's/^undistort: .*/undistort: true/' config/mapping.yaml >"$1/mapping.yaml"
  sed "s/^rate: .*/rate: ${2:-4}/" config/simulator/camera_robot.yaml >"$1/camera.yaml"
  rosrun mapping_simulation simulate --world config/worlds/building.yaml --sensor config/simulator/hokuyo_utm30lx.yaml \
    --sensor "$1/camera.yaml" --sensor config/simulator/velodyne_vlp16_2hz.yaml --no-map-tf --clock-rate 0 \
    --translation-noise 0.02 --rotation-noise 0.01 --seed "${seed:-1}" --out "$1/drive.bag" --ground-truth "$1/truth.tum"
}
