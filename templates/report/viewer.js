/* The interactive view of an arm: draws it from its Denavit-Hartenberg table on a canvas, without libraries.
 *
 * armViewer() makes the view in the elements of the page and returns { load, show, state }. load(scene, solvers) shows an
 * arm; `solvers` has for every tip that can be dragged, by its name ("" for the one without), tip_pose(q),
 * inverse_kinematics(T, near) and approach(T, q, turning) of an emitted <name>_ik.mjs, or functions that return promises of
 * their results. */
"use strict";
function armViewer(changed) {
  const canvas = document.getElementById("view");
  const paint = canvas.getContext("2d");
  const root = document.getElementById("viewer"), page = document.documentElement;
  const state = { q: [], azimuth: -0.9, elevation: 0.38, zoom: 1, frames: true, others: [], trace: [], held: null };
  let scene = null, hands = [], hand = null, start = [], rows = [], tipRow = 0, sliders = [], motion = 0, room = null;
  let list = [], target = null, busy = false, loaded = 0, drawing = 0;

  /* -- geometry: 4x4 transforms as arrays of rows ------------------------------------------------------------------ */

  function times(A, B) {
    return A.map((row) => [0, 1, 2, 3].map((c) => row[0] * B[0][c] + row[1] * B[1][c] + row[2] * B[2][c] + row[3] * B[3][c]));
  }
  function turnZ(angle) {
    const c = Math.cos(angle), s = Math.sin(angle);
    return [[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
  }
  function turnX(angle) {
    const c = Math.cos(angle), s = Math.sin(angle);
    return [[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]];
  }
  function shift(x, z) {
    return [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, z], [0, 0, 0, 1]];
  }
  function origin(T) { return [T[0][3], T[1][3], T[2][3]]; }
  function axis(T, k) { return [T[0][k], T[1][k], T[2][k]]; }
  function plus(p, d, f) { return [p[0] + f * d[0], p[1] + f * d[1], p[2] + f * d[2]]; }
  function dot(p, r) { return p[0] * r[0] + p[1] * r[1] + p[2] * r[2]; }
  function cross(p, r) { return [p[1] * r[2] - p[2] * r[1], p[2] * r[0] - p[0] * r[2], p[0] * r[1] - p[1] * r[0]]; }
  function size(p) { return Math.hypot(p[0], p[1], p[2]); }

  /* Frames, joint axes and the corners of the links at the joint positions q. */
  function pose(q) {
    let T = scene.base;
    const frames = [T], joints = [], lines = [];
    const step = (S) => {
      const from = origin(T);
      T = times(T, S);
      const p = origin(T);
      if (size(plus(p, from, -1)) > 1e-9 * scene.reach) lines.push([from, p]);
    };
    rows.forEach((joint, i) => {
      const y = joint.factors ? joint.factors.reduce((sum, f, k) => sum + f * q[k], 0) : (joint.sign || 1) * q[i];
      T = frames[joint.factors ? joint.parent + 1 : i];
      const theta = joint.theta + (joint.revolute ? y : 0), d = joint.d + (joint.revolute ? 0 : y);
      if (scene.convention === "standard") {
        joints.push({ at: origin(T), along: axis(T, 2), revolute: joint.revolute });
        step(turnZ(theta)); step(shift(0, d)); step(shift(joint.a, 0)); step(turnX(joint.alpha));
      } else {
        step(turnZ(joint.gamma || 0)); step(shift(0, joint.b || 0));
        step(turnX(joint.alpha)); step(shift(joint.a, 0));
        joints.push({ at: origin(T), along: axis(T, 2), revolute: joint.revolute });
        step(turnZ(theta)); step(shift(0, d));
      }
      frames.push(T);
    });
    T = frames[tipRow + 1];
    step(scene.tool);
    frames.push(T);
    const named = (scene.tips || []).map((tip) => {
      T = frames[tip.row + 1];
      step(tip.tool);
      return T;
    });
    const tips = [frames[frames.length - 1], ...named];
    return { frames: frames, joints: joints, lines: lines, tips: tips, tip: tips[hand ? hand.tip : 0] };
  }

  /* -- hands: the tips that can be dragged, each with the joints that move it ----------------------------------------- */

  /* The tip without a name, and after it the named ones, as pose() counts them; solved in the frame of the row that
   * carries their joints, by a solver that knows these joints alone. */
  function handsOf(solvers) {
    const all = scene.joints.map((_, i) => i);
    const tips = [{ name: "", joints: all, carrier: -1 }, ...(scene.tips || [])].map((each, tip) => ({ ...each, tip: tip }));
    return tips.filter((each) => solvers[each.name]).map((each) => ({ ...each, solver: solvers[each.name] }));
  }
  function carried(q) { return hand.carrier < 0 ? null : pose(q).frames[hand.carrier + 1]; }
  function local(T, q) {
    const F = carried(q);
    if (!F) return T;
    const p = origin(F);
    return [0, 1, 2].map((i) => [0, 1, 2, 3].map((c) => dot(axis(F, i), [T[0][c], T[1][c], T[2][c]]) - (c === 3 ? dot(axis(F, i), p) : 0)));
  }
  function own(q) { return hand.joints.map((j) => q[j]); }
  function whole(part, q) {
    const joints = hand.joints;
    return q.map((x, j) => (joints.includes(j) ? part[joints.indexOf(j)] : x));
  }
  /* The pose of the tip by its solver: in the view lengths and angles are rounded, and an arm with fewer than six joints
   * reaches no pose that is off by as much. */
  async function exact(q) {
    const T = [...await hand.solver.tip_pose(own(q)), [0, 0, 0, 1]], F = carried(q);
    return F ? times(F, T) : T;
  }
  async function solved(T, q) {
    const found = await hand.solver.inverse_kinematics(local(T, q), own(q));
    return found.map((each) => ({ ...each, q: whole(each.q, q) }));
  }
  async function approached(T, q, turning) {
    return whole((await hand.solver.approach(local(T, q), own(q), turning)).q, q);
  }

  /* -- projection ---------------------------------------------------------------------------------------------------- */

  let width = 0, height = 0, eye = null;

  /* Middle and radius of what the view shows: the arm in its first pose. */
  function shownRoom() {
    const points = [origin(scene.base)].concat(...pose(start).lines);
    const middle = [0, 1, 2].map((k) => {
      const values = points.map((p) => p[k]);
      return (Math.min(...values) + Math.max(...values)) / 2;
    });
    return { middle: middle, radius: Math.max(0.4 * scene.reach, ...points.map((p) => 1.25 * size(plus(p, middle, -1)))) };
  }

  /* Set the view so that the points `shown` are in it. */
  function look(shown) {
    const ca = Math.cos(state.azimuth), sa = Math.sin(state.azimuth);
    const ce = Math.cos(state.elevation), se = Math.sin(state.elevation);
    eye = {
      right: [-sa, ca, 0], up: [-se * ca, -se * sa, ce], back: [ce * ca, ce * sa, se], middle: room.middle,
      scale: 0.5 * Math.min(width, height) / room.radius, far: 5 * scene.reach,
    };
    const excess = shown.map(project).map((p) => Math.max(
      Math.abs(p[0] - width / 2) / (width / 2 - 36), Math.abs(p[1] - height / 2) / (height / 2 - 36)));
    eye.scale *= state.zoom / Math.max(1, ...excess);  // no part of the arm is out of view unless the view is enlarged
  }
  function project(p) {
    const r = plus(p, eye.middle, -1), depth = dot(r, eye.back), f = eye.scale * eye.far / (eye.far - depth);
    return [width / 2 + f * dot(r, eye.right), height / 2 - f * dot(r, eye.up), depth];
  }

  /* -- solids: facets are collected, sorted from far to near, and filled ------------------------------------------------ */

  function across(direction) {
    const other = Math.abs(direction[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
    const u = cross(direction, other), l = size(u);
    const v = [u[0] / l, u[1] / l, u[2] / l];
    return [v, cross(direction, v)];
  }
  function cylinder(facets, from, to, radius, color, sides) {
    const length = size(plus(to, from, -1));
    if (length < 1e-9 * scene.reach) return;
    const direction = plus([0, 0, 0], plus(to, from, -1), 1 / length), uv = across(direction), rim = [];
    for (let k = 0; k < sides; k++) {
      const angle = 2 * Math.PI * k / sides;
      rim.push(plus(plus([0, 0, 0], uv[0], Math.cos(angle)), uv[1], Math.sin(angle)));
    }
    for (let k = 0; k < sides; k++) {
      const a = rim[k], b = rim[(k + 1) % sides], normal = plus(plus([0, 0, 0], a, 0.5), b, 0.5);
      facet(facets, [plus(from, a, radius), plus(from, b, radius), plus(to, b, radius), plus(to, a, radius)], normal, color);
    }
    facet(facets, rim.map((r) => plus(from, r, radius)), plus([0, 0, 0], direction, -1), color);
    facet(facets, rim.map((r) => plus(to, r, radius)), direction, color);
  }
  function box(facets, at, along, half, color) {
    const uv = across(along), w = along;
    [[uv[0], uv[1], w], [uv[1], w, uv[0]], [w, uv[0], uv[1]]].forEach((t) => {
      [1, -1].forEach((sign) => {
        const middle = plus(at, t[0], sign * half), corners = [[1, 1], [1, -1], [-1, -1], [-1, 1]]
          .map((c) => plus(plus(middle, t[1], c[0] * half), t[2], c[1] * half));
        facet(facets, corners, plus([0, 0, 0], t[0], sign), color);
      });
    });
  }
  function facet(facets, corners, normal, color) {
    if (dot(normal, eye.back) <= -0.12) return;
    const flat = corners.map(project), depth = flat.reduce((sum, p) => sum + p[2], 0) / flat.length;
    const light = plus(plus(plus([0, 0, 0], eye.back, 0.75), eye.up, 0.55), eye.right, -0.35);
    facets.push({ depth: depth, corners: flat, shade: 0.62 + 0.38 * Math.max(0, dot(normal, light)), color: color });
  }
  function tone(color, shade) {
    return "rgb(" + color.map((v) => Math.round(Math.min(255, v * shade))).join(",") + ")";
  }

  /* -- drawing --------------------------------------------------------------------------------------------------------- */

  function palette() {
    const styles = getComputedStyle(root), read = (name) => styles.getPropertyValue(name).trim();
    const channels = (name) => read(name).split(",").map(Number);
    return {
      link: channels("--arm-link"), joint: channels("--arm-joint"), slide: channels("--arm-slide"),
      grid: read("--line"), trace: read("--accent"), ghost: read("--muted"), text: read("--text"), card: read("--card"),
      axes: [read("--axis-x"), read("--axis-y"), read("--axis-z")],
    };
  }
  function line(from, to, color, thickness) {
    const a = project(from), b = project(to);
    paint.strokeStyle = color;
    paint.lineWidth = thickness;
    paint.beginPath();
    paint.moveTo(a[0], a[1]);
    paint.lineTo(b[0], b[1]);
    paint.stroke();
  }
  function ground(colors) {
    const base = origin(scene.base), unit = Math.pow(10, Math.floor(Math.log10(scene.reach))), cells = 5;
    const pitch = scene.reach / unit > 4 ? 2 * unit : scene.reach / unit > 2 ? unit : scene.reach / unit > 1 ? unit / 2 : unit / 4;
    for (let k = -cells; k <= cells; k++) {
      line(plus(base, [k, -cells, 0], pitch), plus(base, [k, cells, 0], pitch), colors.grid, 1);
      line(plus(base, [-cells, k, 0], pitch), plus(base, [cells, k, 0], pitch), colors.grid, 1);
    }
  }
  function triad(T, length, colors) {
    [0, 1, 2].forEach((k) => line(origin(T), plus(origin(T), axis(T, k), length), colors.axes[k], 2));
  }
  function write(labels, colors) {
    const places = [];  // texts that would overlap share a place
    paint.font = "600 12px system-ui, sans-serif";
    const end = (x, text) => x + paint.measureText(text).width + 4;
    const overlap = (place, x, y, text) =>
      Math.abs(y - place.y) < 13 && x < end(place.x, place.text) && place.x < end(x, text);
    labels.forEach((label) => {
      const at = project(label.at);
      let place = { x: at[0], y: at[1], text: label.text };
      for (let k; (k = places.findIndex((other) => overlap(other, place.x, place.y, place.text))) >= 0;) {
        const [other] = places.splice(k, 1);  // a text that has grown may meet a third one
        place = { x: other.x, y: other.y, text: other.text + ", " + place.text };
      }
      places.push(place);
    });
    paint.lineJoin = "round";
    places.forEach((place) => {
      paint.strokeStyle = colors.card;
      paint.lineWidth = 4;
      paint.strokeText(place.text, place.x + 8, place.y - 8);
      paint.fillStyle = colors.text;
      paint.fillText(place.text, place.x + 8, place.y - 8);
    });
  }
  function hue(index) {  // far apart for neighbours, and legible on both grounds
    return "hsl(" + (25 + 137 * index) % 360 + " 62% 52%)";
  }
  function ring(T, colors, held) {
    const [x, y] = project(origin(T));
    paint.strokeStyle = colors.trace;
    paint.lineWidth = held ? 4 : 2.5;
    paint.beginPath();
    paint.arc(x, y, 15, 0, 2 * Math.PI);
    paint.stroke();
  }
  function draw() {
    drawing = 0;
    if (!scene) return;
    const ratio = page.classList.contains("paper") ? 3 : window.devicePixelRatio || 1;
    width = canvas.clientWidth;
    height = canvas.clientHeight;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    paint.setTransform(ratio, 0, 0, ratio, 0, 0);
    paint.clearRect(0, 0, width, height);
    paint.lineCap = "round";
    const colors = palette(), arm = pose(state.q), facets = [], thick = 0.026 * scene.reach;
    if (!state.held) look([origin(scene.base), origin(arm.tip)].concat(...arm.lines, ...state.others.map((other) => pose(other.q).lines.flat())));
    ground(colors);
    state.others.forEach((other) => {
      paint.setLineDash(other.within === false ? [3, 5] : []);
      paint.globalAlpha = other.within === false ? 0.45 : 0.85;
      pose(other.q).lines.forEach((ends) => line(ends[0], ends[1], hue(other.index), 3));
      paint.setLineDash([]);
      paint.globalAlpha = 1;
    });
    arm.lines.forEach((ends) => cylinder(facets, ends[0], ends[1], thick, colors.link, 14));
    arm.joints.forEach((joint) => {
      const half = 1.9 * thick;
      if (joint.revolute) cylinder(facets, plus(joint.at, joint.along, -half), plus(joint.at, joint.along, half), 1.5 * thick, colors.joint, 20);
      else box(facets, joint.at, joint.along, 1.5 * thick, colors.slide);
    });
    facets.sort((a, b) => a.depth - b.depth).forEach((f) => {
      paint.fillStyle = paint.strokeStyle = tone(f.color, f.shade);
      paint.lineWidth = 0.7;
      paint.beginPath();
      f.corners.forEach((p, k) => (k ? paint.lineTo(p[0], p[1]) : paint.moveTo(p[0], p[1])));
      paint.closePath();
      paint.fill();
      paint.stroke();
    });
    for (let k = 1; k < state.trace.length; k++) line(state.trace[k - 1], state.trace[k], colors.trace, 1.5);
    const length = 0.13 * scene.reach;
    const shown = state.frames ? arm.frames.slice(0, -1) : [];
    shown.forEach((T) => triad(T, length, colors));
    triad(arm.tip, 1.3 * length, colors);
    const frames = shown.map((T, k) => ({ at: origin(T), text: String(k) }));
    const names = ["tip", ...(scene.tips || []).map((tip) => tip.name)];
    write([...frames, ...arm.tips.map((T, k) => ({ at: origin(T), text: names[k] }))], colors);
    hands.forEach((each) => ring(arm.tips[each.tip], colors, each === hand && (state.held || hands.length > 1)));
    report(arm.tip);
  }

  /* -- texts ----------------------------------------------------------------------------------------------------------- */

  function fixed(value, digits) {
    const text = value.toFixed(digits);
    return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "\u2212");
  }
  function angles(T) {
    const pitch = Math.atan2(-T[2][0], Math.hypot(T[0][0], T[1][0]));
    const locked = Math.hypot(T[0][0], T[1][0]) < 1e-9;
    const roll = locked ? Math.atan2(-T[1][2], T[1][1]) : Math.atan2(T[2][1], T[2][2]);
    return [roll, pitch, locked ? 0 : Math.atan2(T[1][0], T[0][0])];
  }
  function report(T) {
    const p = origin(T).map((v) => fixed(v * 1000, 1)), a = angles(T).map((v) => fixed(v * 180 / Math.PI, 2));
    Array.from(document.querySelectorAll("#place input")).forEach((input, i) => {
      if (input !== document.activeElement) input.value = (T[i][3] * 1000).toFixed(1);
    });
    document.getElementById("tip").textContent =
      "Tip: x " + p[0] + ", y " + p[1] + ", z " + p[2] + " mm; roll " + a[0] + ", pitch " + a[1] + ", yaw " + a[2] + "\u00b0";
  }
  function written(i, q, digits) {
    return scene.joints[i].revolute ? fixed(q * 180 / Math.PI, digits) + "\u00b0" : fixed(q * 1000, digits) + " mm";
  }
  function value(i) { return written(i, state.q[i], 1); }
  function end(row, i, k) {  // the value at one end of a slider, in brackets where the robot file states no limit
    const joint = scene.joints[i], text = written(i, [joint.lower, joint.upper][k], 1).replace(/\.0(?!\d)/, "");
    element("small", row, joint.limited[k] ? text : "(" + text + ")");
  }

  /* -- controls -------------------------------------------------------------------------------------------------------- */

  function element(kind, parent, text, properties) {
    const made = document.createElement(kind);
    if (text) made.textContent = text;
    Object.assign(made, properties || {});
    parent.appendChild(made);
    return made;
  }
  function show() {
    sliders.forEach((slider, i) => {
      slider.input.value = state.q[i];
      slider.output.textContent = value(i);
      slider.input.setAttribute("aria-valuetext", value(i));
    });
    if (!drawing) draw();
    if (changed) changed(state.q);
  }
  function move(goal) {
    cancelAnimationFrame(motion);
    const arrived = () => { if (goal === start) offer(); };
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) {
      state.q = goal.slice();
      show();
      arrived();
      return;
    }
    const from = state.q.slice(), begin = performance.now();
    const advance = (now) => {
      const s = Math.min(1, (now - begin) / 700), f = s * s * (3 - 2 * s);
      state.q = goal.map((to, i) => from[i] + f * (to - from[i]));
      show();
      if (s < 1) motion = requestAnimationFrame(advance);
      else arrived();
    };
    motion = requestAnimationFrame(advance);
  }
  function release() {
    pause();
    state.others = [];
    state.trace = [];
  }
  function say(text) { document.getElementById("branch").textContent = text; }

  /* -- the tip: dragged in the plane of the picture, or moved by its fields ------------------------------------------------ */

  /* Move the tip to T: the nearest configuration if one is near, else as near as the joints get. The last target wins. */
  async function reach(T, dragged) {
    target = { T: T, dragged: dragged };
    if (busy) return;
    busy = true;
    const mine = loaded;
    try {
      while (target && mine === loaded) {
        const wanted = target;
        target = null;
        const before = state.q.slice(), found = await solved(wanted.T, before);
        const apart = (q) => Math.max(...q.map((x, i) => Math.abs(x - before[i]) / (scene.joints[i].revolute ? 1 : scene.reach)));
        const best = found.filter((each) => each.within).sort((x, y) => apart(x.q) - apart(y.q))[0];
        let q = null, word = "";
        if (best && (!wanted.dragged || apart(best.q) < 0.7)) q = best.q;
        else {
          q = await approached(wanted.T, before, wanted.dragged ? 0.02 : 0);
          word = blocked(q, wanted.T);
        }
        if (mine !== loaded) return;
        release();
        state.q = q;
        say(word);
        show();
      }
    } finally {
      busy = false;
    }
    if (mine === loaded) offer();
  }
  function blocked(q, T) {
    const tip = origin(pose(q).tip), miss = size(plus(tip, [T[0][3], T[1][3], T[2][3]], -1));
    if (miss < 2e-3 * scene.reach) return "";
    const stopped = (x, lower, upper) => (lower !== null && x - lower < 1e-3) || (upper !== null && upper - x < 1e-3);
    const stops = scene.joints.filter((joint, i) => hand.joints.includes(i) && stopped(q[i], joint.limited[0] ? joint.lower : null, joint.limited[1] ? joint.upper : null));
    stops.push(...(scene.followers || []).filter((row) => stopped(row.along.reduce((sum, f, k) => sum + f * q[k], 0), row.lower, row.upper)));
    return stops.length ? "Stopped by the limit of " + stops.map((joint) => joint.name).join(" and ") + "." : "Out of reach from here.";
  }

  /* All configurations with the tip where it is, as buttons and as thin lines. */
  async function offer() {
    if (!hand) return;
    const mine = loaded, of = hand, q = state.q.slice(), found = await solved(await exact(q), q);
    if (mine !== loaded || of !== hand || q.some((x, i) => x !== state.q[i])) return;
    list = found.map((each, index) => ({ q: each.q, within: each.within, index: index, name: named(each.branch) }));
    offered(list);
    state.others = list.filter((each) => !same(each.q, q));
    draw();
  }
  function same(p, q) {
    return p.every((x, i) => Math.abs(scene.joints[i].revolute ? Math.sin((x - q[i]) / 2) : x - q[i]) < 1e-5);
  }
  function named(branch) {
    return Object.entries(branch).map(([name, value]) => name.replace(/_/g, " ") + " " + "+\u2212"[value] || value).join(", ") || "the only one";
  }
  function offered(solutions) {
    const choices = document.getElementById("configurations");
    choices.textContent = "";
    if (solutions.length === 0) return;
    const row = element("p", choices, "", { className: "choice" });
    element("span", row, "Configurations:");
    solutions.forEach((solution) => {
      const button = element("button", row, String(solution.index + 1), { type: "button", title: solution.name });
      const outside = solution.within ? "" : ", outside the joint limits";
      button.setAttribute("aria-label", "configuration " + (solution.index + 1) + ": " + solution.name + outside);
      button.setAttribute("aria-pressed", String(same(solution.q, state.q)));
      button.style.setProperty("--hue", hue(solution.index));
      if (outside) button.classList.add("outside");
      button.addEventListener("click", () => {
        release();
        state.others = solutions.filter((other) => other !== solution);
        Array.from(row.querySelectorAll("button")).forEach((b) => b.setAttribute("aria-pressed", String(b === button)));
        say(solution.name + outside);
        move(solution.q);
      });
    });
  }

  /* -- controls of one arm ------------------------------------------------------------------------------------------------ */

  function controls() {
    const panel = document.getElementById("joints");
    panel.textContent = "";
    sliders = [];
    scene.joints.forEach((joint, i) => {
      const row = element("label", panel, "", { className: "slider" });
      element("span", row, joint.name);
      const output = element("output", row, value(i));
      end(row, i, 0);
      const input = element("input", row, "", { type: "range", min: joint.lower, max: joint.upper, step: "any", value: state.q[i] });
      end(row, i, 1);
      input.addEventListener("input", () => {
        cancelAnimationFrame(motion);
        release();
        say("");
        state.q[i] = Number(input.value);
        output.textContent = value(i);
        input.setAttribute("aria-valuetext", value(i));
        draw();
        if (changed) changed(state.q);
      });
      input.addEventListener("change", offer);
      sliders.push({ input: input, output: output });
    });
    const buttons = document.getElementById("actions");
    buttons.textContent = "";
    element("button", buttons, "First pose", { type: "button" }).addEventListener("click", () => { release(); say(""); move(start); });
    const zero = scene.joints.map((joint) => Math.min(Math.max(0, joint.lower), joint.upper));
    element("button", buttons, zero.every((q) => q === 0) ? "Zero pose" : "Nearest to zero", { type: "button" })
      .addEventListener("click", () => { release(); say(""); move(zero); });
    const toggle = element("button", buttons, "Frames", { type: "button" });
    toggle.setAttribute("aria-pressed", String(state.frames));
    toggle.addEventListener("click", () => {
      state.frames = !state.frames;
      toggle.setAttribute("aria-pressed", String(state.frames));
      draw();
    });
    const place = document.getElementById("place");
    place.textContent = "";
    if (!hand) return;
    if (hands.length > 1) {
      const choice = element("select", element("label", place, "Tip ", { className: "tip" }));
      hands.forEach((each, k) => choice.add(new Option(each.name || "tip", k, false, each === hand)));
      choice.addEventListener("change", () => take(hands[choice.value]));
    }
    ["x", "y", "z"].forEach((name, i) => {
      const label = element("label", place, name + " ");
      const input = element("input", label, "", { type: "number", step: 10 });
      input.setAttribute("aria-label", name + " of the tip in mm");
      input.addEventListener("change", () => {
        if (!Number.isFinite(input.valueAsNumber)) return;
        exact(state.q).then((T) => {
          T[i][3] = input.valueAsNumber / 1000;
          reach(T, false);
        });
      });
    });
    element("span", place, "mm");
  }

  /* Another tip is dragged from now on. */
  function take(next) {
    if (next === hand) return;
    hand = next;
    const choice = document.querySelector("#place select");
    choice.value = hands.indexOf(hand);
    release();
    say("");
    document.getElementById("configurations").textContent = "";
    draw();
    offer();
  }

  /* -- motions: played in real time, interpolated between their samples --------------------------------------------------- */

  let playing = 0;
  function pause() {
    cancelAnimationFrame(playing);
    playing = 0;
    document.querySelectorAll("#player .play button").forEach((b) => { b.textContent = "Play"; });
  }
  function sample(movement, t) {
    let low = 0, high = movement.t.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (movement.t[middle] <= t) low = middle; else high = middle;
    }
    const f = (t - movement.t[low]) / (movement.t[high] - movement.t[low]);
    return movement.q[low].map((from, i) => from + f * (movement.q[high][i] - from));
  }
  function players() {
   const player = document.getElementById("player");
   player.textContent = "";
   (scene.motions || []).forEach((movement) => {
    const end = movement.t[movement.t.length - 1];
    element("span", player, movement.name, { className: "note" });
    const row = element("div", player, "", { className: "play" });
    const button = element("button", row, "Play", { type: "button" });
    const input = element("input", row, "", { type: "range", min: 0, max: end, step: "any", value: 0 });
    input.setAttribute("aria-label", "time of " + movement.name);
    const output = element("output", row);
    const to = (t) => {
      input.value = t;
      output.textContent = fixed(t, 2) + " of " + fixed(end, 2) + " s";
      state.q = sample(movement, t);
    };
    const follow = () => {
      if (!movement.trace) movement.trace = movement.q.map((q) => origin(pose(q).tip));
      cancelAnimationFrame(motion);
      release();
      state.trace = movement.trace;
    };
    input.addEventListener("input", () => { const t = Number(input.value); follow(); to(t); show(); });
    button.addEventListener("click", () => {
      if (button.textContent === "Pause") { pause(); return; }
      follow();
      button.textContent = "Pause";
      const from = Number(input.value) >= end ? 0 : Number(input.value), begin = performance.now();
      const advance = (now) => {
        const t = Math.min(end, from + Math.max(0, now - begin) / 1000);
        to(t);
        show();
        if (t < end) playing = requestAnimationFrame(advance);
        else pause();
      };
      playing = requestAnimationFrame(advance);
    });
    output.textContent = fixed(0, 2) + " of " + fixed(end, 2) + " s";
   });
  }

  /* -- pointer and keys ---------------------------------------------------------------------------------------------------- */

  function at(event) {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }
  function overTip(event) {  // the hand whose ring is under the pointer
    if (!hand || !eye) return null;
    const [x, y] = at(event), tips = pose(state.q).tips;
    const away = (each) => { const p = project(origin(tips[each.tip])); return Math.hypot(x - p[0], y - p[1]); };
    const nearest = hands.reduce((best, each) => (away(each) < away(best) ? each : best));
    return away(nearest) < (event.pointerType === "touch" ? 34 : 22) ? nearest : null;
  }
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    const under = overTip(event);
    if (under) {
      take(under);
      const tip = pose(state.q).tip, p = project(origin(tip)), [x, y] = at(event);
      state.held = { T: tip, from: [x, y], scale: eye.scale * eye.far / (eye.far - p[2]), right: eye.right, up: eye.up };
      const held = state.held;
      exact(state.q).then((T) => { held.T = T; });
      cancelAnimationFrame(motion);
      draw();
      return;
    }
    state.drag = [event.clientX, event.clientY, state.azimuth, state.elevation];
  });
  canvas.addEventListener("touchstart", (event) => {  // a finger on the ring drags the tip and does not scroll the page
    const touch = event.touches[0];
    if (overTip({ clientX: touch.clientX, clientY: touch.clientY, pointerType: "touch" })) event.preventDefault();
  }, { passive: false });
  canvas.addEventListener("pointermove", (event) => {
    if (state.held) {
      const [x, y] = at(event), held = state.held;
      const p = plus(plus(origin(held.T), held.right, (x - held.from[0]) / held.scale), held.up, (held.from[1] - y) / held.scale);
      reach(held.T.map((row, i) => (i < 3 ? [...row.slice(0, 3), p[i]] : row)), true);
      return;
    }
    if (!state.drag) {
      canvas.classList.toggle("over", overTip(event) !== null);
      return;
    }
    state.azimuth = state.drag[2] - 0.008 * (event.clientX - state.drag[0]);
    state.elevation = Math.min(1.55, Math.max(-1.55, state.drag[3] + 0.008 * (event.clientY - state.drag[1])));
    draw();
  });
  ["pointerup", "pointercancel"].forEach((kind) => canvas.addEventListener(kind, () => {
    state.drag = null;
    if (state.held) { state.held = null; draw(); offer(); }
  }));
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.shiftKey) return;
    event.preventDefault();
    state.zoom = Math.min(8, Math.max(0.3, state.zoom * Math.exp(-0.0015 * event.deltaY)));
    draw();
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
    if (turn) {
      event.preventDefault();
      state.azimuth += turn[0];
      state.elevation = Math.min(1.55, Math.max(-1.55, state.elevation + turn[1]));
    } else if (event.key === "+" || event.key === "-") {
      state.zoom = Math.min(8, Math.max(0.3, state.zoom * (event.key === "+" ? 1.15 : 0.87)));
    } else return;
    draw();
  });
  function reachable() {  // what scrolls can be scrolled with the keys
    document.querySelectorAll(".wide").forEach((each) => {
      if (each.scrollWidth > each.clientWidth) each.tabIndex = 0; else each.removeAttribute("tabindex");
    });
  }
  window.addEventListener("resize", () => { draw(); reachable(); });
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  function load(next, solvers) {
    scene = next;
    hands = handsOf(solvers);
    hand = hands[0] || null;
    loaded += 1;
    target = null;
    busy = false;
    rows = scene.rows || scene.joints;  // the joints, or the rows of a mechanism, each with its parent and its factors of q
    tipRow = scene.rows ? scene.tip_row : rows.length - 1;
    start = scene.start;
    cancelAnimationFrame(motion);
    Object.assign(state, { q: start.slice(), zoom: 1, others: [], trace: [], held: null, drag: null });
    if (rows.length > 8) state.frames = false;  // too many names for one picture
    room = shownRoom();
    root.classList.add("alive");
    controls();
    players();
    say("");
    document.getElementById("configurations").textContent = "";
    show();
    reachable();
    offer();
  }
  return { load: load, show: show, state: state, ringPlace: () => project(origin(pose(state.q).tip)).slice(0, 2) };
}
