// SPDX-License-Identifier: BSD-3-Clause
//
// Shows the occupied cuboids of an R-tree map, to turn (left button), move (right) and zoom (wheel), up to a height that
// a slider gives. The data are in the page, see report.py: six 16-bit integers for each cuboid, its least corner and its
// size in voxels, then a byte for its colour.
/* global THREE */
function showMap(canvas, slider, map) {
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const boxes = new Int16Array(bytes(map.boxes).buffer);
  const values = bytes(map.values);

  const renderer = new THREE.WebGLRenderer({canvas, antialias: true});
  const scene = new THREE.Scene();
  renderer.localClippingEnabled = true;
  scene.background = new THREE.Color(0x1b1f24);
  const camera = new THREE.PerspectiveCamera(45, 1, 0.1, 2000);
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, canvas);

  scene.add(new THREE.HemisphereLight(0xffffff, 0x555566, 0.85));
  const sun = new THREE.DirectionalLight(0xffffff, 0.5);
  sun.position.set(1, -2, 3);
  scene.add(sun);

  const cubes = new THREE.InstancedMesh(new THREE.BoxGeometry(1, 1, 1), new THREE.MeshLambertMaterial(), values.length);
  const below = new THREE.Plane(new THREE.Vector3(0, 0, -1), 0);
  cubes.material.clippingPlanes = [below];
  const matrix = new THREE.Matrix4();
  const color = new THREE.Color();
  const box = new THREE.Box3();
  for (let i = 0; i < values.length; i++) {
    const [x, y, z, width, depth, height] = boxes.subarray(6 * i, 6 * i + 6);
    matrix.makeScale(width, depth, height).setPosition(x + width / 2, y + depth / 2, z + height / 2);
    cubes.setMatrixAt(i, matrix);
    cubes.setColorAt(i, color.setHSL(0.67 * (1 - values[i] / 255), 0.75, 0.55));
    box.expandByPoint(new THREE.Vector3(x, y, z));
    box.expandByPoint(new THREE.Vector3(x + width, y + depth, z + height));
  }
  scene.add(cubes);

  const size = box.getSize(new THREE.Vector3()).length();
  box.getCenter(controls.target);
  camera.position.copy(controls.target).add(new THREE.Vector3(-0.35, -0.55, 0.6).multiplyScalar(size));
  camera.near = size / 1000;
  camera.far = size * 10;

  const draw = () => renderer.render(scene, camera);
  const resize = () => {
    renderer.setPixelRatio(window.devicePixelRatio);
    renderer.setSize(canvas.clientWidth, canvas.clientHeight, false);
    camera.aspect = canvas.clientWidth / canvas.clientHeight;
    camera.updateProjectionMatrix();
    draw();
  };
  const cut = () => {
    below.constant = box.min.z + slider.value / 100 * (box.max.z - box.min.z);
    draw();
  };
  controls.addEventListener('change', draw);
  slider.addEventListener('input', cut);
  window.addEventListener('resize', resize);
  controls.update();
  cut();
  resize();
}
