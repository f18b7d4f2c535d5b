// Draws the page's GLB with three.js: one sun with soft shadows, light from sky and ground, and a level cut through everything.
"use strict";

const UNCUT = 1e6;

class Painter {
  constructor(canvas, fov) {
    const context = canvas.getContext("webgl2", { antialias: true, alpha: false });
    if (!context) throw new Error("WebGL 2 is missing");
    this.renderer = new THREE.WebGLRenderer({ canvas, context });
    Object.assign(this.renderer, { outputEncoding: THREE.sRGBEncoding, localClippingEnabled: true });
    Object.assign(this.renderer.shadowMap, { enabled: true, type: THREE.PCFSoftShadowMap, autoUpdate: false });
    this.canvas = canvas;
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(THREE.MathUtils.radToDeg(fov));
    this.plane = new THREE.Plane(new THREE.Vector3(0, -1, 0), UNCUT);
    // The inside of a solid shows only where it is cut.
    const before = { polygonOffset: true, polygonOffsetFactor: 0, polygonOffsetUnits: -16 };
    this.section = new THREE.MeshBasicMaterial({ side: THREE.BackSide, clippingPlanes: [this.plane], ...before });
    this.materials = new Map();
    this.ceilings = [];
    this.insides = [];
  }

  /** Reads the GLB; resolves once its pictures are there. */
  async load(bytes) {
    const loader = new THREE.GLTFLoader().register((parser) => {
      // As elements, pictures need no fetch, which the page's policy forbids.
      parser.textureLoader = new THREE.TextureLoader(parser.options.manager);
      return { name: "pictures" };
    });
    const { scene } = await new Promise((resolve, reject) => loader.parse(bytes.buffer, "", resolve, reject));
    const meshes = [];
    scene.traverse((node) => { if (node.isMesh) meshes.push(node); });
    for (const mesh of meshes) this.prepare(mesh);
    this.scene.add(scene);
    this.light(new THREE.Box3().setFromObject(scene));
  }

  /** The material without gloss, which costs half on a machine without a graphics card. */
  matt({ color, map, transparent, opacity, depthWrite }) {
    if (map) map.anisotropy = 8;
    const cutting = { clippingPlanes: [this.plane], clipShadows: true, shadowSide: THREE.DoubleSide };
    return new THREE.MeshLambertMaterial({ color, map, transparent, opacity, depthWrite, ...cutting });
  }

  prepare(mesh) {
    if (!this.materials.has(mesh.material)) this.materials.set(mesh.material, this.matt(mesh.material));
    const material = (mesh.material = this.materials.get(mesh.material)), ceiling = mesh.name.startsWith("ceiling");
    mesh.receiveShadow = true;
    mesh.castShadow = !ceiling && !material.transparent;
    if (ceiling) this.ceilings.push(mesh);
    if (material.transparent) return;
    const inside = new THREE.Mesh(mesh.geometry, this.section);
    this.insides.push(inside);
    mesh.add(inside);
  }

  light(bounds) {
    const middle = bounds.getCenter(new THREE.Vector3()), radius = bounds.getSize(new THREE.Vector3()).length() / 2;
    const sun = new THREE.DirectionalLight(new THREE.Color(0.62, 0.58, 0.5));
    sun.position.set(-0.42, 0.82, 0.39).normalize().multiplyScalar(2 * radius).add(middle);
    sun.target.position.copy(middle);
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    Object.assign(sun.shadow, { bias: -0.0005, normalBias: 0.02 });
    Object.assign(sun.shadow.camera, { left: -radius, right: radius, bottom: -radius, top: radius, near: 0, far: 4 * radius });
    this.scene.add(sun, sun.target, new THREE.HemisphereLight(new THREE.Color(0.6, 0.63, 0.68), new THREE.Color(0.4, 0.37, 0.34), 0.92));
    this.renderer.shadowMap.needsUpdate = true;
  }

  /** Turns the camera; the shares of the picture that are covered count as outside. */
  look({ eye, target, near = 0.05, far = 100, covered = { left: 0, top: 0, bottom: 0 } }) {
    const { camera, canvas } = this;
    camera.aspect = canvas.clientWidth / Math.max(1, canvas.clientHeight);
    Object.assign(camera, { near: Math.max(0.05, near), far });
    camera.updateProjectionMatrix();
    camera.projectionMatrix.elements[8] -= covered.left;
    camera.projectionMatrix.elements[9] -= covered.bottom - covered.top;
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    camera.position.set(...eye);
    // Straight down, north is up the picture.
    camera.up.set(0, 1, eye[0] === target[0] ? -1 : 0);
    camera.lookAt(...target);
    camera.updateMatrixWorld();
  }

  /** Draws the scene; `look` holds cut (metres or nothing), ceiling, ground and section (colours, 0 to 1). */
  draw({ cut, ceiling, ground, section }) {
    const { renderer, canvas } = this, level = cut === null ? UNCUT : cut;
    renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    renderer.setSize(canvas.clientWidth, canvas.clientHeight, false);
    renderer.shadowMap.needsUpdate ||= this.plane.constant !== level;
    this.plane.constant = level;
    this.section.color.setRGB(...section).convertSRGBToLinear();
    this.scene.background = new THREE.Color(...ground);
    for (const mesh of this.ceilings) mesh.visible = ceiling;
    for (const inside of this.insides) inside.visible = cut !== null;
    renderer.render(this.scene, this.camera);
  }
}
