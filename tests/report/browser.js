// A headless Chromium of the machine, and pages of it that note everything that goes wrong.
import { spawn } from "node:child_process";
import { existsSync, mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { setTimeout as sleep } from "node:timers/promises";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const quiet = [
  "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
  "--disable-component-update", "--disable-sync",
];

/** Starts a browser with a new profile. Close it with `close()`. */
export async function open_browser() {
  const profile = mkdtempSync(join(tmpdir(), "orbid-report-"));
  const process_ = spawn(process.env.ORBID_CHROMIUM, [
    ...quiet, "--remote-debugging-port=0", `--user-data-dir=${profile}`, "about:blank",
  ], { stdio: ["ignore", "ignore", "pipe"] });
  // From the start: a browser that crashes during a test has ended before anybody closes it.
  const ended = new Promise((resolve) => process_.on("exit", resolve));
  const address = await new Promise((resolve, reject) => {
    let said = "";
    process_.stderr.on("data", (data) => {
      said += data;
      const found = said.match(/DevTools listening on (ws:\S+)/);
      if (found) resolve(found[1]);
    });
    ended.then((code) => reject(new Error(`Chromium ended with ${code}: ${said}`)));
  });
  const browser = await chromium.connectOverCDP(address);
  return {
    browser,
    async close() {
      await browser.close();
      process_.kill();
      await ended;
      // Chromium's children may still write for a moment. Node's own repetitions do not see what they added.
      for (let attempt = 1; existsSync(profile); ++attempt) {
        try {
          rmSync(profile, { recursive: true, force: true });
        } catch (error) {
          if (attempt === 50) throw error;
          await sleep(200);
        }
      }
    },
  };
}

export const report_path = (name) => join(process.env.ORBID_REPORTS, name, "report.html");

/**
 * Opens a report in a context of its own.
 * @param options  of the context: { javaScriptEnabled, colorScheme, viewport }.
 * @returns the page; `page.wrong` lists messages of the console, exceptions and requests other than the page itself.
 */
export async function open_report(browser, name, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1200, height: 900 }, ...options });
  const page = await context.newPage();
  const address = pathToFileURL(report_path(name)).href;
  page.wrong = [];
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) page.wrong.push(`${message.type()}: ${message.text()}`);
  });
  page.on("pageerror", (error) => page.wrong.push(`exception: ${error.stack}`));
  page.on("request", (request) => {
    const url = request.url();
    if (url !== address && !url.startsWith("data:")) page.wrong.push(`request: ${url}`);
  });
  await page.goto(address);
  return page;
}

/** Scrolls through the whole page, so that every chart has come into view, and waits for their points. */
export async function see_all(page) {
  await page.evaluate(async () => {
    for (const figure of document.querySelectorAll("figure[data-chart]")) {
      figure.scrollIntoView({ block: "center" });
      const deadline = performance.now() + 20000;
      while (figure.dataset.drawn === undefined || figure.dataset.points === "loading" ||
             figure.getAttribute("aria-busy") === "true") {
        if (performance.now() > deadline) throw new Error(`${figure.id} is not drawn`);
        await new Promise((resolve) => setTimeout(resolve, 20));
      }
    }
    scrollTo(0, 0);
  });
}
