# SPDX-License-Identifier: BSD-3-Clause
# A camera goes along a simulated street twice, the second time beside its first way and darker: where it has been before.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
rm -rf "$out/walks" "$out/loops"
rosrun ibuild_loop_closure simulate_walks --seed 1 --out "$out/walks"
rosrun ibuild_loop_closure loop_closure_images --images "$out/walks/first" --images "$out/walks/second" \
  --poses "$out/walks/poses.txt" --out "$out/loops" | tee "$out/loops.txt"
