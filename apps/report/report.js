// Puts live charts beside the still pictures of the page and lets its tables sort.
import { Chart } from "./chart.js";
import { make_sortable } from "./sortable_table.js";

for (const table of document.querySelectorAll("table.sortable")) make_sortable(table);

// A chart is made when it comes near the view: a page of thirty opens at once.
const near = new IntersectionObserver((entries) => {
  for (const { isIntersecting, target } of entries) {
    if (!isIntersecting) continue;
    near.unobserve(target);
    const spec = JSON.parse(document.getElementById(`data-${target.dataset.chart}`).textContent);
    new Chart(target, spec);
  }
}, { rootMargin: "400px" });
for (const figure of document.querySelectorAll("figure[data-chart]")) {
  figure.hidden = false; // one that has no still picture
  near.observe(figure);
}
