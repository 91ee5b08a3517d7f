/* The compiler in a worker: Python compiled to WebAssembly, with everything in the folder of the page. */
import { loadPyodide } from "./pyodide/pyodide.mjs";

const PLACE = "/compiler", OUT = "/work";
let python = null, compiler = null;

function tell(done, text) { postMessage({ progress: done, text }); }

async function start() {
  const sizes = await (await fetch("sizes.json")).json();
  const megabytes = Object.values(sizes).reduce((sum, size) => sum + size, 0) / 1e6;
  tell(0.05, `Loading the compiler, ${megabytes.toFixed(0)} MB`);
  const archive = fetch("compiler.zip").then((response) => response.arrayBuffer());
  python = await loadPyodide({ indexURL: new URL("./pyodide/", import.meta.url).href });
  tell(0.45, "Unpacking the compiler");
  python.unpackArchive(await archive, "zip", { extractDir: PLACE });
  tell(0.65, "Starting the compiler");
  python.runPython(`
import sys
sys.path.insert(0, "${PLACE}")
import json
from rrrgen.base.errors import RrrgenError
from rrrgen.emit.html import playground

def answer(call, values):
    try:
        return json.dumps({"result": getattr(playground, call)(*json.loads(values))})
    except RrrgenError as error:
        return json.dumps({"error": str(error)})

def package(values):
    from rrrgen.cli.playground import package
    return json.dumps(package(*json.loads(values)))
`);
  compiler = { answer: python.globals.get("answer"), package: python.globals.get("package") };
  tell(0.85, "Starting the compiler");
  compiler.answer("check", JSON.stringify([""]));
  tell(1, "The compiler is ready.");
}

const ready = start().catch((error) => {
  postMessage({ failed: String(error) });
  throw error;
});

addEventListener("message", async ({ data }) => {
  await ready;
  try {
    if (data.call === "package") {
      const result = JSON.parse(compiler.package(JSON.stringify([data.values[0], OUT, ...data.values.slice(1)])));
      const zip = result.code === 0 ? python.FS.readFile(result.zip) : null;
      postMessage({ id: data.id, result: { ...result, zip } });
      return;
    }
    const { result, error } = JSON.parse(compiler.answer(data.call, JSON.stringify(data.values)));
    postMessage({ id: data.id, result, error });
  } catch (error) {
    postMessage({ id: data.id, error: String(error).trim().split("\n").pop() });
  }
});
