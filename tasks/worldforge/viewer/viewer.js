// The page: a camera that circles what it looks at, buttons, keys, and the rooms' names.
"use strict";

const FOV = 0.75;
const $ = (id) => document.getElementById(id);

class Viewer {
  constructor(world) {
    const bytes = Uint8Array.from(atob($("glb").textContent.trim()), (letter) => letter.charCodeAt(0));
    this.world = world;
    this.canvas = $("view");
    this.painter = new Painter(this.canvas, FOV);
    this.state = { ceiling: true, labels: true, cut: null };
    this.pointers = new Map();
    this.setBounds(world.bounds);
    this.home();
    this.addLabels();
    this.listen();
    this.addControls();
    this.painter.load(bytes).then(() => {
      this.complete = true;
      this.draw();
    }).catch(fail);
  }

  setBounds([low, high]) {
    const middle = low.map((value, axis) => (value + high[axis]) / 2);
    this.bounds = { low, high, middle, radius: Math.hypot(...low.map((value, axis) => high[axis] - value)) / 2 };
  }

  home() {
    this.camera = { target: [...this.bounds.middle], yaw: -0.42, pitch: 0.95, distance: 1 };
    this.camera.target[1] = 0.4;
    this.fit(this.bounds.low, this.bounds.high);
  }

  /** Shares of the canvas, at its edges, that the panels cover; what lies beside the upper one is free, or what lies below it. */
  covered() {
    const { clientWidth: width, clientHeight: height } = this.canvas, panel = $("panel");
    const share = (pixels, whole) => Math.min(0.4, Math.max(0, pixels / Math.max(1, whole)));
    const bottom = share(height - $("bar").offsetTop, height);
    const left = share(panel.offsetLeft + panel.offsetWidth, width), top = share(panel.offsetTop + panel.offsetHeight, height);
    return (1 - left) * (1 - bottom) > 1 - top - bottom ? { left, top: 0, bottom } : { left: 0, top, bottom };
  }

  /** Goes so far away that a box is seen whole, and no nearer than it is said. */
  fit(low, high, nearest = 1) {
    const { camera } = this, aspect = this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
    const { left, top, bottom } = this.covered(), half = Math.tan(FOV / 2);
    this.painter.look({ eye: this.eye({ ...camera, distance: 1 }), target: camera.target });
    let distance = 1;
    for (let corner = 0; corner < 8; corner++) {
      const place = [0, 1, 2].map((axis) => ((corner >> axis) & 1 ? high : low)[axis]);
      const { x, y, z } = new THREE.Vector3(...place).applyMatrix4(this.painter.camera.matrixWorldInverse);
      distance = Math.max(distance, 1 + z + Math.max(Math.abs(y) / (half * (1 - top - bottom)), Math.abs(x) / (half * aspect * (1 - left))));
    }
    camera.distance = Math.max(distance * 1.06, nearest);
    this.fitted = [low, high];
    this.redraw();
  }

  eye({ target, yaw, pitch, distance }) {
    const flat = Math.cos(pitch) * distance;
    return [target[0] + flat * Math.sin(yaw), target[1] + Math.sin(pitch) * distance, target[2] + flat * Math.cos(yaw)];
  }

  turn(yaw, pitch) {
    this.camera.yaw += yaw;
    this.camera.pitch = Math.min(Math.PI / 2 - 0.001, Math.max(-0.15, this.camera.pitch + pitch));
    // Whatever was seen whole stays so; from the side it may be wider.
    if (this.fitted) this.fit(...this.fitted, this.camera.distance);
    else this.redraw();
  }

  zoom(factor) {
    this.fitted = null;
    this.camera.distance = Math.min(20 * this.bounds.radius, Math.max(0.4, this.camera.distance * factor));
    this.redraw();
  }

  /** Moves over the floor by pixels. */
  pan(dx, dy) {
    this.fitted = null;
    const { camera } = this, size = (2 * Math.tan(FOV / 2) * camera.distance) / this.canvas.clientHeight;
    const [s, c] = [Math.sin(camera.yaw), Math.cos(camera.yaw)], up = dy / Math.max(0.35, Math.sin(Math.abs(camera.pitch)));
    camera.target[0] -= size * (dx * c + up * s);
    camera.target[2] -= size * (up * c - dx * s);
    this.redraw();
  }

  toRoom(room) {
    const low = [room.west, 0, -room.north], high = [room.east, 1.2, -room.south];
    Object.assign(this.camera, { target: low.map((value, axis) => (value + high[axis]) / 2), pitch: 1.05 });
    this.fit(low, high);
  }

  redraw() {
    if (!this.waiting) this.waiting = requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.waiting = 0;
    const { camera, state } = this, reach = 2.5 * this.bounds.radius;
    const depths = { near: camera.distance - reach, far: camera.distance + reach };
    this.painter.look({ eye: this.eye(camera), target: camera.target, ...depths, covered: this.covered() });
    this.painter.draw({ cut: state.cut, ceiling: state.ceiling, ground: shade("--ground"), section: shade("--section") });
    this.placeLabels();
    document.body.dataset.state = this.complete ? "drawn" : "loading";
  }

  addLabels() {
    this.labels = this.world.rooms.map((room) => {
      const label = document.createElement("div");
      label.className = "label";
      label.append(room.name);
      const area = document.createElement("small");
      area.textContent = `${room.area_m2.toFixed(1)} m²`;
      label.append(area);
      $("labels").append(label);
      return [label, new THREE.Vector3(room.x, 0.1, -room.y)];
    });
  }

  placeLabels() {
    $("labels").hidden = !this.state.labels;
    for (const [label, place] of this.labels) {
      const { x, y, z } = place.clone().project(this.painter.camera);
      label.hidden = z > 1;
      label.style.transform = `translate(-50%,-50%) translate(${((x + 1) / 2) * this.canvas.clientWidth}px,${((1 - y) / 2) * this.canvas.clientHeight}px)`;
    }
  }

  listen() {
    const { canvas } = this;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, event);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
    }, { passive: false });
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      fail(new Error("the graphics system took WebGL away; reload the page"));
    });
    document.addEventListener("keydown", (event) => this.key(event));
    // Whatever was seen whole stays so in a window of another shape.
    new ResizeObserver(() => (this.fitted ? this.fit(...this.fitted) : this.redraw())).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
  }

  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
    const others = [...this.pointers.values()].filter((other) => other.pointerId !== event.pointerId);
    if (others.length) {
      const apart = (pointer) => Math.hypot(pointer.clientX - others[0].clientX, pointer.clientY - others[0].clientY) || 1;
      this.zoom(apart(before) / apart(event));
      this.pan(dx / 2, dy / 2);
    } else if (before.button === 0 && !event.shiftKey) this.turn(-dx * 0.006, dy * 0.006);
    else this.pan(dx, dy);
    this.pointers.set(event.pointerId, Object.defineProperty(event, "button", { value: before.button }));
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "INPUT") return;
    const move = event.shiftKey, arrows = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (event.key in arrows) {
      const [x, y] = arrows[event.key];
      if (move) this.pan(x * 40, y * 40);
      else this.turn(-x * 0.12, y * 0.08);
    } else if (event.key === "+" || event.key === "=") this.zoom(0.88);
    else if (event.key === "-") this.zoom(1 / 0.88);
    else {
      const button = document.querySelector(`button[data-key="${CSS.escape(event.key.toLowerCase())}"]`);
      if (!button) return;
      button.click();
    }
    event.preventDefault();
  }

  addControls() {
    const toggle = (id, member) => $(id).addEventListener("click", () => {
      this.state[member] = !this.state[member];
      $(id).setAttribute("aria-pressed", this.state[member]);
      this.redraw();
    });
    toggle("ceiling", "ceiling");
    toggle("names", "labels");
    $("home").addEventListener("click", () => this.home());
    $("above").addEventListener("click", () => {
      Object.assign(this.camera, { yaw: 0, pitch: Math.PI / 2 - 0.001, target: [...this.bounds.middle] });
      this.fit(this.bounds.low, this.bounds.high);
    });
    $("theme").addEventListener("click", () => {
      const root = document.documentElement;
      root.dataset.theme = isDark() ? "light" : "dark";
      this.redraw();
    });
    const cut = $("cut");
    cut.max = Math.ceil(this.bounds.high[1] * 20) / 20;
    cut.value = cut.max;
    cut.addEventListener("input", () => {
      this.state.cut = +cut.value >= +cut.max ? null : +cut.value;
      $("cut-text").textContent = +cut.value >= +cut.max ? "none" : `${(+cut.value).toFixed(2)} m`;
      this.redraw();
    });
    for (const room of this.world.rooms) {
      const button = document.createElement("button");
      button.textContent = room.name;
      button.addEventListener("click", () => this.toRoom(room));
      $("rooms").append(button);
    }
  }
}

function isDark() {
  return (document.documentElement.dataset.theme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
}

/** A colour of the style sheet, `r g b` from 0 to 255, as WebGL wants it. */
function shade(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim().split(/\s+/).map((value) => value / 255);
}

function fail(error) {
  document.body.dataset.state = "failed";
  $("problem").hidden = false;
  $("problem-text").textContent = error.message;
}

try {
  new Viewer(JSON.parse($("world").textContent));
} catch (error) {
  fail(error);
}
