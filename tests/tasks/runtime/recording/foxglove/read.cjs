// Reads a recording with the libraries that Foxglove reads recordings with, and prints what it found, a line per
// message. Numbers that JSON has not are written as texts, bytes in hexadecimal.

const { open } = require("node:fs/promises");
const { McapIndexedReader } = require("@mcap/core");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");
const zstd = require("@foxglove/wasm-zstd");

async function readableFile(path) {
  const file = await open(path);
  const size = BigInt((await file.stat()).size);
  return {
    size: async () => size,
    read: async (offset, length) => {
      const buffer = new Uint8Array(Number(length));
      const { bytesRead } = await file.read(buffer, 0, buffer.length, Number(offset));
      if (bytesRead !== buffer.length) {
        throw new Error(`${bytesRead} of ${length} bytes at ${offset}`);
      }
      return buffer;
    },
  };
}

function plain(_, value) {
  if (value instanceof Uint8Array) {
    return Buffer.from(value).toString("hex");
  }
  if (ArrayBuffer.isView(value)) {
    return Array.from(value);
  }
  return typeof value === "number" && !Number.isFinite(value) ? String(value) : value;
}

async function main(path) {
  await zstd.isLoaded;
  const decompressHandlers = { zstd: (data, size) => zstd.decompress(data, Number(size)) };
  const reader = await McapIndexedReader.Initialize({ readable: await readableFile(path), decompressHandlers });
  const readers = new Map();
  for (const [id, schema] of reader.schemasById) {
    const definition = parse(new TextDecoder().decode(schema.data), { ros2: true });
    readers.set(id, new MessageReader(definition));
  }
  for await (const { channelId, logTime, data } of reader.readMessages()) {
    const { topic, schemaId } = reader.channelsById.get(channelId);
    const message = readers.get(schemaId).readMessage(data);
    console.log(JSON.stringify([topic, String(logTime), message], plain));
  }
}

main(process.argv[2]).catch((error) => {
  console.error(error);
  process.exitCode = 1;
});
