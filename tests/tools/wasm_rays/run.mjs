// Casts the rays of scenes in WebAssembly, and prints millions of rays a second: node run.mjs MODULE FOLDER...
import { readFile } from "node:fs/promises";
import { basename } from "node:path";

const PARTS = ["frame", "grid", "nodes", "summaries", "atlas"];
const ROUNDS = 9;
const [module, ...folders] = process.argv.slice(2);

for (const folder of folders) {
  const { instance } = await WebAssembly.instantiate(await readFile(module), {});
  const { memory, make_room, draw } = instance.exports;
  for (const [number, name] of PARTS.entries()) {
    const bytes = await readFile(`${folder}/${name}.bin`);
    const address = make_room(number, bytes.length / 4);
    new Uint8Array(memory.buffer, address, bytes.length).set(bytes);
  }
  const { pixels } = JSON.parse(await readFile(`${folder}/scene.json`));
  const best = [true, false].map((inPackets) => {
    let [least, sum] = [Infinity, 0];
    for (let round = 0; round < ROUNDS; round++) {
      const begin = performance.now();
      sum = draw(inPackets);
      least = Math.min(least, performance.now() - begin);
    }
    return { mrays: pixels / least / 1e3, sum };
  });
  if (best[0].sum !== best[1].sum) throw new Error(`${folder}: packets draw another picture than single rays`);
  console.log(`${basename(folder)}: packets ${best[0].mrays.toFixed(2)}, single rays ${best[1].mrays.toFixed(2)} million rays a second`);
}
