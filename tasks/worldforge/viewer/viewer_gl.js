// Draws batches with WebGL 2: one sun with soft shadows, light from sky and ground, and a level cut through everything.
"use strict";

const SUN = (() => {
  const [x, y, z] = [-0.42, 0.82, 0.39], size = Math.hypot(x, y, z);
  return [x / size, y / size, z / size];
})();
const SHADOW_PX = 2048;

const VERTEX = `#version 300 es
layout(location=0) in vec3 position; layout(location=1) in vec3 normal; layout(location=2) in vec2 uv;
uniform mat4 view; uniform mat4 sunView;
out vec3 place; out vec3 facing; out vec2 spot; out vec3 shade;
void main() {
  place = position; facing = normal; spot = uv; gl_Position = view * vec4(position, 1);
  shade = (sunView * vec4(position + normal * .02, 1)).xyz * .5 + .5;
}`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DShadow;
in vec3 place; in vec3 facing; in vec2 spot; in vec3 shade;
uniform vec4 color; uniform sampler2D picture; uniform sampler2DShadow shadows;
uniform vec3 sun; uniform float cut; uniform float textured; uniform vec3 section;
out vec4 result;
float lit() {
  float sum = 0.;
  for (int i = -1; i <= 1; i++) for (int j = -1; j <= 1; j++)
    sum += texture(shadows, vec3(shade.xy + vec2(i, j) * (1. / ${SHADOW_PX}.), shade.z - .0012));
  return sum / 9.;
}
void main() {
  if (place.y > cut) discard;
  // The inside of a solid shows only where it is cut.
  if (!gl_FrontFacing) { result = vec4(section, 1); return; }
  vec3 n = normalize(facing);
  vec4 base = color * (textured > .5 ? texture(picture, spot) : vec4(1));
  vec3 sky = mix(vec3(.40, .37, .34), vec3(.60, .63, .68), n.y * .5 + .5);
  float side = max(dot(n, sun), 0.) * lit();
  vec3 light = sky * (.9 + .1 * n.x) + vec3(.62, .58, .50) * side;
  vec3 linear = base.rgb * light;
  result = vec4(pow(clamp(linear, 0., 1.), vec3(1. / 2.2)), base.a);
}`;

const SHADOW_FRAGMENT = `#version 300 es
precision highp float;
in vec3 place; uniform float cut;
void main() { if (place.y > cut) discard; }`;

class Painter {
  constructor(canvas, glb) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
    if (!gl) throw new Error("WebGL 2 is missing");
    Object.assign(this, { gl, canvas, pictures: new Map() });
    this.program = this.link(VERTEX, FRAGMENT);
    this.shadowProgram = this.link(VERTEX, SHADOW_FRAGMENT);
    this.blank = this.texture(null);
    this.batches = batchesOf(glb).map((batch) => this.upload(batch, glb));
    this.bounds = this.extent();
    this.shadows = this.shadowMap();
    this.shadowsFor = null;
  }

  link(vertex, fragment) {
    const { gl } = this, program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS), at = {};
    for (let i = 0; i < count; i++) {
      const { name } = gl.getActiveUniform(program, i);
      at[name] = gl.getUniformLocation(program, name);
    }
    return { program, at };
  }

  upload(batch, glb) {
    const { gl } = this, vertices = new Float32Array(batch.vertices), array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
    for (const [slot, size, start] of [[0, 3, 0], [1, 3, 12], [2, 2, 24]]) {
      gl.enableVertexAttribArray(slot);
      gl.vertexAttribPointer(slot, size, gl.FLOAT, false, 32, start);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(batch.triangles), gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    const surface = batch.material.pbrMetallicRoughness, texture = surface.baseColorTexture;
    if (texture && !this.pictures.has(texture.index)) this.pictures.set(texture.index, this.fetched(glb, texture.index));
    return {
      array, vertices, count: batch.triangles.length, ceiling: batch.ceiling,
      color: surface.baseColorFactor || [1, 1, 1, 1], clear: batch.material.alphaMode === "BLEND",
      picture: texture ? this.pictures.get(texture.index) : null,
    };
  }

  fetched(glb, index) {
    const entry = { texture: null };
    entry.arrives = texturePicture(glb, index).then((bitmap) => { entry.texture = this.texture(bitmap); });
    return entry;
  }

  texture(bitmap) {
    const { gl } = this, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    if (bitmap) gl.texImage2D(gl.TEXTURE_2D, 0, gl.SRGB8_ALPHA8, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
    else gl.texImage2D(gl.TEXTURE_2D, 0, gl.SRGB8_ALPHA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([255, 255, 255, 255]));
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    const finer = gl.getExtension("EXT_texture_filter_anisotropic");
    if (finer) gl.texParameterf(gl.TEXTURE_2D, finer.TEXTURE_MAX_ANISOTROPY_EXT, 8);
    return texture;
  }

  /** Resolves when all pictures are there. */
  ready() {
    return Promise.all([...this.pictures.values()].map((entry) => entry.arrives));
  }

  extent() {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const { vertices } of this.batches)
      for (let i = 0; i < vertices.length; i += 8)
        for (let axis = 0; axis < 3; axis++) {
          low[axis] = Math.min(low[axis], vertices[i + axis]);
          high[axis] = Math.max(high[axis], vertices[i + axis]);
        }
    return { low, high, middle: low.map((value, axis) => (value + high[axis]) / 2), radius: Math.hypot(...low.map((value, axis) => high[axis] - value)) / 2 };
  }

  shadowMap() {
    const { gl } = this, depth = gl.createTexture(), frame = gl.createFramebuffer();
    gl.bindTexture(gl.TEXTURE_2D, depth);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_PX, SHADOW_PX);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, depth, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const { middle, radius } = this.bounds, r = radius * 1.02;
    const from = middle.map((value, axis) => value + SUN[axis] * 2 * r);
    const flat = [1 / r, 0, 0, 0, 0, 1 / r, 0, 0, 0, 0, -1 / r, 0, 0, 0, -2, 1];
    return { depth, frame, view: product(flat, lookAt(from, middle)) };
  }

  castShadows(cut) {
    if (this.shadowsFor === cut) return;
    const { gl, shadows } = this, { program, at } = this.shadowProgram;
    gl.bindFramebuffer(gl.FRAMEBUFFER, shadows.frame);
    gl.viewport(0, 0, SHADOW_PX, SHADOW_PX);
    gl.useProgram(program);
    gl.uniformMatrix4fv(at.view, false, shadows.view);
    gl.uniform1f(at.cut, cut);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    for (const batch of this.batches) if (!batch.ceiling && !batch.clear) this.drawBatch(batch);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.shadowsFor = cut;
  }

  drawBatch(batch) {
    this.gl.bindVertexArray(batch.array);
    this.gl.drawElements(this.gl.TRIANGLES, batch.count, this.gl.UNSIGNED_INT, 0);
  }

  /** Draws the scene; `look` holds view, cut (metres), cutting, ceiling, ground and section (colours, 0 to 1). */
  draw(look) {
    const { gl, canvas } = this, { program, at } = this.program;
    this.castShadows(look.cut);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(...look.ground, 1);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(program);
    gl.uniformMatrix4fv(at.view, false, look.view);
    gl.uniformMatrix4fv(at.sunView, false, this.shadows.view);
    gl.uniform3fv(at.sun, SUN);
    gl.uniform3fv(at.section, look.section);
    gl.uniform1f(at.cut, look.cut);
    gl.uniform1i(at.picture, 0);
    gl.uniform1i(at.shadows, 1);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.shadows.depth);
    gl.activeTexture(gl.TEXTURE0);
    (look.cutting ? gl.disable : gl.enable).call(gl, gl.CULL_FACE);
    const shown = this.batches.filter((batch) => look.ceiling || !batch.ceiling);
    for (const batch of shown) if (!batch.clear) this.paint(batch, at);
    gl.enable(gl.CULL_FACE);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    for (const batch of shown) if (batch.clear) this.paint(batch, at);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  paint(batch, at) {
    const { gl } = this, texture = batch.picture && batch.picture.texture;
    gl.uniform4fv(at.color, batch.color);
    gl.uniform1f(at.textured, texture ? 1 : 0);
    gl.bindTexture(gl.TEXTURE_2D, texture || this.blank);
    this.drawBatch(batch);
  }
}

function lookAt(from, to) {
  const away = from.map((value, axis) => value - to[axis]), far = Math.hypot(...away), [zx, zy, zz] = away.map((value) => value / far);
  // Straight down, north is up the picture.
  const up = Math.abs(zy) > 0.9999 ? [0, 0, -1] : [0, 1, 0];
  let x = [up[1] * zz - up[2] * zy, up[2] * zx - up[0] * zz, up[0] * zy - up[1] * zx];
  const size = Math.hypot(...x);
  x = x.map((value) => value / size);
  const y = [zy * x[2] - zz * x[1], zz * x[0] - zx * x[2], zx * x[1] - zy * x[0]];
  const along = (axis) => -(axis[0] * from[0] + axis[1] * from[1] + axis[2] * from[2]);
  return [x[0], y[0], zx, 0, x[1], y[1], zy, 0, x[2], y[2], zz, 0, along(x), along(y), along([zx, zy, zz]), 1];
}

function perspective(fov, aspect, near, far) {
  const f = 1 / Math.tan(fov / 2);
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
}
