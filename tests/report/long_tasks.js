// How fluid a report of a million points is: opens it, zooms and moves its section, and reads Chromium's own trace for
// the longest task of the page's main thread. Prints figures; decides nothing.
//   tests/report/run.sh PROGRAM FOLDER long_tasks
import { open_browser, open_report } from "./browser.js";

const name = process.argv[2] ?? "pendulum_table3";
const session = await open_browser();
const page = await open_report(session.browser, name);
const client = await page.context().newCDPSession(page);

/** Runs `act` under the tracer; durations of the main thread's tasks [ms], longest first: by the clock and the processor. */
async function traced(act) {
  const events = [];
  const take = ({ value }) => events.push(...value);
  client.on("Tracing.dataCollected", take);
  await client.send("Tracing.start", {
    transferMode: "ReportEvents",
    traceConfig: { includedCategories: ["toplevel", "disabled-by-default-devtools.timeline", "devtools.timeline", "__metadata"] },
  });
  const took = await act();
  const complete = new Promise((resolve) => client.once("Tracing.tracingComplete", resolve));
  await client.send("Tracing.end");
  await complete;
  client.off("Tracing.dataCollected", take);
  // The main thread of the page is the one that ran its scripts.
  const mains = new Set(events.filter((event) => event.name === "thread_name" && event.args.name === "CrRendererMain")
    .map((event) => `${event.pid}:${event.tid}`));
  const tasks = events.filter((event) => event.ph === "X" && mains.has(`${event.pid}:${event.tid}`) &&
    /RunTask|ThreadControllerImpl::RunTask/.test(event.name)).map((event) => ({ wall: event.dur / 1000, processor: (event.tdur ?? NaN) / 1000 }));
  return { tasks: tasks.sort((a, b) => b.wall - a.wall), took };
}

const say = (what, { tasks, took }) => console.log(
  `${what.padEnd(28)} longest task ${tasks[0].wall.toFixed(0)} ms (processor ` +
  `${Math.max(...tasks.map((task) => task.processor)).toFixed(0)} ms at most), ` +
  `over 50 ms: ${tasks.filter((task) => task.wall > 50).length}, ` +
  `over 200 ms: ${tasks.filter((task) => task.wall > 200).length}${took ? `, all points after ${took.toFixed(0)} ms` : ""}`);

const painted = () => page.evaluate(async () => {
  const figure = document.querySelector("#plot-section");
  const from = performance.now();
  figure.scrollIntoView({ block: "center" });
  while (figure.dataset.points === undefined || figure.dataset.points === "loading") await new Promise(requestAnimationFrame);
  for (let i = 0; i < 20; ++i) await new Promise(requestAnimationFrame);
  return performance.now() - from;
});
say("opening the page", await traced(async () => { await page.reload(); }));
say("points arrive and are painted", await traced(painted));

const figure = page.locator("#plot-section");
await figure.locator(".plot").focus();
const box = await figure.locator(".u-over").boundingBox();
say("zoom by keys, 6 steps in", await traced(async () => {
  for (let i = 0; i < 6; ++i) {
    await page.keyboard.press("+");
    await page.waitForTimeout(120);
  }
}));
say("move, 12 steps", await traced(async () => {
  for (const key of ["ArrowLeft", "ArrowUp", "ArrowRight", "ArrowDown"]) {
    for (let i = 0; i < 3; ++i) {
      await page.keyboard.press(key);
      await page.waitForTimeout(60);
    }
  }
}));
say("whole again", await traced(async () => {
  await page.keyboard.press("0");
  await page.waitForTimeout(500);
}));
say("wheel, 10 steps at once", await traced(async () => {
  await page.mouse.move(box.x + 0.4 * box.width, box.y + 0.5 * box.height);
  await page.keyboard.down("Control");
  for (let i = 0; i < 10; ++i) await page.mouse.wheel(0, i < 5 ? -120 : 120);
  await page.keyboard.up("Control");
  await page.waitForTimeout(600);
}));
say("drag of a box, and back", await traced(async () => {
  await page.mouse.move(box.x + 0.3 * box.width, box.y + 0.3 * box.height);
  await page.mouse.down();
  await page.mouse.move(box.x + 0.6 * box.width, box.y + 0.7 * box.height, { steps: 12 });
  await page.mouse.up();
  await page.waitForTimeout(300);
  await page.mouse.dblclick(box.x + 10, box.y + 10);
  await page.waitForTimeout(500);
}));
await session.close();
