// The table of cells: a click on a head sorts the rows of each group, words filter them, a name opens its image.

function sortable(table) {
  for (const head of table.querySelectorAll("th[data-column]")) {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const next = { ascending: "descending", descending: null }[head.getAttribute("aria-sort")];
      for (const other of table.querySelectorAll("th[aria-sort]")) other.removeAttribute("aria-sort");
      const direction = next === undefined ? "ascending" : next;
      if (direction) head.setAttribute("aria-sort", direction);
      sortRows(table, Number(head.dataset.column), direction);
    });
  }
  for (const row of rowsOf(table)) row.dataset.order = [...row.parentNode.children].indexOf(row);
}

// Without a direction, rows are in the order of the study; rows without a value come last in both directions.
function sortRows(table, column, direction) {
  const sign = direction === "descending" ? -1 : 1;
  const compare = (a, b) => {
    const order = a.dataset.order - b.dataset.order;
    if (!direction) return order;
    const [x, y] = [a, b].map((row) => JSON.parse(row.dataset.values)[column] ?? null);
    if (x === null || y === null) return (x === null) - (y === null) || order;
    if (typeof x !== typeof y) return typeof x === "number" ? -1 : 1;
    return sign * (typeof x === "number" ? x - y : x.localeCompare(y, undefined, { numeric: true })) || order;
  };
  for (const body of table.tBodies) {
    body.append(...[...body.querySelectorAll("tr[data-values]")].sort(compare));
  }
}

function rowsOf(table) {
  return [...table.querySelectorAll("tr[data-values]")];
}

// A row is shown if it, or the title of its group, contains every word.
function filterable(table, input, count) {
  const rows = rowsOf(table);
  const texts = new Map(rows.map((row) => {
    const title = row.parentNode.querySelector("th.group").textContent;
    return [row, `${title} ${row.textContent} ${row.dataset.values}`.toLowerCase()];
  }));
  const filter = () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    let n = 0;
    for (const row of rows) {
      row.hidden = !words.every((word) => texts.get(row).includes(word));
      n += !row.hidden;
    }
    for (const body of table.tBodies) body.hidden = !body.querySelector("tr[data-values]:not([hidden])");
    count.textContent = words.length ? `${n} of ${rows.length} cells` : `${rows.length} cells`;
  };
  input.addEventListener("input", filter);
  document.getElementById("filter-label").hidden = false;
  filter();
}

const cellTable = document.getElementById("cells");
sortable(cellTable);
filterable(cellTable, document.getElementById("filter"), document.getElementById("filter-count"));
document.addEventListener("click", (event) => {
  const link = event.target.closest?.("a.opens");
  if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
  event.preventDefault();
  openCell(link.dataset.key);
});
