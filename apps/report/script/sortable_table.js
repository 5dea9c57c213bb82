// Tables whose columns sort by their headers, with the pointer and with the keyboard.

/** What a cell sorts by: its data-value, else its text; numbers before texts, nothing last. */
function sort_key(cell) {
  const text = (cell?.dataset.value ?? cell?.textContent ?? "").trim();
  if (text === "") return { rank: 2, value: "" };
  const number = Number(text);
  return Number.isNaN(number) ? { rank: 1, value: text } : { rank: 0, value: number };
}

function compare(a, b) {
  if (a.rank !== b.rank) return a.rank - b.rank;
  if (a.rank === 0) return a.value - b.value;
  return a.value.localeCompare(b.value, undefined, { numeric: true });
}

function sort(table, header) {
  const column = header.cellIndex;
  const falling = header.getAttribute("aria-sort") === "ascending";
  const body = table.tBodies[0];
  const rows = Array.from(body.rows, (row) => ({ row, key: sort_key(row.cells[column]) }));
  rows.sort((a, b) => {
    // Nothing stays last either way.
    if (a.key.rank === 2 || b.key.rank === 2) return a.key.rank - b.key.rank;
    return falling ? compare(b.key, a.key) : compare(a.key, b.key);
  });
  for (const other of table.tHead.querySelectorAll("[aria-sort]")) other.removeAttribute("aria-sort");
  header.setAttribute("aria-sort", falling ? "descending" : "ascending");
  body.append(...rows.map(({ row }) => row));
}

/** Gives every header of a table marked `sortable` a button. */
export function make_sortable(table) {
  for (const header of table.tHead.rows[table.tHead.rows.length - 1].cells) {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...header.childNodes);
    header.append(button);
    button.addEventListener("click", () => sort(table, header));
  }
}
