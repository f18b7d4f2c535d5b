// Reads a GLB: everything drawn becomes a few large batches, one for each material, in the scene's own metres.
"use strict";

function readGlb(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (view.getUint32(0, true) !== 0x46546c67) throw new Error("the page's model is no GLB");
  const length = view.getUint32(12, true);
  const document_ = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + length)));
  return { document: document_, binary: bytes.slice(20 + length + 8) };
}

function accessorValues(glb, index) {
  const accessor = glb.document.accessors[index], range = glb.document.bufferViews[accessor.bufferView];
  const kinds = { 5126: Float32Array, 5123: Uint16Array, 5125: Uint32Array };
  const width = { SCALAR: 1, VEC2: 2, VEC3: 3 }[accessor.type];
  const start = (range.byteOffset || 0) + (accessor.byteOffset || 0);
  return new kinds[accessor.componentType](glb.binary.buffer, start, accessor.count * width);
}

function nodeMatrix(node) {
  const [x, y, z, w] = node.rotation || [0, 0, 0, 1], [a, b, c] = node.scale || [1, 1, 1];
  const [tx, ty, tz] = node.translation || [0, 0, 0];
  return [
    a * (1 - 2 * (y * y + z * z)), a * 2 * (x * y + z * w), a * 2 * (x * z - y * w), 0,
    b * 2 * (x * y - z * w), b * (1 - 2 * (x * x + z * z)), b * 2 * (y * z + x * w), 0,
    c * 2 * (x * z + y * w), c * 2 * (y * z - x * w), c * (1 - 2 * (x * x + y * y)), 0,
    tx, ty, tz, 1,
  ];
}

function product(a, b) {
  const out = new Array(16).fill(0);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) out[column * 4 + row] += a[k * 4 + row] * b[column * 4 + k];
  return out;
}

class Batch {
  constructor(material, ceiling) {
    Object.assign(this, { material, ceiling, vertices: [], triangles: [] });
  }

  add(glb, primitive, m) {
    const positions = accessorValues(glb, primitive.attributes.POSITION);
    const normals = accessorValues(glb, primitive.attributes.NORMAL);
    const uvs = "TEXCOORD_0" in primitive.attributes ? accessorValues(glb, primitive.attributes.TEXCOORD_0) : null;
    const first = this.vertices.length / 8;
    // Normals turn with the cofactors of the matrix: right also where an axis is stretched.
    const n = [
      m[5] * m[10] - m[6] * m[9], m[6] * m[8] - m[4] * m[10], m[4] * m[9] - m[5] * m[8],
      m[9] * m[2] - m[10] * m[1], m[10] * m[0] - m[8] * m[2], m[8] * m[1] - m[9] * m[0],
      m[1] * m[6] - m[2] * m[5], m[2] * m[4] - m[0] * m[6], m[0] * m[5] - m[1] * m[4],
    ];
    for (let i = 0, count = positions.length / 3; i < count; i++) {
      const [x, y, z] = positions.subarray(3 * i, 3 * i + 3), [u, v, w] = normals.subarray(3 * i, 3 * i + 3);
      const nx = n[0] * u + n[3] * v + n[6] * w, ny = n[1] * u + n[4] * v + n[7] * w, nz = n[2] * u + n[5] * v + n[8] * w;
      const size = Math.hypot(nx, ny, nz) || 1;
      this.vertices.push(
        m[0] * x + m[4] * y + m[8] * z + m[12], m[1] * x + m[5] * y + m[9] * z + m[13],
        m[2] * x + m[6] * y + m[10] * z + m[14], nx / size, ny / size, nz / size,
        uvs ? uvs[2 * i] : 0, uvs ? uvs[2 * i + 1] : 0,
      );
    }
    for (const index of accessorValues(glb, primitive.indices)) this.triangles.push(first + index);
  }
}

function batchesOf(glb) {
  const batches = new Map(), { nodes, meshes, scenes, scene } = glb.document;
  const visit = (index, above) => {
    const node = nodes[index], matrix = product(above, nodeMatrix(node));
    if (node.mesh !== undefined)
      for (const primitive of meshes[node.mesh].primitives) {
        const ceiling = (node.name || "").startsWith("ceiling"), key = `${primitive.material} ${ceiling}`;
        if (!batches.has(key)) batches.set(key, new Batch(glb.document.materials[primitive.material], ceiling));
        batches.get(key).add(glb, primitive, matrix);
      }
    for (const child of node.children || []) visit(child, matrix);
  };
  for (const root of scenes[scene || 0].nodes) visit(root, nodeMatrix({}));
  return [...batches.values()];
}

function texturePicture(glb, index) {
  const image = glb.document.images[glb.document.textures[index].source];
  const range = glb.document.bufferViews[image.bufferView], start = range.byteOffset || 0;
  const bytes = glb.binary.subarray(start, start + range.byteLength);
  return createImageBitmap(new Blob([bytes], { type: image.mimeType }), { colorSpaceConversion: "none" });
}
