// The playground by clicks, from an own table to the downloaded C: node playground.mjs ADDRESS CHROMIUM PLAYWRIGHT; prints
// seconds as JSON. playground.py runs it.
import { pathToFileURL } from "node:url";
const [address, chromium, playwright] = process.argv.slice(2);
const { chromium: browserType } = await import(pathToFileURL(`${playwright}/index.mjs`).href);
const browser = await browserType.launch({ executablePath: chromium, args: ["--no-sandbox", "--disable-gpu", "--no-first-run"] });
const seconds = { arms: {} };
let context = null, page = null;

// the policy of the page forbids to evaluate text in it again and again, so values are polled from outside
async function until(question, argument, limit = 600000) {
  for (const begin = Date.now(); Date.now() - begin < limit; ) {
    if (await page.evaluate(question, argument)) return;
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
  throw new Error(`after ${limit / 1000} s: ${await page.evaluate(() => document.getElementById("status").textContent)}`);
}

// what is typed into the table of six joints to start from (deg, m), whose wrist is spherical
const TABLES = {
  spherical: [],
  general: [["alpha", 2, "-10"], ["alpha", 3, "80"], ["a", 4, "0.05"], ["alpha", 4, "70"], ["a", 5, "0.08"], ["d", 5, "0.06"]],
};

/* Seconds until the picture is drawn, by the clock of the page. */
async function visit() {
  await page.goto(address);
  await until(() => document.body.dataset.shown);
  return Number(await page.evaluate(() => document.body.dataset.shown)) / 1000;
}
async function download(cells) {
  await page.selectOption("#robot", "my_arm");
  await until(() => document.body.dataset.arm === "my_arm");
  for (const [column, joint, text] of cells) {
    const cell = page.getByLabel(`${column} of joint ${joint}`, { exact: true });
    await cell.fill(text);
    await cell.press("Tab");
  }
  await page.click("#tab-code");
  await page.click("#make");
  await until(() => document.getElementById("code"));
  const [file] = await Promise.all([page.waitForEvent("download"), page.click("text=Download all as ZIP")]);
  await file.path();
}
async function timed(work) {
  const begin = Date.now();
  await work();
  return (Date.now() - begin) / 1000;
}

async function fresh() {  // a browser that has not seen the page
  if (context) await context.close();
  context = await browser.newContext({ viewport: { width: 1280, height: 900 }, acceptDownloads: true });
  page = await context.newPage();
}

const VISITS = 5, pictures = [[], []];
for (let k = 0; k < VISITS; k++) {
  await fresh();
  for (const list of pictures) list.push(await visit());
}
seconds.picture = pictures.map((list) => list.sort((a, b) => a - b)[(VISITS - 1) / 2]);

for (const [name, cells] of Object.entries(TABLES)) {
  await fresh();
  const cold = await timed(async () => {
    const picture = await visit();
    if (!seconds.compiler) seconds.compiler = await timed(() => until(() => document.body.dataset.compiler)) + picture;
    await download(cells);
  });
  await page.selectOption("#robot", "ur5");
  await until(() => document.body.dataset.arm === "ur5");
  // another number, so that nothing of the first answer is of use
  const warm = await timed(() => download([...cells, ["d", 6, "0.12345"]]));
  seconds.arms[name] = [cold, warm];
}
await browser.close();
console.log(JSON.stringify(seconds));
