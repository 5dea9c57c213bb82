// What a reader of report.html relies on, looked at in a browser.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { after, before, test } from "node:test";
import { open_browser, open_report, report_path, see_all } from "./browser.js";

const reports = ["pendulum_table3", "hare_lynx", "pendulum_cascade", "henon", "hostile"];
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
let session;
before(async () => { session = await open_browser(); });
after(async () => { await session.close(); });

/** Pixels of a chart's canvas that are coloured: axes, grid and numbers are grey. */
const coloured = (page, name) => page.evaluate((chart) => {
  const canvas = document.querySelector(`#plot-${chart} canvas`);
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    const [red, green, blue] = data.subarray(i, i + 3);
    if (data[i + 3] > 100 && Math.max(red, green, blue) - Math.min(red, green, blue) > 60) ++count;
  }
  return count;
}, name);

/** What the section of table 3 shows: its canvas as a data URL. */
const section_picture = (page) => page.evaluate(() => document.querySelector("#plot-section canvas").toDataURL());

/** Waits until the section shows `picture`; fails after half a minute. */
const shows_again = (page, picture) => page.waitForFunction(
  (expected) => document.querySelector("#plot-section canvas").toDataURL() === expected, picture, { polling: 50 });

/** Waits until the section shows something else than `picture` and all points are counted, and returns it. */
async function next_picture(page, picture) {
  await page.waitForFunction((old) => {
    const figure = document.querySelector("#plot-section");
    return figure.getAttribute("aria-busy") === "false" && figure.querySelector("canvas").toDataURL() !== old;
  }, picture, { polling: 50 });
  return section_picture(page);
}

for (const name of reports) {
  test(`${name}: opens without errors and requests, every chart is drawn`, async () => {
    const page = await open_report(session.browser, name);
    await see_all(page);
    const charts = await page.$$eval("figure[data-chart]", (all) => all.map((figure) => figure.dataset.chart));
    assert.ok(charts.length > 0, "the report has no chart");
    for (const chart of charts) assert.ok((await coloured(page, chart)) > 20, `${chart} is empty`);
    assert.deepEqual(page.wrong, []);
    await page.context().close();
  });

  test(`${name}: every view of every chart can be chosen`, async () => {
    const page = await open_report(session.browser, name);
    await see_all(page);
    for (const select of await page.$$("figure select")) {
      const count = await select.$$eval("option", (options) => options.length);
      for (let i = 0; i < Math.min(count, 12); ++i) await select.selectOption({ index: i });
    }
    assert.deepEqual(page.wrong, []);
    await page.context().close();
  });

  for (const colorScheme of ["light", "dark"]) {
    test(`${name}: accessible in ${colorScheme} mode`, async () => {
      const page = await open_report(session.browser, name, { colorScheme });
      await see_all(page);
      await page.evaluate(axe);
      const result = await page.evaluate(() => axe.run(document, {
        runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"],
      }));
      const said = result.violations.map(({ id, help, nodes }) => `${id}: ${help}: ${nodes.slice(0, 3).map((node) => node.html.slice(0, 200)).join(" | ")}`);
      assert.equal(said.join("\n"), "");
      await page.context().close();
    });
  }
}

test("tables sort by click and by keyboard, both ways", async () => {
  const page = await open_report(session.browser, "pendulum_table3");
  const table = page.locator("table.sortable", { has: page.locator("caption", { hasText: "Unstable periodic orbits" }) });
  const column = (index) => table.locator(`tbody tr > :nth-child(${index + 1})`).evaluateAll((cells) =>
    cells.map((cell) => cell.dataset.value ?? cell.textContent).filter((text) => text !== "").map(Number));
  const headers = await table.locator("thead th").allTextContents();
  const multiplier = headers.findIndex((text) => text.startsWith("largest"));
  assert.ok(multiplier > 0);
  const button = table.locator("thead button").nth(multiplier);
  await button.click();
  const rising = await column(multiplier);
  assert.ok(rising.length > 50);
  assert.deepEqual(rising, [...rising].sort((a, b) => a - b));
  assert.equal(await table.locator("thead th").nth(multiplier).getAttribute("aria-sort"), "ascending");
  await button.focus();
  await page.keyboard.press("Enter");
  const falling = await column(multiplier);
  assert.deepEqual(falling, [...falling].sort((a, b) => b - a));
  assert.equal(await table.locator("thead th").nth(multiplier).getAttribute("aria-sort"), "descending");
  await table.locator("thead button").nth(1).focus();
  await page.keyboard.press("Space");
  const periods = await column(1);
  assert.deepEqual(periods, [...periods].sort((a, b) => a - b));
  assert.equal(await table.locator("[aria-sort]").count(), 1);
  await page.context().close();
});

test("all points arrive, and zoom by keys, buttons and drag shows other pixels", async () => {
  const page = await open_report(session.browser, "pendulum_table3");
  await see_all(page);
  const figure = page.locator("#plot-section");
  assert.equal(await figure.getAttribute("data-points"), "1048576");
  const whole = await section_picture(page);
  await figure.locator(".plot").focus();
  await page.keyboard.press("+");
  const near = await next_picture(page, whole);
  await page.keyboard.press("ArrowRight");
  await next_picture(page, near);
  await page.keyboard.press("0");
  await shows_again(page, whole);
  await figure.getByRole("button", { name: /^Zoom in/ }).click();
  await shows_again(page, near);
  await figure.getByRole("button", { name: /^Show all/ }).click();
  await shows_again(page, whole);
  const box = await figure.locator(".u-over").boundingBox();
  await page.mouse.move(box.x + 0.3 * box.width, box.y + 0.3 * box.height);
  await page.mouse.down();
  await page.mouse.move(box.x + 0.5 * box.width, box.y + 0.6 * box.height, { steps: 5 });
  await page.mouse.up();
  await page.mouse.move(0, 0);
  await next_picture(page, whole);
  assert.deepEqual(page.wrong, []);
  await page.context().close();
});

test("the cursor names the cycle under it, and the legend switches a period off", async () => {
  const page = await open_report(session.browser, "pendulum_table3");
  await see_all(page);
  const figure = page.locator("#plot-section");
  await figure.scrollIntoViewIfNeeded();
  const spec = JSON.parse(await page.locator("#data-section").textContent());
  const view = spec.views[0];
  const layer = view.layers.find((one) => one.name === "period 1");
  const box = await figure.locator(".u-over").boundingBox();
  const x = box.x + ((layer.x[0] - view.x.lower) / (view.x.upper - view.x.lower)) * box.width;
  const y = box.y + (1 - (layer.y[0] - view.y.lower) / (view.y.upper - view.y.lower)) * box.height;
  await page.mouse.move(x, y);
  await figure.locator("output", { hasText: new RegExp(`^${layer.labels[0].replace(/[|.]/g, "\\$&")}`) }).waitFor();
  await page.mouse.move(0, 0);
  const before_ = await section_picture(page);
  const button = figure.getByRole("button", { name: "period 1" });
  await button.click();
  await next_picture(page, before_);
  assert.equal(await button.getAttribute("aria-pressed"), "false");
  await page.context().close();
});

for (const name of reports) {
  test(`${name}: reads without scripts`, async () => {
    const page = await open_report(session.browser, name, { javaScriptEnabled: false });
    const html = readFileSync(report_path(name), "utf8");
    const figures = (html.match(/<figure (?![^>]* hidden)/g) ?? []).length;
    const pictures = page.locator("figure .still > svg");
    assert.equal(await pictures.count(), figures, "a figure has no still picture");
    for (let i = 0; i < figures; ++i) {
      const box = await pictures.nth(i).boundingBox();
      assert.ok(box.width > 300 && box.height > 60, "a still picture has no size");
    }
    assert.ok((await page.locator("main table tbody tr").count()) > 3);
    assert.ok(await page.getByRole("heading", { name: "In short" }).isVisible());
    assert.equal(await page.locator("figure canvas").count(), 0);
    assert.deepEqual(page.wrong, []);
    await page.context().close();
  });
}

test("dark mode changes page and charts", async () => {
  const colours = [];
  for (const colorScheme of ["light", "dark"]) {
    const page = await open_report(session.browser, "pendulum_table3", { colorScheme });
    await see_all(page);
    colours.push(await page.evaluate(() => getComputedStyle(document.documentElement).backgroundColor),
      await section_picture(page));
    await page.context().close();
  }
  assert.notEqual(colours[0], colours[2]);
  assert.notEqual(colours[1], colours[3]);
});

test("prints: still pictures instead of canvases, more than one page", async () => {
  const page = await open_report(session.browser, "pendulum_table3");
  await see_all(page);
  await page.emulateMedia({ media: "print" });
  assert.ok(await page.locator("#plot-section .still > svg").isVisible());
  assert.ok(!(await page.locator("#plot-section canvas").isVisible()));
  const pdf = await page.pdf({ format: "A4" });
  assert.equal(pdf.subarray(0, 5).toString("latin1"), "%PDF-");
  const pages = (pdf.toString("latin1").match(/\/Type\s*\/Page\b/g) ?? []).length;
  assert.ok(pages >= 3 && pages < 40, `${pages} pages`);
  await page.context().close();
});

test("fits a telephone: nothing but tables scrolls sideways", async () => {
  for (const name of reports) {
    const page = await open_report(session.browser, name, { viewport: { width: 390, height: 844 } });
    await see_all(page);
    const [wide, shown] = await page.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);
    assert.ok(wide <= shown, `${name}: ${wide} px on a screen of ${shown}`);
    await page.context().close();
  }
});

test("names of a job are text, whatever they hold", async () => {
  const page = await open_report(session.browser, "hostile");
  await see_all(page);
  const title = '</script><b>bold</b> & "quoted" <img src=x onerror=alert(1)>';
  assert.equal(await page.title(), title);
  assert.equal(await page.locator("h1").textContent(), title);
  assert.equal(await page.locator("b, main img").count(), 0);
  assert.deepEqual(page.wrong, []);
  await page.context().close();
});

test("table 3 takes at most 2 MB besides the points of its section", () => {
  const html = readFileSync(report_path("pendulum_table3"), "utf8");
  const points = [...html.matchAll(/<script type="text\/plain" data-points=.*?<\/script>/gs)]
    .reduce((sum, [text]) => sum + text.length, 0);
  console.log(`page ${html.length} bytes, of which ${points} are points`);
  assert.ok(points > 0);
  assert.ok(html.length - points <= 2 * 1024 * 1024);
});

test("the licence of the plotting library stands in the page", async () => {
  const page = await open_report(session.browser, "henon");
  const text = await page.locator("footer details pre").textContent();
  assert.match(text, /uplot 1\.\d+\.\d+ \(MIT\)/);
  assert.match(text, /Permission is hereby granted/);
  await page.context().close();
});
