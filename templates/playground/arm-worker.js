/* Runs the emitted JavaScript of one arm, perhaps a stranger's, away from the page: it sees poses and joint values alone. */
"use strict";
let arm = null;
addEventListener("message", async ({ data }) => {
  try {
    if (data.source !== undefined) {
      const address = URL.createObjectURL(new Blob([data.source], { type: "text/javascript" }));
      arm = await import(address);
      URL.revokeObjectURL(address);
      postMessage({ id: data.id, result: true });
    } else {
      const begin = performance.now();
      postMessage({ id: data.id, result: arm[data.call](...data.values), microseconds: 1000 * (performance.now() - begin) });
    }
  } catch (error) {
    postMessage({ id: data.id, error: String(error) });
  }
});
