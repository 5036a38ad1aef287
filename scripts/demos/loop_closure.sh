# SPDX-License-Identifier: BSD-3-Clause
# A camera goes along a simulated street twice, the second time beside its first way and darker: where it has been before.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
rm -rf "$out/walks" "$out/loops"
rosrun mapping_simulation simulate --world config/worlds/street_walk.yaml --sensor config/simulator/camera.yaml --seed 1 \
  --world-seed 1 --images "$out/walks"
rosrun ibuild_loop_closure loop_closure_images --images "$out/walks/camera/image_raw" \
  --poses "$out/walks/camera/image_raw.tum" --out "$out/loops" | tee "$out/loops.txt"
