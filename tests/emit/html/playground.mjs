// Drives the playground in Chromium and prints what it finds as JSON: node playground.mjs ADDRESS CHROMIUM PLAYWRIGHT FOLDER
import { pathToFileURL } from "node:url";
import { writeFileSync } from "node:fs";
const [address, chromium, playwright, folder] = process.argv.slice(2);
const { chromium: browserType } = await import(pathToFileURL(`${playwright}/index.mjs`).href);
const flags = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
  "--disable-component-update", "--disable-sync"];
const browser = await browserType.launch({ executablePath: chromium, args: flags });
const found = { requests: [], console: [], errors: [], widths: {} };
const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, acceptDownloads: true, reducedMotion: "reduce" });
await context.grantPermissions(["clipboard-read", "clipboard-write"]);
const page = await context.newPage();
page.on("request", (request) => found.requests.push(request.url()));
page.on("console", (message) => found.console.push(message.text()));
page.on("pageerror", (error) => found.errors.push(String(error)));
const shoot = (name) => page.screenshot({ path: `${folder}/${name}.png` });

// the policy of the page forbids to evaluate text in it again and again, so values are polled from outside
async function until(what, question, limit = 180000) {
  const begin = Date.now();
  for (;;) {
    const answer = await page.evaluate(question);
    if (answer) return answer;
    if (Date.now() - begin > limit) throw new Error(`${what}: ${await page.evaluate(() => document.getElementById("status").textContent)}`);
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
}
const status = () => page.evaluate(() => document.getElementById("status").textContent);
const joints = () => page.evaluate(() => [...document.querySelectorAll("#joints output")].map((e) => e.textContent));
const tip = () => page.evaluate(() => document.getElementById("tip").textContent);

try {
  // the first picture, before the compiler
  await page.goto(address);
  found.shown = await until("first picture", () => document.body.dataset.shown);
  await until("configurations", () => document.querySelectorAll("#configurations button").length);
  found.first = { arm: await page.evaluate(() => document.body.dataset.arm), joints: await joints(), tip: await tip(),
    compiler: (await page.evaluate(() => document.body.dataset.compiler)) || "", robot: await page.inputValue("#robot"),
    configurations: await page.locator("#configurations button").count(), hint: await page.textContent("#hint") };
  for (const scheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme: scheme });
    for (const width of [390, 1280, 1920]) {
      await page.setViewportSize({ width, height: width === 390 ? 844 : 1000 });
      await page.waitForTimeout(150);
      found.widths[`${width} ${scheme}`] = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      await shoot(`${width}-${scheme}`);
    }
  }
  await page.emulateMedia({ colorScheme: "light" });
  await page.setViewportSize({ width: 1280, height: 900 });

  // the ring is dragged, then the tip moved by its field and a configuration chosen, both by keyboard
  const box = await page.locator("#view").boundingBox();
  const ring = await page.evaluate(() => window.ringPlace());
  await page.mouse.move(box.x + ring[0], box.y + ring[1]);
  await page.mouse.down();
  for (let k = 1; k <= 12; k++) { await page.mouse.move(box.x + ring[0] + 4 * k, box.y + ring[1] + 3 * k); await page.waitForTimeout(25); }
  await page.mouse.up();
  await page.waitForTimeout(400);
  found.dragged = { from: ring, to: await page.evaluate(() => window.ringPlace()), joints: await joints(), tip: await tip() };
  await page.locator("#place input").nth(2).focus();
  await page.keyboard.press("ArrowUp");
  await page.keyboard.press("Tab");
  await page.waitForTimeout(400);
  found.lifted = await tip();
  await page.locator("#configurations button").nth(1).focus();
  await page.keyboard.press("Enter");
  await page.waitForTimeout(300);
  found.chosen = { tip: await tip(), joints: await joints(), branch: await page.textContent("#branch") };

  // mass matrix and gravity torques follow the posture
  const dynamics = () => page.evaluate(() => [...document.querySelectorAll("#mass tbody tr")].map((row) => [...row.cells].map((cell) => cell.textContent)));
  await page.click("#tab-dynamics");
  await until("mass matrix", () => document.querySelector("#mass tbody td") && document.querySelector("#mass tbody td").textContent);
  await page.waitForTimeout(300);
  found.dynamics = { joints: await joints(), rows: await dynamics(), note: await page.textContent("#timed") };
  await shoot("dynamics");
  await page.locator("#joints input").nth(1).focus();
  await page.keyboard.press("Home");
  await page.waitForTimeout(300);
  found.moved = { joints: await joints(), rows: await dynamics() };

  // the compiler; a fault as one types, with its place; mended again
  await until("compiler", () => document.body.dataset.compiler);
  await page.selectOption("#robot", "my_arm");
  await until("my arm", () => document.body.dataset.arm === "my_arm");
  const cell = page.getByLabel("alpha of joint 2", { exact: true });
  await cell.fill("9o");
  await until("fault", () => document.querySelector("#faults li"));
  found.fault = await page.evaluate(() => document.querySelector("#faults li").innerText);
  await shoot("fault");
  await cell.fill("-10");
  await page.getByLabel("d of joint 6", { exact: true }).fill("0.12345");
  found.derived = await until("derived", () => document.body.dataset.derived);
  found.faults = await page.locator("#faults li").count();
  found.text = await page.inputValue("#text");
  found.family = await page.textContent("#about");
  await page.click("#tab-base_parameters");
  found.parameters = await page.locator("#shown tbody tr").count();

  // an arm in general position: all configurations, and those of a dragged tip
  const general = found.text.slice(0, found.text.indexOf("joints:")).replace("my_arm", "general_arm") + "joints:\n" + [[70, 0.1, 0.3], [50, 0.42, 0.1],
    [80, 0.31, 0.04], [65, 0.07, 0.35], [55, 0.05, 0.08], [20, 0.03, 0.06]].map(([alpha, a, d]) =>
    `  - {type: revolute, alpha: ${alpha}, a: ${a}, d: ${d}, theta: 0}\n`).join("");
  await page.fill("#text", general).catch(async () => { await page.click("summary"); await page.fill("#text", general); });
  await until("general arm", () => document.body.dataset.arm === "general_arm");
  await until("its configurations", () => document.querySelectorAll("#configurations button").length);
  found.general = { configurations: await page.locator("#configurations button").count(), tips: [await tip()], joints: [] };
  for (let k = 0; k < found.general.configurations; k++) {
    await page.locator("#configurations button").nth(k).click();
    await page.waitForTimeout(300);
    found.general.joints.push((await joints()).join());
    found.general.tips.push(await tip());
  }
  await shoot("general");
  await page.fill("#text", found.text);
  await until("my arm again", () => document.body.dataset.arm === "my_arm");

  // a link, opened in the same page without a network: the robot file is in it
  await page.click("#share");
  await until("link", () => location.hash.startsWith("#file="));
  found.link = await page.evaluate(() => location.href);

  // the package, with the network cut
  await page.selectOption("#robot", "rrr");
  await until("rrr", () => document.body.dataset.arm === "rrr");
  await context.setOffline(true);
  await page.click("#tab-code");
  const choice = (group, word) => page.locator(".code fieldset").nth(group).locator("label", { hasText: new RegExp(`^${word}$`) }).locator("input");
  for (const [group, word] of ["controller", "computed_torque", "observer"].entries()) await choice(group, word).check();
  await shoot("controller");
  await page.click("#make");
  await until("controller", () => document.getElementById("code"));
  found.controller = await page.evaluate(() => [...document.querySelectorAll(".code select option")].map((e) => e.value));
  await page.selectOption(".code select", "rrr_controller.h");
  found.modes = (await page.textContent("#code")).match(/RRR_CONTROLLER_MODE_\w+/g);
  await choice(0, "controller").uncheck();
  await page.click("#make");
  await until("package", () => document.getElementById("code"));
  found.header = (await page.textContent("#code")).slice(0, 200);
  await shoot("code");
  const [download] = await Promise.all([page.waitForEvent("download"), page.click("text=Download all as ZIP")]);
  await download.saveAs(`${folder}/rrr.zip`);
  await page.click("text=Copy >> nth=1");
  await page.waitForTimeout(200);
  found.copied = await status();

  // the page opens again without a network, on what it kept
  const offline = await context.newPage();
  await offline.goto(address);
  for (let k = 0; k < 100 && !found.offline; k++) {
    await offline.waitForTimeout(100);
    found.offline = await offline.evaluate(() => document.body.dataset.arm || "");
  }
  await offline.close();
  await context.setOffline(false);

  // a stranger's link with markup in its texts
  const hostile = found.text.replace("name: my_arm", 'name: my_arm\ndescription: "<img src=x onerror=document.body.dataset.broken=1>"');
  await page.fill("#text", hostile).catch(async () => { await page.click("summary"); await page.fill("#text", hostile); });
  await until("hostile", () => document.getElementById("about").textContent.includes("onerror"));
  found.broken = (await page.evaluate(() => document.body.dataset.broken)) || "";
  await page.goto("about:blank");
  await page.goto(found.link);
  await until("own arm by its link", () => document.body.dataset.arm === "my_arm" && document.getElementById("text").value.includes("0.12345"));
  found.again = await page.inputValue("#text");
  await page.goto("about:blank");
  await page.goto(`${address}#file=AAAA`);
  found.unreadable = await until("unreadable link", () => (document.querySelector("#faults li") || {}).textContent);
} catch (error) {
  found.errors.push(String(error));
  await shoot("failed").catch(() => {});
}
await browser.close();
writeFileSync(`${folder}/found.json`, JSON.stringify(found, null, 1));
