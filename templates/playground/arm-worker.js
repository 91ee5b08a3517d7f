/* Runs the emitted JavaScript of one arm, perhaps a stranger's, away from the page: it sees poses and joint values alone.
 *
 * { name, source } loads a module, { name, call, values, times } calls a function of it, `times` times to measure one call. */
"use strict";
const modules = {};
addEventListener("message", async ({ data }) => {
  try {
    if (data.source !== undefined) {
      const address = URL.createObjectURL(new Blob([data.source], { type: "text/javascript" }));
      modules[data.name] = await import(address);
      URL.revokeObjectURL(address);
      postMessage({ id: data.id, result: true });
    } else {
      const call = modules[data.name][data.call], times = data.times || 1, begin = performance.now();
      let value = null;
      for (let k = 0; k < times; k++) value = call(...data.values);
      postMessage({ id: data.id, result: data.times ? { value, microseconds: 1000 * (performance.now() - begin) / times } : value });
    }
  } catch (error) {
    postMessage({ id: data.id, error: String(error) });
  }
});
