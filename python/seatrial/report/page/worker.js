// The core in a worker: a request in TOML in, numbers and text out. The page never waits for it.
"use strict";
let module = null, core = null;
const toBytes = new TextEncoder(), toText = new TextDecoder();

function call(name, request) {
  const bytes = toBytes.encode(request);
  const place = core.input(bytes.length);
  new Uint8Array(core.memory.buffer, place, bytes.length).set(bytes);
  const refused = core[name]();
  const text = toText.decode(new Uint8Array(core.memory.buffer, core.text(), core.text_length()));
  if (refused) throw new Error(text);
  return { numbers: new Float64Array(core.memory.buffer, core.numbers(), core.numbers_length()).slice(), text };
}

// Figures and a thin track, for clouds: whole logs of hundreds of flights would fill the memory.
function thinned({ numbers, text }, points) {
  const [figures, columns] = text.split("\n").map((line) => line.split(" "));
  const log = numbers.subarray(figures.length), width = columns.length, rows = log.length / width;
  const step = Math.max(1, Math.floor(rows / points)), track = [];
  for (let row = 0; row < rows; row += step) for (let axis = 0; axis < 3; axis++) track.push(log[row * width + axis]);
  return { numbers: Float64Array.from([...numbers.subarray(0, figures.length), ...track]), text };
}

onmessage = async ({ data }) => {
  if (data.core) {
    module = await WebAssembly.compile(data.core);
    core = (await WebAssembly.instantiate(module, {})).exports;
    postMessage({ ready: true });
    return;
  }
  try {
    const begin = performance.now();
    let result = call(data.call, data.request);
    if (data.points) result = thinned(result, data.points);
    const ms = performance.now() - begin;
    postMessage({ id: data.id, ms, ...result }, [result.numbers.buffer]);
  } catch (error) {
    // After a trap the memory may be in any state: begin afresh.
    if (error instanceof WebAssembly.RuntimeError) core = (await WebAssembly.instantiate(module, {})).exports;
    postMessage({ id: data.id, error: String(error.message || error) });
  }
};
