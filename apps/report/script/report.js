// Puts live charts beside the still pictures of the page and lets its tables sort.
import { Chart } from "./chart.js";
import { make_sortable } from "./sortable_table.js";

for (const table of document.querySelectorAll("table.sortable")) make_sortable(table);

/** Figures whose chart is to be made, in the order they came near. */
const waiting = [];

/** Makes one chart per task, so that several that come into view at once do not hold the page up. */
function make_next() {
  const figure = waiting.shift();
  if (figure === undefined) return;
  setTimeout(make_next, 0);
  figure.classList.add("failed"); // until it is drawn
  const spec = JSON.parse(document.getElementById(`data-${figure.dataset.chart}`).textContent);
  new Chart(figure, spec);
  figure.classList.remove("failed");
}

// A chart is made when it comes near the view: a page of thirty opens at once.
const near = new IntersectionObserver((entries) => {
  const idle = waiting.length === 0;
  for (const { isIntersecting, target } of entries) {
    if (!isIntersecting) continue;
    near.unobserve(target);
    waiting.push(target);
  }
  if (idle) setTimeout(make_next, 0);
}, { rootMargin: "400px" });
for (const figure of document.querySelectorAll("figure[data-chart]")) near.observe(figure);
