/* The page of the playground: the robot file as a form and as text, the arm, and what the compiler derives from it.
 *
 * A bundled robot is drawn from its file in robots/, which was derived when the page was built. The compiler loads behind
 * the picture; what the user changes meanwhile is checked when it is there. */
const MOST_CHARACTERS = 100000, MOST_SECONDS = 120, COLUMNS = ["name", "type", "alpha", "a", "d", "theta"];
const HEADINGS = { name: "joint", type: "type", alpha: "α", a: "a", d: "d", theta: "θ" };
const TABS = { inverse_kinematics: "Inverse kinematics", base_parameters: "Base parameters", dynamics: "M and g", closed_forms: "Closed forms", code: "C code" };
let words = {}, controller = {};  // what --with, --modes and --parts offer: word -> meaning
const $ = (id) => document.getElementById(id);

/* -- workers: questions with numbered answers ------------------------------------------------------------------------- */

class Asked {
  constructor(file, heard, patience) {
    Object.assign(this, { file, heard, patience, number: 0, waiting: new Map(), stopped: () => {} });
    this.begin();
  }
  begin() {
    this.worker = new Worker(this.file, { type: "module" });
    this.worker.addEventListener("message", ({ data }) => {
      const asked = this.waiting.get(data.id);
      if (!asked) { this.heard(data); return; }
      this.waiting.delete(data.id);
      clearTimeout(asked.timer);
      if (data.error) asked.reject(new Error(data.error)); else asked.resolve(data.result);
    });
    this.worker.addEventListener("error", (event) => this.heard({ failed: event.message || "a worker did not start" }));
  }
  ask(message) {
    return new Promise((resolve, reject) => {
      const id = ++this.number;
      const timer = this.patience && setTimeout(() => { this.restart(); }, 1000 * this.patience);
      this.waiting.set(id, { resolve, reject, timer });
      this.worker.postMessage({ id, ...message });
    });
  }
  restart() {  // an answer that takes too long is given up, and so are those behind it
    this.worker.terminate();
    this.stopped();
    const waiting = [...this.waiting.values()];
    this.waiting.clear();
    waiting.forEach((asked) => { clearTimeout(asked.timer); asked.reject(new Error("this took too long and was stopped")); });
    this.begin();
  }
}

/* -- state -------------------------------------------------------------------------------------------------------------- */

let text = "", table = [], shownTab = "inverse_kinematics", derived = {}, files = null, edition = 0, compilerReady = false;
let compiler = null, arm = null, jointNames = [], chosen = "rrr.h";
const viewer = armViewer(showDynamics);
viewer.state.frames = false;

function status(message) { $("status").textContent = message; }

function compilerWorker() {
  if (compiler) return compiler;
  compiler = new Asked("compiler-worker.js", (said) => {
    if (said.failed) { status("The compiler does not start: " + said.failed); $("loading").classList.add("ready"); return; }
    $("progress").value = said.progress;
    status(said.text);
    if (said.progress === 1) { compilerReady = true; $("loading").classList.add("ready"); document.body.dataset.compiler = "ready"; }
  }, 0);
  compiler.stopped = () => { compilerReady = false; $("loading").classList.remove("ready"); };
  return compiler;
}
async function derive(call, ...values) {
  const worker = compilerWorker();
  while (!compilerReady) await new Promise((resolve) => setTimeout(resolve, 100));
  worker.patience = MOST_SECONDS;
  return worker.ask({ call, values });
}

/* -- the arm ------------------------------------------------------------------------------------------------------------ */

async function showArm(picture, keep) {
  const q = viewer.state.q.slice();
  const about = (picture.description ? picture.description + ". " : "") + "Inverse kinematics: " + picture.family + ".";
  document.body.dataset.arm = picture.name;
  $("viewer").hidden = !picture.scene;
  $("about").textContent = picture.scene ? about : about + " Closed loops are not drawn.";
  const solvers = {};
  if (arm) arm.worker.terminate();
  arm = new Asked("arm-worker.js", () => {}, 10);
  for (const [tip, source] of Object.entries(picture.solvers)) {
    const mine = arm, name = `solver ${tip}`, loaded = mine.ask({ name, source });
    const asked = (call) => async (...values) => { await loaded; return mine.ask({ name, call, values }); };
    solvers[tip] = Object.fromEntries(["tip_pose", "inverse_kinematics", "approach"].map((call) => [call, asked(call)]));
  }
  if (!picture.scene) return;
  jointNames = picture.scene.joints.map((joint) => joint.name);
  viewer.load(picture.scene, solvers);
  if (keep && q.length === picture.scene.start.length) { viewer.state.q = q; viewer.show(); }
  $("hint").hidden = !Object.keys(solvers).length;
}
/* Mass matrix and gravity torques in the posture shown; while one is computed, the last posture asked for waits. */
const LIVE = ["mass_matrix_nominal", "gravity_nominal"];
let computing = false, wanted = null;
async function loadDynamics() {
  const mine = arm;
  if (!derived.dynamics || $("viewer").hidden) return;
  await mine.ask({ name: "dynamics", source: derived.dynamics });
  mine.knowsDynamics = true;
  showDynamics(viewer.state.q);
}
async function showDynamics(q) {
  if (shownTab !== "dynamics" || !arm || !arm.knowsDynamics) return;
  wanted = q.slice();
  if (computing) return;
  computing = true;
  try {
    while (wanted) {
      const values = [wanted], mine = arm;
      wanted = null;
      const found = [];
      for (const call of LIVE) found.push(await mine.ask({ name: "dynamics", call, values, times: 100 }));
      if (mine === arm && shownTab === "dynamics") fillDynamics(...found);
    }
  } catch (error) {
    status(error.message);
  } finally {
    computing = false;
  }
}
function fillDynamics(mass, gravity) {
  const shown = $("shown"), number = (value) => (Math.abs(value) < 5e-6 ? "0" : Math.abs(value) < 0.01 ? value.toFixed(5) : value.toPrecision(4)).replace("-", "\u2212");
  if (!shown.querySelector("#mass")) {
    shown.innerHTML = "<div class='wide'><table id='mass'><thead></thead><tbody></tbody></table></div><p class='note' id='timed'></p>";
    const joints = jointNames, head = shown.querySelector("thead").insertRow();
    ["", "g", ...joints.map((_, k) => `M${k + 1}`)].forEach((name) => head.appendChild(Object.assign(document.createElement("th"), { scope: "col", className: "n", textContent: name })));
    joints.forEach((name) => {
      const row = shown.querySelector("tbody").insertRow();
      row.appendChild(Object.assign(document.createElement("th"), { scope: "row", textContent: name }));
      for (let k = 0; k <= joints.length; k++) row.insertCell().className = "n";
    });
  }
  mass.value.forEach((values, i) => [gravity.value[i], ...values].forEach((value, k) => {
    shown.querySelector("tbody").rows[i].cells[k + 1].textContent = number(value);
  }));
  $("timed").textContent = `In the posture shown, in SI units; g is the torque that holds the links. By mass_matrix_nominal(q) in ${mass.microseconds.toFixed(1)} \u00b5s and gravity_nominal(q) in ${gravity.microseconds.toFixed(1)} \u00b5s, the functions that rrrgen prints in JavaScript.`;
}
window.ringPlace = viewer.ringPlace;  // for tests
$("view").addEventListener("pointerup", () => $("hint").classList.add("done"));

/* -- the table ---------------------------------------------------------------------------------------------------------- */

function showTable(check) {
  table = check.joints || [];
  const head = $("dh").tHead, body = $("dh").tBodies[0];
  if (!head.rows.length) {
    const row = head.insertRow();
    for (const name of ["", ...COLUMNS]) {
      const cell = document.createElement("th");
      cell.scope = "col";
      cell.textContent = HEADINGS[name] || "";
      row.appendChild(cell);
    }
  }
  if (table.length || !check.faults.length) {
    while (body.rows.length > table.length) body.deleteRow(-1);
    table.forEach((joint, i) => {
      const row = body.rows[i] || newRow(body, i);
      COLUMNS.forEach((name, k) => {
        const input = row.cells[k + 1].firstChild, cell = joint[name];
        input.disabled = !cell;
        if (input !== document.activeElement) input.value = cell ? cell.text : "";
        const at = cell && check.faults.find((f) => f.severity === "error" && f.line === cell.line && f.column >= cell.column && f.column <= cell.column + cell.text.length);
        input.classList.toggle("wrong", Boolean(at));
        input.title = at ? at.message : "";
      });
    });
  }
  const units = check.units || {};
  $("units").textContent = table.length ? `angles in ${units.angle || "rad"}, lengths in ${units.length || "m"}; expressions such as pi/2 are welcome` : "";
  const list = $("faults");
  list.textContent = "";
  check.faults.forEach((fault) => {
    const item = document.createElement("li");
    item.className = fault.severity;
    if (fault.line) {
      const place = document.createElement("button");
      place.type = "button";
      place.textContent = `${fault.line}:${fault.column}`;
      place.addEventListener("click", () => goTo(fault.line, fault.column));
      item.append(place, " ");
    }
    item.append((fault.severity === "warning" ? "Warning: " : "") + fault.message);
    if (fault.hint) {
      const hint = document.createElement("small");
      hint.textContent = fault.hint;
      item.append(hint);
    }
    list.appendChild(item);
  });
}
function newRow(body, i) {
  const row = body.insertRow();
  row.insertCell().textContent = i + 1;
  COLUMNS.forEach((name) => {
    const input = document.createElement(name === "type" ? "select" : "input");
    if (name === "type") for (const value of ["revolute", "prismatic"]) input.add(new Option(value, value));
    input.setAttribute("aria-label", `${name} of joint ${i + 1}`);
    input.spellcheck = false;
    input.addEventListener("input", () => editCell(i, name, input.value));
    row.insertCell().appendChild(input);
  });
  return row;
}
function offset(line, column) {
  let at = 0;
  for (let k = 1; k < line; k++) at = text.indexOf("\n", at) + 1;
  return at + column - 1;
}
/* A cell replaces its value in the text, and nothing else; cells behind it on the line move along. */
function editCell(i, name, value) {
  const cell = table[i][name];
  if (!cell) return;
  const at = offset(cell.line, cell.column), written = value.replace(/[\r\n]/g, " ");
  change(text.slice(0, at) + written + text.slice(at + cell.text.length));
  const moved = written.length - cell.text.length, from = cell.column;
  cell.text = written;
  table.forEach((joint) => COLUMNS.forEach((other) => {
    const place = joint[other];
    if (place && place !== cell && place.line === cell.line && place.column > from) place.column += moved;
  }));
}
function goTo(line, column) {
  $("file").open = true;
  const area = $("text"), at = offset(line, column);
  area.focus();
  area.setSelectionRange(at, at + 1);
}
function jointLines() {  // the lines of the last joint, where joints are written in one line each
  const last = table[table.length - 1], cell = last && Object.values(last).find(Boolean);
  return cell ? cell.line : 0;
}
$("more").addEventListener("click", () => {
  const lines = text.split("\n"), last = jointLines();
  if (!last) return;
  const flow = /^\s*-\s*\{/.test(lines[last - 1]), indent = (lines[last - 1].match(/^\s*/) || [""])[0];
  let end = last;
  if (!flow) while (end < lines.length && /^\s+[^-\s]|^\s{4,}/.test(lines[end])) end++;
  const dash = flow ? indent : (lines.find((line) => /^\s*-\s/.test(line)) || "  -").match(/^\s*/)[0];
  lines.splice(end, 0, `${dash}- {type: revolute, alpha: 0, a: 0.1, d: 0, theta: 0}`);
  change(lines.join("\n"));
});
$("fewer").addEventListener("click", () => {
  const lines = text.split("\n"), last = jointLines();
  if (!last || table.length < 2) return;
  let begin = last - 1, end = last;
  while (begin > 0 && !/^\s*-\s/.test(lines[begin])) begin--;
  if (!/^\s*-\s*\{/.test(lines[begin])) while (end < lines.length && /^\s{4,}/.test(lines[end])) end++;
  lines.splice(begin, end - begin);
  change(lines.join("\n"));
});

/* -- a changed text: table and faults, then the picture, then what is derived ---------------------------------------------- */

let timer = 0;
function change(next, quick) {
  text = next.slice(0, MOST_CHARACTERS);
  if ($("text").value !== text) $("text").value = text;
  $("robot").value = "";
  files = null;
  clearTimeout(timer);
  const mine = ++edition;
  if (!compilerReady) status("Your change is read as soon as the compiler is loaded.");
  timer = setTimeout(() => rebuild(mine), quick ? 0 : 200);
}
async function rebuild(mine) {
  const current = () => mine === edition;
  try {
    const check = await derive("check", text);
    if (!current()) return;
    showTable(check);
    if (check.faults.some((fault) => fault.severity === "error")) { status("The arm shown is the last one without faults."); return; }
    const picture = await derive("picture", text);
    if (!current()) return;
    await showArm(picture, document.body.dataset.arm === picture.name);
    status("Deriving base parameters …");
    derived = {};
    showTab();
    const results = await derive("results", text);
    if (!current()) return;
    derived = results;
    await loadDynamics();
    showTab();
    status("Derived.");
    document.body.dataset.derived = String(mine);
  } catch (error) {
    if (current()) status(error.message);
  }
}
$("text").addEventListener("input", () => change($("text").value));

/* -- results ------------------------------------------------------------------------------------------------------------ */

Object.entries(TABS).forEach(([name, title]) => {
  const button = document.createElement("button");
  Object.assign(button, { type: "button", textContent: title, id: `tab-${name}` });
  button.setAttribute("role", "tab");
  button.setAttribute("aria-controls", "shown");
  button.addEventListener("click", () => { shownTab = name; showTab(); });
  button.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key], names = Object.keys(TABS);
    if (!step) return;
    shownTab = names[(names.indexOf(name) + step + names.length) % names.length];
    showTab();
    $(`tab-${shownTab}`).focus();
  });
  document.querySelector(".tabs").appendChild(button);
});
function showTab() {
  Object.keys(TABS).forEach((name) => {
    $(`tab-${name}`).setAttribute("aria-selected", String(name === shownTab));
    $(`tab-${name}`).tabIndex = name === shownTab ? 0 : -1;
  });
  $("shown").setAttribute("aria-labelledby", `tab-${shownTab}`);
  if (shownTab === "code") showCode();
  else if (shownTab === "dynamics") {
    const none = derived.dynamics === "" ? "The robot file states no links, so there is no mass matrix." : $("viewer").hidden ? "They follow the posture of the picture, and closed loops are not drawn." : "";
    $("shown").innerHTML = `<p class='note'>${none || "Being derived …"}</p>`;
    showDynamics(viewer.state.q);
  }
  else $("shown").innerHTML = derived[shownTab] || "<p class='note'>Being derived …</p>";  // made by the compiler, which escapes
}
const options = { real: "double", words: new Set(), modes: new Set(), parts: new Set() };
function choices(box, name, offered, chosen) {
  const bar = box.appendChild(Object.assign(document.createElement("fieldset"), { className: "bar" }));
  bar.appendChild(Object.assign(document.createElement("legend"), { textContent: name }));
  Object.entries(offered).forEach(([word, meaning]) => {
    const label = bar.appendChild(document.createElement("label"));
    const input = label.appendChild(Object.assign(document.createElement("input"), { type: "checkbox", checked: chosen.has(word) }));
    label.append(word);
    label.title = meaning;
    input.addEventListener("change", () => { chosen[input.checked ? "add" : "delete"](word); files = null; showCode(); });
  });
}
function showCode() {
  const shown = $("shown");
  shown.textContent = "";
  const box = shown.appendChild(document.createElement("div"));
  box.className = "code";
  const bar = box.appendChild(document.createElement("div"));
  bar.className = "bar";
  const real = bar.appendChild(document.createElement("label"));
  const float = real.appendChild(Object.assign(document.createElement("input"), { type: "checkbox", checked: options.real === "float" }));
  real.append("float");
  float.addEventListener("change", () => { options.real = float.checked ? "float" : "double"; files = null; showCode(); });
  choices(box, "with", words, options.words);
  if (options.words.has("controller")) {
    choices(box, "modes of the controller; none chosen: all that the arm has", controller.modes, options.modes);
    choices(box, "parts of the controller; none chosen: the usual ones", controller.parts, options.parts);
  }
  if (!files) {
    const make = box.appendChild(Object.assign(document.createElement("button"), { type: "button", className: "main", id: "make", textContent: "Print the C package" }));
    make.addEventListener("click", () => print(make).catch((error) => status(error.message)));
    box.appendChild(Object.assign(document.createElement("p"), { className: "note", textContent: "Functions with numbers of the robot folded in, inverse kinematics, self-test and build files: what rrrgen generate writes." }));
    return;
  }
  const second = box.appendChild(document.createElement("div"));
  second.className = "bar";
  const select = second.appendChild(document.createElement("select"));
  select.setAttribute("aria-label", "file");
  Object.keys(files.files).forEach((path) => select.add(new Option(path, path)));
  select.value = chosen in files.files ? chosen : `${document.body.dataset.arm}.h`;
  const copy = second.appendChild(Object.assign(document.createElement("button"), { type: "button", textContent: "Copy" }));
  const zip = second.appendChild(Object.assign(document.createElement("button"), { type: "button", textContent: "Download all as ZIP" }));
  const code = box.appendChild(Object.assign(document.createElement("pre"), { tabIndex: 0, id: "code" }));
  const show = () => { chosen = select.value; code.textContent = files.files[chosen]; };
  select.addEventListener("change", show);
  copy.addEventListener("click", () => toClipboard(files.files[chosen], `${chosen} is in the clipboard.`));
  zip.addEventListener("click", save);
  show();
}
async function print(button) {
  const mine = edition;
  if (button) button.disabled = true;
  status(compilerReady ? "Deriving and printing the package …" : "Printing begins when the compiler is loaded.");
  try {
    const own = options.words.has("controller") ? [[...options.modes], [...options.parts]] : [];
    const result = await derive("package", text, [...options.words], options.real, ...own);
    if (mine !== edition) return null;
    if (result.code !== 0) throw new Error(result.printed.trim().split("\n")[0] || "the package was not printed");
    files = result;
    status(`${Object.keys(result.files).length} files printed.`);
  } finally {
    if (button) button.disabled = false;
  }
  if (shownTab === "code") showCode();
  return files;
}
function save() {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([files.zip], { type: "application/zip" }));
  link.download = `${document.body.dataset.arm}.zip`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
$("download").addEventListener("click", async () => {
  try {
    if (files || await print($("download"))) save();
  } catch (error) {
    status(error.message);
  }
});

/* -- links: the robot file, compressed, behind the # that no server sees ----------------------------------------------------- */

async function packed(content) {
  const stream = new Blob([content]).stream().pipeThrough(new CompressionStream("deflate-raw"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  return btoa(String.fromCharCode(...bytes)).replace(/\+/g, "-").replace(/\//g, "_").replace(/=+$/, "");
}
async function unpacked(code) {
  const bytes = Uint8Array.from(atob(code.replace(/-/g, "+").replace(/_/g, "/")), (c) => c.charCodeAt(0));
  const reader = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw")).getReader();
  const parts = [];
  for (let size = 0; ;) {
    const { done, value } = await reader.read();
    if (done) break;
    size += value.length;
    if (size > MOST_CHARACTERS) throw new Error("the robot file of this link is too large");
    parts.push(value);
  }
  return new Blob(parts).text();
}
async function toClipboard(content, message) {
  try {
    await navigator.clipboard.writeText(content);
    status(message);
  } catch {
    status("The browser does not let the page write to the clipboard.");
  }
}
$("share").addEventListener("click", async () => {
  const name = $("robot").value, address = new URL(location.href);
  address.hash = name ? `robot=${name}` : `file=${await packed(text)}`;
  history.replaceState(null, "", address);
  await toClipboard(address.href, "The link is in the clipboard and in the address line.");
});

/* -- robots -------------------------------------------------------------------------------------------------------------- */

async function open(name) {
  const mine = ++edition;
  const robot = await (await fetch(`robots/${encodeURIComponent(name)}.json`)).json();
  if (mine !== edition) return;
  ({ text } = robot);
  $("text").value = text;
  files = null;
  derived = robot.results;
  await showArm(robot.picture, false);
  document.body.dataset.shown ||= String(Math.round(performance.now()));  // for tests: when the first picture was drawn
  loadDynamics().catch((error) => status(error.message));
  showTable(robot.check);
  showTab();
  $("robot").value = name;
}
$("robot").addEventListener("change", () => {
  if ($("robot").value) open($("robot").value).catch((error) => status(error.message));
});
async function begin() {
  const wanted = new URLSearchParams(location.hash.slice(1));
  const offered = fetch("offered.json").then((response) => response.json());
  const first = open(wanted.get("robot") && /^\w+$/.test(wanted.get("robot")) ? wanted.get("robot") : "ur5").catch(() => null);
  const { robots: names, ...more } = await offered;
  ({ with: words, controller } = more);
  const select = $("robot");
  select.add(new Option("your own", ""));
  names.forEach((name) => select.add(new Option(name === "my_arm" ? "six joints to start from" : name, name)));
  await first;
  if (text === "") await open(names.includes("ur5") ? "ur5" : names[0]);
  else select.value = names.includes(wanted.get("robot") || "ur5") ? wanted.get("robot") || "ur5" : "";
  if (wanted.get("file")) {
    try {
      change(await unpacked(wanted.get("file")), true);
    } catch (error) {
      const item = document.createElement("li");
      item.textContent = "The link cannot be read: " + error.message;
      $("faults").appendChild(item);  // the status goes on with the loading of the compiler
    }
  }
  setTimeout(compilerWorker, 50);  // the picture first
}
begin().catch((error) => status(error.message));
if ("serviceWorker" in navigator) navigator.serviceWorker.register("offline.js", { type: "module" }).catch(() => {});  // file: has none
