// Runs tests in the browser's Python, under node: node pyodide_tests.mjs PYODIDE ARCHIVES... -- ARGUMENTS OF PYTEST
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
const [runtime, ...rest] = process.argv.slice(2);
const end = rest.indexOf("--"), archives = rest.slice(0, end), chosen = rest.slice(end + 1);
const { loadPyodide } = await import(pathToFileURL(`${runtime}/pyodide.mjs`).href);
const python = await loadPyodide({ indexURL: runtime });
for (const archive of archives) python.unpackArchive(Uint8Array.from(readFileSync(archive)), "zip", { extractDir: "/house" });
python.globals.set("chosen", JSON.stringify(chosen));
let code = 2;
try {
  code = python.runPython(`
import json, os, sys
os.chdir("/house")
sys.path[:0] = ["/house", "/house/tests"]
import pytest
int(pytest.main([*json.loads(chosen), "--noconftest", "-p", "no:cacheprovider", "-q"]))
`);
} catch (error) {
  console.error(error.message);  // an uncaught one would print the runtime, a single line
}
process.exit(code);
